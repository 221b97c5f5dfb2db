"""Measurements of a study as text: numbers, tables, and the verdicts on its claims."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
import pandas as pd

from causal_openlock.analysis.table import markdown
from causal_openlock.errors import EvidenceError
from causal_openlock.evidence.derived import DERIVED
from causal_openlock.evidence.published_units import published_units
from causal_openlock.evidence.study import (
    CORRELATION,
    NO_SHARES,
    OF_ALL,
    PUBLISHED,
    Claim,
    Contrast,
    Measure,
    Selection,
    Study,
    Table,
)
from causal_openlock.evidence.study_files import RUN, older_results, read_run, read_units
from causal_openlock.evidence.units import KEYS
from causal_openlock.evidence.verdicts import (
    EQUIVALENCE,
    Ends,
    Estimate,
    Verdict,
    compared,
    of_side,
    together,
    verdict,
)
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.wording import joined, nearest

ENDINGS = ("interval", "units", "sd", "verdict", "without_sign")
OF_THE_RUN = ("core_hours", "machine", "date")


@dataclass(frozen=True)
class Evidence:
    """Measurements of a study, and the verdicts on its claims.

    Attributes:
        study: The study.
    """

    study: Study

    @property
    def was_run(self) -> bool:
        """Whether something was measured."""
        return (self.study.folder / RUN).exists()

    @cached_property
    def own_units(self) -> pd.DataFrame:
        """The units of the study."""
        return read_units(self.study)

    @cached_property
    def units(self) -> pd.DataFrame:
        """The units of the study, and what is published."""
        both = pd.concat([self.own_units, published_units()], ignore_index=True)
        return both.astype(dict.fromkeys(KEYS, "category"))  # rows are selected by them

    @cached_property
    def derived(self) -> pd.DataFrame:
        """Table computed from all units together, by learner.

        Raises:
            EvidenceError: If the study declares no such table.
        """
        name = self.study.file.derived
        if name is None:
            raise EvidenceError(f"{self.study.name} derives no table")
        return DERIVED[name](self.study, self.own_units).set_index("learner")

    @cached_property
    def run(self) -> dict[str, Any]:
        """Facts about the run, from ``run.json``."""
        return read_run(self.study)

    @property
    def played_with(self) -> str:
        """A sentence that says which results were measured, if results are others now."""
        older = older_results(self.run) if self.was_run else ""
        return f"Played with results of {older}." if older else ""

    @property
    def stands(self) -> bool:
        """Whether what was run is what is declared now, or is published."""
        return bool(self.study.file.published) or self.run["declared"] == self.study.declared

    @property
    def complete(self) -> bool:
        """Whether all was run that the study asks for now."""
        networks = self.study.file.networks
        seeds = networks.seeds if networks else []
        kinds = [*networks.files, *networks.parameters] if networks else []
        units = self.own_units[["learner", "unit"]].itertuples(index=False, name=None)
        return (
            self.stands
            and bool(self.run["complete"])
            and {(kind, seed) for kind in kinds for seed in seeds} <= set(units)
        )

    @property
    def _same_networks(self) -> Mapping[str, str]:
        networks = self.study.file.networks
        return dict.fromkeys(networks.parameters, next(iter(networks.files))) if networks else {}

    def late(self, name: str) -> Literal["", "stated", "changed"]:
        """Whether the contrasts of a claim were stated, or changed, after the run."""
        at_the_run = self.run["claims"].get(name) if self.was_run else self.study.margin(name)
        if at_the_run == self.study.margin(name):
            return ""
        return "changed" if at_the_run else "stated"

    @cached_property
    def estimates(self) -> Mapping[tuple[str, str], tuple[Estimate, Verdict] | str]:
        """Difference and verdict by claim and contrast, or why there is none."""
        found: dict[tuple[str, str], tuple[Estimate, Verdict] | str] = {}
        for name, claim in self.study.file.claims.items():
            for part, contrast in claim.contrasts.items():
                try:
                    one = compared(self.units, contrast, self.study.unit, self._same_networks)
                    said = verdict(one, contrast.expected, contrast.smallest)
                    found[name, part] = one, said
                except EvidenceError as error:
                    found[name, part] = str(error) if self.was_run else "not run yet"
        return found

    def verdict(self, name: str) -> Verdict:
        """The verdict on a claim."""
        self._claim(name)
        return together(self.verdicts_of(name))

    def verdicts_of(self, name: str) -> list[Verdict]:
        """The verdict on each contrast of a claim."""
        return [
            "undecided" if isinstance(found, str) else found[1]
            for (claim, _), found in self.estimates.items()
            if claim == name
        ]

    @cached_property
    def claims(self) -> pd.DataFrame:
        """A row for each contrast: what is expected, the difference, its interval, the verdict."""
        rows = []
        for (name, part), found in self.estimates.items():
            claim = self.study.file.claims[name]
            contrast = claim.contrasts[part]
            row: dict[str, Any] = {
                "claim": name,
                "contrast": part,
                "measure": contrast.measure,
                "expected": contrast.expected,
                "smallest": contrast.smallest,
            }
            if not isinstance(found, str):
                one, said = found
                low, high = one.interval
                row |= {"effect": one.value, "ci_low": low, "ci_high": high}
                row |= {"n": one.n, "verdict": said}
            rows.append({"verdict": "undecided", "n": "0", **row, "of_claim": self.verdict(name)})
        columns = ["claim", "contrast", "measure", "expected", "smallest", "effect", "ci_low"]
        columns += ["ci_high", "n", "verdict", "of_claim"]
        return pd.DataFrame(rows, columns=columns)

    # -- single numbers -----------------------------------------------------------------------

    def text(self, title: str) -> str:
        """The number that a link's title asks for.

        Raises:
            EvidenceError: If the title is not understood, or what it asks for has not been run.
        """
        words = title.split()
        kind, rest = (words[0], words[1:]) if words else ("", [])
        if kind in OF_THE_RUN and not rest:
            return str(self.run[kind])
        if kind == "derived" and len(rest) > 1:
            return self._derived_number(rest)
        ending = rest.pop() if rest and rest[-1] in ENDINGS else ""
        if kind == "claim" and rest:
            return self._of_claim(rest, ending)
        if kind not in get_args(Measure) or not rest:
            raise EvidenceError(
                f"{title!r} does not begin with a measure and a learner; "
                f"{nearest(kind, get_args(Measure))}"
            )
        if ending in ("verdict", "without_sign"):
            raise EvidenceError(f"{title!r} asks for the {ending} of what is not a claim")
        chosen = Selection.parse(rest)
        found, of = of_side(self.units, chosen, kind)
        return _written(found, kind, ending, of)

    def _derived_number(self, words: Sequence[str]) -> str:
        *learner, column = words
        table = self.derived
        name = " ".join(learner)
        if name not in table.index or column not in table:
            known = nearest(name, table.index) if name not in table.index else ", ".join(table)
            raise EvidenceError(f"{self.study.name} derives no {column!r} of {name!r}; {known}")
        return _plain(table.loc[name, column])

    def _claim(self, name: str) -> Claim:
        claim = self.study.file.claims.get(name)
        if claim is None:
            known = nearest(name, self.study.file.claims)
            raise EvidenceError(f"{self.study.name} has no claim {name!r}; {known}")
        return claim

    def _of_claim(self, words: Sequence[str], ending: str) -> str:
        name, *part = words
        claim = self._claim(name)
        if ending == "verdict" and (not part or not self.was_run):
            return self.verdict(name)
        chosen = " ".join(part) or next(iter(claim.contrasts))
        if chosen not in claim.contrasts:
            known = nearest(chosen, claim.contrasts)
            raise EvidenceError(f"the claim {name} has no contrast {chosen!r}; {known}")
        found = self.estimates[name, chosen]
        if isinstance(found, str):
            raise EvidenceError(f"{self.study.name}: {found}")
        if ending == "verdict":
            return found[1]
        return _written(found[0], claim.contrasts[chosen].measure, ending or "sign")

    # -- tables ---------------------------------------------------------------------------------

    def block(self, what: str) -> str:
        """The Markdown of a table.

        ``claims`` has a row for each contrast, ``verdicts [CLAIM ...]`` one for each claim; others
        are those that the study declares.
        """
        if what == "claims":
            return self._claims()
        if what.split()[0] == "verdicts":
            return self._verdicts(what.split()[1:] or list(self.study.file.claims))
        if what == OF_ALL and self.study.file.derived:
            return self._derived_table()
        if what not in self.study.file.tables:
            known = nearest(what, ["claims", "verdicts", *self.study.file.tables])
            raise EvidenceError(f"{self.study.name} has no table {what!r}; {known}")
        if what not in self._tables:
            self._tables[what] = self._table(self.study.file.tables[what])
        return self._tables[what]

    @cached_property
    def _tables(self) -> dict[str, str]:
        """Tables as they were written before: the page of the study and others show the same."""
        return {}

    def _table(self, table: Table) -> str:
        try:
            units = self.units
        except EvidenceError as error:
            return f"*{error}*\n"
        rows, sizes = [], []
        for row, label in table.rows.items():
            cells, own = [], set[int]()
            for column in table.columns:
                try:
                    chosen = Selection.parse([*row.split(), *column.split()])
                    one, of = of_side(units, chosen, table.measure)
                    cells.append(_written(one, table.measure, ""))
                except EvidenceError:
                    cells.append("–")
                    continue
                if chosen.learner not in PUBLISHED:
                    own.add(one.units[0])
                    if table.measure == "attempts" and self._solved_none(chosen):
                        cells[-1] = f"> {one.value:g}"
                    elif table.interval and np.isfinite(one.interval[0]):
                        cells[-1] += f" ({_written(one, table.measure, 'interval', of)})"
            rows.append([label, *cells])
            sizes.append(" or ".join(map(str, sorted(own))) or "–")
        of_what = f"Means over n {self.study.unit}s"
        note = "Correlations over n sets of parameters" if table.measure == CORRELATION else of_what
        note += ", 95% intervals." if table.interval else "."
        rows = [[*row, size] for row, size in zip(rows, sizes, strict=True)]
        head = ["", *table.columns, "n"]
        if table.trained_before:
            before = self.derived["before"]
            head.append("attempts of training before")
            names = [row.split()[0] for row in table.rows]
            rows = [[*row, _plain(before.get(name))] for row, name in zip(rows, names, strict=True)]
        return f"{markdown(head, rows)}\n\n{note}\n"

    def _solved_none(self, chosen: Selection) -> bool:
        """Return whether no selected unit solved a trial; all attempts then equal the limit."""
        try:
            solved, _ = of_side(self.units, chosen, "solved")
        except EvidenceError:  # published means have no shares
            return False
        return solved.value == 0

    def figure(self, name: str, folder: str) -> str:
        """The Markdown that shows the figure of a table; empty if it has none."""
        if name not in self.study.file.figures or not self.was_run:
            return ""
        what = "" if name == OF_ALL else f": {name.replace('_', ' ')}, every {self.study.unit}"
        shown = f"{self.study.file.title}{what}"
        return f"![{shown}]({folder}/{name}.svg)\n\n"

    def _derived_table(self) -> str:
        if not self.was_run:
            return "*not run yet*\n"
        table = self.derived
        rows = [
            [name, *map(_plain, row)]
            for name, row in zip(table.index, table.to_numpy(object), strict=True)
        ]
        return f"{markdown(['', *table.columns], rows)}\n"

    def _claims(self) -> str:
        rows = []
        for name, claim in self.study.file.claims.items():
            source = f" ({claim.source})" if claim.source else ""
            rows.append([f"{claim.text}{source}", self._verdict_in_words(name), ""])
            for part, contrast in claim.contrasts.items():
                found = self.estimates[name, part]
                rows.append([*_contrast_in_words(part, contrast, found)])
        return f"{markdown(['claim', 'verdict', 'by'], rows)}\n"

    def _verdict_in_words(self, name: str) -> str:
        """The verdict, and how many contrasts do not hold if some do not."""
        own = self.verdicts_of(name)
        against = own.count("does not hold")
        how = f" ({against} of {len(own)} do not hold)" if 0 < against < len(own) else ""
        late = f"; {late} after the run" if (late := self.late(name)) else ""
        return f"**{self.verdict(name)}**{how}{late}"

    def _verdicts(self, names: Sequence[str]) -> str:
        rows = []
        for name in names:
            claim = self._claim(name)
            differences = [
                f"{part}: {_difference_in_words(claim.contrasts[part], found[0])}"
                for (of, part), found in self.estimates.items()
                if of == name and not isinstance(found, str)
            ]
            by = "<br>".join(differences) or "not run yet"
            rows.append([claim.text, self._verdict_in_words(name), by])
        head = ["claim", "verdict", f"differences, 95% intervals, n {self.study.unit}s"]
        return f"{markdown(head, rows)}\n"


def _difference_in_words(contrast: Contrast, found: Estimate) -> str:
    written = _written(found, contrast.measure, "sign")
    if np.isnan(found.interval[0]):
        return f"{written} ({found.alike}), n = {found.n}"
    interval = _ends(found.interval, contrast.measure)
    if not isinstance(contrast.minus, Selection):
        written += f" from {_number(contrast.minus, contrast.measure)}"
    if contrast.expected == "same":
        interval += f"; {EQUIVALENCE:.0%}: {_ends(found.intervals[EQUIVALENCE], contrast.measure)}"
    return f"{written} ({interval}), n = {found.n}"


def _ends(ends: Ends, measure: str, least: float = -1.0) -> str:
    """An interval; of shares, as far as there can be any."""
    low, high = ends
    if measure not in NO_SHARES:
        low, high = max(low, least), min(high, 1.0)
    return f"{_number(low, measure)} to {_number(high, measure)}"


def _contrast_in_words(
    part: str, contrast: Contrast, found: tuple[Estimate, Verdict] | str
) -> tuple[str, str, str]:
    wanted = _number(contrast.smallest, contrast.measure)
    by = f" by at least {wanted}" if contrast.smallest > 0 else ""
    rule = f"the same within {wanted}" if contrast.expected == "same" else contrast.expected + by
    sides = f"{_side(contrast.of)} − {_side(contrast.minus)}"
    measure = contrast.measure.replace("_", " ")
    where = f"&nbsp;&nbsp;{part}: {measure} of {sides}, expected: {rule}"
    if isinstance(found, str):
        return where, "undecided", found
    one, said = found
    return where, said, _difference_in_words(contrast, one)


def _side(selection: Selection | float) -> str:
    """One side of a contrast in words, as :meth:`Selection.parse` reads it."""
    if not isinstance(selection, Selection):
        return f"{selection:g}"
    words = [f"`{selection.learner}`"]
    of = selection.condition or []
    words += [joined([of] if isinstance(of, str) else of)] if of else []
    words += [selection.phase] if selection.phase else []
    words += [
        f"{name} {at}"
        for name in ("trial", "part", "parameter")
        if (at := getattr(selection, name))
    ]
    return " ".join(words)


def _written(found: Estimate, measure: str, ending: str, of: FloatArray | None = None) -> str:
    """An estimate as it stands on a page: a mean of units, or without these a difference."""
    if ending == "units":
        return found.n
    if ending == "interval":
        if np.isnan(found.interval[0]):
            return found.alike
        return _ends(found.interval, measure, -1.0 if of is None else 0.0)
    if ending == "sd" and of is not None:
        return _number(float(np.std(of, ddof=1)) if len(of) > 1 else np.nan, measure)
    if ending == "without_sign":
        return _number(abs(found.value), measure)
    number = _number(found.value, measure)
    return f"+{number}" if ending == "sign" and found.value > 0 else number


def _number(value: float, measure: str) -> str:
    if not np.isfinite(value):
        raise EvidenceError("this number is not known: too few units")
    text = f"{value:.2f}".replace("-", "−")
    if measure not in NO_SHARES:
        text = re.sub(r"^(−?)0\.", r"\1.", text)
    return {"−.00": ".00", "−0.00": "0.00"}.get(text, text)


def _plain(value: Any) -> str:
    """A value of a derived table."""
    if pd.isna(value):
        return "–"
    if isinstance(value, float | np.floating):
        return f"{value:.2f}".replace("-", "−")
    if isinstance(value, int | np.integer):
        return f"{value:,}"
    return str(value)

"""Measurements of a study as text: numbers, tables, and the verdicts on its claims.

At the end are tables with a row for each learner, computed from all units of a study together.
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import CELL
from causal_openlock.analysis.statistics import LEVEL
from causal_openlock.analysis.table import markdown, printed
from causal_openlock.analysis.topics.learning_cost import costs_by_learner, shown
from causal_openlock.errors import EvidenceError
from causal_openlock.paper.likeness import Likeness, distance, likeness, points_of_model
from causal_openlock.paper.noise_ceiling import beside_null_models
from causal_openlock.paper.references import people
from causal_openlock.version import RESULTS_VERSION
from causal_openlock.wording import nearest
from evidence.published import PUBLISHED
from evidence.run import COSTS, RUN, read_run, read_units
from evidence.study import CORRELATION, DERIVED, MEASURES, NO_SHARES, Contrast, Study, Table, named
from evidence.theories import confusions
from evidence.units import selected, with_differences
from evidence.verdicts import (
    EQUIVALENCE,
    Estimate,
    Verdict,
    compared,
    mean_selected,
    together,
    verdict,
)

NOTHING = Estimate(np.nan, lambda level: (np.nan, np.nan), (0,))
"""What came out where nothing was run."""


class Decided(NamedTuple):
    """What came out of a contrast; ``why`` says why nothing did."""

    contrast: Contrast
    verdict: Verdict
    found: Estimate
    why: str = ""


@dataclass(frozen=True)
class Evidence:
    """Measurements of a study, and the verdicts on its claims."""

    study: Study

    @property
    def was_run(self) -> bool:
        """Whether it was run."""
        return (self.study.folder / RUN).exists()

    @cached_property
    def run(self) -> dict[str, Any]:
        """Facts about the run, from ``run.json``."""
        return read_run(self.study)

    @cached_property
    def units(self) -> pd.DataFrame:
        """The units of the study."""
        return with_differences(read_units(self.study))

    @cached_property
    def derived(self) -> pd.DataFrame:
        """Table computed from all units together, by learner.

        Raises:
            EvidenceError: If the study declares no such table.
        """
        name = self.study.file.derived
        if name is None:
            raise EvidenceError(f"{self.study.name} derives no table")
        return DERIVED_TABLES[name](self.study, read_units(self.study))

    @property
    def figures(self) -> dict[str, Path]:
        """Files of the figures, by table; none before it was run."""
        names = self.study.file.figures if self.was_run else ()
        return {name: self.study.folder / f"{name}.png" for name in names}

    @property
    def played_with(self) -> str:
        """A sentence that says which results were measured, if results are others now."""
        if not self.was_run:
            return ""
        version: str = self.run["versions"]["causal-openlock"]
        stamped = [stamp["results"] for stamp in self.run.get("stamps", ())]
        if RESULTS_VERSION in (version, *stamped[-1:]):
            return ""
        return f"Played with results of {'.'.join(version.split('.')[:2])}."

    @property
    def state(self) -> str:
        """Whether what was run is what is declared now."""
        if self.study.file.published:
            return f"published with version {self.study.file.published}"
        if not self.was_run:
            return "not run"
        return "run" if self.run["declared"] == self.study.declared else "changed since it was run"

    def late(self, claim: str) -> str:
        """Whether the contrasts of a claim were stated, or changed, after the run."""
        now = self.study.margin(claim)
        at_the_run = self.run["claims"].get(claim) if self.was_run else now
        return "" if at_the_run == now else "changed" if at_the_run else "stated"

    @cached_property
    def decided(self) -> dict[str, dict[str, Decided]]:
        """What came out of each contrast, by claim."""
        claims = self.study.file.claims
        return {name: {part: self._decided(contrast) for part, contrast in claim.contrasts.items()}
                for name, claim in claims.items()}  # fmt: skip

    def _decided(self, contrast: Contrast) -> Decided:
        if not self.was_run:
            return Decided(contrast, "undecided", NOTHING, "not run yet")
        units = self.units  # of a damaged file nothing is undecided
        try:
            found = compared(units, contrast, self.study.file.networks)
        except EvidenceError as error:
            return Decided(contrast, "undecided", NOTHING, str(error))
        return Decided(contrast, verdict(found, contrast.expected, contrast.smallest), found)

    def verdict(self, claim: str) -> Verdict:
        """The verdict on a claim."""
        return together(one.verdict for one in named("claim", claim, self.decided).values())

    @cached_property
    def claims(self) -> pd.DataFrame:
        """A row for each contrast: what is expected, the difference, its interval, the verdict."""
        rows = []
        for claim, contrasts in self.decided.items():
            for part, (asked, said, found, _) in contrasts.items():
                row = [claim, part, asked.measure, asked.expected, asked.smallest, found.value]
                rows.append([*row, *found.interval, found.n, said, self.verdict(claim)])
        columns = ["claim", "contrast", "measure", "expected", "smallest", "effect", "ci_low"]
        return pd.DataFrame(rows, columns=[*columns, "ci_high", "n", "verdict", "of_claim"])

    def text(self, title: str) -> str:
        """The number that a link's title asks for.

        Raises:
            EvidenceError: If the title is not understood, or what it asks for has not been run.
        """
        kind, _, rest = title.partition(" ")
        first, _, last = rest.rpartition(" ")
        if kind == DERIVED:
            if first not in self.derived.index or last not in self.derived:
                raise EvidenceError(f"{self.study.name} derives no {last!r} of {first!r}")
            return number(self.derived[last].to_dict()[first])
        asks = last if last in ("interval", "verdict") else ""
        words = first if asks else rest
        if kind == "claim":
            claim, _, part = words.partition(" ")
            contrasts = named("claim", claim, self.decided)
            asked, said, found, why = named("contrast", part or next(iter(contrasts)), contrasts)
            if asks == "verdict":
                return said if part else self.verdict(claim)
            if why:
                raise EvidenceError(f"{self.study.name}: {why}")
            return ends(found, asked.measure) if asks else signed(found, asked.measure)
        if kind not in MEASURES:
            raise EvidenceError(f"{title!r} names no measure; {nearest(kind, MEASURES)}")
        found = mean_selected(self.units, words, kind)
        return ends(found, kind, least=0.0) if asks else number(found.value, kind)

    def block(self, what: str) -> str:
        """The Markdown of a table: ``claims``, ``derived``, or one that the study declares."""
        if what == "claims":
            return self._claims()
        if what != DERIVED:
            return self._table(named("table", what, self.study.file.tables))
        rows = [[name, *map(number, row)] for name, *row in self.derived.itertuples()]
        return f"{markdown(['', *self.derived.columns], rows)}\n"

    def rows(self, table: Table) -> dict[str, pd.DataFrame]:
        """The units of each row of a table, by column, where there are any."""
        cells: dict[str, dict[str, pd.Series[float]]] = {}
        for row, column in product(table.rows, table.columns):
            with suppress(EvidenceError):
                units = selected(self.units, f"{row} {column}", table.measure)
                cells.setdefault(row, {})[column] = units
        return {row: pd.DataFrame(units) for row, units in cells.items()}

    def _table(self, table: Table) -> str:
        trained = self.derived["before the experiment"] if table.trained_before else {}
        rows = []
        for row, label in table.rows.items():
            cells = [self._cell(f"{row} {column}", table) for column in table.columns]
            sizes = sorted({size for _, size in cells if size})
            texts = [text for text, _ in cells]
            rows.append([label, *texts, " or ".join(map(str, sizes)) or "–"])
            if table.trained_before:
                rows[-1].append(trained.get(row.split()[0], "–"))
        head = ["", *table.columns, "n"]
        head += ["attempts of training before"] if table.trained_before else []
        note = f"Means over n {self.study.unit}s"
        if table.measure == CORRELATION:
            note = "Correlations over n sets of parameters"
        note += ", 95% intervals." if table.interval else "."
        return f"{markdown(head, rows)}\n\n{note}\n"

    def _cell(self, asked: str, table: Table) -> tuple[str, int]:
        """A mean of a table as text, with its interval, and of how many units it is."""
        try:
            mean = mean_selected(self.units, asked, table.measure)
        except EvidenceError:
            return "–", 0
        text = number(mean.value, table.measure)
        if asked.split()[0] in PUBLISHED:
            return text, 0
        tried = table.measure == "attempts" and "solved" in self.units
        if tried and not selected(self.units, asked, "solved").any():
            text = f"> {mean.value:g}"  # the limit
        elif table.interval and np.isfinite(mean.interval[0]):
            least = -1.0 if table.measure == CORRELATION else 0.0
            text += f" ({ends(mean, table.measure, least)})"
        return text, mean.units[0]

    def _claims(self) -> str:
        rows = []
        for name, claim in self.study.file.claims.items():
            contrasts = self.decided[name]
            said = f"**{self.verdict(name)}**"
            against = [one.verdict for one in contrasts.values()].count("does not hold")
            if 0 < against < len(contrasts):
                said += f" ({against} of {len(contrasts)} do not hold)"
            if late := self.late(name):
                said += f"; {late} after the run"
            source = f" ({claim.source})" if claim.source else ""
            rows.append([f"{claim.text}{source}", said, ""])
            for part, (asked, verdict_of_part, found, why) in contrasts.items():
                by = why or _difference(asked, found)
                rows.append([f"&nbsp;&nbsp;{part}: {_asked(asked)}", verdict_of_part, by])
        return f"{markdown(['claim', 'verdict', 'by'], rows)}\n"


def _difference(contrast: Contrast, found: Estimate) -> str:
    measure, written = contrast.measure, signed(found, contrast.measure)
    if np.isnan(found.interval[0]):
        return f"{written} ({found.alike}), n = {found.n}"
    interval = ends(found, measure)
    if not isinstance(contrast.minus, str):
        written += f" from {number(contrast.minus, measure)}"
    if contrast.expected == "same":
        interval += f"; {EQUIVALENCE:.0%}: {ends(found, measure, level=EQUIVALENCE)}"
    return f"{written} ({interval}), n = {found.n}"


def _asked(contrast: Contrast) -> str:
    margin = number(contrast.smallest, contrast.measure)
    by = f" by at least {margin}" if contrast.smallest > 0 else ""
    rule = f"the same within {margin}" if contrast.expected == "same" else contrast.expected + by
    sides = f"{_side(contrast.of)} − {_side(contrast.minus)}"
    return f"{contrast.measure.replace('_', ' ')} of {sides}, expected: {rule}"


def _side(side: str | float) -> str:
    """One side of a contrast in words, its learner as code."""
    if not isinstance(side, str):
        return f"{side:g}"
    return re.sub(r"^(\S+)", r"`\1`", side).replace("+", " and ")


def signed(found: Estimate, measure: str) -> str:
    """A difference with its sign."""
    return ("+" if found.value > 0 else "") + number(found.value, measure)


def ends(found: Estimate, measure: str, least: float = -1.0, level: float = LEVEL) -> str:
    """An interval; of shares, as far as there can be any."""
    low, high = found.ends(level)
    if np.isnan(low):
        return found.alike
    if measure not in NO_SHARES:
        low, high = max(low, least), min(high, 1.0)
    return f"{number(low, measure)} to {number(high, measure)}"


def number(value: Any, measure: str = "attempts") -> str:
    """A value as pages have it: two decimals, and of shares no zero before the point.

    >>> number(-0.5), number(-0.5, "solved"), number(1674240)
    ('−0.50', '−.50', '1,674,240')
    """
    text = printed(value, None)
    return text if measure in NO_SHARES else re.sub(r"^(−?)0\.", r"\1.", text)


# -- tables of learners ---------------------------------------------------------------------------


def distances_from_people(study: Study, units: pd.DataFrame) -> pd.DataFrame:
    """Distances of learners from people's means, next to the noise ceiling and null models.

    Columns: as :func:`~causal_openlock.paper.noise_ceiling.beside_null_models`
    returns; ``effects``, of how many of people's six effects a learner has the sign; and ``model``,
    its distance from the fourteen means of the published model.
    """
    trials, like = beside_people(study, units)
    table = beside_null_models(like, trials, study.file.fitted).set_index("learner")
    effects = {name: own["like_people"].sum() for name, own in like.effects.items()}
    model = points_of_model()["mean"].to_numpy()
    far = {name: distance(own.assign(people_mean=model))[0] for name, own in like.points.items()}
    return table.assign(effects=pd.Series(effects, dtype="Int64"), model=pd.Series(far))


def beside_people(study: Study, units: pd.DataFrame) -> tuple[pd.DataFrame, Likeness]:
    """The trials of a study, and its learners compared with people's fourteen means.

    Raises:
        EvidenceError: If no learner has played all six conditions.
    """
    trials = units.rename(columns={"unit": "subject"})
    trials = trials.assign(experiment=study.name, seed=0, loop=1)
    cells = frozenset(trials[CELL].astype(str).itertuples(index=False, name=None))
    like = likeness(trials, replace(people(), cells=cells), list(dict.fromkeys(trials["learner"])))
    if like is None:
        raise EvidenceError("no learner has played all six conditions")
    return trials, like


def learning_costs(study: Study, units: pd.DataFrame) -> pd.DataFrame:
    """The attempts that each learner needs until it solves a new room well, as in a report."""
    table = shown(costs_by_learner(read_units(study, COSTS)))
    return table.set_index("learner").loc[units["learner"].unique()]


DERIVED_TABLES = {
    "distances_from_people": distances_from_people,
    "learning_costs": learning_costs,
    "confusion": confusions,
}
"""Tables that a study may declare as ``derived``, by learner."""

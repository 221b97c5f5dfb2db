"""Pages whose numbers come from evidence.

A measured number on a page is a link to the study that measured it, and the link's title says what
it is; a table stands between two comments that say the same::

    The door opens in [.57](../evidence/figure6/README.md "opens rate_005 CC4 part 1").

    <!-- evidence: figure6 opens -->
    ...
    <!-- end of evidence -->

Besides the tables that a study declares, ``claims`` has a row for each contrast, and ``verdicts``
one for each claim, or for each of those named after it.

:func:`renewed` writes both again from what is stored. :func:`unbound_numbers` finds numbers in the
prose of a page that no link, table or code (for settings, such as ```.005```) accounts for.

A link's title is ``MEASURE LEARNER [CONDITION] [train|test] [trial N|part N]``, the mean over
units (of a recovery also ``r LEARNER parameter NAME``), or ``claim NAME [CONTRAST]``, the
difference; ended by ``interval``, ``units``, ``sd``, ``verdict`` or ``without_sign``, that of it.
``derived LEARNER COLUMN`` is of a table that is computed from all units; ``core_hours``,
``machine`` and ``date`` are of the run.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from causal_openlock.errors import EvidenceError
from causal_openlock.evidence.measured import Evidence
from causal_openlock.evidence.study import Study
from causal_openlock.wording import counted, nearest

LINK = re.compile(
    r"\[(?P<text>[^\]\n]*)\]\((?P<path>(?:[^)\s]*/)?(?P<study>[\w-]+)/README\.md)"
    r'[ \n]"(?P<title>[^"]*)"\)'
)
START = re.compile(r"<!-- evidence: (?P<study>[\w-]+) (?P<what>[\w ]+) -->\n")
END = "<!-- end of evidence -->"
BLOCK = re.compile(
    rf"(?P<start>{START.pattern})(?P<body>(?:(?!<!-- evidence:).)*?)(?P<end>{END})", re.DOTALL
)
_NAMES = re.compile(
    r"\bFigures \d+ (?:and|to) \d+|\b(?:Figure|Table|Section|Python|Part|Trial)s? \d[\d.]*"
    r"|\b(?:CogSci|AAAI|January) (?:19|20)\d\d\b|(?:\(|, |&nbsp;)(?:19|20)\d\d(?=[);])"
    r"|\b[A-Z][A-Za-z]*-?\d+(?:-[A-Z]+\d+)?\b"
)
_NUMBER = re.compile(r"(?<![\w.])[+\-−]?(?:\d[\d.,]*\d|\d|\.\d+)%?|[½¼¾²³]")


@dataclass
class Pages:
    """The pages whose numbers come from the studies of a folder.

    Attributes:
        root: The folder of the studies.
        studies: The studies.
    """

    root: Path
    studies: Sequence[Study]
    _known: dict[str, Evidence] = field(default_factory=dict)

    def evidence(self, name: str) -> Evidence:
        """Measurements of a study.

        Raises:
            EvidenceError: If there is no such study.
        """
        if name not in self._known:
            studies = {study.name: study for study in self.studies}
            if name not in studies:
                raise EvidenceError(f"there is no study {name!r}; {nearest(name, studies)}")
            self._known[name] = Evidence(studies[name])
        return self._known[name]

    def leads_to_study(self, page: Path) -> Callable[[str], bool]:
        """Whether the target of a link on a page is the page of a study."""
        known = {(self.root / study.name / "README.md").resolve() for study in self.studies}
        return lambda target: (page.parent / target).resolve() in known

    def renewed(self, text: str, page: Path) -> tuple[str, list[str]]:
        """A page with its measured numbers and tables rewritten, and what could not be.

        Args:
            text: The text of the page.
            page: Where it is.
        """
        faults: list[str] = []
        here = Path(os.path.relpath(self.root, page.parent)).as_posix()

        def fault(place: int, error: EvidenceError) -> None:
            line = text.count("\n", 0, place) + 1
            faults.append(f"{page}:{line}: {error}")

        of_study = self.leads_to_study(page)

        def link(found: re.Match[str]) -> str:
            if not of_study(found["path"]):
                return found[0]
            try:
                number = self.evidence(found["study"]).text(found["title"])
            except EvidenceError as error:
                fault(found.start(), error)
                return found[0]
            return found[0].replace(f"[{found['text']}]", f"[{number}]", 1)

        def block(found: re.Match[str]) -> str:
            try:
                shown = self.evidence(found["study"])
                body = shown.block(found["what"])
            except EvidenceError as error:
                fault(found.start(), error)
                return found[0]
            folder = f"{here}/{found['study']}"
            source = f"[How it was measured]({folder}/README.md). {shown.played_with}".rstrip()
            figure = shown.figure(found["what"], folder)
            return f"{found['start']}{body}\n{figure}{source}\n{found['end']}"

        blocks = len(BLOCK.findall(text))
        if not blocks == text.count("<!-- evidence:") == text.count(END):
            faults.append(f"{page}: a block of evidence has no end, or no known beginning; fix it")
            return text, faults
        return BLOCK.sub(block, LINK.sub(link, text)), faults


def _in_evidence(target: str) -> bool:
    return "evidence/" in target


def unbound_numbers(
    text: str, of_study: Callable[[str], bool] = _in_evidence
) -> list[tuple[int, str]]:
    """The numbers in the prose of a page that no evidence accounts for, each with its line.

    Settings are written as code (```300```); names such as Figure 6 and CC4, and years of
    references, do not count as numbers.

    >>> unbound_numbers("It opens in .57 of `300` attempts of Figure 6.")
    [(1, '.57')]

    Args:
        text: The text of the page.
        of_study: Whether the target of a link is the page of a study.
    """
    from markdown_it import MarkdownIt

    def blank(found: re.Match[str]) -> str:
        return re.sub(r"[^\n]", " ", found[0])

    # Only what is written as LINK reads it is renewed.
    renewed = Counter((one["path"], one["title"]) for one in LINK.finditer(text))

    def is_link(token: Any) -> bool:
        href, title = token.attrs.get("href", ""), token.attrs.get("title", "")
        renewed[href, title] -= 1
        return bool(title) and of_study(href) and renewed[href, title] >= 0

    text = BLOCK.sub(blank, text)
    # Directives (```{note}) hold prose; other fences are code.
    text = re.sub(r"^(`{3,}|:{3,})\{[^\n]*$(.*?)^\1\s*$", r"\n\2\n", text, flags=re.S | re.M)
    faults = []
    for token in MarkdownIt().enable("table").parse(text):
        line = (token.map or [0])[0] + 1
        inside, prose = False, []
        for one in token.children or ():
            if one.type in ("softbreak", "hardbreak"):
                prose.append("\n")
            elif one.type == "link_open":
                inside = is_link(one)
            elif one.type == "link_close":
                inside = False
            elif one.type in ("text", "image") and not inside:
                prose.append(one.content)
            elif one.type == "code_inline":
                prose.append(" ")
        if token.type == "html_block":
            prose.append(re.sub(r"<!--.*?-->|<[^>]*>", blank, token.content, flags=re.S))
        said = _NAMES.sub(blank, "".join(prose))
        faults += [
            (line + said.count("\n", 0, found.start()), found[0])
            for found in _NUMBER.finditer(said)
        ]
    return faults


def page_of(evidence: Evidence) -> str:
    """The ``README.md`` of a study: what was run, how, and with which result."""
    file = evidence.study.file
    parts = [f"# {file.title}\n"]
    if file.about:
        parts.append(f"{file.about.strip()}\n")
    if evidence.played_with:
        parts.append(f"{evidence.played_with}\n")
    run = evidence.run if evidence.was_run else {}
    if file.claims:
        parts.append(evidence.block("claims"))
        parts.append(
            "What the verdicts mean, and by which rules they follow: "
            "[evidence](../README.md#verdicts).\n"
        )
    derived = ["derived"] if file.derived else []
    for name in (*derived, *file.tables) if run else ():
        parts.append(evidence.block(name))
        parts += filter(None, [evidence.figure(name, ".")])
    parts.append(f"## How it was measured\n\n{_run_in_words(evidence, run)}\n")
    return "\n".join(parts)


def _run_in_words(evidence: Evidence, run: Mapping[str, Any]) -> str:
    study = evidence.study
    experiment = f"[{study.experiment.name}]({study.file.experiment})"
    predicts = {
        "recovery": " and lets every learner predict every subject",
        "design": " and lets every theory predict every subject, its parameters unknown",
    }.get(study.file.measured, "")
    lines = [
        f"    causal-openlock evidence {study.name}",
        "",
        f"plays {experiment}{predicts}, which takes about {_hours(study.file.hours)} of one core.",
    ]
    if published := study.file.published:
        lines = [
            f"It is kept as published with version {published}, which can play it: options of "
            f"`{study.file.experiment}` have been removed since."
        ]
    if study.file.fits:
        fits = ", ".join(f"[{name}]({name})" for name in study.file.fits)
        lines += [f"Its seed is none of the fit that its parameters come from: {fits}."]
    if networks := study.file.networks:
        files = ", ".join(f"[{label}]({path})" for label, path in networks.files.items())
        lines += [
            f"Networks are trained first, {len(networks.seeds)} of each kind: {files}. A network "
            "is the unit: its subjects are averaged."
        ]
    if not run:
        return "\n".join([*lines, "", "It has not been run yet."])
    complete = evidence.complete
    if not evidence.stands:
        return "\n".join(
            [*lines, "", "It has been changed since it was run; what is above is of then."]
        )
    done = "all of it was run" if complete else f"{run['cells']} cells were run so far"
    if networks and not complete:
        units = evidence.units
        counts = units.loc[units["learner"].isin(networks.files)].groupby("learner")["unit"]
        sizes = counts.nunique().reindex(list(networks.files), fill_value=0)
        done = f"{sizes.min()} to {sizes.max()} networks of each kind were trained so far"
    versions = ", ".join(f"{name} {held}" for name, held in sorted(run["versions"].items()))
    return "\n".join(
        [
            *lines,
            "",
            f"On {run['date']}, {done}, in {_hours(run['core_hours'])} of one core (training "
            f"apart) on {run['machine']}; {versions}.",
            *(
                f"Its declaration is written otherwise since: {made['reason']} One subject of "
                f"every learner concerned did the same by the code before ({made['by']}) and after."
                for made in run.get("stamps", ())
            ),
            "",
            f"What was measured, a row for each {study.unit} and time: "
            "[units.parquet](units.parquet). What follows: [verdicts.csv](verdicts.csv). The run: "
            "[run.json](run.json). The claims and their margins: [study.yaml](study.yaml).",
        ]
    )


def _hours(hours: float) -> str:
    return f"{hours:g} hours" if hours >= 1.05 else counted(max(1, round(hours * 60)), "minute")

"""Pages whose numbers come from evidence, written anew or checked.

A measured number on a page is a link to the study that measured it, and the link's title says what
it is; a table stands between two comments that say the same::

    The door opens in [.57](../evidence/figure6/README.md "opens rate_005 CC4 part 1").

    <!-- evidence: figure6 opens -->
    ...
    <!-- end of evidence -->

A link's title is ``MEASURE`` and a selection in words, or ``claim NAME [CONTRAST]``; ended by
``interval`` or, of a claim, by ``verdict``, that of it; or it is ``derived LEARNER COLUMN``.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

from causal_openlock.errors import EvidenceError, OpenLockError
from causal_openlock.files.atomic import write_text
from causal_openlock.files.escaping import csv_of
from causal_openlock.wording import counted
from evidence.measured import Evidence
from evidence.study import DERIVED, FILE, named, read_studies

VERDICTS, README = "verdicts.csv", "README.md"
REMEDY = "write it again with: python -m evidence --write"

LINK = re.compile(
    r"\[[^\]\n]*\](?P<target>\((?:[^)\s]*/)?(?P<study>[\w-]+)/README\.md"
    r'[ \n]"(?P<title>[^"]*)"\))'
)
START, END = "<!-- evidence:", "<!-- end of evidence -->"
BLOCK = re.compile(
    rf"(?P<start>{START} (?P<study>[\w-]+) (?P<what>\w+) -->\n).*?(?P<end>{END})", re.DOTALL
)


def check(root: Path, write: bool = False) -> list[str]:
    """Faults of what follows from studies, a sentence each; other texts are one, or written anew.

    Pages are Markdown next to the folder of studies, and in ``docs`` there.
    """
    texts: dict[Path, str] = {}
    faults: list[str] = []
    studies = {study.name: Evidence(study) for study in read_studies(root)}
    for evidence in studies.values():
        study = evidence.study
        try:
            if not study.file.published:
                faults += [f"{study.folder / FILE}: {fault}" for fault in study.faults()]
            if evidence.state.startswith("changed"):
                faults.append(
                    f"{study.folder}: {study.file.experiment}, or what it names, has changed since "
                    f"it was run; run: make evidence NAME={study.name}"
                )
            texts[study.folder / README] = page_of(evidence)
            if evidence.was_run:
                texts[study.folder / VERDICTS] = csv_of(evidence.claims.round(6))
        except OpenLockError as error:  # of a damaged file nothing is written
            faults.append(f"{study.folder}: {error}")
        missing = [path for path in evidence.figures.values() if not path.exists()]
        faults += [f"{path} is missing; {REMEDY}" for path in missing]
    for page in [*root.parent.glob("*.md"), *root.parent.glob("docs/**/*.md"), root / README]:
        if page.exists():
            texts[page] = renewed(page, root, studies, faults)
    for path, text in texts.items():
        if path.exists() and path.read_text(encoding="utf-8") == text:
            continue
        if write:
            write_text(path, text)
        else:
            faults.append(f"{path} is not what was measured; {REMEDY}")
    return faults


def renewed(page: Path, root: Path, studies: dict[str, Evidence], faults: list[str]) -> str:
    """The text of a page with its numbers and tables as measured; what cannot be is a fault."""
    text = page.read_text(encoding="utf-8")
    here = Path(os.path.relpath(root, page.parent)).as_posix()

    def rewritten(found: re.Match[str]) -> str:
        try:
            evidence = named("study", found["study"], studies)
            if found.re is LINK:
                return f"[{evidence.text(found['title'])}]{found['target']}"
            body = evidence.block(found["what"])
            source = f"[How it was measured]({here}/{found['study']}/README.md)."
            source = f"{source} {evidence.played_with}".rstrip()
            return f"{found['start']}{body}\n{source}\n{found['end']}"
        except EvidenceError as error:
            line = text.count("\n", 0, found.start()) + 1
            faults.append(f"{page}:{line}: {error}")
            return found[0]

    if not len(BLOCK.findall(text)) == text.count(START) == text.count(END):
        faults.append(f"{page}: a block of evidence has no end, or no known beginning; fix it")
        return text
    return BLOCK.sub(rewritten, LINK.sub(rewritten, text))


def page_of(evidence: Evidence) -> str:
    """The ``README.md`` of a study: what was run, how, and with which result."""
    study, file = evidence.study, evidence.study.file
    parts = [f"# {file.title}\n"]
    parts += [f"{text.strip()}\n" for text in (file.about, evidence.played_with) if text]
    if file.claims:
        rules = "What the verdicts mean, and by which rules they follow: "
        parts += [evidence.block("claims"), f"{rules}[evidence](../README.md#verdicts).\n"]
    for name in (*([DERIVED] if file.derived else ()), *file.tables) if evidence.was_run else ():
        parts.append(evidence.block(name))
        if name in evidence.figures:
            more = "" if name == DERIVED else f": {name.replace('_', ' ')}, every {study.unit}"
            parts.append(f"![{file.title}{more}](./{name}.png)\n\n")
    return "\n".join([*parts, "## How it was measured\n", *_how(evidence)]) + "\n"


def _how(evidence: Evidence) -> Iterator[str]:
    study, file = evidence.study, evidence.study.file
    if file.published:
        yield (
            f"It is kept as published with version {file.published}, which can play it: options of "
            f"`{file.experiment}` have been removed since."
        )
    else:
        yield f"    make evidence NAME={study.name}\n"
        yield (
            f"plays [{Path(file.experiment).name}]({file.experiment}), which takes about "
            f"{_duration(file.hours)} of one core."
        )
    if file.fits:
        fits = ", ".join(f"[{name}]({name})" for name in file.fits)
        yield f"Its seed is none of the fit that its parameters come from: {fits}."
    if networks := file.networks:
        files = ", ".join(f"[{label}]({path})" for label, path in networks.files.items())
        yield f"The units are networks, {len(networks.seeds)} of each kind, trained first: {files}."
    if not evidence.was_run:
        yield "\nIt has not been run yet."
        return
    run = evidence.run
    versions = ", ".join(f"{name} {held}" for name, held in sorted(run["versions"].items()))
    yield (
        f"\nOn {run['date']}, all of it was run, in {_duration(run['core_hours'])} of one core "
        f"(training apart) on {run['machine']}; {versions}."
    )
    if stamps := run.get("stamps"):
        reasons = " ".join(stamp["reason"] for stamp in stamps)
        yield (
            f"Its declaration is written otherwise since: {reasons} Each time one subject of every "
            "learner concerned did the same by the code before and after."
        )
    yield (
        f"\nWhat was measured, a row for each {study.unit} and time: "
        "[units.parquet](units.parquet). What follows: [verdicts.csv](verdicts.csv). The run: "
        "[run.json](run.json). The claims and their margins: [study.yaml](study.yaml)."
    )


def _duration(hours: float) -> str:
    return f"{hours:g} hours" if hours >= 1.05 else counted(max(1, round(hours * 60)), "minute")

"""Check that pages and figures follow from the stored measurements and the present declarations.

Recomputing takes seconds: it reads the stored units and runs nothing.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from pydantic import Field

from causal_openlock.errors import EvidenceError, OpenLockError
from causal_openlock.evidence.figures import drawn, figure_path, is_current
from causal_openlock.evidence.measured import Evidence
from causal_openlock.evidence.pages import Pages, page_of, unbound_numbers
from causal_openlock.evidence.study import FILE, read_studies
from causal_openlock.files.atomic import write_text
from causal_openlock.files.escaping import csv_of
from causal_openlock.files.validation import StrictModel
from causal_openlock.files.yaml_file import read_document

VERDICTS, README, PAGES = "verdicts.csv", "README.md", "pages.yaml"


class PagesFile(StrictModel):
    """``evidence/pages.yaml``: which pages take numbers from the studies.

    Attributes:
        results: Pages on which every number in the prose comes from a study.
        others: Pages that take numbers from studies among others.
    """

    results: list[str] = Field(default_factory=list)
    others: list[str] = Field(default_factory=list)


@dataclass
class Written:
    """Text and figures written from studies, as they should be.

    Attributes:
        texts: Text by file.
        figures: Function that draws a figure, by file, for figures that are out of date.
        faults: Other faults, a sentence each.
    """

    texts: dict[Path, str] = field(default_factory=dict)
    figures: dict[Path, Callable[[], str]] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)

    @property
    def stale(self) -> list[Path]:
        """The files that hold something else."""
        texts = [path for path, text in self.texts.items() if _text(path) != text]
        return [*texts, *self.figures]


def written(root: Path, trusted: Collection[str] = ()) -> Written:
    """All that follows from the studies of a folder, and what is wrong with them.

    Args:
        root: The folder of the studies.
        trusted: Names of studies whose code may run; that of others makes them a fault.

    Raises:
        EvidenceError: If it holds none.
        FileError: If one of its files cannot be read.
    """
    made = Written()
    studies = read_studies(root, tell=lambda _: None, trusted=trusted)
    pages = Pages(root, studies)
    for study in studies:
        found = pages.evidence(study.name)
        try:
            if not study.file.published:
                made.faults += [f"{study.folder / FILE}: {fault}" for fault in study.faults()]
            if found.was_run:
                _ = found.units  # a damaged file is a fault, and nothing is written from it
                made.faults += _changed(found)
            text = page_of(found)
            table = csv_of(found.claims.round(6)) if found.was_run else ""
        except OpenLockError as error:
            made.faults.append(f"{study.folder}: {error}")
            continue
        made.texts[study.folder / README] = text
        if table:
            made.texts[study.folder / VERDICTS] = table
        for name in study.file.figures if found.was_run else ():
            if not is_current(found, name):
                made.figures[figure_path(found, name)] = partial(drawn, found, name)
    for path, bound in _pages(root):
        text, faults = pages.renewed(path.read_text(encoding="utf-8"), path)
        made.texts[path] = text
        made.faults += faults
        if bound:
            made.faults += [
                f"{path}:{line}: no evidence gives {number}; link it to the study that measured "
                "it, or write a setting as code"
                for line, number in unbound_numbers(text, pages.leads_to_study(path))
            ]
    return made


def check(root: Path, trusted: Collection[str] = ()) -> list[str]:
    """Faults of what is written, a sentence each; nothing is changed."""
    made = written(root, trusted)
    remedy = "write it again with: causal-openlock evidence --write"
    return [*made.faults, *(f"{path} is not what was measured; {remedy}" for path in made.stale)]


def write(root: Path, trusted: Collection[str] = ()) -> tuple[list[Path], list[str]]:
    """Write all that follows from the studies; returns what changed, and what is wrong."""
    made = written(root, trusted)
    stale = made.stale
    for path in stale:
        write_text(path, made.texts[path] if path in made.texts else made.figures[path]())
    return stale, made.faults


def _changed(found: Evidence) -> list[str]:
    """Whether what is declared has changed since it was run."""
    study = found.study
    if found.stands:
        return []
    return [
        f"{study.folder}: {study.experiment.name}, or what it names, has changed since it was run; "
        f"run it again with: causal-openlock evidence {study.name}, or see --stamp"
    ]


def _pages(root: Path) -> Iterator[tuple[Path, bool]]:
    """The pages that take numbers from studies, and whether all of theirs must be."""
    path = root / PAGES
    if not path.exists():
        return
    declared = read_document(path).validate(PagesFile)
    for names, bound in ((declared.results, True), (declared.others, False)):
        for name in names:
            page = Path(os.path.normpath(root / name))
            if not page.is_file():
                raise EvidenceError(f"{path} names {name}, which is not a file; fix the name")
            yield page, bound


def _text(path: Path) -> str | None:
    return path.read_text(encoding="utf-8") if path.exists() else None

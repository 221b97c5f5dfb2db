"""People in a report: how long they took."""

from __future__ import annotations

import itertools
from pathlib import Path

import causal_openlock as ol
from causal_openlock.importing.folder import import_files
from causal_openlock.paper.published import minutes

SOLVED = [("LOWERLEFT", "UPPERRIGHT"), ("UPPERLEFT", "UPPERRIGHT")]
"""Levers of the two solutions of CE3 in its first published room."""


def rows(subject: str, solves: bool, start: float, step: float) -> list[str]:
    """A trial of CE3, solved in two attempts or failed in thirty; a row for each action."""
    attempts = SOLVED if solves else [("LOWERLEFT", "LOWERLEFT")] * 30
    acts = [
        (number, name) for number, levers in enumerate(attempts, 1) for name in (*levers, "door")
    ]
    return [
        f"{subject},CE3,1,{attempt},push_{name},trial1,{start + step * n}"
        for n, (attempt, name) in enumerate(acts)
    ]


def imported(folder: Path, *people: list[str]) -> Path:
    head = "subject,condition,trial,attempt,action,layout,time"
    (folder / "data.csv").write_text("\n".join([head, *itertools.chain(*people)]) + "\n")
    import_files([folder / "data.csv"], folder / "people")
    return folder / "people"


def test_minutes_of_people_are_told_next_to_the_published_ones(tmp_path: Path) -> None:
    """Six actions from the first to the last: five steps of a minute, of two and of nine."""
    several = [rows(str(n), True, 100.0, 60.0 * step) for n, step in enumerate((1, 2, 9))]
    results = ol.open_results(imported(tmp_path, *several))
    assert minutes() == {"baseline": 17.4, "transfer": 17.3}
    told = "3 people took 10.0 minutes in a baseline (median); people (Edmonds et al., 2018) took "
    told += "about 17.4 in a baseline and 17.3 in transfer."
    assert told in results.methods()
    results.report()
    page = (tmp_path / "people" / "report.html").read_text(encoding="utf-8")
    assert told in page


def test_learners_have_no_minutes(tmp_path: Path) -> None:
    results = ol.compare(["CE3"], ["oracle"], subjects=2, workers=0, out=tmp_path / "x")
    assert "minutes" not in results.methods()

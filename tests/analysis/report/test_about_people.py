"""People in a report: who is left out, and how long they took."""

from __future__ import annotations

import itertools
from pathlib import Path

import pyarrow as pa
import pytest

import causal_openlock as ol
from causal_openlock.analysis.results.reading import Exclusion, read_results, without_excluded
from causal_openlock.analysis.results.references import find_references
from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.importing.folder import import_files
from causal_openlock.paper.published import minutes
from causal_openlock.storage.store import Store
from support.command import at_once

RULES: tuple[Exclusion | None, ...] = (None, "completed no trial")
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


@pytest.fixture(scope="module")
def two_of_three(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of three people, one of whom solved nothing."""
    folder = tmp_path_factory.mktemp("people")
    each = [rows(str(n), n != 1, 0.0, 60.0) for n in range(3)]
    return imported(folder, *each)


LEFT_OUT = "Of 3 people (person), 1 completed no trial and was left out."


def test_who_completed_no_trial_is_left_out_only_if_asked_and_never_silently(
    two_of_three: Path,
) -> None:
    everybody = ol.open_results(two_of_three)
    assert everybody.trials["solved"].tolist() == [True, False, True]
    assert "left out" not in everybody.methods() + " ".join(everybody.warnings)
    results = ol.open_results(two_of_three, exclude="completed no trial")
    assert results.trials["subject"].tolist() == [0, 2]
    assert results.attempts["subject"].unique().tolist() == [0, 2]
    assert len(results.attempts) == 4
    assert LEFT_OUT in results.warnings
    assert f"{LEFT_OUT} From the first action to the last, 2 people took 5.0" in results.methods()
    results.report()
    page = (two_of_three / "report.html").read_text(encoding="utf-8")
    assert f"<li>{LEFT_OUT}</li>" in page


def test_learners_are_never_left_out(two_of_three: Path, tmp_path: Path) -> None:
    ol.compare(["CE3"], ["tabular_q"], subjects=2, workers=0, out=tmp_path / "x")
    results = ol.open_results(tmp_path / "x", two_of_three, exclude="completed no trial")
    unsolved = results.trials.query("learner == 'tabular_q'").groupby("subject")["solved"]
    assert not unsolved.any().any()
    assert results.experiment.excluded == {"person": 1}
    joined = ol.open_results(tmp_path / "x") + ol.open_results(
        two_of_three, exclude="completed no trial"
    )
    assert len(joined.attempts) == len(results.attempts)


def test_people_as_a_reference_are_left_out_by_the_same_rule(two_of_three: Path) -> None:
    whole, rest = (find_references(f"mine={two_of_three}", rule) for rule in RULES)
    assert (whole[0].points["subjects"].iloc[0], rest[0].points["subjects"].iloc[0]) == (3, 2)
    assert rest[0].detail == "one's own, 1 who completed no trial left out"


def test_a_rule_that_leaves_nobody_is_refused(tmp_path: Path) -> None:
    folder = imported(tmp_path, rows("a", False, 0.0, 1.0))
    done = at_once("report", folder, "--exclude", "completed no trial")
    assert (done.status, "nobody is left to report" in done.stderr) == (2, True)


def test_the_command_says_who_is_left_out(two_of_three: Path) -> None:
    done = at_once("report", two_of_three, "--exclude", "completed no trial")
    assert (done.status, LEFT_OUT in done.stdout) == (0, True)
    both = at_once("report", two_of_three, two_of_three, "--exclude", "completed no trial")
    assert (both.status, "or --exclude" in both.stderr) == (2, True)


def test_another_rule_is_refused(two_of_three: Path) -> None:
    with pytest.raises(OpenLockError, match="no rule 'nope' leaves people out"):
        ol.open_results(two_of_three, exclude="nope")  # type: ignore[arg-type]


def test_a_solution_that_was_shown_completes_no_trial(two_of_three: Path) -> None:
    record, experiment = read_results(Store(two_of_three))
    first = record.column_names.index("phase")
    shown = pa.array(["shown"] * record.num_rows)
    with pytest.raises(StoreError, match="everybody completed no trial"):
        without_excluded(record.set_column(first, "phase", shown), experiment, ["person"])

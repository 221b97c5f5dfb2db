"""People in a report: who is left out, and how long they took."""

import pyarrow as pa
import pytest

import causal_openlock as ol
from causal_openlock.analysis.results.reading import read_results, without_excluded
from causal_openlock.errors import StoreError
from causal_openlock.paper.references import people
from causal_openlock.storage.store import Store
from support.command import at_once
from support.imported import imported, rows

RULE = "completed no trial"
LEFT_OUT = f"Of 3 people (person), 1 {RULE} and was left out."


def test_minutes_are_a_median_of_people_and_learners_have_none(tmp_path):
    """Six actions from the first to the last: five steps of a minute, of two and of nine."""
    several = [rows(n, True, 60.0 * step) for n, step in enumerate((1, 2, 9))]
    results = ol.open_results(imported(tmp_path, *several))
    assert people().minutes == {"baseline": 17.4, "transfer": 17.3}
    told = "3 people took 10.0 minutes in a baseline (median)"
    page = results.report().path.read_text(encoding="utf-8")
    for text in (results.methods(), page):
        assert told in text
        assert "17.4 in a baseline and 17.3 in transfer" in text
    learners = ol.compare(["CE3"], ["oracle"], subjects=2, workers=0, out=tmp_path / "x")
    assert "minutes" not in learners.methods()


@pytest.fixture(scope="module")
def two_of_three(tmp_path_factory):
    """A folder of three people, one of whom solved nothing."""
    return imported(tmp_path_factory.mktemp("people"), *[rows(n, n != 1, 60.0) for n in range(3)])


def test_who_completed_no_trial_is_left_out_only_if_asked_and_never_silently(two_of_three):
    everybody = ol.open_results(two_of_three)
    assert everybody.trials["solved"].tolist() == [True, False, True]
    assert "left out" not in everybody.methods() + " ".join(everybody.warnings)
    results = ol.open_results(two_of_three, exclude=RULE)
    assert results.trials["subject"].tolist() == [0, 2]
    assert results.attempts["subject"].unique().tolist() == [0, 2]
    assert len(results.attempts) == 4
    assert LEFT_OUT in results.warnings
    assert f"{LEFT_OUT} From the first action to the last, 2 people took 5.0" in results.methods()
    assert f"<li>{LEFT_OUT}</li>" in results.report().path.read_text(encoding="utf-8")
    done = at_once("report", two_of_three, "--exclude", RULE)
    assert (done.status, LEFT_OUT in done.stdout) == (0, True)


def test_learners_are_never_left_out(two_of_three, tmp_path):
    ol.compare(["CE3"], ["tabular_q"], subjects=2, workers=0, out=tmp_path / "x")
    results = ol.open_results(tmp_path / "x", two_of_three, exclude=RULE)
    unsolved = results.trials.query("learner == 'tabular_q'").groupby("subject")["solved"]
    assert not unsolved.any().any()
    assert results.experiment.excluded == {"person": 1}
    joined = ol.open_results(tmp_path / "x") + ol.open_results(two_of_three, exclude=RULE)
    assert len(joined.attempts) == len(results.attempts)


def test_a_rule_that_leaves_nobody_is_refused(tmp_path, two_of_three):
    folder = imported(tmp_path, rows("a", False, 1.0))
    done = at_once("report", folder, "--exclude", RULE)
    assert (done.status, "nobody is left" in done.stderr) == (2, True)
    record, experiment = read_results(Store(two_of_three))
    first = record.column_names.index("phase")  # a solution that was shown completes no trial
    shown = record.set_column(first, "phase", pa.array(["shown"] * record.num_rows))
    with pytest.raises(StoreError, match=f"everybody {RULE}"):
        without_excluded(shown, experiment)

"""Who made simulated subjects is found again, where it can be."""

import numpy as np
import pandas as pd
import pytest

from causal_openlock.experiment.making import learner, make_experiment
from causal_openlock.fitting.recovery import drawn_sets, made_with, recovered, recovery, space_of
from causal_openlock.fitting.space import Range, bundled_search
from causal_openlock.fitting.to_actions import Fitted
from support.command import at_once

pytestmark = pytest.mark.slow


def scores(chances):
    """Subjects of one condition, by label of who made them: log-likelihoods of `a` and `b`."""
    subject = {"condition": "CC3", "protocol": "human", "experiment": "e", "seed": 1}
    rows = [
        {"learner": maker, "subject": number, "trial": trial, "scored": scored, **subject}
        | {"log_probability": value}
        for maker, differences in chances.items()
        for number, difference in enumerate(differences)
        for trial, share in ((1, -1.0), (2, 2.0))
        for scored, value in (("a", -9.0 + share * difference), ("b", -9.0))
    ]
    return pd.DataFrame(rows)


def test_the_confusion_of_a_hand_made_record():
    # Of the subjects of a, one in four looks like b; b's are clear. Each first trial misleads.
    found = recovery(scores({"a": [3, 3, 3, -1], "b": [-2, -2, -2, -2]}))
    assert found.single.to_numpy().tolist() == [[0.75, 0.25], [0.0, 1.0]]
    assert found.subjects == 4
    assert found.groups.loc["a", "a"] > 0.95
    assert found.groups.loc["b", "b"] == 1.0
    first = found.by_size[found.by_size["trials"] == 1]
    assert first[first["subjects"] == 1]["right"].tolist() == [0.25, 0.0]
    assert found.bits.loc["b", "b"] == pytest.approx(9 / np.log(2))
    assert found.confused(found.single) == [("a", "b", 0.25)]
    alike = recovery(scores({"a": [0, 0], "b": [0, 0]}))
    assert (alike.single == 0.5).all().all()


def test_drawn_parameters_lie_in_their_ranges():
    space = bundled_search("bayes")
    sets = drawn_sets(space, 30, 1)
    for name, one in space.ranges.items():
        values = np.array([chosen[name] for chosen in sets])
        assert one.low <= values.min() < values.max() <= one.high
    assert drawn_sets(space, 3, 1) == sets[:3]
    made = make_experiment(["CC3"], made_with(space, sets[:2], 3)).learners
    assert [one.name for one in made] == ["set_000", "set_001"]
    assert made[1].parameters["forgetting"] == sets[1]["forgetting"]
    thompson = learner("bayes", label="t", policy="thompson", forgets="failures")
    plain, other = make_experiment(["CC3"], ["bayes", thompson]).learners
    assert (space_of(plain), space_of(other)) == (None, space)


def test_correlations_are_on_the_scale_that_is_searched():
    space = bundled_search("theory_based")
    truth = drawn_sets(space, 12, 3)
    assert space.ranges["local_gain"] == Range(0.05, 1.0, log=True)
    squared = [{**one, "local_gain": one["local_gain"] ** 2, "edit_weight": 1.0} for one in truth]
    fits = [Fitted("s", -1, one, 1.0, 1, 0.0, 0, 0.0, 1, 2.0) for one in squared]
    pairs, found = recovered(truth, fits, space)
    r = found.set_index("parameter")["r"]
    assert r["local_gain"] == pytest.approx(1.0)
    assert r["schema_gain"] == pytest.approx(1.0)
    assert np.isnan(r["edit_weight"])
    assert len(pairs) == 12 * 4


def test_the_command_recovers_learners_and_parameters(tmp_path):
    (tmp_path / "two.yaml").write_text(
        "name: two\nseed: 4\nsubjects: 3\nprotocol: brief\nconditions: [CC3]\n"
        "protocols: {brief: {attempt_limit: 8, stop_when_solved: true, baseline_trials: 2}}\n"
        "learners: [random, associative]\n"
    )
    words = ["recover", tmp_path / "two.yaml", "-o", tmp_path / "r", "--workers", 1]
    words += ["--parameters", "associative", "-s", "temperature=0.02:2:log", "--sets", 3]
    done = at_once(*words, "--candidates", 2)
    assert done.status == 0, done.stderr
    single = pd.read_csv(tmp_path / "r" / "single.csv", index_col=0)
    assert np.diag(single).mean() > 0.6
    assert (tmp_path / "r" / "recovery.svg").exists()
    pairs = pd.read_csv(tmp_path / "r" / "parameters_associative.csv")
    assert pairs["true"].between(0.02, 2).all()
    assert pairs["at_bound"].isin([True, False]).all()
    stored = {path: path.stat().st_mtime_ns for path in (tmp_path / "r").rglob("*.parquet")}
    assert at_once(*words, "--candidates", 2).status == 0
    assert stored == {path: path.stat().st_mtime_ns for path in stored}  # nothing is made again

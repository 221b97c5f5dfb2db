"""Conditions are ranked by what a minute in them tells about theories with unknown parameters."""

import itertools
import json
import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from causal_openlock.comparison.comparing import play
from causal_openlock.experiment.declare import Cell
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.making import learner, make_experiment
from causal_openlock.fitting import design
from causal_openlock.fitting.design import (
    DOUBT,
    Effort,
    drawn,
    information_ends,
    informed,
    posterior,
    ranked,
    told_apart,
    unknown,
)
from causal_openlock.running.worker import made
from causal_openlock.scoring.inverse_binomial import Draws
from causal_openlock.scoring.teacher_forcing import recorded_subjects, score_actions
from causal_openlock.storage.store import Store
from support.command import at_once

EXPERIMENT = """
name: three
seed: 4
subjects: 2
protocol: brief
conditions: [CC3]
protocols: {brief: {attempt_limit: 5, stop_when_solved: true, baseline_trials: 1}}
learners: [random, win_stay, associative]
"""


def told(rows, condition="CC3"):
    """Subjects by who made them, with the log-likelihoods of two theories."""
    subject = {"condition": condition, "protocol": "human", "attempts": 10, "actions": 30}
    return pd.DataFrame(
        {"learner": maker, "subject": number, "nats a": a, "nats b": b, **subject}
        for number, (maker, a, b) in enumerate(rows)
    )


# -- what subjects tell ---------------------------------------------------------------------------


def test_information_of_made_up_subjects():
    sure, even = math.log(9), 0.0
    found = informed(told([("a", sure, 0.0), ("a", even, 0.0), ("b", sure, 0.0), ("c", 0.0, 0.0)]))
    right, wrong = 0.98 * 0.9 + 0.01, 0.98 * 0.1 + 0.01
    expected = [1 + math.log2(right), 0.0, 1 + math.log2(wrong), np.nan]
    assert found["information"].tolist() == pytest.approx(expected, nan_ok=True)
    assert found["single"].tolist() == pytest.approx([1.0, 0.5, 0.0, np.nan], nan_ok=True)
    assert found["certain"].tolist() == [0.0, 0.0, 0.0, 0.0]
    low, high = information_ends(2)
    assert (low, high) == pytest.approx((math.log2(DOUBT), math.log2(2 - DOUBT)))
    extreme = informed(told([("a", 0.0, -900.0), ("b", 0.0, -900.0)]))
    assert extreme["information"].tolist() == pytest.approx([high, low])
    assert extreme["certain"].tolist() == [1.0, 1.0]


def test_a_subject_that_acts_like_no_theory_stands_out():
    own = [("a", -30.0 - number, -60.0) for number in range(design.FEWEST_OWN)]
    others = [("b", -60.0, -30.0), ("c", -80.0, -90.0), ("c", -31.0, -90.0), ("c", -80.0, -20.0)]
    found = informed(told([*own, *others]))["unlike"]
    assert found[: len(own) + 1].isna().all()
    # The last is taken for b, which made too few subjects to say how badly it predicts its own.
    assert found.tolist()[-3:] == pytest.approx([1.0, 0.0, np.nan], nan_ok=True)


@given(
    st.lists(st.lists(st.integers(1, 9), min_size=3, max_size=3), min_size=2, max_size=2),
    st.lists(st.lists(st.floats(-9, 0), min_size=3, max_size=3), min_size=2, max_size=2),
)
def test_information_is_not_overstated_whatever_is_believed_of_likelihoods(odds, believed):
    """Two theories, three courses of action; the mean over all is at most the exact information."""
    truth = np.array(odds) / np.sum(odds, axis=1, keepdims=True)
    exact = (truth / 2 * np.log2(truth / truth.mean(axis=0))).sum()
    pairs = [*itertools.product((0, 1), range(3))]
    found = informed(told([("ab"[i], believed[0][k], believed[1][k]) for i, k in pairs]))
    weights = np.array([truth[pair] / 2 for pair in pairs])
    assert weights @ found["information"] <= exact + 1e-12


def test_conditions_are_ranked_by_the_minute():
    quick, slow = told([("a", 0.0, -3.0), ("b", -3.0, 0.0)]), told([("a", 0.0, -5.0)] * 2, "CE3")
    found = ranked(pd.concat([slow.assign(attempts=30), quick], ignore_index=True))
    assert found["condition"].tolist() == ["CC3", "CE3"]
    assert found["minutes"].tolist() == pytest.approx([10 * 17.4 / 61.0875, 30 * 17.4 / 61.0875])
    assert found["per_minute"].tolist() == pytest.approx(found["information"] / found["minutes"])


def test_theories_count_alike_however_many_subjects_they_made():
    far, near = ("a", 0.0, -900.0), ("b", 0.0, 0.0)
    found = ranked(told([far, far, far, far, near, near]))
    assert found["information"][0] == pytest.approx(information_ends(2)[1] / 2)
    assert found["se"][0] == 0
    assert np.isnan(ranked(told([far, near]))["se"][0])


def test_standard_errors_are_those_of_many_draws():
    random = np.random.default_rng(1)

    def drawn_table():
        rows = [
            (maker, *random.normal((1.0, 0.0) if maker == "a" else (0.0, 1.0), 1.0))
            for maker in "ab"
            for _ in range(20)
        ]
        return told(rows).assign(attempts=random.integers(5, 30, len(rows)))

    many = pd.concat([ranked(drawn_table()) for _ in range(400)])
    assert many["se"].mean() == pytest.approx(many["information"].std(), rel=0.1)


# -- parameters -----------------------------------------------------------------------------------


def test_a_parameter_within_its_range_is_unknown_and_one_outside_is_set():
    thompson = {"policy": "thompson", "forgets": "failures", "forgetting": 0.8}
    plain, slow, flat, other = make_experiment(
        ["CC3"],
        [
            "bayes",
            learner("bayes", label="slow", concentration=60.0, **thompson),
            learner("bayes", label="flat", directness=1.1, **thompson),
            "theory_based",
        ],
    ).learners
    assert [*unknown(plain)] == []
    assert [*unknown(slow)] == ["forgetting", "concentration"]
    assert [*unknown(other)] == ["local_gain", "global_gain", "schema_gain", "edit_weight"]
    (one, two), (shared, _) = (drawn(theory, 1, "theory", [3, 4]) for theory in (slow, flat))
    assert one.parameters["forgetting"] == shared.parameters["forgetting"]
    assert one.parameters["forgetting"] != two.parameters["forgetting"]
    assert one.parameters["policy"] == "thompson"
    makers = drawn(slow, 1, "subject", range(50))
    for name, ends in unknown(slow).items():
        values = [maker.parameters[name] for maker in makers]
        assert ends.low <= min(values) < max(values) <= ends.high
    assert drawn(slow, 1, "subject", [3])[0].parameters != one.parameters


# -- simulated ------------------------------------------------------------------------------------


@pytest.fixture
def asked(tmp_path):
    (tmp_path / "three.yaml").write_text(EXPERIMENT)
    return read_experiment(tmp_path / "three.yaml")


def test_subjects_and_likelihoods_are_those_of_compare_and_score(asked, tmp_path):
    found = told_apart(asked, Effort(draws=1, asked=8), folder=tmp_path / "kept")
    store = Store(tmp_path / "played")
    assert not play(asked, store.folder, workers=1, warn=print)
    record, played = store.record()
    scores = score_actions(record, played, asked.learners, 0.01, draws=Draws(most=8))
    by = ["learner", "condition", "subject"]
    sums = scores.groupby([*by, "scored"], observed=True)["log_probability"].sum().unstack()
    own = found.set_index(by)[[f"nats {name}" for name in sums]].sort_index()
    assert own.to_numpy() == pytest.approx(sums.sort_index().to_numpy(), abs=1e-9)
    actions = scores.groupby(by, observed=True)["action_index"].size().div(len(asked.learners))
    assert found.set_index(by)["actions"].sort_index().tolist() == actions.sort_index().tolist()


def test_workers_and_interruptions_change_nothing(asked, tmp_path):
    effort, folder = Effort(draws=1), tmp_path / "one"
    alone = told_apart(asked, effort, folder=folder, outside=["associative"])
    side = told_apart(asked, effort, folder=tmp_path / "two", outside=["associative"], workers=2)
    pd.testing.assert_frame_equal(alone, side)
    assert [*posterior(alone)] == ["random", "win_stay"]
    assert informed(alone).loc[lambda t: t["learner"] == "associative", "single"].isna().all()
    # More subjects are added to those that are there, and what is kept is not made again.
    more = replace(asked, learners=tuple(replace(one, subjects=3) for one in asked.learners))
    for made_now in ([*range(6, 10)], [9]):
        steps = []
        larger = told_apart(
            more,
            effort,
            folder=folder,
            outside=["associative"],
            report=lambda done, _, steps=steps: steps.append(done),
        )
        assert steps == made_now
        kept = larger[larger["subject"] < 2].reset_index(drop=True)
        pd.testing.assert_frame_equal(kept, alone)
    for path, text in zip(sorted(folder.iterdir()), ("", "[]", '{"a": 1}'), strict=False):
        path.write_text(text)
    again = told_apart(more, effort, folder=folder, outside=["associative"])
    pd.testing.assert_frame_equal(again, larger)


def test_design_writes_conditions_and_subjects(asked, tmp_path):
    out = tmp_path / "out"
    words = ("design", tmp_path / "three.yaml", "--draws", 1, "--workers", 1, "-o", out)
    done = at_once(*words, "--outside", "associative")
    assert done.status == 0, done.stderr
    table = pd.read_csv(out / "conditions.csv")
    shown = next(line.split() for line in done.stdout.splitlines() if line[:9] == "condition")
    assert {*shown} <= {*table.columns}
    assert table["condition"].tolist() == ["CC3"]
    settings = json.loads((out / "design.json").read_text())
    assert (settings["draws"], settings["outside"]) == (1, ["associative"])
    assert len(pd.read_csv(out / "subjects.csv")) == 6


def test_a_theory_does_not_know_the_random_numbers_of_its_subjects(asked):
    """Or a network would predict best what it did itself from the same beginning."""
    spec = asked.learners[0]
    session, maker = made(Cell(asked.name, asked.seed, spec, asked.conditions[0], 0, 1))
    numbers = session.brief.generators[0].random(3).tolist()
    session.play(maker)
    (part,) = recorded_subjects(session.record(), asked)
    assert part.session(spec).brief.generators[0].random(3).tolist() != numbers

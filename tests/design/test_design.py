"""Which theories are told apart, and where in the least time, with parameters known or unknown."""

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
from causal_openlock.design.apart import drawn, told_apart, unknown
from causal_openlock.design.parameters import correlations, searched
from causal_openlock.design.telling import (
    DOUBT,
    FEWEST_OWN,
    bits,
    by_size,
    confusion,
    informed,
    most_bits,
    ranked,
)
from causal_openlock.experiment.declare import Cell
from causal_openlock.experiment.making import learner, make_experiment, read_experiment
from causal_openlock.running.worker import made
from causal_openlock.scoring.recorded import recorded_subjects
from causal_openlock.storage.store import Store
from support.command import at_once
from support.processes import start_prepared
from support.scores import score_actions

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


def test_information_of_made_up_subjects():
    sure, even = math.log(9), 0.0
    found = informed(told([("a", sure, 0.0), ("a", even, 0.0), ("b", sure, 0.0), ("c", 0.0, 0.0)]))
    right, wrong = 0.98 * 0.9 + 0.01, 0.98 * 0.1 + 0.01
    expected = [1 + math.log2(right), 0.0, 1 + math.log2(wrong), np.nan]
    assert found["information"].tolist() == pytest.approx(expected, nan_ok=True)
    assert found["single"].tolist() == pytest.approx([1.0, 0.5, 0.0, np.nan], nan_ok=True)
    assert found["certain"].tolist() == [0.0, 0.0, 0.0, 0.0]
    low, high = math.log2(DOUBT), most_bits(2)
    extreme = informed(told([("a", 0.0, -900.0), ("b", 0.0, -900.0)]))
    assert extreme["information"].tolist() == pytest.approx([high, low])
    assert extreme["certain"].tolist() == [1.0, 1.0]


def test_a_subject_that_acts_like_no_theory_stands_out():
    own = [("a", -30.0 - number, -60.0) for number in range(FEWEST_OWN)]
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
    assert found["information"][0] == pytest.approx(most_bits(2) / 2)
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

    many = pd.concat([ranked(drawn_table()) for _ in range(150)])
    assert many["se"].mean() == pytest.approx(many["information"].std(), rel=0.15)


def test_the_confusion_of_a_hand_made_table():
    # Of the subjects of a, one in four looks like b; b's are clear.
    rows = [("a", 3.0, 0.0)] * 3 + [("a", -1.0, 0.0)] + [("b", -2.0, 0.0)] * 4
    sizes = by_size(told([(maker, a - 9, b - 9) for maker, a, b in rows]))
    assert confusion(sizes).to_numpy().tolist() == [[0.75, 0.25], [0.0, 1.0]]
    groups = confusion(sizes, of_groups=True)
    assert groups.loc["a", "a"] > 0.95
    assert groups.loc["b"].tolist() == [0.0, 1.0]
    assert sizes["subjects"].tolist() == [1, 2, 4, 1, 2, 4]
    alike = by_size(told([("a", -9.0, -9.0), ("b", -9.0, -9.0)]))
    assert (alike[["a", "b"]] == 0.5).all().all()
    table = bits(told([("a", -10.0, -20.0), ("b", -30.0, -15.0)]))
    assert (table * np.log(2) * 30).round(9).to_numpy().tolist() == [[10.0, 20.0], [30.0, 15.0]]


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
    one, two = (drawn(slow, 1, "theory", number) for number in (3, 4))
    shared = drawn(flat, 1, "theory", 3)
    assert one.parameters["forgetting"] == shared.parameters["forgetting"]
    assert one.parameters["forgetting"] != two.parameters["forgetting"]
    assert one.parameters["policy"] == "thompson"
    makers = [drawn(slow, 1, "subject", number) for number in range(50)]
    for name, ends in unknown(slow).items():
        values = [maker.parameters[name] for maker in makers]
        assert ends.low <= min(values) < max(values) <= ends.high
    assert drawn(slow, 1, "subject", 3).parameters != one.parameters


@pytest.fixture
def asked(tmp_path):
    (tmp_path / "three.yaml").write_text(EXPERIMENT)
    return read_experiment(tmp_path / "three.yaml")


def test_subjects_and_likelihoods_are_those_of_compare_and_score(asked, tmp_path):
    found = told_apart(asked, tmp_path / "kept", copies=8)
    store = Store(tmp_path / "played")
    assert not play(asked, store.folder, workers=1, warn=print)
    record, played = store.record()
    scores = score_actions(record, played, asked.learners, 0.01, draws=8)
    by = ["learner", "condition", "subject"]
    sums = scores.groupby([*by, "scored"], observed=True)["log_probability"].sum().unstack()
    own = found.set_index(by)[[f"nats {name}" for name in sums]].sort_index()
    assert own.to_numpy() == pytest.approx(sums.sort_index().to_numpy(), abs=1e-9)
    actions = scores.groupby(by, observed=True)["action_index"].size().div(len(asked.learners))
    assert found.set_index(by)["actions"].sort_index().tolist() == actions.sort_index().tolist()


def test_workers_and_interruptions_change_nothing(asked, tmp_path, monkeypatch):
    start_prepared(monkeypatch)
    folder, settings = tmp_path / "one", {"draws": 1, "outside": ["associative"]}
    alone = told_apart(asked, folder, **settings)
    side = told_apart(asked, tmp_path / "two", workers=2, **settings)
    pd.testing.assert_frame_equal(alone, side)
    assert [name for name in alone if "nats" in name] == ["nats random", "nats win_stay"]
    assert informed(alone).loc[lambda t: t["learner"] == "associative", "single"].isna().all()
    # More subjects are added to those that are there, and what is stored is not made again.
    more = replace(asked, learners=tuple(replace(spec, subjects=3) for spec in asked.learners))
    stored = {path: path.stat().st_mtime_ns for path in folder.glob("steps/*")}
    larger = told_apart(more, folder, **settings)
    kept = larger[larger["subject"] < 2].reset_index(drop=True)
    pd.testing.assert_frame_equal(kept, alone)
    assert stored == {path: path.stat().st_mtime_ns for path in stored}
    assert len([*folder.glob("steps/*")]) == len(larger) == 9


def test_a_theory_does_not_know_the_random_numbers_of_its_subjects(asked):
    """Or a network would predict best what it did itself from the same beginning."""
    spec = asked.learners[0]
    session, maker = made(Cell(asked.name, asked.seed, spec, asked.conditions[0], 0, 1))
    numbers = session.brief.generators[0].random(3).tolist()
    session.play(maker)
    (part,) = recorded_subjects(session.record(), asked)
    assert part.session(spec).brief.generators[0].random(3).tolist() != numbers


def test_design_writes_all_tables_and_continues(asked, tmp_path):
    out = tmp_path / "out"
    words = ["design", tmp_path / "three.yaml", "--draws", 1, "--workers", 1, "-o", out]
    words += ["--outside", "random", "--parameters", "associative", "-s", "temperature=0.02:2:log"]
    words += ["--sets", 3, "--candidates", 2]
    done = at_once(*words)
    assert done.status == 0, done.stderr
    table = pd.read_csv(out / "conditions.csv")
    shown = next(line.split() for line in done.stdout.splitlines() if "per_minute" in line)
    assert shown == [*table.columns]
    assert "of 4 subjects, and" in done.stdout  # too few for an interval
    assert table["condition"].tolist() == ["CC3"]
    settings = json.loads((out / "design.json").read_text())
    assert (settings["draws"], settings["outside"]) == (1, ["random"])
    assert len(pd.read_csv(out / "subjects.csv")) == 6
    sizes = pd.read_csv(out / "confusion.csv")
    assert [*sizes.columns[3:]] == ["win_stay", "associative"]
    assert np.diag(confusion(sizes)).mean() > 0.6
    pairs = pd.read_csv(out / "parameters_associative.csv")
    assert pairs["true"].between(0.02, 2).all()
    assert pairs["at_bound"].isin([True, False]).all()
    steps = {path: path.stat().st_mtime_ns for path in out.rglob("steps/*")}
    assert at_once(*words).status == 0
    assert steps == {path: path.stat().st_mtime_ns for path in out.rglob("steps/*")}


def test_parameters_are_searched_as_the_learner_is_set():
    thompson = learner("bayes", label="t", policy="thompson", forgets="failures")
    (spec,) = make_experiment(["CC3"], [thompson]).learners
    assert [*searched(spec).ranges] == ["forgetting", "concentration", "by_colour", "directness"]
    (own,) = searched(spec, ["lapse=0.01:0.5:log"]).ranges.items()
    assert own[0] == "lapse"


def test_correlations_are_on_the_scale_that_is_searched():
    (spec,) = make_experiment(["CC3"], ["theory_based"]).learners
    space = searched(spec)
    assert space.ranges["local_gain"].log
    assert not space.ranges["edit_weight"].log
    truth = np.array([0.1, 0.2, 0.3, 0.5, 0.9])
    pairs = pd.concat(
        pd.DataFrame({"set": range(5), "parameter": name, "true": truth, "fitted": fitted,
                      "at_bound": fitted > 0.8})
        for name, fitted in (("local_gain", truth**2), ("edit_weight", 0 * truth))
    )  # fmt: skip
    found = correlations(pairs, space)
    assert found.loc["local_gain"].tolist() == pytest.approx([1.0, 5, 1])
    assert np.isnan(found.loc["edit_weight", "r"])

"""The learner that plays by the exact optimum (the optimum itself: tests/belief/test_plans.py)."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from causal_openlock.contract.registry import create
from causal_openlock.experiment.condition import Condition, Trials
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import find_schema
from causal_openlock.schemas.schema import Gate, Schema
from openlock_learners.ideal import Ideal
from oracle import least_attempts
from support.session_play import named, play, trials_of

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("condition", "limit"), [("CC4", 3), ("CE4", 3), ("CC3-CE4", 3), ("chain3", 4), ("two_keys", 3)]
)
def test_it_needs_as_many_attempts_as_the_optimum(condition, limit):
    record = play(create("ideal"), condition, subjects=400 if condition == "CC4" else 150)
    trials = trials_of(record)
    assert (trials["found"] == trials["solutions"]).all()
    for schema, own in trials.groupby("schema", observed=True):
        taken, expected = own["attempts"], least_attempts({find_schema(schema): 1.0}, limit)
        error = taken.std() / math.sqrt(len(taken))
        assert taken.mean() == pytest.approx(expected, abs=4 * error + 1e-9)
    if condition == "CC4":  # what is equally good is drawn by chance
        first = record[(record["attempt"] == 1) & (record["trial"] == 1)]
        for _, actions in first.groupby("layout", observed=True)["actions"]:
            counts = np.unique([each[0] for each in actions], return_counts=True)[1]
            assert len(counts) == 4
            assert counts.min() > counts.max() / 3


UNEVEN = Schema(
    "uneven",
    ["A", "B", "C"],
    {"A": {"C": 0.6}, "B": {"C": 0.9}, "C": {"door": 1.0}},
    gates={"C": Gate("all")},
)


@pytest.mark.parametrize(("schema", "most"), [("noisy_CC3", 4.3), ("seven", 8), (UNEVEN, 4.3)])
def test_where_the_optimum_is_out_of_reach_it_plans_ahead(schema, most):
    subjects = 3 if schema == "seven" else 40
    condition = Condition("x", (Trials(schema),)) if isinstance(schema, Schema) else schema
    trials = trials_of(play(create("ideal"), condition, subjects=subjects))
    assert (trials["found"] == trials["solutions"]).all()
    assert trials["attempts"].mean() < most


def test_it_repeats_solutions_when_there_is_nothing_left_to_find():
    protocol = Protocol("on", 12, stop_when_solved=False, baseline_trials=1)
    record = play(create("ideal"), "CC4", protocol, subjects=20)
    assert record[record["attempt"] > 8]["opened"].all()


def test_it_is_told_no_layout():
    class Blind(Ideal):
        """Is informed of each room's schema and nothing else."""

        def inform(self, truth):
            rooms = [SimpleNamespace(schema=room.schema) for room in truth.rooms]
            super().inform(replace(truth, rooms=tuple(rooms)))

    def actions(learner):
        return Session(named("CC3-CE4"), Protocol("p", 8, True), 5).play(learner)["actions"]

    assert actions(Blind()) == actions(Ideal())

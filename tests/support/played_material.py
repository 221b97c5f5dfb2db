"""Learners that have played, for tests of what is made of it."""

from __future__ import annotations

import pyarrow as pa

from causal_openlock import Condition, Session, find_schema
from causal_openlock.analysis.results.material import Material
from causal_openlock.contract.registry import create
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.protocol import PROTOCOLS
from support.made_up_experiments import spec, stored

HUMAN = PROTOCOLS["human"]


def played(learner: str, *conditions: str, subjects: int = 6) -> Material:
    """What a learner does in some conditions, without a folder."""
    chosen = [Condition.named(name, find_schema) for name in conditions]
    records = [
        Session(one, HUMAN, subjects, seed=3, learner=learner).play(create(learner))
        for one in chosen
    ]
    experiment = Experiment(
        "session", "", 3, subjects, tuple(chosen), (spec(learner, learner=learner),)
    )
    return Material.of(pa.concat_tables(records), stored(experiment))

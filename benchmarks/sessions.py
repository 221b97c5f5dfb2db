"""Sessions against a plain Python loop over the environment that does the same.

Both play random actions under the human protocol (five rooms of CC4, 30 attempts in each, over as
soon as every solution is found) and end with an Arrow table of the attempts.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pyarrow as pa
from measure import Measurement, Row, Target, in_turns, stopwatch

from causal_openlock import Condition, OpenLockEnv, Session, find_schema
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.world.room import published_layouts
from openlock_learners.random import RandomLearner

SUBJECTS, SUBJECTS_IN_THE_LOOP = 4096, 64
HUMAN = PROTOCOLS["human"]
TARGET = Target("at least", 3e6, on="ours")


def session(repeats: int) -> Iterator[Row]:
    """A session of many subjects."""
    for case, set_up, target in (
        ("set-up and Arrow table included", True, TARGET),
        ("Arrow table included", False, None),
    ):
        mine, others = in_turns(_session(set_up), _plain_loop, repeats)
        said = f"{SUBJECTS:,} random subjects, {case}"
        yield Row("session", said, "actions/s", mine, "plain loop", others, target)


def _session(set_up: bool) -> Measurement:
    condition = Condition.named("CC4", find_schema)

    def begin() -> Session:
        return Session(condition, HUMAN, SUBJECTS)

    def measure() -> float:
        begun = None if set_up else begin()
        with stopwatch() as seconds:
            record = (begun or begin()).play(RandomLearner())
            took = seconds()
        return len(record["actions"].combine_chunks().flatten()) / took

    return measure


def _plain_loop() -> float:
    generator = np.random.default_rng(0)
    schema = find_schema("CC4")
    rooms = {
        layout: OpenLockEnv(schema, layout, reward="paper") for layout in published_layouts(schema)
    }
    for room in rooms.values():
        room.reset(seed=0)
    layouts = list(rooms)
    columns: dict[str, list[Any]] = {
        name: [] for name in ("subject", "trial", "layout", "attempt", "actions", "reward")
    }
    with stopwatch() as seconds:
        for subject in range(SUBJECTS_IN_THE_LOOP):
            order = generator.permutation(len(layouts))[: HUMAN.baseline_trials]
            for trial, layout in enumerate(order.tolist()):
                room = rooms[layouts[layout]]
                _, info = room.reset(options={"new_trial": True})
                drawn = generator.integers(15, size=(HUMAN.attempt_limit, 3)).tolist()
                for attempt, actions in enumerate(drawn):
                    if attempt:
                        room.reset()
                    earned, done = 0.0, []
                    for action in actions:
                        _, reward, over, _, info = room.step(action)
                        earned += reward
                        done.append(action)
                        if over:
                            break
                    row = (subject, trial + 1, layouts[layout], attempt + 1, done, earned)
                    for column, value in zip(columns.values(), row, strict=True):
                        column.append(value)
                    if not info["console"]["solutions_left"]:
                        break
        table = pa.table(columns)
        took = seconds()
    return len(table["actions"].combine_chunks().flatten()) / took

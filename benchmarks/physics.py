"""The physical room: how fast it is played, and whether it agrees with the symbolic one.

The benchmark plays it at random through ``gymnasium.make``. Started by itself, this file checks the
agreement as a whole instead: for each of the paper's schemas every one of the 3,375 sequences of
three actions in one layout, and 500 random ones in random layouts (:func:`agreement`); some
minutes on one core.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import gymnasium
import numpy as np
from measure import Row, Target, in_turns, stopwatch

import causal_openlock
from causal_openlock.physics.room import PhysicalRoom
from causal_openlock.schemas.finding import find_schema
from causal_openlock.schemas.fsm import compile_schema
from causal_openlock.world.room import Layout, Room

LEAST = 40
"""Actions per second on one core that a person or a film needs at the least."""
AUTHORS = "the authors' Box2D mode: 3.6 actions/s"
ROOMS = {"CC3": "trial1", "CE3": "trial1", "CC4": "trial7", "CE4": "trial7"}


def physics(repeats: int) -> Iterator[Row]:
    """Random actions, half of them aimed at what is grey or the door."""
    actions = 150
    env = gymnasium.make(causal_openlock.ENV_ID, schema="CC4", layout="trial7", physics=True)
    generator = np.random.default_rng(0)
    lively = generator.choice([*np.flatnonzero(env.reset(seed=0)[0][7:14]), 14], size=actions)
    anything = generator.integers(15, size=actions)
    chosen = np.where(generator.random(actions) < 0.5, lively, anything).tolist()
    told: dict[str, Any] = {}

    def measure() -> float:
        env.reset(seed=0)
        with stopwatch() as seconds:
            for action in chosen:
                _, _, terminated, truncated, info = env.step(action)
                told.update(info["physics"])
                if terminated or truncated:
                    env.reset()
            return actions / seconds()

    mine, _ = in_turns(measure, None, repeats)
    broken = f"{told['unfinished']} movements not finished" if told["unfinished"] else ""
    target = Target("at least", LEAST, on="ours")
    said = "physics=True, random actions"
    yield Row("physics", said, "actions/s", mine, target=target, broken=broken, note=AUTHORS)


@dataclass
class Agreement:
    """What came of playing sequences of actions in a physical room and in its tables.

    Attributes:
        sequences: Sequences played.
        actions: Actions in them.
        differing: Actions after which the two were not seen alike.
        unfinished: Movements that were not finished.
        steps: Steps of the simulation.
        longest: Steps of the longest movement.
    """

    sequences: int = 0
    actions: int = 0
    differing: int = 0
    unfinished: int = 0
    steps: int = 0
    longest: int = 0

    def play(self, room: Room, sequences: Iterable[Iterable[int]]) -> None:
        """Play each sequence from the start of an attempt."""
        physical = PhysicalRoom(room.fsm, room.layout)
        for sequence in sequences:
            physical.reset()
            state = 0
            self.sequences += 1
            for action in sequence:
                movement = physical.act(action)
                state = int(room.next_state[state, action])
                seen = physical.observation()
                self.actions += 1
                self.differing += not np.array_equal(seen, room.observation[state])
                self.unfinished += not movement.finished
                self.steps += movement.steps
                self.longest = max(self.longest, movement.steps)


def agreement(name: str, others: int = 500) -> Agreement:
    """Every sequence of three actions in a published layout, and others in random ones."""
    schema = find_schema(name)
    result = Agreement()
    result.play(Room.of(schema, ROOMS[name]), product(range(15), repeat=3))
    generator = np.random.default_rng(0)
    fsm = compile_schema(schema)
    for sequence in generator.integers(15, size=(others, 3)).tolist():
        result.play(Room(fsm, Layout.random(schema, generator)), [sequence])
    return result


if __name__ == "__main__":
    for name in ROOMS:
        with stopwatch() as seconds:
            result = agreement(name)
            print(name, result, f"{result.actions / seconds():.0f} actions/s", flush=True)

"""Rooms of many schemas in one table: each, stepped among others, is the oracle's room.

Rooms that are not put back, and those of one schema: tests/envs/test_envs.py.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.testing import schemas
from causal_openlock.world.kernel import AFTER, PAYER
from causal_openlock.world.rewards import find_reward
from causal_openlock.world.room import Layout
from causal_openlock.world.rooms import Rooms, RoomTables
from oracle import Room as Trial
from oracle import Rules

BUNDLED = bundled_schemas()
LEVERS = [f"L{index}" for index in range(12)]
FIELDS = (
    *("first", "last", "inactive", "changed", "unlocks", "unlocked"),
    *("opens", "on_path", "repeated", "new", "retraced", "found"),
)


def six_of_twelve(strength):
    edges = {lever: {DOOR: strength} for lever in LEVERS}
    return Schema("six_of_twelve", LEVERS, edges, gates={DOOR: Gate("at_least", 6)})


def total(fields):
    """The fields of events as one number: a digit for each, the number found last."""
    return sum(field * 2.0**power for power, field in enumerate(fields))


def every_field(events):
    """A reward that tells each field of the events."""
    return total(getattr(events, name) for name in FIELDS)


def late(events):
    """A reward that only the second solution makes a difference to."""
    return 3.0 * (events.found >= 2)


class Subject:
    """One of the rooms of a batch, by the oracle."""

    def __init__(self, schema, layout, limit, positions):
        self.rules = Rules.of(schema).at(dict(zip(schema.levers, layout.places, strict=True)))
        self.solutions = [
            frozenset(layout.places[schema.levers.index(lever)] for lever in levers)
            for levers in schema.solutions
        ]
        self.room, self.attempt = Trial(self.rules, positions, limit), 1
        self.begin()

    def begin(self):
        self.room.begin()
        self.done = []  # what each action moved, None for nothing

    def begun(self):
        """The solutions that the actions so far are the beginning of."""
        pushes = [node for verb, node in filter(None, self.done) if verb == "push"]
        if len(pushes) < len(self.done) or len(set(pushes)) < len(pushes):
            return set()
        levers = {node for node in pushes if node != DOOR}
        return {
            solution
            for solution in self.solutions
            if levers <= solution and (DOOR not in pushes or levers == solution)
        }

    def step(self, action, luck):
        """The fields of the event of an action."""
        room, before = self.room, [self.rules.solution(levers) for levers in self.room.found]
        event = room.step(action, luck)
        verb, node = room.named(action)
        self.done.append((verb, node) if event.moved else None)
        stands = self.rules.solution(room.pushed)
        return (
            event.first, room.over, node != DOOR and node not in self.rules.causes, event.moved,
            event.unlocks, self.rules.holds(DOOR, room.pushed), event.opens, bool(self.begun()),
            event.repeated, stands is not None and stands not in before,
            bool(self.begun() & {*before}), len(before),
        )  # fmt: skip

    def useful(self, generator):
        """An action: those that lead to a solution more often than chance would have it."""
        room, positions, found = self.room, self.room.positions, self.room.found
        if generator.random() < 0.15 and room.previous is not None:
            return room.previous
        if generator.random() < 0.7:
            if self.rules.holds(DOOR, room.pushed):
                return 2 * positions
            left = [s for s in self.solutions if room.pushed <= s and s not in found]
            goal = left[generator.integers(len(left))] if left else set(self.rules.levers)
            could = sorted(p for p in goal - room.pushed if self.rules.holds(p, room.pushed))
            return could[generator.integers(len(could))] if could else 2 * positions
        return int(generator.integers(2 * positions + 1))


def play(drawn, positions, seed, stop_when_solved=True, more=(-1, 0, 1), steps=40):
    """Play trial after trial in one batch, and compare each action's outcome with the oracle's.

    Returns how often the door was opened. Layouts are random, and attempts have a few actions
    ``more`` than the schemas need.
    """
    generator = np.random.default_rng(seed)
    limits = [max(1, one.least_action_limit + int(generator.choice(more))) for one in drawn]
    tables = RoomTables.of([*zip(drawn, limits, strict=True)], positions)
    size, limit, opened, kept = 2 * len(drawn), 4, 0, []
    payers = [find_reward(every_field), find_reward(late)]
    batch = Rooms(tables, payers, size, limit, stop_when_solved=stop_when_solved)
    batch.state.situation[:, PAYER] = np.arange(size) % 2
    subjects = {}

    def begin(which):
        chosen = generator.integers(len(drawn), size=len(which))
        layouts = [Layout.random(drawn[number], generator, positions) for number in chosen]
        batch.begin_trials(which, chosen, np.array([layout.lever_at() for layout in layouts]))
        for row, number, layout in zip(which, chosen, layouts, strict=True):
            subjects[row] = Subject(drawn[number], layout, limits[number], positions)

    begin([*range(size)])
    for _ in range(steps):
        action = np.array([subjects[row].useful(generator) for row in range(size)])
        luck, finished = generator.random(size), []
        taken = batch.step(action, luck, seen=True)
        seen, console = batch.observation, batch.console
        kept += [(array, array.copy()) for array in (seen, console, *taken)]
        for row, subject in subjects.items():
            room, found = subject.room, len(subject.room.found)
            fields = subject.step(int(action[row]), luck[row])
            assert taken.seen[row].tolist() == room.observation()
            assert tables.used[batch.now(AFTER)[row]] == room.used
            left, opened = len(subject.solutions) - len(room.found), opened + room.opened
            ends = room.over and (subject.attempt == limit or (stop_when_solved and not left))
            paid = 3.0 * (fields[-1] >= 2) if row % 2 else total(fields)
            outcome = [array[row] for array in taken[:4]]
            assert outcome == [paid, room.over, ends, len(room.found) > found]
            if room.over:
                subject.attempt += 1
                subject.begin()
            assert seen[row].tolist() == room.observation()
            attempts = 0 if ends else limit + 1 - subject.attempt
            assert console[row].tolist() == [
                left, len(room.found), attempts, room.action_limit - room.used
            ]  # fmt: skip
            standing = {*map(subject.rules.solution, room.found)}
            which = {k for k, levers in enumerate(subject.solutions) if levers in standing}
            assert {*np.flatnonzero(batch.state.found[row])} == which
            finished += [row] * ends
        if finished:
            begin(finished)
    assert all((array == copied).all() for array, copied in kept)
    return opened


@settings(max_examples=30, deadline=None)
@given(
    drawn=st.lists(
        schemas(max_levers=5, stochastic=True) | st.sampled_from([*BUNDLED.values()]),
        min_size=2, max_size=4, unique=True,
    ),
    seed=st.integers(0, 1000),
    stop=st.booleans(),
)  # fmt: skip
def test_rooms_of_a_batch_are_the_oracles(drawn, seed, stop):
    play(drawn, 7, seed, stop)


@pytest.mark.parametrize("strength", [1.0, 0.9])
def test_rooms_of_twelve_levers_and_924_solutions(strength):
    drawn = [six_of_twelve(strength), BUNDLED["seven"], six_of_twelve(strength)]
    assert play(drawn, 12, seed=0, more=[1], steps=60) > 5

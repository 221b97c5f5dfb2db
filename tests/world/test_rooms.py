"""Many rooms in one table: each of them, stepped among others, is the oracle's room."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.testing import schemas
from causal_openlock.world.kernel import (
    ACTIONS_LEFT,
    AFTER,
    ATTEMPTS_LEFT,
    PAYER,
    SOLUTIONS_FOUND,
    SOLUTIONS_LEFT,
)
from causal_openlock.world.rewards import TERMS, find_reward
from causal_openlock.world.room import Layout
from causal_openlock.world.rooms import Rooms, RoomTables
from oracle import WEIGHTS, Rules, reward
from oracle import Room as Trial

BUNDLED = bundled_schemas()
LEVERS = [f"L{index}" for index in range(12)]


def six_of_twelve(strength):
    edges = {lever: {DOOR: strength} for lever in LEVERS}
    return Schema("six_of_twelve", LEVERS, edges, gates={DOOR: Gate("at_least", 6)})


FIELDS = (
    *("first", "last", "inactive", "changed", "unlocks", "unlocked"),
    *("opens", "on_path", "repeated", "new", "retraced", "found"),
)


def every_field(events):
    """A reward that tells each field of the events: a digit for each, the number found last."""
    return sum(getattr(events, name) * 2.0**power for power, name in enumerate(FIELDS))


def late(events):
    """A reward that only the second solution makes a difference to."""
    return 3.0 * (events.found >= 2)


def rules_at(schema, layout):
    return Rules.of(schema).at(dict(zip(schema.levers, layout.places, strict=True)))


class Subject:
    """One of the rooms of a batch, by the oracle."""

    def __init__(self, schema, layout, limit, positions):
        self.schema, self.rules = schema, rules_at(schema, layout)
        self.solutions = [
            frozenset(layout.places[schema.levers.index(lever)] for lever in levers)
            for levers in schema.solutions
        ]
        self.room, self.attempt = Trial(self.rules, positions, limit), 1
        self.done = []

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

    def step(self, action, luck, terms, weights):
        """What an action did, and what is paid: by terms, or by one of the functions above."""
        room, before = self.room, [self.rules.solution(each) for each in self.room.found]
        event = room.step(action, luck)
        verb, node = room.named(action)
        self.done.append((verb, node) if event.moved else None)
        stands = self.rules.solution(room.pushed)
        fields = [
            event.first, room.over, node != DOOR and node not in self.rules.causes, event.moved,
            event.unlocks, self.rules.holds(DOOR, room.pushed), event.opens, bool(self.begun()),
            event.repeated, stands is not None and stands not in before,
            bool(self.begun() & {*before}), len(before),
        ]  # fmt: skip
        if terms == "every_field":
            return event, sum(value * 2.0**power for power, value in enumerate(fields))
        return event, 3.0 * (len(before) >= 2) if terms == "late" else reward(event, terms, weights)

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


def play(rooms, positions, generator, put_back, stop_when_solved, steps=40):
    """Rooms in one batch, trial after trial, each compared with the oracle's after every action."""
    tables = RoomTables.of([(schema, limit) for schema, _, limit in rooms], positions)
    terms = [
        sorted(TERMS)[i] for i in generator.permutation(len(TERMS))[: generator.integers(1, 7)]
    ]
    drawn = {name: float(generator.integers(-5, 9)) for name in WEIGHTS}
    own = {name: value for name, value in drawn.items()
           if name in terms or (name in ("unlock", "open") and "basic" in terms)}  # fmt: skip
    payers = [(terms, WEIGHTS), (terms, WEIGHTS | own), ("every_field", None), ("late", None)]
    forms = [terms, {"terms": terms, **own}, every_field, late]
    functions = [*map(find_reward, forms)]
    size, limit = 2 * len(rooms), 4
    batch = Rooms(tables, functions, size, limit, stop_when_solved=stop_when_solved,
                  put_back=put_back)  # fmt: skip
    batch.state.situation[:, PAYER] = np.arange(size) % 4
    subjects = [None] * size

    def begin(which):
        chosen = generator.integers(len(rooms), size=len(which))
        batch.begin_trials(which, chosen, np.array([rooms[n][1].lever_at() for n in chosen]))
        for row, number in zip(which, chosen.tolist(), strict=True):
            subjects[row] = Subject(*rooms[number], positions)

    begin([*range(size)])
    kept = []
    opened = 0
    for _ in range(steps):
        action = np.array([subject.useful(generator) for subject in subjects])
        waits = generator.random(size) < 0.05 * put_back
        luck = generator.random(size)
        resets = [subject.room.over for subject in subjects]  # only where they are not put back
        asked = np.where(waits, tables.waits, action)
        taken, finished = batch.step(asked, luck, seen=True), []
        seen, console = batch.observation, batch.console
        kept += [(array, array.copy()) for array in (seen, console, *taken)]
        for row, subject in enumerate(subjects):
            room, expected = subject.room, (False, False, False, 0.0)
            if waits[row]:
                room.previous = None  # what comes after waiting repeats nothing
            elif resets[row]:
                room.begin()
                subject.done = []
            else:
                payer = payers[row % 4]
                event, paid = subject.step(int(action[row]), luck[row], *payer)
                new = event.opens and event.new
                every = len(room.found) == len(subject.solutions)
                solved = stop_when_solved and every
                ends = room.over and (solved or subject.attempt >= limit)
                expected, opened = (room.over, ends, new, paid), opened + event.opens
                subject.attempt += room.over and not ends
                if ends:
                    finished.append(row)
            got = (taken.attempt_over, taken.trial_over, taken.new_solution, taken.reward)
            assert tuple(each[row] for each in got) == pytest.approx(expected)
            assert console[row, SOLUTIONS_FOUND] == len(room.found)
            assert console[row, SOLUTIONS_LEFT] == len(subject.solutions) - len(room.found)
            found = {k for k, levers in enumerate(subject.solutions)
                     if levers in map(subject.rules.solution, room.found)}  # fmt: skip
            assert set(np.flatnonzero(batch.state.found[row])) == found
            if not waits[row] and not resets[row]:
                assert taken.seen[row].tolist() == room.observation()
                assert tables.used[batch.now(AFTER)[row]] == room.used
            if put_back and room.over:
                room.begin()
                subject.done = []
            assert seen[row].tolist() == room.observation()
            left = 0 if room.over else room.action_limit - room.used
            assert console[row, ACTIONS_LEFT] == left
            if row not in finished and not room.over:
                assert console[row, ATTEMPTS_LEFT] == limit + 1 - subject.attempt
        if finished:
            begin(finished)
    assert all((array == copied).all() for array, copied in kept)
    return opened


def rooms_of(drawn, positions, generator):
    """The schemas in random layouts with an action more or less than they need."""
    return [
        (
            schema,
            Layout.random(schema, generator, positions),
            max(1, schema.least_action_limit + int(generator.integers(-1, 2))),
        )
        for schema in drawn
    ]


@settings(max_examples=30, deadline=None)
@given(
    drawn=st.lists(
        schemas(max_levers=5, stochastic=True) | st.sampled_from([*BUNDLED.values()]),
        min_size=2, max_size=4, unique=True,
    ),
    seed=st.integers(0, 1000),
    put_back=st.booleans(),
    stop=st.booleans(),
)  # fmt: skip
def test_rooms_of_a_batch_are_the_oracles(drawn, seed, put_back, stop):
    generator = np.random.default_rng(seed)
    play(rooms_of(drawn, 7, generator), 7, generator, put_back, stop)


@pytest.mark.parametrize("strength", [1.0, 0.9])
def test_rooms_of_twelve_levers_and_924_solutions(strength):
    generator = np.random.default_rng(0)
    drawn = [six_of_twelve(strength), BUNDLED["seven"], six_of_twelve(strength)]
    rooms = [(schema, Layout.random(schema, generator, 12), 8) for schema in drawn]
    assert play(rooms, 12, generator, True, True, steps=60) > 5

"""The compiled tables against a second reading of the graph that knows no tables and no bits."""

from __future__ import annotations

from itertools import product
from math import prod
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.schemas.fsm import FSM, NO_SOLUTION, compile_schema, unroll
from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.testing import schemas

BUNDLED = bundled_schemas()
Action = tuple[str, str]
Seen = tuple[frozenset[str], bool]
"""Which levers are pushed, and whether the door is open."""


# -- the second reading ---------------------------------------------------------------------------


def enough(schema: Schema, node: str, met: list[bool]) -> bool:
    """Whether so many of its causes are enough for a node."""
    gate = schema.graph.nodes[node]["gate"]
    if gate.kind == "any":
        return any(met)
    return all(met) if gate.kind == "all" else sum(met) >= gate.k


def is_unlocked(schema: Schema, pushed: frozenset[str]) -> bool:
    return enough(schema, DOOR, [cause in pushed for cause in schema.graph.predecessors(DOOR)])


def chance_by_hand(schema: Schema, node: str, pushed: frozenset[str]) -> float:
    """Probability that ``node`` gives way: every way in which its causes may transmit, added up."""
    causes = list(schema.graph.predecessors(node))
    if not causes:
        return 1.0
    total = 0.0
    for outcome in product([True, False], repeat=len(causes)):
        transmits = [schema.graph.edges[cause, node]["strength"] for cause in causes]
        likely = prod(
            (strength if cause in pushed else 0.0)
            if transmitted
            else (1 - strength if cause in pushed else 1.0)
            for cause, strength, transmitted in zip(causes, transmits, outcome, strict=True)
        )
        total += likely * enough(schema, node, list(outcome))
    return total


def effect_by_hand(schema: Schema, seen: Seen, action: Action) -> tuple[Seen, float]:
    """Where an action leads if it takes effect, and how probable that is."""
    pushed, opened = seen
    verb, node = action
    if node == DOOR:
        if opened or not is_unlocked(schema, pushed):
            return seen, 0.0
        return (pushed, True), chance_by_hand(schema, DOOR, pushed)
    if (verb == "push") == (node in pushed):
        return seen, 0.0
    chance = chance_by_hand(schema, node, pushed)
    return (pushed ^ {node}, opened) if chance else seen, chance


def solution_by_hand(schema: Schema, pushed: frozenset[str]) -> int:
    found = [
        index
        for index, solution in enumerate(schema.solutions)
        if frozenset(solution) == pushed - frozenset(schema.inert)
    ]
    return found[0] if found else NO_SOLUTION


def actions_of(schema: Schema) -> list[Action]:
    return [(verb, lever) for verb in ("push", "pull") for lever in schema.levers] + [
        ("push", DOOR)
    ]


def seen_in(fsm: FSM, state: int) -> Seen:
    """What a state of the machine means, from its number written in binary."""
    door, *levers = format(state, f"0{fsm.levers + 1}b")
    names = reversed(fsm.schema.levers)
    return frozenset(n for n, bit in zip(names, levers, strict=True) if bit == "1"), door == "1"


def agrees(fsm: FSM, state: int, action: int) -> None:
    schema = fsm.schema
    seen = seen_in(fsm, state)
    after, chance = effect_by_hand(schema, seen, actions_of(schema)[action])
    assert seen_in(fsm, fsm.next_state[state, action]) == after
    assert fsm.chance[state, action] == pytest.approx(chance, rel=1e-9)
    assert (fsm.chance[state, action] > 0) == (after != seen)


# -- one machine ----------------------------------------------------------------------------------


@settings(max_examples=120, deadline=None)
@given(schema=schemas(max_levers=4, stochastic=True))
def test_every_entry_of_the_tables_agrees_with_the_graph(schema: Schema) -> None:
    fsm = compile_schema(schema)
    assert fsm.states == 2 ** (len(schema.levers) + 1)
    assert fsm.actions == len(actions_of(schema))
    for state in range(fsm.states):
        pushed, opened = seen_in(fsm, state)
        assert fsm.unlocked[state] == is_unlocked(schema, pushed)
        assert fsm.solution[state] == solution_by_hand(schema, pushed)
        assert fsm.opened[state] == opened
        assert fsm.state(tuple(pushed), opened) == state
        for action in range(fsm.actions):
            agrees(fsm, state, action)


@settings(max_examples=100, deadline=None)
@given(schema=schemas(max_levers=7, stochastic=True), data=st.data())
def test_larger_machines_agree_in_samples(schema: Schema, data: st.DataObject) -> None:
    fsm = compile_schema(schema)
    for state in data.draw(st.lists(st.integers(0, fsm.states - 1), min_size=5, max_size=5)):
        pushed, _ = seen_in(fsm, state)
        assert fsm.unlocked[state] == is_unlocked(schema, pushed)
        assert fsm.solution[state] == solution_by_hand(schema, pushed)
        for action in range(fsm.actions):
            agrees(fsm, state, action)


@settings(max_examples=10, deadline=None)
@given(
    schema=schemas(max_levers=12, stochastic=True).filter(lambda schema: len(schema.levers) >= 9),
    seed=st.integers(0, 1000),
)
def test_machines_of_up_to_twelve_levers_agree_in_samples(schema: Schema, seed: int) -> None:
    fsm = compile_schema(schema)
    generator = np.random.default_rng(seed)
    for state in generator.integers(0, fsm.states, 4):
        assert fsm.unlocked[state] == is_unlocked(schema, seen_in(fsm, state)[0])
        for action in generator.integers(0, fsm.actions, 4):
            agrees(fsm, int(state), int(action))


@settings(max_examples=60, deadline=None)
@given(schema=schemas(max_levers=7))
def test_certain_strengths_leave_nothing_to_chance(schema: Schema) -> None:
    fsm = compile_schema(schema)
    assert set(np.unique(fsm.chance)) <= {0.0, 1.0}
    assert np.array_equal(fsm.chance == 1.0, fsm.next_state != np.arange(fsm.states)[:, None])


def test_the_solutions_are_the_states_that_pushing_them_leads_to() -> None:
    for schema in BUNDLED.values():
        fsm = compile_schema(schema)
        for index, solution in enumerate(schema.solutions):
            state = 0
            for lever in solution:
                state = fsm.next_state[state, schema.levers.index(lever)]
            assert fsm.solution[state] == index
            assert fsm.unlocked[state]
            state = fsm.next_state[state, -1]
            assert fsm.opened[state]
            assert fsm.solution[state] == index


def test_the_door_locks_again_when_the_last_enabling_lever_is_pulled() -> None:
    fsm = compile_schema(BUNDLED["CC4"])
    names = [fsm.action_name(action) for action in range(fsm.actions)]

    def after(*actions: str) -> str:
        state = 0
        for action in actions:
            state = fsm.next_state[state, names.index(action)]
        return fsm.describe(state)

    assert after("push L1") == "all pulled, locked"
    assert after("push L0", "push L1") == "L0 L1 pushed, unlocked"
    # L1 stays out and the door unlocked without L0, which now holds L1 where it is.
    assert after("push L0", "push L1", "pull L0") == "L1 pushed, unlocked"
    assert after("push L0", "push L1", "pull L0", "pull L1") == "L1 pushed, unlocked"
    assert after("push L0", "push L1", "pull L1") == "L0 pushed, locked"
    assert after("push L0", "push L1", "push L2", "pull L1") == "L0 L2 pushed, unlocked"
    assert after("push L0", "push L1", "push door", "pull L1") == "L0 pushed, locked, open"


@pytest.mark.parametrize(
    ("gate", "chance"),
    [
        (Gate("any"), 1 - 0.5 * 0.8 * 0.75),
        (Gate("all"), 0.5 * 0.2 * 0.25),
        (
            Gate("at_least", 2),  # A and B, A and C, B and C, or all three
            0.5 * 0.2 * 0.75 + 0.5 * 0.8 * 0.25 + 0.5 * 0.2 * 0.25 + 0.5 * 0.2 * 0.25,
        ),
    ],
    ids=str,
)
def test_chance_is_noisy_or_noisy_and_or_something_between(gate: Gate, chance: float) -> None:
    schema = Schema(
        "noisy", ["A", "B", "C"], {"A": {DOOR: 0.5}, "B": {DOOR: 0.2}, "C": {DOOR: 0.25}},
        gates={DOOR: gate},
    )  # fmt: skip
    fsm = compile_schema(schema)
    everything = fsm.state(("A", "B", "C"))
    assert fsm.unlocked[everything]
    assert fsm.chance[everything, -1] == pytest.approx(chance)


# -- an attempt, moment by moment -----------------------------------------------------------------


class History:
    """An attempt by hand: the room, and what was done in it."""

    def __init__(self, schema: Schema, action_limit: int) -> None:
        self.schema, self.action_limit = schema, action_limit
        self.seen: Seen = (frozenset(), False)
        self.done: list[tuple[Action, bool]] = []

    def take(self, action: Action | None, takes_effect: bool) -> None:
        """Take an action; without one, act on a lever that is not part of the schema."""
        if action is None:
            self.done.append((("push", "inactive"), False))
            return
        after, _ = effect_by_hand(self.schema, self.seen, action)
        moved = takes_effect and after != self.seen
        self.seen = after if moved else self.seen
        self.done.append((action, moved))

    @property
    def over(self) -> bool:
        return self.seen[1] or len(self.done) == self.action_limit

    def begins(self, solution: tuple[str, ...]) -> bool:
        """Whether what was done is the beginning of one of the orders, and did what it does."""
        wholes = [
            [*(("push", lever) for lever in order), ("push", DOOR)]
            for order in self.schema.orders(solution)
        ]
        actions = [action for action, _ in self.done]
        return all(moved for _, moved in self.done) and any(
            whole[: len(actions)] == actions for whole in wholes
        )


@settings(max_examples=150, deadline=None)
@given(
    schema=schemas(max_levers=6, stochastic=True),
    extra=st.integers(-1, 2),
    seed=st.integers(0, 10_000),
)
def test_walking_rows_is_walking_states_and_remembers_what_a_history_would(
    schema: Schema, extra: int, seed: int
) -> None:
    fsm = compile_schema(schema)
    limit = max(1, schema.least_action_limit + extra)
    attempt = unroll(fsm, limit)
    generator = np.random.default_rng(seed)
    for _ in range(8):
        row, history = 0, History(schema, limit)
        # Mostly what a solution asks for, since chance alone seldom opens a door.
        orders = list(schema.orders(schema.solutions[generator.integers(len(schema.solutions))]))
        plan = [
            *(schema.levers.index(lever) for lever in orders[generator.integers(len(orders))]),
            fsm.actions - 1,
        ]
        while not history.over:
            agrees_with(attempt, row, history)
            moment = len(history.done)
            follows = moment < len(plan) and generator.random() < 0.8
            action = plan[moment] if follows else int(generator.integers(fsm.actions + 1))
            chance = attempt.chance[row, action]
            takes_effect = generator.random() < max(chance, 0.7 * (chance > 0))
            idle = attempt.effect[row, fsm.actions]
            row = attempt.effect[row, action] if takes_effect or chance == 0.0 else idle
            history.take([*actions_of(schema), None][action], bool(takes_effect))
        agrees_with(attempt, row, history)
        # An attempt that is over stays where it is.
        assert (attempt.effect[row] == row).all()
        assert not attempt.chance[row].any()


def agrees_with(attempt: Any, row: int, history: History) -> None:
    fsm, schema = attempt.fsm, history.schema
    assert seen_in(fsm, attempt.state[row]) == history.seen
    assert attempt.used[row] == len(history.done)
    assert attempt.over[row] == history.over
    begins = [history.begins(solution) for solution in schema.solutions]
    assert attempt.begins[row].tolist() == begins
    if not history.over:
        for index, action in enumerate(actions_of(schema)):
            _, chance = effect_by_hand(schema, history.seen, action)
            assert attempt.chance[row, index] == pytest.approx(chance, rel=1e-9)
        assert attempt.chance[row, fsm.actions] == 0.0


@settings(max_examples=60, deadline=None)
@given(schema=schemas(max_levers=6, stochastic=True), limit=st.integers(1, 6))
def test_an_attempt_has_each_state_at_each_moment_once_and_only_those_it_can_reach(
    schema: Schema, limit: int
) -> None:
    fsm = compile_schema(schema)
    attempt = unroll(fsm, limit)
    rows = list(zip(attempt.used.tolist(), attempt.state.tolist(), strict=True))
    reached: set[tuple[int, int]] = {(0, 0)}
    for moment in range(limit):
        for state in [state for used, state in reached if used == moment]:
            if not seen_in(fsm, state)[1]:
                reached |= {(moment + 1, after) for after in {state, *fsm.next_state[state]}}
    assert len(set(rows)) == len(rows)
    assert set(rows) == reached
    assert rows[0] == (0, 0)


def test_the_papers_attempt_is_small() -> None:
    attempt = unroll(compile_schema(BUNDLED["CC4"]), 3)
    assert attempt.begins[0].all()
    assert attempt.fsm.opened[attempt.state].sum() == 3
    assert len(attempt.state) < 40


def test_an_inert_push_on_the_way_leaves_the_path_but_opens_the_door() -> None:
    keys = BUNDLED["two_keys"]  # L0 and L1 unlock, L2 is a decoy
    attempt = unroll(compile_schema(keys), 4)
    row = 0
    for action in (0, 2, 1):
        row = attempt.effect[row, action]
    assert attempt.fsm.solution[attempt.state[row]] == 0
    assert not attempt.begins[row].any()
    row = attempt.effect[row, attempt.fsm.actions - 1]
    assert attempt.fsm.opened[attempt.state[row]]
    assert not attempt.begins[row].any()

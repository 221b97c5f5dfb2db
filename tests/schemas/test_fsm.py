"""The compiled tables, and attempts unrolled from them, against the oracle."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.schemas.fsm import compile_schema, unroll
from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.testing import schemas
from oracle import Room as Trial
from oracle import Rules

BUNDLED = bundled_schemas()
LEVERS = [f"L{index}" for index in range(12)]
SIX_OF_TWELVE = Schema(
    "six_of_twelve",
    LEVERS,
    {lever: {DOOR: 0.9} for lever in LEVERS},
    gates={DOOR: Gate("at_least", 6)},
)


def pushed_in(fsm, state):
    return frozenset(lever for bit, lever in enumerate(fsm.schema.levers) if state >> bit & 1)


def check_states(schema, states):
    """Everything that the tables say of these states, door closed and open."""
    fsm, rules = compile_schema(schema), Rules.of(schema)
    levers = list(schema.levers)
    actions = [(verb, lever) for verb in ("push", "pull") for lever in levers] + [("push", DOOR)]
    solutions = [frozenset(levers) for levers in schema.solutions]
    assert fsm.states == 2 ** (len(levers) + 1)
    assert fsm.next_state.shape == fsm.chance.shape == (fsm.states, len(actions))
    assert [fsm.action_name(i) for i in range(fsm.actions)] == [" ".join(a) for a in actions]
    assert set(solutions) == rules.solutions
    assert set(schema.inert) == rules.inert
    for state in states:
        pushed, opened = pushed_in(fsm, state), bool(state >> len(levers))
        solution = rules.solution(pushed)
        assert fsm.state(tuple(pushed), opened) == state
        assert fsm.opened[state] == opened
        assert fsm.unlocked[state] == rules.holds(DOOR, pushed)
        assert fsm.solution[state] == (-1 if solution is None else solutions.index(solution))
        for action, (verb, node) in enumerate(actions):
            can = not opened if node == DOOR else (verb == "pull") == (node in pushed)
            chance = rules.chance(node, pushed) if can else 0.0
            after = (pushed, True) if node == DOOR else (pushed ^ {node}, opened)
            after = after if chance else (pushed, opened)
            assert fsm.chance[state, action] == pytest.approx(chance, rel=1e-9)
            assert fsm.chance[state, action] <= 1
            assert fsm.next_state[state, action] == fsm.state(tuple(after[0]), after[1])


@settings(max_examples=60, deadline=None)
@given(schema=schemas(max_levers=5, stochastic=True))
def test_tables_of_random_schemas(schema):
    check_states(schema, range(2 ** (len(schema.levers) + 1)))


@pytest.mark.parametrize("schema", [*BUNDLED.values(), SIX_OF_TWELVE], ids=lambda s: s.name)
def test_tables_of_bundled_schemas_and_of_924_solutions(schema):
    every = range(2 ** (len(schema.levers) + 1))
    check_states(schema, every if len(every) < 1000 else [*every[:3], *every[63:8000:331], 4096])


# -- attempts --------------------------------------------------------------------------------------


def begins(rules, solution, done):
    """Whether actions, all of which took effect, are the beginning of one of its orders."""
    pushes = [node for verb, node in done if verb == "push" and node != DOOR]
    opens = done[-1:] == [("push", DOOR)]
    if len(done) != len(pushes) + opens or len(set(pushes)) < len(pushes):
        return False
    return set(pushes) <= solution and (not opens or set(pushes) == solution)


def check_row(attempt, row, trial, done):
    """Everything that a row says, after ``done``: the actions, None for one without effect."""
    fsm, rules = attempt.fsm, trial.rules
    levers = list(fsm.schema.levers)
    roles = frozenset(levers[place] for place in trial.pushed)
    assert attempt.state[row] == fsm.state(tuple(roles), trial.opened)
    assert attempt.used[row] == trial.used
    assert attempt.over[row] == trial.over
    expected = [
        None not in done and begins(rules, frozenset(map(levers.index, solution)), done)
        for solution in fsm.schema.solutions
    ]
    assert attempt.begins[row].tolist() == expected
    chances = [0.0 if trial.over else trial.can_do(action) for action in range(fsm.actions)]
    assert attempt.chance[row].tolist() == pytest.approx([*chances, 0.0], rel=1e-9)


@settings(max_examples=80, deadline=None)
@given(
    schema=schemas(max_levers=6, stochastic=True)
    | st.sampled_from([*BUNDLED.values()]).filter(lambda s: len(s.levers) < 7),
    extra=st.integers(-1, 2),
    seed=st.integers(0, 10_000),
)
def test_rows_of_an_attempt_are_what_its_actions_lead_to(schema, extra, seed):
    limit = max(1, schema.least_action_limit + extra)
    attempt, levers = unroll(compile_schema(schema), limit), len(schema.levers)
    rules = Rules.of(schema).at(dict(zip(schema.levers, range(levers), strict=True)))
    generator = np.random.default_rng(seed)
    for _ in range(6):
        row, trial, done = 0, Trial(rules, levers, limit), []
        # Mostly what a solution asks for, since chance alone seldom opens a door.
        order = schema.solutions[generator.integers(len(schema.solutions))]
        plan = [*map(schema.levers.index, order), 2 * levers]
        while not trial.over:
            check_row(attempt, row, trial, done)
            follows = trial.used < len(plan) and generator.random() < 0.8
            action = plan[trial.used] if follows else int(generator.integers(2 * levers + 2))
            if action > 2 * levers:  # on a lever that is not part of the schema
                trial.used, moved = trial.used + 1, False
            else:
                lucky = generator.random() < 0.7
                named = trial.named(action)
                moved = trial.step(action, luck=0.0 if lucky else 1.0).moved
            done.append(named if moved else None)
            effect = moved or attempt.chance[row, action] == 0.0
            row = attempt.effect[row, action if effect else 2 * levers + 1]
        check_row(attempt, row, trial, done)
        assert (attempt.effect[row] == row).all()  # what is over stays where it is
    rows = np.column_stack([attempt.used, attempt.state])  # each state that can be reached, once
    assert len(np.unique(rows, axis=0)) == len(rows)
    assert {*range(1, len(rows))} <= {*attempt.effect.ravel().tolist()}

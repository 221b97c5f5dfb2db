"""The compiled tables against the oracle; attempts unrolled from them are tested with rooms."""

import pytest
from hypothesis import given, settings

from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.schemas.fsm import compile_schema
from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.testing import schemas
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

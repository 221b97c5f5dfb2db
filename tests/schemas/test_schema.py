"""What a schema means, by itself and compiled, against the oracle; and when two schemas are one."""

import networkx as nx
import pytest
from hypothesis import given, settings

from causal_openlock.schemas.finding import bundled_schemas, schema
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


def check_graph(schema, rules):
    """Solutions, each in an order that works, and the causes of every node."""
    assert {*map(frozenset, schema.solutions)} == rules.solutions
    assert len(schema.solutions) == len(rules.solutions)
    assert schema.least_action_limit == 1 + max(map(len, rules.solutions))
    assert {*schema.inert} == rules.inert
    for solution in schema.solutions:
        assert all(rules.holds(lever, {*solution[:at]}) for at, lever in enumerate(solution))
    for node, causes in rules.causes.items():
        assert dict(zip(schema.causes(node), schema.strengths(node), strict=True)) == causes
        assert list(schema.causes(node)) == [lever for lever in schema.levers if lever in causes]
        assert schema.threshold(node) == rules.needed[node]
    strengths = [strength for causes in rules.causes.values() for strength in causes.values()]
    assert schema.deterministic == all(strength == 1 for strength in strengths)


def check_tables(schema, rules, states):
    """Everything that the tables say of these states, door closed and open."""
    fsm, levers = compile_schema(schema), list(schema.levers)
    actions = [(verb, lever) for verb in ("push", "pull") for lever in levers] + [("push", DOOR)]
    solutions = [frozenset(solution) for solution in schema.solutions]
    assert fsm.states == 2 ** (len(levers) + 1)
    assert fsm.next_state.shape == fsm.chance.shape == (fsm.states, len(actions))
    assert [fsm.action_name(i) for i in range(fsm.actions)] == [" ".join(a) for a in actions]
    for state in states:
        pushed = frozenset(lever for bit, lever in enumerate(levers) if state >> bit & 1)
        opened = bool(state >> len(levers))
        solution = rules.solution(pushed)
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
            assert fsm.next_state[state, action] == schema.mask(after[0]) | after[1] << len(levers)


@settings(max_examples=60, deadline=None)
@given(drawn=schemas(max_levers=5, stochastic=True))
def test_any_schema_is_what_the_oracle_says(drawn):
    check_graph(drawn, Rules.of(drawn))
    check_tables(drawn, Rules.of(drawn), range(2 ** (len(drawn.levers) + 1)))


@pytest.mark.parametrize("schema", [*BUNDLED.values(), SIX_OF_TWELVE], ids=lambda s: s.name)
def test_bundled_schemas_and_924_solutions_are_what_the_oracle_says(schema):
    check_graph(schema, Rules.of(schema))
    every = range(2 ** (len(schema.levers) + 1))
    states = every if len(every) < 1000 else [*every[:3], *every[63:8000:331], 4096]
    check_tables(schema, Rules.of(schema), states)


def test_solutions_are_in_the_order_of_levers():
    assert list(BUNDLED)[:4] == ["CC3", "CE3", "CC4", "CE4"]
    assert BUNDLED["CE3"].solutions == (("L1", "L0"), ("L2", "L0"))
    assert [" ".join(solution) for solution in BUNDLED["seven"].solutions] == [
        "L0 L1 L2", "L0 L3 L5", "L1 L4 L6",
    ]  # fmt: skip
    assert repr(BUNDLED["CC3"]) == "<Schema CC3: 3 levers, 2 solutions>"


def test_schemas_are_equal_if_they_mean_the_same_in_the_same_words():
    one = schema("S: A -> B, door; B -> door")
    any_of = {"A": ["B", DOOR], "B": {DOOR: 1.0}}
    for same in (schema("S: B -> door; A -> door, B; A, B"), Schema("S", ["A", "B"], any_of)):
        assert (one, hash(one)) == (same, hash(same))
    for other in (
        schema("S: A -> B; A & B -> door"),
        schema("S: A -> B (0.5), door; B -> door"),
        schema("S: B, A; A -> B, door; B -> door"),
        schema("T: A -> B, door; B -> door"),
        Schema("S", ["A", "B"], any_of, title="another"),
        "S",
    ):
        assert one != other


def test_a_schema_cannot_be_changed_through_its_graph():
    with pytest.raises(nx.NetworkXError):
        BUNDLED["CC3"].graph.add_edge("L1", "L2")

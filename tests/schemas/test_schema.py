"""A schema's meaning: what unlocks the door, and when two schemas are one."""

import networkx as nx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from causal_openlock.schemas.finding import bundled_schemas, schema
from causal_openlock.schemas.schema import DOOR, Schema
from causal_openlock.testing import schemas
from oracle import Rules

BUNDLED = bundled_schemas()


def test_solutions_of_bundled_schemas():
    assert list(BUNDLED)[:4] == ["CC3", "CE3", "CC4", "CE4"]
    assert BUNDLED["CE3"].solutions == (("L1", "L0"), ("L2", "L0"))
    assert BUNDLED["seven"].solutions == (
        ("L0", "L1", "L2"), ("L0", "L3", "L5"), ("L1", "L4", "L6"),
    )  # fmt: skip
    assert BUNDLED["seven"].least_action_limit == 4
    assert repr(BUNDLED["CC3"]) == "<Schema CC3: 3 levers, 2 solutions>"


@settings(max_examples=150, deadline=None)
@given(drawn=schemas(max_levers=6, stochastic=True) | st.sampled_from([*BUNDLED.values()]))
def test_solutions_are_those_of_the_oracle(drawn):
    rules = Rules.of(drawn)
    assert {*map(frozenset, drawn.solutions)} == rules.solutions
    assert len(drawn.solutions) == len(rules.solutions)
    assert drawn.least_action_limit == 1 + max(map(len, rules.solutions))
    assert {*drawn.inert} == rules.inert

    for solution in drawn.solutions:  # in an order that works
        assert all(rules.holds(lever, {*solution[:at]}) for at, lever in enumerate(solution))
    for node, causes in rules.causes.items():
        assert dict(zip(drawn.causes(node), drawn.strengths(node), strict=True)) == causes
        assert list(drawn.causes(node)) == [lever for lever in drawn.levers if lever in causes]
        assert drawn.threshold(node) == rules.needed[node]
    certain = all(strength == 1 for own in rules.causes.values() for strength in own.values())
    assert drawn.deterministic == certain


# -- equality --------------------------------------------------------------------------------------


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

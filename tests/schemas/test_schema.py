"""A schema's meaning: what unlocks the door, and when two schemas are one."""

import pickle
import subprocess
import sys

import networkx as nx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.testing import schemas
from oracle import Rules
from support.waiting import HANGS

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
@given(schema=schemas(max_levers=6, stochastic=True) | st.sampled_from([*BUNDLED.values()]))
def test_solutions_are_those_of_the_oracle(schema):
    rules = Rules.of(schema)
    assert {*map(frozenset, schema.solutions)} == rules.solutions
    assert len(schema.solutions) == len(rules.solutions)
    assert schema.least_action_limit == 1 + max(map(len, rules.solutions))
    assert {*schema.inert} == rules.inert

    for solution in schema.solutions:  # in an order that works
        assert all(rules.holds(lever, {*solution[:at]}) for at, lever in enumerate(solution))
    for node, causes in rules.causes.items():
        assert dict(zip(schema.causes(node), schema.strengths(node), strict=True)) == causes
        assert list(schema.causes(node)) == [lever for lever in schema.levers if lever in causes]
        assert schema.threshold(node) == rules.needed[node]
    certain = all(strength == 1 for own in rules.causes.values() for strength in own.values())
    assert schema.deterministic == certain


# -- equality --------------------------------------------------------------------------------------


def test_schemas_are_equal_if_they_mean_the_same_in_the_same_words():
    one = Schema("S", ["A", "B"], {"A": ["B", DOOR], "B": {DOOR: 1.0}})
    spelled = {"B": Gate("any"), DOOR: Gate("any", 2)}  # k says nothing to any
    for same in (
        Schema("S", ["A", "B"], {"B": [DOOR], "A": [DOOR, "B"]}),
        Schema("S", ["A", "B"], {"A": ["B", DOOR], "B": [DOOR]}, gates=spelled),
    ):
        assert one == same
        assert hash(one) == hash(same)
    for other in (
        Schema("S", ["A", "B"], {"A": ["B", DOOR], "B": [DOOR]}, gates={DOOR: Gate("all")}),
        Schema("S", ["A", "B"], {"A": {"B": 0.5, DOOR: 1.0}, "B": [DOOR]}),
        Schema("S", ["B", "A"], {"A": ["B", DOOR], "B": [DOOR]}),
        Schema("T", ["A", "B"], {"A": ["B", DOOR], "B": [DOOR]}),
        Schema("S", ["A", "B"], {"A": ["B", DOOR], "B": [DOOR]}, title="another"),
        "S",
    ):
        assert one != other


def test_a_schema_cannot_be_changed_through_its_graph():
    with pytest.raises(nx.NetworkXError):
        BUNDLED["CC3"].graph.add_edge("L1", "L2")


def test_a_pickled_schema_is_the_same_key_in_another_process():
    schema = BUNDLED["CC4"]
    hash(schema)
    code = (
        "import pickle, sys; from causal_openlock import find_schema;"
        "sent = pickle.load(sys.stdin.buffer); assert {find_schema('CC4'): 1}[sent] == 1"
    )
    subprocess.run(
        [sys.executable, "-c", code], input=pickle.dumps(schema), check=True, timeout=HANGS
    )

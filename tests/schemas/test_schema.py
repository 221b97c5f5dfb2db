"""A schema's meaning: what unlocks the door, in which orders, and which graphs are refused."""

from __future__ import annotations

import pickle
import subprocess
import sys
from itertools import chain, combinations, permutations
from typing import Any

import networkx as nx
import pytest
from hypothesis import given, settings

from causal_openlock.errors import SchemaError
from causal_openlock.schemas.finding import bundled_schemas, find_schema
from causal_openlock.schemas.schema import DOOR, MAX_LEVERS, Gate, Schema
from causal_openlock.testing import schemas
from support.waiting import HANGS

BUNDLED = bundled_schemas()


# -- a room by hand -------------------------------------------------------------------------------


def holds(schema: Schema, node: str, pushed: set[str]) -> bool:
    """Whether a gate holds, read off the graph."""
    met = [cause in pushed for cause in schema.graph.predecessors(node)]
    gate = schema.graph.nodes[node]["gate"]
    if not met:
        return node != DOOR
    return {"any": any(met), "all": all(met)}.get(gate.kind, sum(met) >= gate.k)


def pushed_by_hand(schema: Schema, order: tuple[str, ...]) -> set[str] | None:
    """What is pushed after pushing in this order, or nothing if one of the levers did not move."""
    pushed: set[str] = set()
    for lever in order:
        if not holds(schema, lever, pushed):
            return None
        pushed.add(lever)
    return pushed


def unlocks(schema: Schema, order: tuple[str, ...]) -> bool:
    pushed = pushed_by_hand(schema, order)
    return pushed is not None and holds(schema, DOOR, pushed)


def subsets(levers: tuple[str, ...]) -> chain[tuple[str, ...]]:
    return chain.from_iterable(combinations(levers, size) for size in range(len(levers) + 1))


# -- solutions of known schemas -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "solutions", "limit"),
    [
        ("CC3", [("L0", "L1"), ("L0", "L2")], 3),
        ("CE3", [("L1", "L0"), ("L2", "L0")], 3),
        ("CC4", [("L0", "L1"), ("L0", "L2"), ("L0", "L3")], 3),
        ("CE4", [("L1", "L0"), ("L2", "L0"), ("L3", "L0")], 3),
        ("chain3", [("L0", "L1", "L2")], 4),
        ("noisy_CC3", [("L0", "L1"), ("L0", "L2")], 3),
        ("two_keys", [("L0", "L1")], 3),
        (
            "two_of_four",
            [("L0", "L1"), ("L0", "L2"), ("L0", "L3"), ("L1", "L2"), ("L1", "L3"), ("L2", "L3")],
            3,
        ),
        ("seven", [("L0", "L1", "L2"), ("L0", "L3", "L5"), ("L1", "L4", "L6")], 4),
        ("same_keys", [("L0", "L1", "L4"), ("L0", "L1", "L5")], 4),
        ("shared_key", [("L0", "L1", "L4"), ("L0", "L2", "L5")], 4),
        ("own_keys", [("L0", "L1", "L4"), ("L2", "L3", "L5")], 4),
    ],
)
def test_solutions_of_the_bundled_schemas(
    name: str, solutions: list[tuple[str, ...]], limit: int
) -> None:
    assert BUNDLED[name].solutions == tuple(solutions)
    assert BUNDLED[name].least_action_limit == limit


def test_every_bundled_schema_has_its_worked_example_above() -> None:
    assert set(BUNDLED) == {
        *("CC3", "CE3", "CC4", "CE4", "chain3", "noisy_CC3", "two_keys", "two_of_four", "seven"),
        *("same_keys", "shared_key", "own_keys"),
    }
    assert list(BUNDLED)[:4] == ["CC3", "CE3", "CC4", "CE4"]


def test_a_common_cause_has_to_be_pushed_first_and_two_keys_do_not() -> None:
    assert list(BUNDLED["CC4"].orders(("L2", "L0"))) == [("L0", "L2")]
    assert list(BUNDLED["CE4"].orders(("L0", "L3"))) == [("L3", "L0")]
    assert list(BUNDLED["two_keys"].orders(("L1", "L0"))) == [("L0", "L1"), ("L1", "L0")]
    assert list(BUNDLED["seven"].orders(("L0", "L1", "L2"))) == [
        ("L0", "L1", "L2"),
        ("L1", "L0", "L2"),
    ]
    assert list(BUNDLED["chain3"].orders(("L0", "L2"))) == []


def test_an_order_is_told_causes_first_whatever_the_levers_are_called() -> None:
    back = Schema("back", ["A", "B", "C"], {"C": ["B"], "B": ["A"], "A": [DOOR]})
    assert back.solutions == (("C", "B", "A"),)
    assert list(back.orders(back.solutions[0])) == [("C", "B", "A")]


def test_what_a_gate_makes_of_the_same_edges() -> None:
    edges = {lever: [DOOR] for lever in ("A", "B", "C")}

    def solutions(gate: Gate) -> tuple[tuple[str, ...], ...]:
        return Schema("gate", "ABC", edges, gates={DOOR: gate}).solutions

    assert solutions(Gate("any")) == (("A",), ("B",), ("C",))
    assert solutions(Gate("at_least", 2)) == (("A", "B"), ("A", "C"), ("B", "C"))
    assert solutions(Gate("at_least", 3)) == solutions(Gate("all")) == (("A", "B", "C"),)


def test_a_longer_way_to_the_door_is_no_solution_if_a_part_of_it_is_one() -> None:
    shortcut = Schema("s", ["A", "B"], {"A": ["B", DOOR], "B": [DOOR]})
    assert shortcut.solutions == (("A",),)


def test_twelve_levers_are_solved_as_well() -> None:
    levers = [f"L{index}" for index in range(MAX_LEVERS)]
    quorum = Schema(
        "quorum", levers, {x: [DOOR] for x in levers}, gates={DOOR: Gate("at_least", 6)}
    )
    assert len(quorum.solutions) == 924  # 12 choose 6
    assert quorum.least_action_limit == 7


# -- solutions of random schemas ------------------------------------------------------------------


@settings(max_examples=150, deadline=None)
@given(schema=schemas(max_levers=7))
def test_each_order_of_each_solution_unlocks_the_door_and_no_part_of_it_does(
    schema: Schema,
) -> None:
    assert schema.solutions
    for solution in schema.solutions:
        orders = list(schema.orders(solution))
        assert solution in orders
        assert len(set(orders)) == len(orders)
        assert all(unlocks(schema, order) and set(order) == {*solution} for order in orders)
        for part in subsets(solution):
            if len(part) < len(solution):
                assert not any(unlocks(schema, order) for order in permutations(part))


@settings(max_examples=150, deadline=None)
@given(schema=schemas(max_levers=5))
def test_solutions_and_orders_agree_with_trying_every_order_of_every_subset(
    schema: Schema,
) -> None:
    working = {
        frozenset(subset): {order for order in permutations(subset) if unlocks(schema, order)}
        for subset in subsets(schema.levers)
    }
    working = {subset: orders for subset, orders in working.items() if orders}
    minimal = {
        subset: orders
        for subset, orders in working.items()
        if not any(other < subset for other in working)
    }
    assert {frozenset(solution) for solution in schema.solutions} == set(minimal)
    assert len(schema.solutions) == len(minimal)
    for subset, orders in minimal.items():
        assert set(schema.orders(subset)) == orders
    assert schema.least_action_limit == 1 + max(map(len, minimal))


@settings(max_examples=100, deadline=None)
@given(schema=schemas(max_levers=7, stochastic=True))
def test_chance_changes_no_solution(schema: Schema) -> None:
    certain = Schema(
        schema.name,
        schema.levers,
        {lever: list(schema.graph.successors(lever)) for lever in schema.levers},
        gates={
            node: gate
            for node, gate in schema.graph.nodes(data="gate")
            if schema.graph.in_degree(node)
        },
        inert=schema.inert,
    )
    assert certain.solutions == schema.solutions
    assert certain.deterministic
    assert (certain == schema) == schema.deterministic


# -- what is refused ------------------------------------------------------------------------------

FINE: dict[str, Any] = {
    "name": "fine",
    "levers": ["A", "B", "C"],
    "edges": {"A": ["B"], "B": [DOOR], "C": [DOOR]},
}
REFUSED: list[tuple[str, dict[str, Any], tuple[Any, ...], str]] = [
    ("a cycle", {"edges": {"B": ["A"], "A": ["B"], "C": [DOOR, "A"]}}, ("edges", "A", "B"),
     "A -> B -> A is a cycle"),
    ("a cycle that leads to the door", {"edges": {"C": ["A"], "B": ["C"], "A": ["B", DOOR]}},
     ("edges", "A", "B"), "A -> B -> C -> A is a cycle"),
    ("a cycle behind a lever", {"edges": {"A": ["C"], "B": ["C"], "C": ["B", DOOR]}},
     ("edges", "B", "C"), "B -> C -> B is a cycle"),
    ("a lever that enables itself", {"edges": {"A": ["B"], "B": [DOOR], "C": ["C", DOOR]}},
     ("edges", "C", "C"), "C -> C is a cycle"),
    ("an unknown cause", {"edges": {"A": ["B"], "B": [DOOR], "c": [DOOR]}}, ("edges", "c"),
     "did you mean C?"),
    ("an unknown effect", {"edges": {"A": ["B"], "B": ["dor"], "C": [DOOR]}},
     ("edges", "B", "dor"), "did you mean door?"),
    ("a door that enables", {"edges": {DOOR: ["A"]}}, ("edges", DOOR), "enables nothing"),
    ("a lever listed twice", {"levers": ["A", "B", "A"]}, ("levers", 2), "listed twice"),
    ("a door among the levers", {"levers": ["A", DOOR]}, ("levers", 1), "the door is not a lever"),
    ("no lever", {"levers": []}, ("levers",), "at least one lever"),
    ("a bad name for a lever", {"levers": ["A", "B", "1C"]}, ("levers", 2), "'1C' is not a valid"),
    ("a bad name", {"name": "no-dash"}, ("name",), "letters, digits and underscores"),
    ("an empty name", {"name": ""}, ("name",), "begin with a letter"),
    ("a name with a line break", {"name": "CC3\n"}, ("name",), "begin with a letter"),
    ("a title that no file can hold", {"title": "a\0b"}, ("title",), "U+0000"),
    ("no edges", {"edges": {}}, ("edges",), "nothing unlocks the door"),
    ("no edge to the door", {"edges": {"A": ["B", "C"]}}, ("edges",), "nothing unlocks the door"),
    ("a lever on no path", {"edges": {"A": ["B"], "B": [DOOR]}}, ("levers", 2), "on no path"),
    ("a lever on a dead end", {"edges": {"A": [DOOR], "B": ["C"]}, "inert": ["C"]}, ("levers", 1),
     "lever B is on no path"),
    ("an inert lever that leads to the door", {"inert": ["A"]}, ("inert", 0),
     "cannot be inert"),
    ("an unknown inert lever", {"inert": ["D"]}, ("inert", 0), "'D' is unknown"),
    ("an inert lever twice", {"edges": {"A": [DOOR], "B": [DOOR]}, "inert": ["C", "C"]},
     ("inert", 1), "listed twice"),
    ("a strength of 0", {"edges": {"A": {"B": 0.0}, "B": [DOOR], "C": [DOOR]}},
     ("edges", "A", "B", "strength"), "above 0"),
    ("a strength below 0", {"edges": {"A": {"B": -0.5}, "B": [DOOR], "C": [DOOR]}},
     ("edges", "A", "B", "strength"), "above 0"),
    ("a strength above 1", {"edges": {"A": ["B"], "B": {DOOR: 1.01}, "C": [DOOR]}},
     ("edges", "B", DOOR, "strength"), "at most 1"),
    ("a strength that is no number", {"edges": {"A": ["B"], "B": {DOOR: float("nan")}}},
     ("edges", "B", DOOR, "strength"), "nan"),
    ("a gate that can never hold", {"gates": {DOOR: Gate("at_least", 3)}}, ("gates", DOOR),
     "can never hold"),
    ("a gate that asks for nothing", {"gates": {DOOR: Gate("at_least", 0)}}, ("gates", DOOR),
     "require 1 to 2"),
    ("a gate of a free lever", {"gates": {"A": Gate("all")}}, ("gates", "A"), "no cause"),
    ("a gate of nobody", {"gates": {"D": Gate("all")}}, ("gates", "D"), "'D' is unknown"),
    ("a gate of no known kind", {"gates": {DOOR: Gate("al")}}, ("gates", DOOR),
     "did you mean all?"),
    ("more levers than positions", {"levers": [f"L{i}" for i in range(MAX_LEVERS + 1)]},
     ("levers",), "13 levers are more than the 12 positions"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "at", "said"), [row[1:] for row in REFUSED], ids=[row[0] for row in REFUSED]
)
def test_a_schema_without_meaning_is_refused_with_its_place(
    changes: dict[str, Any], at: tuple[Any, ...], said: str
) -> None:
    Schema(**FINE)
    with pytest.raises(SchemaError) as caught:
        Schema(**{**FINE, **changes})
    assert caught.value.at == at
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_strengths_of_1_and_just_above_0_are_fine() -> None:
    noisy = Schema("noisy", ["A"], {"A": {DOOR: 1e-9}})
    assert not noisy.deterministic
    assert Schema("certain", ["A"], {"A": {DOOR: 1.0}}).deterministic


def test_a_decoy_may_hang_on_a_lever_that_matters_and_on_another_decoy() -> None:
    decoys = Schema("decoys", ["A", "B", "C"], {"A": [DOOR, "B"], "B": ["C"]}, inert=["C", "B"])
    assert decoys.solutions == (("A",),)


# -- equality -------------------------------------------------------------------------------------


def test_schemas_are_equal_if_they_mean_the_same_in_the_same_words() -> None:
    one = Schema("S", ["A", "B"], {"A": ["B", DOOR], "B": {DOOR: 1.0}}, gates={DOOR: Gate("all")})
    same = Schema("S", ["A", "B"], {"B": [DOOR], "A": [DOOR, "B"]}, gates={DOOR: Gate("all")})
    assert one == same
    assert hash(one) == hash(same)
    any_gate = Schema("S", ["A", "B"], {"A": ["B", DOOR], "B": [DOOR]})
    assert one != any_gate
    spelled = {"B": Gate("any"), DOOR: Gate("any", 2)}  # k says nothing to any
    assert any_gate == Schema("S", "AB", {"A": ["B", DOOR], "B": [DOOR]}, gates=spelled)
    assert any_gate != Schema("S", "AB", {"A": {"B": 0.5, DOOR: 1.0}, "B": [DOOR]})
    assert any_gate != Schema("S", "BA", {"A": ["B", DOOR], "B": [DOOR]})
    assert any_gate != Schema("T", "AB", {"A": ["B", DOOR], "B": [DOOR]})
    assert any_gate != "S"


def test_a_schema_cannot_be_changed_through_its_graph() -> None:
    with pytest.raises(nx.NetworkXError):
        BUNDLED["CC3"].graph.add_edge("L1", "L2")


def test_a_pickled_schema_is_the_same_key_in_another_process() -> None:
    schema = find_schema("CC4")
    hash(schema)
    code = (
        "import pickle, sys; from causal_openlock import find_schema;"
        "sent = pickle.load(sys.stdin.buffer); assert {find_schema('CC4'): 1}[sent] == 1"
    )
    subprocess.run(
        [sys.executable, "-c", code], input=pickle.dumps(schema), check=True, timeout=HANGS
    )

"""Structures as arrays do what their schemas do."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings

from causal_openlock.belief.structures import (
    Structures,
    gate_dags,
    linear_extensions,
    members,
    merge,
)
from causal_openlock.schemas.fsm import compile_schema
from causal_openlock.testing import schemas
from support.belief_by_hand import (
    arrays_of,
    every_gate_dag,
    partition,
    plain_of,
    plains_of,
    transcript,
)


@settings(max_examples=80, deadline=None)
@given(schemas(max_levers=6))
def test_a_structure_does_what_its_schema_does(schema):
    own, fsm, n = arrays_of([plain_of(schema)]), compile_schema(schema), len(schema.levers)
    for pushed in range(1 << n):
        holds = own.holds(pushed)[0]
        assert holds[n] == fsm.unlocked[pushed]
        for lever in range(n):
            action = lever + n * (pushed >> lever & 1)
            assert holds[lever] == (fsm.chance[pushed, action] > 0)
    solutions = {int(mask) for mask in np.flatnonzero(own.solutions()[0])}
    assert solutions == {schema.mask(levers) for levers in schema.solutions}
    assert int(own.inert()[0]) == schema.mask(schema.inert)


@settings(max_examples=40, deadline=None)
@given(schemas(max_levers=5))
def test_a_set_works_if_and_only_if_some_order_of_pushes_unlocks_the_door(schema):
    working, fsm = arrays_of([plain_of(schema)]).working(), compile_schema(schema)
    works = members(working, len(schema.levers))[0]
    reached, new = {0}, {0}
    while new:  # by pushes alone
        pushes = fsm.next_state[sorted(new), : len(schema.levers)]
        new = set(pushes.ravel().tolist()) - reached
        reached |= new
    assert set(np.flatnonzero(works)) == {state for state in reached if fsm.unlocked[state]}


def rows(structures: Structures) -> list[tuple[int, ...]]:
    return [(*c, *t) for c, t in zip(structures.causes.tolist(), structures.threshold.tolist(),
                                     strict=True)]  # fmt: skip


@pytest.mark.parametrize("levers", [1, 2, 3])
def test_every_gate_dag_is_listed_once(levers):
    ours = rows(gate_dags(levers))
    assert len(set(ours)) == len(ours)
    assert set(ours) == set(rows(arrays_of(every_gate_dag(levers))))


@pytest.mark.parametrize(("levers", "dags"), [(1, 1), (2, 3), (3, 25), (4, 543)])
def test_the_levers_of_gate_dags_are_all_labelled_dags(levers, dags):
    causes = np.unique(gate_dags(levers).causes[:, :levers], axis=0)
    assert len(causes) == dags  # OEIS A003024
    for row in causes.tolist():
        arrows = [(c, e) for e, mask in enumerate(row) for c in range(levers) if mask >> c & 1]
        assert nx.is_directed_acyclic_graph(nx.DiGraph(arrows))


@pytest.mark.parametrize(
    ("levers", "dags", "any_or_all", "solvable"), [(3, 79, 206, 6), (4, 3377, 15354, 56)]
)
def test_there_are_as_many_as_others_counted(levers, dags, any_or_all, solvable):
    # Counted by recurrence and by another program: the door is the only sink, gates are any or
    # all, attempts have three actions; solvable: levers - 1 solutions of two levers each.
    every = gate_dags(levers)
    sink = every[every.inert() == 0]
    assert len(np.unique(sink.causes, axis=0)) == dags
    plain = (sink.threshold <= 1) | (sink.threshold == np.bitwise_count(sink.causes))
    chosen = sink[plain.all(axis=1)]
    assert len(chosen) == any_or_all
    first, _ = merge(chosen.behaviour(3))
    two = np.bitwise_count(np.arange(1 << levers)) == 2
    found = chosen[first].solutions()
    assert ((found.sum(axis=1) == levers - 1) & ~found[:, ~two].any(axis=1)).sum() == solvable


@pytest.mark.parametrize("levers", [2, 3, 4])
def test_linear_extensions_are_topological_orders(levers):
    dags = np.unique(gate_dags(levers).causes[:, :levers], axis=0)
    causes = np.column_stack([dags, np.zeros(len(dags), dtype=np.uint16)])
    counted = linear_extensions(causes)
    chosen = range(0, len(dags), 7 if levers == 4 else 1)
    for index in chosen:
        graph = nx.DiGraph()
        graph.add_nodes_from(range(levers))
        graph.add_edges_from(
            (c, e) for e, mask in enumerate(dags[index].tolist())
            for c in range(levers) if mask >> c & 1
        )  # fmt: skip
        assert counted[index] == sum(1 for _ in nx.all_topological_sorts(graph))


@settings(max_examples=40, deadline=None)
@given(schemas(max_levers=5))
def test_levers_with_other_names_make_the_same_graph(schema):
    own, n = plain_of(schema), len(schema.levers)
    order = np.random.default_rng(n).permutation(n)
    relabelled = plains_of(arrays_of([own]).on_slots(order, n))[0]
    for was, now in enumerate([*order.tolist(), n]):
        assert relabelled.causes[now] == {int(order[cause]) for cause in own.causes[was]}
        assert relabelled.threshold[now] == own.threshold[was]


@pytest.mark.parametrize("strength", [1.0, 0.7])
@pytest.mark.parametrize(("levers", "action_limit"), [(1, 2), (2, 1), (2, 2), (2, 3), (2, 4),
                                                      (3, 2), (3, 3)])  # fmt: skip
def test_behaviours_are_equal_exactly_if_no_attempt_tells_them_apart(
    levers, action_limit, strength
):
    every = gate_dags(levers)
    _, alike = merge(every.behaviour(action_limit, uncertain=strength < 1))
    seen = partition(transcript(plain, action_limit, strength) for plain in plains_of(every))
    assert partition(alike.tolist()) == seen
    assert levers < 3 or 1 < max(seen) + 1 < len(every)


@pytest.mark.parametrize("strength", [1.0, 0.7])
def test_four_levers_are_alike_exactly_if_no_attempt_tells_them_apart(strength):
    # Structures that are thought to be alike, and some more; door first, for transcripts are long.
    every = gate_dags(4)
    behaviour = every.behaviour(3, uncertain=strength < 1)
    _, alike = merge(behaviour)
    generator = np.random.default_rng(0)
    large = np.flatnonzero(np.bincount(alike) > 1)
    pairs = [generator.permutation(np.flatnonzero(alike == group))[:3]
             for group in generator.permutation(large)[:15]]  # fmt: skip
    chosen = np.unique(np.concatenate([*pairs, generator.permutation(len(every))[:30]]))
    _, alike = merge(behaviour[chosen])
    seen = partition(transcript(plain, 3, strength) for plain in plains_of(every[chosen]))
    assert partition(alike.tolist()) == seen

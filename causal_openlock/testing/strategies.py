"""Hypothesis strategies: any schema and layout that is valid.

A test that holds for whatever these draw holds for schemas that no author thought of, and
Hypothesis finds the smallest one for which it fails:

>>> from hypothesis import find
>>> find(schemas(max_levers=2), lambda schema: len(schema.solutions) == 2).as_dict()["edges"]
{'L0': ['door'], 'L1': ['door']}
"""

from __future__ import annotations

import networkx as nx
from hypothesis import strategies as st

from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.world.room import Layout, positions_for

UNTITLED = st.just("")


@st.composite
def schemas(
    draw: st.DrawFn,
    max_levers: int = 7,
    stochastic: bool = False,
    titles: st.SearchStrategy[str] = UNTITLED,
) -> Schema:
    """Any valid schema: a random DAG with gates and, where it has to be, inert levers.

    With ``stochastic``, edges may have strengths below 1. Titles are drawn from ``titles``.
    """
    levers = [f"L{index}" for index in range(draw(st.integers(1, max_levers), label="levers"))]
    # Causes come first in this order, which is not the order of the levers.
    order = [*draw(st.permutations(levers), label="causal order"), DOOR]
    pairs = [(cause, effect) for i, cause in enumerate(order) for effect in order[i + 1 :]]
    # As often sparse as dense, which a coin for each pair would not be.
    edges = draw(st.permutations(pairs), label="pairs")[: draw(st.integers(0, len(pairs)))]
    graph = nx.DiGraph(edges)
    graph.add_nodes_from(order)
    if not graph.in_degree(DOOR):
        graph.add_edge(draw(st.sampled_from(levers), label="cause of the door"), DOOR)
    if draw(st.booleans(), label="no inert levers"):
        ends = [lever for lever in levers if graph.out_degree(lever) == 0]
        graph.add_edges_from((lever, DOOR) for lever in ends)
    strengths = st.just(1.0)
    if stochastic:
        strengths |= st.floats(0.05, 1.0, allow_subnormal=False)
    useful = nx.ancestors(graph, DOOR)
    return Schema(
        "drawn",
        levers,
        {lever: {effect: draw(strengths) for effect in graph[lever]} for lever in levers},
        gates={node: draw(_gates(causes)) for node, causes in graph.in_degree() if causes},
        inert=draw(st.permutations([lever for lever in levers if lever not in useful])),
        title=draw(titles),
    )


def _gates(causes: int) -> st.SearchStrategy[Gate]:
    counts = st.integers(1, causes).map(lambda k: Gate("at_least", k))
    return st.sampled_from([Gate(), Gate("all")]) | counts


def layouts(schema: Schema, positions: int | None = None) -> st.SearchStrategy[Layout]:
    """Any layout of a schema's levers, by default in the smallest room for them."""
    places = positions_for(schema) if positions is None else positions
    levers = len(schema.levers)
    return st.permutations(range(places)).map(lambda order: Layout(tuple(order[:levers]), places))

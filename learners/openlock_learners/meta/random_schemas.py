"""Random schemas, to train a learner that is to find out any schema."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import permutations

import networkx as nx
import numpy as np

from causal_openlock.errors import SchemaError
from causal_openlock.experiment.declare import PAPER_ACTION_LIMIT
from causal_openlock.schemas.schema import DOOR, Gate, Schema

MOST_SOLUTIONS = 4


def behaviour(schema: Schema) -> tuple[int, ...]:
    """The behaviour of a schema, chance aside: equal if schemas differ in levers' names alone.

    For each set of pushed levers there is a number, whose bits say which levers can move then and
    whether the door is unlocked. Of all orders of the levers, that with the least numbers counts.
    """
    count = len(schema.levers)
    sets = np.arange(1 << count)
    nodes = [*schema.levers, DOOR]
    causes = np.array([schema.mask(schema.causes(node)) for node in nodes])
    needed = np.array([schema.threshold(node) for node in nodes])
    enabled = np.bitwise_count(sets[:, None] & causes) >= needed
    least: tuple[int, ...] = ()
    for order in permutations(range(count)):
        renamed = np.empty_like(sets)
        weights = 1 << np.array([*order, count])
        renamed[(sets[:, None] >> np.arange(count) & 1) @ weights[:-1]] = enabled @ weights
        least = min(least or tuple(renamed.tolist()), tuple(renamed.tolist()))
    return least


def random_schemas(
    number: int,
    levers: Sequence[int],
    seed: int,
    excluded: Iterable[Schema] = (),
    solutions: Mapping[int, int] | None = None,
) -> list[Schema]:
    """Random gate-DAG schemas that attempts of three actions can solve, no two the same.

    Every lever has causes among those before it in a random order, every node a random gate, and
    levers that lead nowhere are inert.

    Args:
        number: How many.
        levers: The numbers of levers that one may have.
        seed: All of them follow from it.
        excluded: None behaves as one of these.
        solutions: How many solutions a schema has, by its number of levers; by default at most
            :data:`MOST_SOLUTIONS`.
    """
    forbidden = {behaviour(schema) for schema in excluded}
    generator = np.random.default_rng(seed)
    made: dict[str, Schema] = {}
    while len(made) < number:
        names = [f"L{index}" for index in range(int(generator.choice(np.array(levers))))]
        order = [names[index] for index in generator.permutation(len(names))]
        nodes = [*order, DOOR]
        chance = generator.uniform(0.2, 0.8)
        graph = nx.DiGraph()
        graph.add_nodes_from(nodes)
        for index, effect in enumerate(nodes):
            graph.add_edges_from(
                (cause, effect) for cause in nodes[:index] if generator.random() < chance
            )
        useful = nx.ancestors(graph, DOOR)
        gates = {
            node: Gate("all")
            for node, causes in graph.in_degree()
            if causes > 1 and generator.random() < 0.3
        }
        try:
            schema = Schema(
                f"random{len(made)}",
                names,
                {name: list(graph.successors(name)) for name in names},
                gates=gates,
                inert=[name for name in names if name not in useful],
            )
        except SchemaError:
            continue
        if len(schema.solutions) > MOST_SOLUTIONS or schema.least_action_limit > PAPER_ACTION_LIMIT:
            continue
        if solutions and solutions.get(len(names)) != len(schema.solutions):
            continue
        if forbidden and behaviour(schema) in forbidden:
            continue
        form = {**schema.as_dict(), "name": ""}
        made.setdefault(str(form), schema)
    return list(made.values())

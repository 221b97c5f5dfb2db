"""Random schemas, to train a learner that is to find out any schema."""

from __future__ import annotations

from collections.abc import Sequence

import networkx as nx
import numpy as np

from causal_openlock.errors import SchemaError
from causal_openlock.experiment.protocol import PAPER_ACTION_LIMIT
from causal_openlock.schemas.schema import DOOR, Gate, Schema

MOST_SOLUTIONS = 4


def random_schemas(number: int, levers: Sequence[int], seed: int) -> list[Schema]:
    """Random gate-DAG schemas that attempts of three actions can solve, no two the same.

    Every lever has causes among those before it in a random order, every node a random gate, and
    levers that lead nowhere are inert. At most :data:`MOST_SOLUTIONS` solve one. ``levers`` are the
    numbers of levers that a schema may have.
    """
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
        form = {**schema.as_dict(), "name": ""}
        made.setdefault(str(form), schema)
    return list(made.values())

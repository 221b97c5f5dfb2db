"""A schema as a Bayesian network of pgmpy: one push per lever, then of the door."""

from __future__ import annotations

from itertools import compress, product
from typing import TYPE_CHECKING

import numpy as np

from causal_openlock.schemas.fsm import gate_chance
from causal_openlock.schemas.schema import Schema

if TYPE_CHECKING:
    from pgmpy.models import DiscreteBayesianNetwork


def to_bayesian_network(schema: Schema) -> DiscreteBayesianNetwork:
    """The causal model of one push per lever, causes before effects, then of the door.

    A lever's state is 1 if it moved: it was pushed and as many of its causes transmitted as its
    gate needs. The door's state is 1 if it opens when it is pushed then. For an intervention, cut
    the model and condition on the state that was set, in pgmpy
    ``VariableElimination(model.do(["L0"])).query(["door"], evidence={"L0": 1})``;
    its ``CausalInference.query`` is wrong where levers that cause one another are set together.
    """
    from pgmpy.factors.discrete import TabularCPD
    from pgmpy.models import DiscreteBayesianNetwork

    network = DiscreteBayesianNetwork()
    network.name = schema.name
    network.add_nodes_from(schema.graph.nodes)
    network.add_edges_from(schema.graph.edges)
    for node in schema.graph.nodes:
        causes = schema.causes(node)
        # pgmpy counts through the causes' states with the first cause slowest.
        states = product((0, 1), repeat=len(causes))
        moved = np.array([schema.mask(compress(causes, state)) for state in states])
        chance = gate_chance(schema, node, moved)
        names = {name: [0, 1] for name in (node, *causes)}
        sizes = [2] * len(causes)
        network.add_cpds(TabularCPD(node, 2, [1.0 - chance, chance], causes, sizes, names))
    network.check_model()
    return network


def bif_text(schema: Schema) -> str:
    """The network as text in the Bayesian Interchange Format."""
    from pgmpy.readwrite import BIFWriter

    return str(BIFWriter(to_bayesian_network(schema)))

"""A posterior as causal Bayesian networks of pgmpy, and the effects of interventions.

A *lever's state* is 1 while it is pushed, the *door's* is 1 while it is unlocked. ``do`` sets
states from outside: a lever that is set stays as set, whether or not its gate holds, and the edges
from its causes are cut. An intervention here has three parts:

* ``pushed``: levers set to 1;
* ``pulled``: levers set to 0;
* ``push_probability``: each other lever is pushed with this probability, once, causes before
  effects, and moves if its gate holds (see
  :func:`~causal_openlock.formats.graphs.to_bayesian_network`).

Three examples, with levers A and B and others:

* *Is the door unlocked if A and B are pushed?* ``pushed=[A, B]``; the others stay pulled. The lock
  is a function of the levers' states, so strengths do not matter.
* *Is it, after somebody has tried to push A and B?* ``pulled`` are all the others, with
  ``push_probability=1``: A moves only if its gate holds, with the probability of its strength.
* *Is it, if A is forced and every other lever is tried?* ``pushed=[A]``, ``push_probability=1``.

pgmpy is imported only here and when needed: posteriors are updated as plain arrays, thousands of
times faster.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING

import networkx as nx
import numpy as np

from causal_openlock.belief.marginals import (
    StructurePosterior,
    edge_probabilities,
    most_probable,
    structure_posteriors,
)
from causal_openlock.belief.posterior import Belief
from causal_openlock.errors import OpenLockError
from causal_openlock.formats.graphs import binary_cpd, to_bayesian_network
from causal_openlock.wording import nearest
from causal_openlock.world.fsm import FloatArray
from causal_openlock.world.room import position_names
from causal_openlock.world.schema import DOOR, Schema

if TYPE_CHECKING:
    import pandas as pd
    from pgmpy.models import DiscreteBayesianNetwork


@dataclass(frozen=True, eq=False)
class Model:
    """A subject's posterior at one moment, for pgmpy and networkx; it does not change later.

    Attributes:
        schema: The most probable structure; levers are named by position, here and below.
        probability: Its probability, together with structures that behave alike in every attempt.
        network: The same as a checked network: levers that are pushed once, causes before effects,
            and a door that is then pushed open; for the meaning of its states see
            :func:`~causal_openlock.formats.graphs.to_bayesian_network`.
        edges: ``[P, P + 1]`` posterior probability that the lever of the row enables that of the
            column, or the door; averaged over all structures.
        parts: The posterior over structures, for each possible set of active levers.
    """

    schema: Schema
    probability: float
    network: DiscreteBayesianNetwork
    edges: pd.DataFrame
    parts: tuple[StructurePosterior, ...] = field(repr=False)

    @property
    def graph(self) -> nx.DiGraph:
        """The edges of positive probability, each with its ``probability``."""
        graph = nx.DiGraph(name="belief")
        graph.add_nodes_from(self.edges.index, kind="lever")
        graph.add_node(DOOR, kind="door")
        for cause, row in self.edges.iterrows():
            for effect, probability in row.items():
                if probability > 0:
                    graph.add_edge(cause, effect, probability=float(probability))
        return graph

    def unlocked(
        self,
        pushed: Iterable[str] = (),
        pulled: Iterable[str] = (),
        push_probability: float = 0.0,
    ) -> float:
        """P(door unlocked | do) under the most probable structure, by pgmpy.

        Args:
            pushed: Positions of levers that are set to pushed, whether or not they could move.
            pulled: Positions of levers that are set to pulled.
            push_probability: Probability that a lever that is not set is pushed; at 0 they stay
                pulled.

        Raises:
            OpenLockError: If there is no such position, or one is set both ways.
        """
        up, down = _checked(self.edges.index, pushed, pulled, push_probability)
        levers = set(self.schema.levers)  # setting any other has no effect
        return probability_unlocked(self.schema, up & levers, down & levers, push_probability)

    def expected_unlocked(
        self,
        pushed: Iterable[str] = (),
        pulled: Iterable[str] = (),
        push_probability: float = 0.0,
    ) -> float:
        """P(door unlocked | do) averaged over the posterior; otherwise as :meth:`unlocked`.

        The average is over structures and not over behaviours, as ``do`` can set levers in ways
        that no attempt can.
        """
        up, down = _checked(self.edges.index, pushed, pulled, push_probability)
        total = sum(part.unlocked(up, down, push_probability) for part in self.parts)
        return min(total, 1.0)  # rounding may end just above 1


def model_of(belief: Belief, classes: FloatArray) -> Model:
    """A belief as objects of pgmpy, given the probability of each schema class."""
    import pandas as pd

    schema, probability = most_probable(belief, classes)
    names = position_names(belief.space.sight.positions)
    edges = pd.DataFrame(
        edge_probabilities(belief, classes),
        index=pd.Index(names, name="cause"),
        columns=pd.Index([*names, DOOR], name="effect"),
    )
    parts = structure_posteriors(belief, classes)
    return Model(schema, probability, to_bayesian_network(schema), edges, parts)


def lock_network(schema: Schema, push_probability: float = 0.0) -> DiscreteBayesianNetwork:
    """The causal model of the lock, in which the door is 1 if it is unlocked.

    In :func:`~causal_openlock.formats.graphs.to_bayesian_network` it is 1 if it opens, which also
    depends on strengths; the rest is the same.

    """
    network = to_bayesian_network(schema, push_probability)
    causes = schema.causes(DOOR)
    pushed = np.array([sum(states) for states in product((0, 1), repeat=len(causes))])
    unlocked = (pushed >= schema.threshold(DOOR)).astype(float)
    network.remove_cpds(network.get_cpds(DOOR))
    network.add_cpds(binary_cpd(DOOR, unlocked, causes))
    network.check_model()
    return network


def probability_unlocked(
    schema: Schema,
    pushed: Iterable[str] = (),
    pulled: Iterable[str] = (),
    push_probability: float = 0.0,
) -> float:
    """P(door unlocked | do) under a schema, by pgmpy.

    Edges into the levers that are set are cut, and their states made certain. (Conditioning on
    their states fails if these had probability 0 before, and pgmpy's ``CausalInference.query`` is
    wrong where levers that cause one another are set together.)

    Args:
        schema: The levers and the door.
        pushed: Levers that are set to pushed, whether or not they could move.
        pulled: Levers that are set to pulled.
        push_probability: Probability that a lever that is not set is pushed; at 0 they stay pulled.

    Raises:
        OpenLockError: If there is no such lever, or one is set both ways.

    Example:
        >>> chain = Schema("chain", ["A", "B"], {"A": ["B"], "B": ["door"]})
        >>> probability_unlocked(chain, pushed=["A"])
        0.0
        >>> probability_unlocked(chain, pushed=["A"], push_probability=0.5)
        0.5
    """
    from pgmpy.inference import VariableElimination

    up, down = _checked(schema.levers, pushed, pulled, push_probability)
    states = {**dict.fromkeys(up, 1), **dict.fromkeys(down, 0)}
    network = lock_network(schema, push_probability)
    if states:
        network = network.do(list(states))
    for lever, state in states.items():
        network.remove_cpds(lever)
        network.add_cpds(binary_cpd(lever, np.array([float(state)])))
    answer = VariableElimination(network).query([DOOR], show_progress=False)
    return float(answer.get_value(**{DOOR: 1}))


def _checked(
    known: Iterable[str], pushed: Iterable[str], pulled: Iterable[str], push_probability: float
) -> tuple[set[str], set[str]]:
    """The levers set to pushed and those set to pulled, as sets."""
    if isinstance(pushed, str) or isinstance(pulled, str):
        raise OpenLockError("give levers as a list of names, even a single one")
    known, up, down = list(known), {*map(str, pushed)}, {*map(str, pulled)}
    for name in sorted(up | down):
        if name not in known:
            raise OpenLockError(f"there is no lever {name!r}; {nearest(name, known)}")
    if both := sorted(up & down):
        raise OpenLockError(f"{both[0]} cannot be set to both pushed and pulled; choose one")
    if not 0.0 <= push_probability <= 1.0:
        raise OpenLockError(f"push_probability is {push_probability}; give a number from 0 to 1")
    return up, down

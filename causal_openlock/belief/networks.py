"""A belief as objects of pgmpy and networkx, and what follows from interventions.

A *lever's state* is 1 while it stands pushed, the *door's* is 1 while it is unlocked. ``do`` sets
states from outside: a lever that is set stands where it was put, whether or not its gate holds,
and its arrows from its causes are cut. What the other levers do has to be said too, so every
question here has three parts:

* ``pushed``: levers set to 1;
* ``pulled``: levers set to 0;
* ``push_probability``: each lever that is not set is pushed with this probability, once, causes
  before effects, and moves if its gate lets it (see
  :func:`~causal_openlock.formats.graphs.to_bayesian_network`).

Three questions that can be asked so, of levers A and B and all the others:

* *Is the door unlocked if A and B stand pushed?* ``pushed=[A, B]``, the others stay pulled. No luck
  is involved: the lock is a function of where the levers stand, and strengths do not matter.
* *Is it, once somebody has tried to push A and B?* ``pulled`` are all the others, with
  ``push_probability=1``: A moves only if its gate holds, and with the chance of its strength.
* *Is it, if A is forced and all that can move is pushed?* ``pushed=[A]``, ``push_probability=1``.

pgmpy is loaded when it is needed and never before: beliefs themselves are updated and planned with
by plain arrays, which say the same thousands of times faster.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING

import networkx as nx
import numpy as np

from causal_openlock.belief.beliefs import Belief
from causal_openlock.belief.insight import Held, edge_probabilities, held, most_probable
from causal_openlock.errors import OpenLockError
from causal_openlock.formats.graphs import to_bayesian_network
from causal_openlock.wording import nearest
from causal_openlock.world.fsm import FloatArray
from causal_openlock.world.room import position_names
from causal_openlock.world.schema import DOOR, Schema

if TYPE_CHECKING:
    import pandas as pd
    from pgmpy.models import DiscreteBayesianNetwork


@dataclass(frozen=True, eq=False)
class Model:
    """What a subject believes at one moment, for users of pgmpy and networkx.

    It stays as it is while the learner goes on.

    Attributes:
        schema: The most probable structure; its levers are called by their positions, as
            everything here.
        probability: How probable it is, together with those that act alike in every attempt.
        network: The same as a checked network: levers that are pushed once, causes before effects,
            and a door that is then pushed open. Ask it anything that pgmpy can answer, and see
            :func:`~causal_openlock.formats.graphs.to_bayesian_network` for what its states mean.
        edges: ``[P, P + 1]`` posterior-mean probability that the lever of the row enables that of
            the column, or the door; averaged over all structures.
        held: Every structure that is held possible.
    """

    schema: Schema
    probability: float
    network: DiscreteBayesianNetwork
    edges: pd.DataFrame
    held: tuple[Held, ...] = field(repr=False)

    @property
    def graph(self) -> nx.DiGraph:
        """The edges that are possible at all, each with its ``probability``."""
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
        """P(door unlocked | do) if the most probable structure is right; pgmpy's answer.

        Args:
            pushed: Positions of levers that are set to pushed, whether or not they could move.
            pulled: Positions of levers that are set to pulled.
            push_probability: Probability that a lever that is not set is pushed; at 0 they stay
                pulled.

        Raises:
            OpenLockError: If there is no such position, or one is set both ways.
        """
        up, down = _checked(self.edges.index, pushed, pulled, push_probability)
        levers = set(self.schema.levers)  # a lever of no use may be set, to no effect
        return probability_unlocked(self.schema, up & levers, down & levers, push_probability)

    def expected_unlocked(
        self,
        pushed: Iterable[str] = (),
        pulled: Iterable[str] = (),
        push_probability: float = 0.0,
    ) -> float:
        """P(door unlocked | do) as the subject believes it: averaged over all that it holds.

        Structures count and not behaviours, as setting levers can bring about what no attempt can.

        Args:
            pushed: As for :meth:`unlocked`.
            pulled: The same.
            push_probability: The same.

        Raises:
            OpenLockError: If there is no such position, or one is set both ways.
        """
        up, down = _checked(self.edges.index, pushed, pulled, push_probability)
        total = sum(held.unlocked(up, down, push_probability) for held in self.held)
        return min(total, 1.0)  # rounding may end just above 1


def model_of(belief: Belief, classes: FloatArray) -> Model:
    """A belief as objects of pgmpy.

    Args:
        belief: A subject's belief.
        classes: ``[C + 1]`` how probable the subject holds each schema class.
    """
    import pandas as pd

    schema, probability = most_probable(belief, classes)
    names = position_names(belief.space.sight.positions)
    edges = pd.DataFrame(
        edge_probabilities(belief, classes),
        index=pd.Index(names, name="cause"),
        columns=pd.Index([*names, DOOR], name="effect"),
    )
    return Model(schema, probability, to_bayesian_network(schema), edges, held(belief, classes))


def lock_network(schema: Schema, push_probability: float = 0.0) -> DiscreteBayesianNetwork:
    """The causal model of the lock: levers as they are, and a door that is unlocked or not.

    It is :func:`~causal_openlock.formats.graphs.to_bayesian_network` but for the door, whose state
    is 1 if it is unlocked, which no strength has a part in, and not if it opens.

    Args:
        schema: The levers and the door.
        push_probability: Probability that a lever is pushed, each on its own; at 0 all stay pulled
            until ``do`` sets them.

    Returns:
        A checked model whose nodes are the schema's and have the states 0 and 1.

    Raises:
        OpenLockError: If ``push_probability`` is no probability.
    """
    from pgmpy.factors.discrete import TabularCPD

    network = to_bayesian_network(schema, push_probability)
    causes = schema.causes(DOOR)
    pushed = np.array([sum(states) for states in product((0, 1), repeat=len(causes))])
    unlocked = (pushed >= schema.threshold(DOOR)).astype(float)
    network.remove_cpds(network.get_cpds(DOOR))
    network.add_cpds(
        TabularCPD(
            DOOR,
            2,
            [1.0 - unlocked, unlocked],
            evidence=list(causes),
            evidence_card=[2] * len(causes),
            state_names={each: [0, 1] for each in (DOOR, *causes)},
        )
    )
    network.check_model()
    return network


def probability_unlocked(
    schema: Schema,
    pushed: Iterable[str] = (),
    pulled: Iterable[str] = (),
    push_probability: float = 0.0,
) -> float:
    """P(door unlocked | do) under a schema, by pgmpy.

    The network is cut above the levers that are set, and these are made certain; to condition on
    what they are set to would not do, as it may have had no probability before.
    ``CausalInference.query`` of pgmpy would be shorter and is wrong where levers that cause one
    another are set together.

    Args:
        schema: The levers and the door.
        pushed: Levers that are set to pushed, whether or not they could move.
        pulled: Levers that are set to pulled.
        push_probability: Probability that a lever that is not set is pushed; at 0 they stay pulled.

    Raises:
        OpenLockError: If there is no such lever, or one is set both ways.
    """
    from pgmpy.factors.discrete import TabularCPD
    from pgmpy.inference import VariableElimination

    up, down = _checked(schema.levers, pushed, pulled, push_probability)
    states = {**dict.fromkeys(up, 1), **dict.fromkeys(down, 0)}
    network = lock_network(schema, push_probability)
    if states:
        network = network.do(list(states))
    for lever, state in states.items():
        network.remove_cpds(lever)
        network.add_cpds(
            TabularCPD(lever, 2, [[1.0 - state], [state]], state_names={lever: [0, 1]})
        )
    answer = VariableElimination(network).query([DOOR], show_progress=False)
    return float(answer.get_value(**{DOOR: 1}))


def _checked(
    known: Iterable[str], pushed: Iterable[str], pulled: Iterable[str], push_probability: float
) -> tuple[set[str], set[str]]:
    """What is set to pushed, and to pulled."""
    if isinstance(pushed, str) or isinstance(pulled, str):
        raise OpenLockError("levers are given as a list of names, also a single one")
    known, up, down = list(known), {*map(str, pushed)}, {*map(str, pulled)}
    for name in sorted(up | down):
        if name not in known:
            raise OpenLockError(f"there is no lever {name!r}; {nearest(name, known)}")
    if both := sorted(up & down):
        raise OpenLockError(f"{both[0]} cannot be set to both pushed and pulled; choose one")
    if not 0.0 <= push_probability <= 1.0:
        raise OpenLockError(f"push_probability is {push_probability}; give a number from 0 to 1")
    return up, down

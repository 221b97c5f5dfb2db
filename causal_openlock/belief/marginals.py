"""Marginals of a posterior over structures: edges, the mode, interventions.

A posterior is over behaviours, and many structures can have the same behaviour. Here it is spread
over structures again,

    P(structure) = P(behaviour) P(structure | behaviour)

the last factor from the subject's knowledge of schema classes, whose probabilities ``[C + 1]`` are
called ``classes`` here. Levers are named by position and not by slot, as people see the room.

**Interventions.** A *lever's state* is 1 while it is pushed, the *door's* is 1 while it is
unlocked. ``do`` sets levers from outside, ``pushed`` ones to 1 and ``pulled`` ones to 0: they stay
as set, whether or not their gates hold, and the edges from their causes are cut. Any other lever is
pushed with ``push_probability``, once, causes before effects, and moves if its gate holds (see
:func:`~causal_openlock.schemas.bayes_net.to_bayesian_network`).

pgmpy is imported only for :attr:`Model.network`: posteriors are updated as plain arrays, thousands
of times faster.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING

import networkx as nx
import numpy as np

from causal_openlock.belief.beliefs import Belief
from causal_openlock.belief.hypotheses import Strengths
from causal_openlock.belief.structure_schemas import schema_of
from causal_openlock.belief.structures import NEVER, Structures
from causal_openlock.contract.learner import Structure
from causal_openlock.errors import OpenLockError
from causal_openlock.schemas.bayes_net import to_bayesian_network
from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.schemas.schema import DOOR, Schema
from causal_openlock.wording import nearest
from causal_openlock.world.room import position_names

if TYPE_CHECKING:
    import pandas as pd
    from pgmpy.models import DiscreteBayesianNetwork


@dataclass(frozen=True, eq=False)
class Posterior:
    """A belief at one moment, spread over the structures that are possible."""

    structures: Structures  #: M structures, on the positions of the room
    behaviour: IntArray  #: ``[M]`` numbers that are equal for those that behave alike
    strengths: Strengths  #: the G possible strengths
    chance: FloatArray  #: ``[M, G]`` probability of each structure together with each strength

    @classmethod
    def of(cls, belief: Belief, classes: FloatArray) -> Posterior:
        """The posterior of a belief, given the probability of each schema class."""
        space = belief.space
        weight = np.zeros(len(space))
        weight[belief.which] = belief.weight
        structures, behaviours, chances, listed = [], [], [], 0
        parts = np.split(weight, space.ends[:-1])
        for (slots, own), part in zip(space.blocks, parts, strict=True):
            if part.any():
                pairs = own.pairs_given_behaviour(classes)
                share = np.bincount(own.member, pairs, minlength=len(own.members))
                chance = share[:, None] * part.reshape(-1, len(space.strengths))[own.behaviour]
                possible = np.flatnonzero(chance.any(axis=1))
                at = belief.positions[list(slots)]
                structures.append(own.members[possible].on_slots(at, space.sight.positions))
                behaviours.append(own.behaviour[possible] + listed)
                chances.append(chance[possible])
            listed += len(own)
        joined = Structures.joined(structures)
        return cls(joined, np.concatenate(behaviours), space.strengths, np.concatenate(chances))

    def expected(self) -> Structure:
        """Probabilities of edges and gates."""
        return expected_structure(self.structures, self.chance.sum(axis=1))

    def most_probable(self) -> tuple[Schema, float]:
        """The most probable behaviour: a schema that has it, and its probability (MAP).

        The schema is the most probable structure with that behaviour, and the probability is that
        of all structures with it, whatever their strength. Levers are named by position; those
        without effect on the door are inert.
        """
        probability = self.chance.sum(axis=1)
        alike = np.bincount(self.behaviour, probability)
        having = np.flatnonzero(self.behaviour == alike.argmax())
        best = having[probability[having].argmax()]
        strength = float(self.strengths.value[self.chance[best].argmax()])
        names = position_names(self.structures.levers)
        structure = self.structures[best : best + 1]
        return schema_of(structure, names, strength), float(alike.max())

    def unlocked(self, do: Mapping[int, int], push_probability: float) -> float:
        """P(door unlocked | do), given the states of the levers that are set."""
        threshold, total = self.structures.threshold, 0.0
        can_move = np.flatnonzero((threshold[:, :-1] < NEVER).any(axis=0))
        unset = [lever for lever in can_move.tolist() if lever not in do]
        for states in product((0, 1), repeat=len(unset) if push_probability > 0 else 0):
            state = {**do, **dict(zip(unset, states, strict=False))}
            pushed = np.uint16(sum(up << lever for lever, up in state.items()))
            live = np.bitwise_count(self.structures.causes & pushed)
            likely = np.where(live[:, -1] >= threshold[:, -1], 1.0, 0.0)[:, None]
            for lever, up in zip(unset, states, strict=False):
                works = self.strengths.chance[:, live[:, lever], threshold[:, lever]].T
                moves = push_probability * works
                likely = likely * (moves if up else 1.0 - moves)
            total += float((self.chance * likely).sum())
        return total


def expected_structure(structures: Structures, probability: FloatArray) -> Structure:
    """Probabilities of edges and gates, of M structures with ``[M]`` these probabilities."""
    levers, many = np.arange(structures.levers), np.bitwise_count(structures.causes)
    edges = np.array([probability @ (structures.causes >> lever & 1) for lever in levers])
    several = probability @ (many > 1)
    all_of_them = probability @ ((many > 1) & (structures.threshold >= many))
    gates = np.divide(all_of_them, several, out=np.full(len(several), np.nan), where=several > 0)
    return Structure(edges, gates)


@dataclass(frozen=True, eq=False)
class Model:
    """A subject's posterior at one moment, for pgmpy and networkx; it does not change later."""

    schema: Schema  #: the most probable structure; levers are named by position, here and below
    probability: float  #: its probability, together with structures that always behave alike
    network: DiscreteBayesianNetwork
    """The same as a checked network: levers that are pushed once, causes before effects, and a door
    that is then pushed open (:func:`~causal_openlock.schemas.bayes_net.to_bayesian_network`)."""
    edges: pd.DataFrame
    """``[P, P + 1]`` posterior probability that the lever of the row enables that of the column, or
    the door; averaged over all structures."""
    posterior: Posterior = field(repr=False)  #: what all of them follow from

    @property
    def graph(self) -> nx.DiGraph:
        """The edges of positive probability, each with its ``probability``."""
        graph = nx.DiGraph(name="belief")
        graph.add_nodes_from(self.edges.index, kind="lever")
        graph.add_node(DOOR, kind="door")
        for (cause, effect), probability in self.edges.stack().items():
            if probability > 0:
                graph.add_edge(cause, effect, probability=float(probability))
        return graph

    def expected_unlocked(
        self, pushed: Iterable[str] = (), pulled: Iterable[str] = (), push_probability: float = 0.0
    ) -> float:
        """P(door unlocked | do), averaged over the posterior; see the head of this module.

        The average is over structures and not over behaviours, as ``do`` can set levers in ways
        that no attempt can. For the most probable structure alone, ask :attr:`network`.

        Raises:
            OpenLockError: If there is no such position, or one is set both ways.
        """
        if isinstance(pushed, str) or isinstance(pulled, str):
            raise OpenLockError("give levers as a list of names, even a single one")
        names, up, down = list(self.edges.index), {*map(str, pushed)}, {*map(str, pulled)}
        for name in sorted(up | down):
            if name not in names:
                raise OpenLockError(f"there is no lever {name!r}; {nearest(name, names)}")
        if both := sorted(up & down):
            raise OpenLockError(f"{both[0]} cannot be set to both pushed and pulled; choose one")
        if not 0.0 <= push_probability <= 1.0:
            raise OpenLockError(
                f"push_probability is {push_probability}; give a number from 0 to 1"
            )
        do = {names.index(name): int(name in up) for name in up | down}
        # Rounding may end just above 1.
        return min(self.posterior.unlocked(do, push_probability), 1.0)


def model_of(posterior: Posterior) -> Model:
    """A posterior as objects of pgmpy."""
    import pandas as pd

    schema, probability = posterior.most_probable()
    names = position_names(posterior.structures.levers)
    edges = pd.DataFrame(
        posterior.expected().edges,
        index=pd.Index(names, name="cause"),
        columns=pd.Index([*names, DOOR], name="effect"),
    )
    return Model(schema, probability, to_bayesian_network(schema), edges, posterior)

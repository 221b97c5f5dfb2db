"""Marginals of a posterior over structures: edges, the mode, interventions.

A posterior is over behaviours, and many structures can have the same behaviour. Here it is spread
over structures again,

    P(structure) = P(behaviour) P(structure | behaviour)

the last factor from the subject's knowledge of schema classes. Levers are named by position and not
by slot, as people see the room.

**Interventions.** A *lever's state* is 1 while it is pushed, the *door's* is 1 while it is
unlocked. ``do`` sets levers from outside, ``pushed`` ones to 1 and ``pulled`` ones to 0: they stay
as set, whether or not their gates hold, and the edges from their causes are cut. Any other lever is
pushed with ``push_probability``, once, causes before effects, and moves if its gate holds (see
:func:`~causal_openlock.schemas.bayes_net.to_bayesian_network`).

pgmpy is imported only for :attr:`Model.network`: posteriors are updated as plain arrays, thousands
of times faster.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING

import networkx as nx
import numpy as np

from causal_openlock.belief.beliefs import Belief
from causal_openlock.belief.catalogue import feasible
from causal_openlock.belief.hypotheses import Strengths
from causal_openlock.belief.structure_schemas import schema_of
from causal_openlock.belief.structures import Hypotheses, Structures
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
class StructurePosterior:
    """The part of a posterior about M structures on the same levers.

    Attributes:
        positions: ``[n]`` where the levers are.
        structures: ``[M]`` structures on them.
        behaviour: ``[M]`` equal for those that behave alike in every attempt.
        strengths: The G possible strengths.
        probability: ``[M, G]`` of each structure together with each strength.
    """

    positions: IntArray
    structures: Structures
    behaviour: IntArray
    strengths: Strengths
    probability: FloatArray

    def unlocked(self, do: Mapping[int, int], push_probability: float) -> float:
        """Contribution to P(unlocked | do), given the states of the levers that are set."""
        places = self.positions.tolist()
        unset = [lever for lever, position in enumerate(places) if position not in do]
        other = (0, 1) if push_probability > 0 else (0,)
        threshold, total = self.structures.threshold, 0.0
        for states in product(*((do[at],) if at in do else other for at in places)):
            mask = np.uint16(sum(state << lever for lever, state in enumerate(states)))
            live = np.bitwise_count(self.structures.causes & mask)
            likely = np.where(live[:, -1] >= threshold[:, -1], 1.0, 0.0)[:, None]
            for lever in unset:
                moves = self.strengths.chance[:, live[:, lever], threshold[:, lever]].T
                moves = push_probability * moves
                likely = likely * (moves if states[lever] else 1.0 - moves)
            total += float((self.probability * likely).sum())
        return total


def structure_posteriors(belief: Belief, classes: FloatArray) -> Iterator[StructurePosterior]:
    """The posterior over structures, one part for each possible set of active levers.

    ``classes``, ``[C + 1]``, is the subject's probability of each schema class; so everywhere here.
    """
    space = belief.space
    weight = np.zeros(len(space))
    weight[belief.which] = belief.weight
    for block, part in zip(space.blocks, np.split(weight, space.ends[:-1]), strict=True):
        if not part.any():
            continue
        own = block.catalogue
        pairs = own.pairs_given_behaviour(classes * feasible(own.members.levers))
        share = np.bincount(own.member, pairs, minlength=len(own.members))
        joint = share[:, None] * part.reshape(-1, len(space.strengths))[own.behaviour]
        possible = np.flatnonzero(joint.any(axis=1))
        yield StructurePosterior(
            belief.positions[list(block.slots)],
            own.members[possible],
            own.behaviour[possible],
            space.strengths,
            joint[possible],
        )


def believed_structure(belief: Belief, classes: FloatArray) -> Structure:
    """Probabilities of edges and gates, of the room that a belief is about."""
    parts = (
        (part.positions, part.structures, part.probability.sum(axis=1))
        for part in structure_posteriors(belief, classes)
    )
    return expected_structure(parts, belief.space.sight.positions)


def expected_structure(
    parts: Iterable[tuple[IntArray, Structures | Hypotheses, FloatArray]], positions: int
) -> Structure:
    """Probabilities of edges and gates, of structures with these probabilities.

    Args:
        parts: ``[n]`` where some levers are, M structures on them, and ``[M]`` their probabilities;
            of all parts together these add up to 1.
        positions: Positions of the room, P.
    """
    edges = np.zeros((positions, positions + 1))
    several, all_of_them = np.zeros(positions + 1), np.zeros(positions + 1)
    for at, own, probability in parts:
        to = np.append(at, positions)
        for lever, position in enumerate(at):
            causes = (own.causes >> np.uint16(lever) & 1).astype(float)
            edges[position, to] += probability @ causes
        many = np.bitwise_count(own.causes)
        several[to] += probability @ (many > 1)
        all_of_them[to] += probability @ ((many > 1) & (own.threshold >= many))
    gates = np.divide(all_of_them, several, out=np.full(positions + 1, np.nan), where=several > 0)
    return Structure(edges, gates)


def most_probable(belief: Belief, classes: FloatArray) -> tuple[Schema, float]:
    """The most probable behaviour: a schema that has it, and its probability (MAP).

    The schema is the most probable structure with that behaviour, and the probability is that of
    all structures with it, whatever their strength. Levers are named by position; those without
    effect on the door are inert.
    """
    parts = [*structure_posteriors(belief, classes)]
    behaviours = [np.bincount(part.behaviour, part.probability.sum(axis=1)) for part in parts]
    at = int(np.argmax([alike.max() for alike in behaviours]))
    part, alike = parts[at], behaviours[at]
    having = np.flatnonzero(part.behaviour == alike.argmax())
    best = having[part.probability[having].sum(axis=1).argmax()]
    strength = float(part.strengths.value[part.probability[best].argmax()])
    every = position_names(belief.space.sight.positions)
    names = [every[position] for position in part.positions]
    schema = schema_of(part.structures[best : best + 1], names, strength)
    return schema, float(alike.max())


@dataclass(frozen=True, eq=False)
class Model:
    """A subject's posterior at one moment, for pgmpy and networkx; it does not change later.

    Attributes:
        schema: The most probable structure; levers are named by position, here and below.
        probability: Its probability, together with structures that behave alike in every attempt.
        network: The same as a checked network: levers that are pushed once, causes before effects,
            and a door that is then pushed open; for the meaning of its states see
            :func:`~causal_openlock.schemas.bayes_net.to_bayesian_network`.
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
        for (cause, effect), probability in self.edges.stack().items():
            if probability > 0:
                graph.add_edge(cause, effect, probability=float(probability))
        return graph

    def expected_unlocked(
        self,
        pushed: Iterable[str] = (),
        pulled: Iterable[str] = (),
        push_probability: float = 0.0,
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
        total = sum(part.unlocked(do, push_probability) for part in self.parts)
        return min(total, 1.0)  # rounding may end just above 1


def model_of(belief: Belief, classes: FloatArray) -> Model:
    """A belief as objects of pgmpy, given the probability of each schema class."""
    import pandas as pd

    schema, probability = most_probable(belief, classes)
    names = position_names(belief.space.sight.positions)
    edges = pd.DataFrame(
        believed_structure(belief, classes).edges,
        index=pd.Index(names, name="cause"),
        columns=pd.Index([*names, DOOR], name="effect"),
    )
    parts = tuple(structure_posteriors(belief, classes))
    return Model(schema, probability, to_bayesian_network(schema), edges, parts)

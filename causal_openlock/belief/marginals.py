"""Marginals of a posterior: the probability of each edge, and the most probable structure.

A posterior is over behaviours, and many structures can have the same behaviour. Here it is spread
over structures again,

    P(structure) = P(behaviour) P(structure | behaviour)

the last factor from the subject's knowledge of schema classes. Levers are named by position and not
by slot, as people see the room.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from causal_openlock.belief.catalogue import feasible
from causal_openlock.belief.posterior import Belief
from causal_openlock.belief.strength import Strengths
from causal_openlock.belief.structures import Structures
from causal_openlock.world.fsm import FloatArray, IntArray
from causal_openlock.world.room import position_names
from causal_openlock.world.schema import DOOR, Gate, Schema


def edge_probabilities(belief: Belief, classes: FloatArray) -> FloatArray:
    """``[P, P + 1]`` probability that the lever at a position enables another, or the door (last).

    Args:
        belief: A subject's belief.
        classes: ``[C + 1]`` the subject's probability of each schema class; so everywhere here.
    """
    positions = belief.space.sight.positions
    edges = np.zeros((positions, positions + 1))
    for part in structure_posteriors(belief, classes):
        probability = part.probability.sum(axis=1)
        to = np.append(part.positions, positions)
        for lever, position in enumerate(part.positions):
            causes = (part.structures.causes >> np.uint16(lever) & 1).astype(float)
            edges[position, to] += probability @ causes
    return edges


def most_probable(belief: Belief, classes: FloatArray) -> tuple[Schema, float]:
    """The most probable behaviour: a schema that has it, and its probability (MAP).

    The schema is the most probable structure with that behaviour, and the probability is that of
    all structures with it, whatever their strength. Levers are named by position; those without
    effect on the door are inert.
    """
    best, found = -1.0, None
    for part in structure_posteriors(belief, classes):
        each = part.probability.sum(axis=1)
        alike = np.bincount(part.behaviour, each)
        index = int(np.where(part.behaviour == alike.argmax(), each, -1.0).argmax())
        if alike.max() > best:
            best, found = float(alike.max()), (part, index)
    assert found is not None, "a belief has a possible hypothesis"
    part, index = found
    strength = float(part.strengths.value[part.probability[index].argmax()])
    return _schema(part.structures[np.array([index])], part.names, strength), best


@dataclass(frozen=True, eq=False)
class StructurePosterior:
    """The part of a posterior about structures on the same set of levers.

    Attributes:
        positions: ``[n]`` where the levers stand.
        names: The names of these positions.
        structures: M structures on them.
        behaviour: ``[M]`` equal for those that behave alike in every attempt.
        strengths: The possible strengths.
        probability: ``[M, G]`` of each structure together with each strength.
    """

    positions: IntArray
    names: tuple[str, ...]
    structures: Structures
    behaviour: IntArray
    strengths: Strengths
    probability: FloatArray

    def unlocked(self, pushed: set[str], pulled: set[str], push_probability: float) -> float:
        """Their part of P(unlocked | do); levers that are not among theirs have no effect."""
        n = len(self.names)
        set_to = {**dict.fromkeys(pushed, (1,)), **dict.fromkeys(pulled, (0,))}
        unset = [lever for lever, name in enumerate(self.names) if name not in set_to]
        other = (0, 1) if push_probability > 0 else (0,)
        total = 0.0
        for states in product(*(set_to.get(name, other) for name in self.names)):
            mask = np.uint16(sum(state << lever for lever, state in enumerate(states)))
            live = np.bitwise_count(self.structures.causes & mask)
            threshold = self.structures.threshold
            likely = np.where(live[:, n] >= threshold[:, n], 1.0, 0.0)[:, None]
            for lever in unset:
                moves = self.strengths.chance[:, live[:, lever], threshold[:, lever]].T
                moves = push_probability * moves
                likely = likely * (moves if states[lever] else 1.0 - moves)
            total += float((self.probability * likely).sum())
        return total


def structure_posteriors(belief: Belief, classes: FloatArray) -> tuple[StructurePosterior, ...]:
    """The posterior over structures, one part for each possible set of active levers."""
    space = belief.space
    many = len(space.strengths)
    names = position_names(space.sight.positions)
    weight = np.zeros(len(space))
    weight[belief.which] = belief.weight
    parts = []
    for block, part in zip(space.blocks, np.split(weight, space.ends[:-1]), strict=True):
        if not part.any():
            continue
        own = block.catalogue
        pairs = own.pairs_given_behaviour(classes * feasible(own.members.levers))
        share = np.bincount(own.member, pairs, minlength=len(own.members))
        joint = share[:, None] * part.reshape(-1, many)[own.behaviour]
        possible = np.flatnonzero(joint.any(axis=1))
        at = belief.positions[block.slots]
        parts.append(
            StructurePosterior(
                at,
                tuple(names[position] for position in at),
                own.members[possible],
                own.behaviour[possible],
                space.strengths,
                joint[possible],
            )
        )
    return tuple(parts)


def _schema(structure: Structures, names: tuple[str, ...], strength: float) -> Schema:
    """One structure as a schema."""
    edges: dict[str, dict[str, float]] = {}
    gates: dict[str, Gate] = {}
    for node, effect in enumerate([*names, DOOR]):
        causes = [name for i, name in enumerate(names) if structure.causes[0, node] >> i & 1]
        for cause in causes:
            edges.setdefault(cause, {})[effect] = strength
        enough = int(structure.threshold[0, node])
        if enough > 1:
            gate = Gate("all") if enough == len(causes) else Gate("at_least", enough)
            gates[effect] = gate
    inert = [name for i, name in enumerate(names) if structure.inert()[0] >> i & 1]
    return Schema("belief", names, edges, gates=gates, inert=inert, title="Most probable")

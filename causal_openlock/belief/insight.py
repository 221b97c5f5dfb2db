"""Looking inside a belief: what a subject thinks of each lever, each arrow, the whole.

A belief is about behaviours, and many structures can stand behind one behaviour; here it is spread
over the structures again, as probable as the subject's knowledge of schemas makes them. Everything
is by position and not by slot, as people see the room.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from causal_openlock.belief.beliefs import Belief
from causal_openlock.belief.catalogue import feasible
from causal_openlock.belief.strength import Strengths
from causal_openlock.belief.structures import Structures
from causal_openlock.world.fsm import FloatArray, IntArray
from causal_openlock.world.room import position_names
from causal_openlock.world.schema import DOOR, Gate, Schema


def edge_probabilities(belief: Belief, classes: FloatArray) -> FloatArray:
    """``[P, P + 1]`` probability that the lever at a position enables another, or the door (last).

    Args:
        belief: A subject's belief.
        classes: ``[C + 1]`` how probable the subject holds each schema class.
    """
    positions = belief.space.sight.positions
    edges = np.zeros((positions, positions + 1))
    for part in held(belief, classes):
        probability = part.probability.sum(axis=1)
        to = np.append(part.positions, positions)
        for lever, position in enumerate(part.positions):
            causes = (part.structures.causes >> np.uint16(lever) & 1).astype(float)
            edges[position, to] += probability @ causes
    return edges


def most_probable(belief: Belief, classes: FloatArray) -> tuple[Schema, float]:
    """What is most probable, as a schema, and its probability, whatever the strength.

    Structures that act alike in every attempt are one hypothesis. It is the most probable one that
    counts; the schema is the most probable structure behind it, and the probability is that of all
    of them. Its levers are called by their positions; those of no use for the door are inert.

    Args:
        belief: A subject's belief.
        classes: ``[C + 1]`` how probable the subject holds each schema class.
    """
    best, found = -1.0, None
    for part in held(belief, classes):
        each = part.probability.sum(axis=1)
        alike = np.bincount(part.behaviour, each)
        index = int(np.where(part.behaviour == alike.argmax(), each, -1.0).argmax())
        if alike.max() > best:
            best, found = float(alike.max()), (part, index)
    assert found is not None, "a belief holds something possible"
    part, index = found
    strength = float(part.strengths.value[part.probability[index].argmax()])
    return _schema(part.structures[np.array([index])], part.names, strength), best


@dataclass(frozen=True, eq=False)
class Held:
    """Structures on the same levers, and how probable a subject holds them.

    Attributes:
        positions: ``[n]`` where the levers stand.
        names: What these positions are called.
        structures: M structures on them.
        behaviour: ``[M]`` equal for those that act alike in every attempt.
        strengths: How surely levers may move.
        probability: ``[M, G]`` of each structure together with each strength.
    """

    positions: IntArray
    names: tuple[str, ...]
    structures: Structures
    behaviour: IntArray
    strengths: Strengths
    probability: FloatArray

    def unlocked(self, pushed: set[str], pulled: set[str], push_probability: float) -> float:
        """The part of P(unlocked | do) that is due to these structures.

        Levers that are not among these do nothing here, wherever they are set.
        """
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


def held(belief: Belief, classes: FloatArray) -> tuple[Held, ...]:
    """Everything that is held possible, structure by structure, for each set of active levers.

    Args:
        belief: A subject's belief.
        classes: ``[C + 1]`` how probable the subject holds each schema class.
    """
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
            Held(
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

"""Looking inside a belief: what a subject thinks of each lever, each arrow, the whole.

A belief is about behaviours, and many structures can stand behind one behaviour; here it is spread
over the structures again, as probable as the subject's knowledge of schemas makes them. Everything
is by position and not by slot, as people see the room.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from causal_openlock.belief.beliefs import Belief
from causal_openlock.belief.catalogue import feasible
from causal_openlock.belief.space import Block
from causal_openlock.fsm import FloatArray, IntArray
from causal_openlock.room import position_names
from causal_openlock.schema import DOOR, Gate, Schema


def active_probabilities(belief: Belief) -> FloatArray:
    """``[P]`` probability that the lever at each position is active."""
    space = belief.space
    blocks = np.searchsorted(space.ends, belief.which, side="right")
    held = np.bincount(blocks, belief.weight, minlength=len(space.blocks))
    probabilities: FloatArray = held @ (space.active[:, None] >> belief.slots & 1)
    return probabilities


def edge_probabilities(belief: Belief, classes: FloatArray) -> FloatArray:
    """``[P, P + 1]`` probability that the lever at a position enables another, or the door (last).

    Args:
        belief: A subject's belief.
        classes: ``[C + 1]`` how probable the subject holds each schema class.
    """
    positions = belief.space.sight.positions
    edges = np.zeros((positions, positions + 1))
    for block, members, _ in _members(belief, classes):
        own = block.catalogue.members
        at = belief.positions[block.slots]
        to = np.append(at, positions)
        for lever, position in enumerate(at):
            causes = (own.causes >> np.uint16(lever) & 1).astype(float)
            edges[position, to] += members @ causes
    return edges


def strength_probabilities(belief: Belief) -> FloatArray:
    """``[G]`` probability of each strength of the space."""
    many = len(belief.space.strengths)
    return np.bincount(belief.which % many, belief.weight, minlength=many)


def most_probable(belief: Belief, classes: FloatArray) -> tuple[Schema, float]:
    """The most probable structure as a schema, and its probability.

    Its levers are called by their positions. Levers that do nothing for the door are inert.

    Args:
        belief: A subject's belief.
        classes: ``[C + 1]`` how probable the subject holds each schema class.
    """
    best, found = -1.0, None
    for block, members, strength in _members(belief, classes):
        index = int(members.argmax())
        if members[index] > best:
            best, found = float(members[index]), (block, index, strength)
    assert found is not None, "a belief holds something possible"
    block, index, strength = found
    return _schema(block, index, belief, strength), best


def _members(belief: Belief, classes: FloatArray) -> Iterator[tuple[Block, FloatArray, float]]:
    """Each block that is held possible, with the probability of each of its structures.

    The third is the strength that is most probable if the block is right.
    """
    space = belief.space
    many = len(space.strengths)
    starts = np.concatenate([[0], space.ends[:-1]])
    in_block = np.searchsorted(space.ends, belief.which, side="right")
    for number in np.unique(in_block):
        block = space.blocks[number]
        own = block.catalogue
        mine = in_block == number
        place = belief.which[mine] - starts[number]
        weight = belief.weight[mine]
        held = np.bincount(place // many, weight, minlength=len(own))
        pairs = own.pairs_given_behaviour(classes * feasible(own.members.levers))
        members = np.bincount(own.member, pairs, minlength=len(own.members)) * held[own.behaviour]
        strength = space.strengths.value[np.bincount(place % many, weight).argmax()]
        yield block, members, float(strength)


def _schema(block: Block, index: int, belief: Belief, strength: float) -> Schema:
    own = block.catalogue.members[np.array([index])]
    positions: IntArray = belief.positions[block.slots]
    names = [position_names(belief.space.sight.positions)[position] for position in positions]
    edges: dict[str, dict[str, float]] = {}
    gates: dict[str, Gate] = {}
    for node, effect in enumerate([*names, DOOR]):
        causes = [name for i, name in enumerate(names) if own.causes[0, node] >> i & 1]
        for cause in causes:
            edges.setdefault(cause, {})[effect] = strength
        enough = int(own.threshold[0, node])
        if enough > 1:
            gate = Gate("all") if enough == len(causes) else Gate("at_least", enough)
            gates[effect] = gate
    inert = [name for i, name in enumerate(names) if own.inert()[0] >> i & 1]
    return Schema("belief", names, edges, gates=gates, inert=inert, title="Most probable")

"""All behaviours of n levers that have the number of solutions on the console.

Structures that no attempt can distinguish are one hypothesis with the sum of their probabilities. A
:class:`Catalogue` lists each such *behaviour* once, and keeps its structures, so that beliefs about
edges follow from beliefs about behaviours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from causal_openlock.belief.grammar import assigned, outlines, schema_classes
from causal_openlock.belief.structures import (
    Hypotheses,
    Structures,
    gate_dags,
    linear_extensions,
    merge,
)
from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray

FREE_FORM_LEVERS = 4
"""Most levers of which every gate-DAG is enumerated; five have seventeen million."""

HYPOTHESES = 20_000
"""About how many hypotheses are listed for a room."""

TABLE_BYTES = 1 << 27
"""Most bytes of the table in which structures are compared; it limits how many are listed."""


@dataclass(frozen=True, eq=False)
class Catalogue:
    """The behaviours of n levers with k solutions, within the limit of actions.

    U behaviours, M labelled structures that have them, G pairs of a structure and a class that
    generates it, C classes and the free form.
    """

    members: Structures  #: ``[M]`` the structures
    behaviour: IntArray  #: ``[M]`` which behaviour each has; ascending
    member: IntArray  #: ``[G]`` the structure of each pair; ascending
    kind: IntArray  #: ``[G]`` the class of each pair; C is the free form
    chance: FloatArray  #: ``[G]`` how likely the class is to generate the structure

    @cached_property
    def behaviours(self) -> Hypotheses:
        """``[U]`` each behaviour, as its first structure."""
        first = np.searchsorted(self.behaviour, np.arange(len(self)))
        return Hypotheses.of(self.members[first])

    def __len__(self) -> int:
        return int(self.behaviour[-1]) + 1 if len(self.behaviour) else 0

    def prior(self, classes: FloatArray) -> FloatArray:
        """``[U]`` probability of each behaviour, given ``[C + 1]`` that of each class."""
        possible = classes * feasible(self.members.levers)
        pairs = (possible / possible.sum())[self.kind] * self.chance
        starts = np.searchsorted(self.behaviour[self.member], np.arange(len(self)))
        return np.add.reduceat(pairs, starts)

    def pairs_given_behaviour(self, classes: FloatArray) -> FloatArray:
        """``[G]`` probability of structure and class, given the behaviour; for one subject."""
        pairs = (classes * feasible(self.members.levers))[self.kind] * self.chance
        groups = self.behaviour[self.member]
        total = np.bincount(groups, pairs, minlength=len(self))
        return np.divide(pairs, total[groups], out=np.zeros_like(pairs), where=pairs > 0)

    def classes(self, behaviours: FloatArray, before: FloatArray) -> FloatArray:
        """``[C + 1]`` probability of each class, given ``[U]`` that of each behaviour in a room.

        ``before``, ``[C + 1]``, is the probability of the classes without the room.
        """
        pairs = self.pairs_given_behaviour(before)
        pairs *= behaviours[self.behaviour[self.member]]
        return np.bincount(self.kind, pairs, minlength=len(before)).astype(float)


def distance(structures: Structures, solutions: int, action_limit: int) -> IntArray:
    """``[M]`` number of solutions too many or too few, plus those too long for an attempt."""
    found = structures.solutions()
    sizes = np.bitwise_count(np.arange(found.shape[1]))
    too_many = np.abs(found.sum(axis=1) - solutions)
    # The push of the door is an action as well.
    return too_many + found[:, sizes >= action_limit].sum(axis=1)


@cache
def feasible(levers: int) -> BoolArray:
    """``[C + 1]`` which classes can have this number of levers; the free form always can."""
    return np.array(
        [any(True for _ in kind.sizes(levers)) for kind in schema_classes()] + [True], dtype=bool
    )


@lru_cache(maxsize=16)
def free_form_weight(levers: int, simplicity: float) -> FloatArray:
    """``[M]`` probability of each gate-DAG in the free form.

    Levers are put in a random order, and each chooses its causes among those before it; each cause
    and each gate other than ``any`` costs ``simplicity`` nats.
    """
    structures = gate_dags(levers)
    weight = linear_extensions(structures.causes)
    for node in range(levers + 1):
        causes = np.bitwise_count(structures.causes[:, node])
        weight = weight * gate_weight(causes, structures.threshold[:, node], simplicity)
    return weight / weight.sum()


def gate_weight(
    causes: NDArray[np.integer], threshold: NDArray[np.integer], simplicity: float
) -> FloatArray:
    """Prior factor of one node in the free form, by the length of its description."""
    return np.exp(-simplicity * (causes + (threshold > 1.0)))


@lru_cache(maxsize=256)  # a fit tries many values of simplicity
def catalogue(
    levers: int, solutions: int, action_limit: int, uncertain: bool, simplicity: float
) -> Catalogue:
    """The catalogue for what a subject perceives of a room.

    If levers may fail to move (``uncertain``), more behaviours differ. With more than four levers,
    only :data:`HYPOTHESES` of the shortest classes are listed, within :data:`TABLE_BYTES`; the
    others are sampled from the free form. For ``simplicity`` see :func:`free_form_weight`.
    """
    structures, outlined = outlines(levers)
    fitting = np.flatnonzero(distance(structures, solutions, action_limit) == 0)
    if levers > FREE_FORM_LEVERS:  # classes come in the order of their length
        orders = math.factorial(levers)
        ways = [orders // math.prod(map(math.factorial, outlined[at].sizes)) for at in fitting]
        sets = sum(math.comb(levers, pushed) for pushed in range(min(levers, action_limit) + 1))
        bytes_of_each = sets * (levers + 3)
        most = min(HYPOTHESES, TABLE_BYTES // bytes_of_each)
        fitting = fitting[np.cumsum(ways) <= most]
    structures, kind, chance = assigned(structures[fitting], [outlined[at] for at in fitting])
    if levers <= FREE_FORM_LEVERS:
        every = gate_dags(levers)
        chosen = np.flatnonzero(distance(every, solutions, action_limit) == 0)
        structures = Structures.joined([structures, every[chosen]])
        kind = np.append(kind, np.full(len(chosen), len(schema_classes())))
        chance = np.append(chance, free_form_weight(levers, simplicity)[chosen])
    first, member = merge(structures.labels())
    members = structures[first]
    _, behaviour = merge(members.behaviour(action_limit, uncertain))
    rank = np.argsort(behaviour, kind="stable")  # structures of a behaviour side by side
    member = np.argsort(rank)[member]
    pairs = np.argsort(member, kind="stable")
    return Catalogue(members[rank], behaviour[rank], member[pairs], kind[pairs], chance[pairs])

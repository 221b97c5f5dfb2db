"""A grammar of causal schemas of any size: roles, and which role enables which.

What a subject transfers from a room with three levers to one with four is not a structure but a
*class* of structures, such as "one lever enables many, any of which unlocks the door". A class is a
list of up to four *roles*. A role is played by one lever or by many, and is enabled by earlier
roles through a gate (any of their levers, all of them, at least two of them); the door is enabled
in the same way, or by at least three or four levers. A role that enables nothing is a decoy.

The prior prefers short descriptions, ``P(class)`` proportional to ``exp(-simplicity * length)``:
each role, each "role enables role", and each gate other than ``any`` counts one; at most eight.

On n levers, a class *generates* structures: first how many levers play each role, then which.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations, pairwise, permutations
from typing import NamedTuple

import numpy as np

from causal_openlock.belief.structures import Structures, renamed
from causal_openlock.schemas.fsm import FloatArray, IntArray

MAX_ROLES = 4
MAX_LENGTH = 8
MOST_OUTLINES = 6000
GATES = ("any", "all", "two")
DOOR_GATES = (*GATES, "three", "four")
ENOUGH = {"any": 1, "two": 2, "three": 3, "four": 4}


@dataclass(frozen=True, order=True)
class Role:
    """Interchangeable levers."""

    many: bool  #: whether any number of levers may play it, or exactly one
    causes: int  #: the roles that enable it, as a bit mask; 0 if its levers are free
    gate: str
    """How many of their levers must be pushed, one of :data:`GATES`, or of :data:`DOOR_GATES`."""

    @property
    def length(self) -> int:
        """Length of its description."""
        return 1 + self.causes.bit_count() + (self.gate != "any")


@dataclass(frozen=True, order=True)
class SchemaClass:
    """Schemas of all sizes that share a description.

    Example:
        >>> common_cause = SchemaClass(
        ...     (Role(False, 0, "any"), Role(True, 0b01, "any")), Role(False, 0b10, "any")
        ... )
        >>> print(common_cause)
        A; A -> B+; B+ -> door
        >>> common_cause.length, list(common_cause.sizes(4))
        (4, [(1, 3)])
    """

    roles: tuple[Role, ...]  #: the levers' roles, causes before effects
    door: Role  #: the door's causes and gate

    @cached_property
    def length(self) -> int:
        """Length of its description: roles, arrows between them, and unusual gates."""
        return sum(role.length for role in (*self.roles, self.door)) - 1

    def sizes(self, levers: int) -> Iterator[tuple[int, ...]]:
        """Ways to divide a number of levers among the roles, as sizes of the roles."""
        for cuts in combinations(range(1, levers), len(self.roles) - 1):
            sizes = tuple(end - start for start, end in pairwise((0, *cuts, levers)))
            if all(role.many or size == 1 for role, size in zip(self.roles, sizes, strict=True)):
                yield sizes

    def __str__(self) -> str:
        names = [f"{chr(65 + i)}{'+' * role.many}" for i, role in enumerate(self.roles)]

        def causes(role: Role) -> str:
            joined = " ".join(name for i, name in enumerate(names) if role.causes >> i & 1)
            return joined if role.gate == "any" else f"{role.gate}({joined})"

        arrows = [
            f"{causes(role)} -> {name}" if role.causes else name
            for role, name in zip(self.roles, names, strict=True)
        ]
        return "; ".join([*arrows, f"{causes(self.door)} -> door"])


@cache
def schema_classes(roles: int = MAX_ROLES, length: int = MAX_LENGTH) -> tuple[SchemaClass, ...]:
    """Every class up to a number of roles and a length, each once, the shortest first."""

    def extend(chosen: tuple[Role, ...], left: int) -> Iterator[SchemaClass]:
        """Classes that begin with these roles, within what is left of the length."""
        if chosen:
            for door in _options(len(chosen), door=True):
                if door.length - 1 <= left and _chooses(door, chosen):
                    yield SchemaClass(chosen, door)
        if len(chosen) < roles:
            for role in _options(len(chosen)):
                # The door needs one part more.
                if role.length < left and _chooses(role, chosen):
                    yield from extend((*chosen, role), left - role.length)

    found = filter(_is_canonical, extend((), length))
    return tuple(sorted(found, key=lambda kind: (kind.length, kind)))


@cache
def _options(earlier: int, door: bool = False) -> list[Role]:
    """Possible roles after ``earlier`` others, or the possible causes of the door."""
    return [
        Role(many, causes, gate)
        for many in ((False,) if door else (False, True))
        for causes in range(1 if door else 0, 1 << earlier)
        for gate in ((DOOR_GATES if door else GATES) if causes else GATES[:1])
    ]


def _chooses(role: Role, roles: tuple[Role, ...]) -> bool:
    """Whether the gate differs from the plain one."""
    causes = [other for i, other in enumerate(roles) if role.causes >> i & 1]
    most = math.inf if any(other.many for other in causes) else len(causes)
    return role.gate == "any" or most > (1 if role.gate == "all" else ENOUGH[role.gate])


def _is_canonical(kind: SchemaClass) -> bool:
    """Whether no other order of the roles describes the same class by something smaller."""
    given = [(role.many, role.causes, role.gate) for role in kind.roles]
    for order, moved in _renamings(len(given)):
        in_order = [given[old] for old in order]
        described = [(many, moved[causes], gate) for many, causes, gate in in_order]
        # Where a cause would come after its effect, this is no description.
        if any(causes >> index for index, (_, causes, _) in enumerate(described)):
            continue
        if (described, moved[kind.door.causes]) < (given, kind.door.causes):
            return False
    return True


@cache
def _renamings(roles: int) -> list[tuple[tuple[int, ...], list[int]]]:
    """Every order of the roles, and each set of roles as a bit mask in that order."""
    sets, orders = np.arange(1 << roles, dtype=np.uint16), permutations(range(roles))
    return [(order, renamed(sets, np.argsort(order)).tolist()) for order in orders]


def class_prior(simplicity: float, free_form: float) -> FloatArray:
    """``[C + 1]`` prior probability of each class; the last is "none of these", the free form.

    Each part of a description costs ``simplicity`` nats; a schema is of no class with the
    probability ``free_form``.
    """
    lengths = np.array([kind.length for kind in schema_classes()], dtype=float)
    prior = np.exp(-simplicity * (lengths - lengths.min()))
    return np.append((1.0 - free_form) * prior / prior.sum(), free_form)


class Outline(NamedTuple):
    """A class, the sizes of its roles, and the probability of these sizes given the class."""

    kind: int
    sizes: tuple[int, ...]
    chance: float


@cache
def outlines(levers: int) -> tuple[Structures, list[Outline]]:
    """One structure for each class and each way to split the levers into its roles.

    Which lever plays which role is left open: it changes neither the number of solutions nor their
    lengths, which rule most structures out. With many levers only the shortest classes are
    outlined, as there are tens of thousands.
    """
    found: list[Outline] = []
    for index, kind in enumerate(schema_classes()):
        ways = list(kind.sizes(levers))
        if len(found) + len(ways) > MOST_OUTLINES:
            break
        found += [Outline(index, sizes, 1.0 / len(ways)) for sizes in ways]
    nodes = np.array([_outline(schema_classes()[one.kind], one.sizes) for one in found])
    structures = Structures(nodes[..., 0].astype(np.uint16), nodes[..., 1].astype(np.uint8))
    return structures, found


def _outline(kind: SchemaClass, sizes: tuple[int, ...]) -> list[tuple[int, int]]:
    """Causes and threshold of each lever, role after role, and of the door."""
    starts = np.cumsum([0, *sizes]).tolist()
    members = [(1 << end) - (1 << start) for start, end in pairwise(starts)]
    nodes: list[tuple[int, int]] = []
    for role, size in zip((*kind.roles, kind.door), (*sizes, 1), strict=True):
        causes = sum(levers for i, levers in enumerate(members) if role.causes >> i & 1)
        most = causes.bit_count()
        nodes += [(causes, min(ENOUGH.get(role.gate, most), most))] * size
    return nodes


def assigned(
    structures: Structures, outlined: Sequence[Outline]
) -> tuple[Structures, IntArray, FloatArray]:
    """Each outline with every assignment of levers to its roles, equally probable.

    Returns:
        The structures, of each its class, and the probability that the class generates it.
    """
    kind = np.array([outline.kind for outline in outlined], dtype=int)
    chance = np.array([outline.chance for outline in outlined])
    parts = [(structures[:0], kind[:0], chance[:0])]
    for sizes in sorted({outline.sizes for outline in outlined}):
        alike = np.flatnonzero([outline.sizes == sizes for outline in outlined])
        orders = [*assignments(sizes)]
        for order in orders:
            placed = structures[alike].on_slots(order, structures.levers)
            parts.append((placed, kind[alike], chance[alike] / len(orders)))
    placed, kinds, chances = zip(*parts, strict=True)
    return Structures.joined(placed), np.concatenate(kinds), np.concatenate(chances)


def assignments(
    sizes: Sequence[int], levers: Collection[int] | None = None
) -> Iterator[tuple[int, ...]]:
    """Every assignment of levers, by default as many as needed, to roles of these sizes.

    >>> list(assignments([1, 2]))
    [(0, 1, 2), (1, 0, 2), (2, 0, 1)]
    """
    levers = range(sum(sizes)) if levers is None else levers
    if not sizes:
        yield ()
        return
    for first in combinations(levers, sizes[0]):
        left = [lever for lever in levers if lever not in first]
        for others in assignments(sizes[1:], left):
            yield (*first, *others)

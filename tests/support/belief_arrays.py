"""Beliefs as arrays, and the same as rules and structures of the oracle."""

from collections.abc import Sequence
from functools import cache

import numpy as np

from causal_openlock.belief.grammar import SchemaClass, schema_classes
from causal_openlock.belief.structures import NEVER, Hypotheses, Structures
from causal_openlock.schemas.schema import Schema
from oracle import DOOR, Rules, Seen, behaviour, fits_console, free_form, generated, structure

Key = tuple[tuple[frozenset, ...], tuple[int, ...]]
"""A structure on levers 0, 1, ...: causes of each and of the door, and how many are needed."""


def lever_set(mask: int) -> frozenset[int]:
    return frozenset(lever for lever in range(16) if int(mask) >> lever & 1)


def mask(levers) -> int:
    return sum(1 << lever for lever in levers)


def key_of(schema: Schema) -> Key:
    """The structure of a schema, its levers by number."""
    place = {lever: number for number, lever in enumerate(schema.levers)}
    return key_of_rules(Rules.of(schema).at(place))[1]


def key_of_rules(rules: Rules) -> tuple[tuple, Key]:
    """The levers in their order, and the structure on their numbers in that order."""
    levers = tuple(sorted(rules.levers))
    nodes = (*levers, DOOR)
    causes = tuple(frozenset(map(levers.index, rules.causes[node])) for node in nodes)
    return levers, (causes, tuple(rules.needed[node] for node in nodes))


def arrays_of(keys: Sequence[Key]) -> Structures:
    """Structures as arrays."""
    return Structures(
        np.array([[mask(own) for own in causes] for causes, _ in keys], dtype=np.uint16),
        np.array([needed for _, needed in keys], dtype=np.uint8),
    )


def keys_of(structures: Structures) -> list[Key]:
    """Arrays as structures."""
    causes, needed = structures.causes.tolist(), structures.threshold.tolist()
    return [(tuple(map(lever_set, c)), tuple(n)) for c, n in zip(causes, needed, strict=True)]


def rules_in(hypotheses: Hypotheses, index: int, strength: float = 1.0) -> Rules:
    """The rules of one of many hypotheses, its levers by slot."""
    *levers, door = range(hypotheses.causes.shape[1])
    needed = hypotheses.threshold[index].tolist()
    active = {slot: slot for slot in levers if needed[slot] != NEVER} | {door: DOOR}
    causes = {
        name: dict.fromkeys(sorted(lever_set(hypotheses.causes[index, node])), strength)
        for node, name in active.items()
    }
    return Rules(causes, {name: needed[node] for node, name in active.items()})


def hypothesis_of(key: Key, slots: Sequence[int], positions: int, strength: int = 0) -> Hypotheses:
    """A structure as arrays: its levers stand in ``slots``; the others of a room never move."""
    rules = structure(*key)
    causes = np.zeros((1, positions + 1), dtype=np.uint16)
    needed = np.full((1, positions + 1), NEVER, dtype=np.uint8)
    causes[0, [*slots, positions]] = [mask(slots[c] for c in own) for own in key[0]]
    needed[0, [*slots, positions]] = key[1]
    solutions = sorted(mask(slots[c] for c in levers) for levers in rules.solutions)
    return Hypotheses(
        causes,
        needed,
        np.array([mask(slots[c] for c in rules.inert)], dtype=np.uint16),
        np.array([solutions], dtype=np.uint16),
        np.array([strength], dtype=np.uint8),
    )


def partition(labels) -> list[int]:
    """Equal labels get equal numbers, counted as they come."""
    numbers: dict = {}
    return [numbers.setdefault(label, len(numbers)) for label in labels]


def seen_in(before, after, positions: int, new: bool, door: bool) -> tuple[frozenset, Seen]:
    """Levers pushed before an action, and what was seen after it, from two observations."""
    pushed, then = (frozenset(np.flatnonzero(one[:positions]).tolist()) for one in (before, after))
    opened = bool(after[-1])
    moved = opened if door else pushed != then
    return pushed, Seen(moved, then, not after[-2], opened, bool(new))


@cache
def seen_of(key: Key, action_limit: int, strength: float = 1.0):
    """All that attempts with a structure can show: equal if nothing can tell two apart."""
    return behaviour(structure(*key, strength), action_limit)


@cache
def class_structures(kind: SchemaClass, levers: int) -> dict[Key, float]:
    """What a class of the grammar generates."""
    roles = [(lever_set(role.causes), role.gate, role.many) for role in (*kind.roles, kind.door)]
    return generated(roles[:-1], roles[-1], levers)


def of_classes(classes: Sequence[float], levers: int, simplicity: float):
    """Class, structure and probability; classes that cannot have so many levers are impossible.

    Given is how probable the classes of the grammar are, and the free form last.
    """
    every = [class_structures(kind, levers) for kind in schema_classes()]
    every.append(free_form(levers, simplicity))
    possible = sum(p for p, own in zip(classes, every, strict=True) if own)
    for index, (p, own) in enumerate(zip(classes, every, strict=True)):
        for key, chance in own.items():
            yield index, key, p / possible * chance


def fits(key: Key, solutions: int, action_limit: int) -> bool:
    """Whether a structure has what the console shows."""
    return fits_console(structure(*key), solutions, action_limit)

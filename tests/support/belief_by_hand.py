"""Beliefs in plain Python, slow and by definition, to compare the fast ones with.

What a structure does is asked of the machine of its schema, and never derived here: structures
become schemas, schemas are compiled, and the machine's tables say what happens.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from itertools import combinations, permutations, product
from typing import NamedTuple

import networkx as nx
import numpy as np

from causal_openlock.belief.grammar import SchemaClass
from causal_openlock.belief.structures import NEVER, Hypotheses, Structures
from causal_openlock.schemas.fsm import FSM, compile_schema
from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.world.room import Layout, Room

DOOR_SLOT = -1


class Plain(NamedTuple):
    """A gate-DAG on n levers: causes and threshold of each lever, and of the door at the end."""

    causes: tuple[frozenset[int], ...]
    threshold: tuple[int, ...]


def plain_of(schema: Schema) -> Plain:
    """The structure of a schema, its levers by number."""
    nodes = [*schema.levers, DOOR]
    return Plain(
        tuple(frozenset(map(schema.levers.index, schema.causes(node))) for node in nodes),
        tuple(map(schema.threshold, nodes)),
    )


@cache
def schema_of(plain: Plain, strength: float = 1.0) -> Schema:
    """A structure as a schema, all its edges equally strong."""
    names = [*(f"L{lever}" for lever in range(len(plain.causes) - 1)), DOOR]
    edges: dict[str, dict[str, float]] = {name: {} for name in names[:-1]}
    for effect, causes in zip(names, plain.causes, strict=True):
        for cause in causes:
            edges[names[cause]][effect] = strength
    graph = nx.DiGraph([(cause, effect) for cause, effects in edges.items() for effect in effects])
    useful = nx.ancestors(graph, DOOR)
    return Schema(
        "by_hand",
        names[:-1],
        edges,
        gates={
            name: Gate("at_least", k)
            for name, k in zip(names, plain.threshold, strict=True)
            if k
        },
        inert=[name for name in names[:-1] if name not in useful],
    )  # fmt: skip


def arrays_of(plains: Sequence[Plain]) -> Structures:
    """Structures as arrays."""
    causes = [[sum(1 << lever for lever in node) for node in plain.causes] for plain in plains]
    return Structures(
        np.array(causes, dtype=np.uint16),
        np.array([plain.threshold for plain in plains], dtype=np.uint8),
    )


def plains_of(structures: Structures) -> list[Plain]:
    """Arrays as structures."""
    return [
        Plain(
            tuple(frozenset(i for i in range(16) if mask >> i & 1) for mask in causes),
            tuple(threshold),
        )
        for causes, threshold in zip(
            structures.causes.tolist(), structures.threshold.tolist(), strict=True
        )
    ]


@cache
def machine(plain: Plain, strength: float = 1.0) -> FSM:
    """The machine of a structure."""
    return compile_schema(schema_of(plain, strength))


@cache
def transcript(plain: Plain, action_limit: int, strength: float = 1.0) -> tuple[object, ...]:
    """Everything that can be seen in an attempt, whatever is done: equal if nothing tells apart.

    After each sequence of actions, each of which takes effect or fails: how probable that was,
    what is pushed, whether the door is unlocked, and which solution was completed, the solutions
    being numbered as they come, since what they are called is not for the eye.
    """
    fsm = machine(plain, strength)
    chances, afters = fsm.chance.tolist(), fsm.next_state.tolist()
    unlocked, solution = fsm.unlocked.tolist(), fsm.solution.tolist()
    numbers: dict[int, int] = {}

    def seen(state: int, left: int) -> tuple[object, ...]:
        if state >> fsm.levers:  # the door is open, and the attempt is over
            number = -1
            if solution[state] >= 0:
                number = numbers.setdefault(solution[state], len(numbers))
            return (number,)
        whole: list[object] = [state, unlocked[state]]
        for action in range(fsm.actions if left else 0):
            chance = round(chances[state][action], 9)
            whole.append(chance)
            if chance < 1:
                whole.append(seen(state, left - 1))
            if chance > 0:
                whole.append(seen(afters[state][action], left - 1))
        return tuple(whole)

    return seen(0, action_limit)


def partition(labels: Iterable[object]) -> list[int]:
    """Equal labels get equal numbers, counted as they come."""
    numbers: dict[object, int] = {}
    return [numbers.setdefault(label, len(numbers)) for label in labels]


# -- what is probable before anything is tried ----------------------------------------------------


@cache
def every_gate_dag(levers: int) -> tuple[Plain, ...]:
    """Every labelled gate-DAG, by asking networkx of every graph whether it is acyclic."""
    arrows = list(permutations(range(levers), 2))
    found = []
    for present in product((False, True), repeat=len(arrows)):
        graph = nx.DiGraph()
        graph.add_nodes_from(range(levers))
        graph.add_edges_from(arrow for arrow, is_there in zip(arrows, present, strict=True)
                             if is_there)  # fmt: skip
        if not nx.is_directed_acyclic_graph(graph):
            continue
        causes = [frozenset(graph.predecessors(lever)) for lever in range(levers)]
        for size in range(1, levers + 1):
            for of_door in combinations(range(levers), size):
                whole = (*causes, frozenset(of_door))
                gates = [range(1, len(node) + 1) if node else (0,) for node in whole]
                found += [Plain(whole, chosen) for chosen in product(*gates)]
    return tuple(found)


@cache
def free_form(levers: int, simplicity: float) -> dict[Plain, float]:
    """Levers in a random order, each choosing its causes among those before it."""
    weight = {
        plain: sum(
            all(order[cause] < order[lever] for lever in range(levers)
                for cause in plain.causes[lever])
            for order in permutations(range(levers))
        ) * math.exp(-simplicity * sum(
            len(causes) + (k > 1) for causes, k in zip(*plain, strict=True)
        ))
        for plain in every_gate_dag(levers)
    }  # fmt: skip
    total = sum(weight.values())
    return {plain: value / total for plain, value in weight.items()}


@cache
def generated(kind: SchemaClass, levers: int) -> dict[Plain, float]:
    """What a class generates: first how many levers play each role, then which."""
    by_split: dict[tuple[int, ...], list[Plain]] = defaultdict(list)
    for played in product(range(len(kind.roles)), repeat=levers):
        players = [frozenset(i for i, role in enumerate(played) if role == r)
                   for r in range(len(kind.roles))]  # fmt: skip
        if any(
            not levers_of_it or (len(levers_of_it) > 1 and not role.many)
            for role, levers_of_it in zip(kind.roles, players, strict=True)
        ):
            continue
        causes, threshold = [], []
        for role in (*(kind.roles[r] for r in played), kind.door):
            enabling = frozenset[int]().union(
                *(levers_of_it for r, levers_of_it in enumerate(players) if role.causes >> r & 1)
            )
            count = {"any": 1, "all": len(enabling), "two": 2, "three": 3, "four": 4}
            enough = count[role.gate]
            causes.append(enabling)
            threshold.append(min(enough, len(enabling)))
        by_split[tuple(map(len, players))].append(Plain(tuple(causes), tuple(threshold)))
    chance: dict[Plain, float] = defaultdict(float)
    for plains in by_split.values():
        for plain in plains:
            chance[plain] += 1 / len(by_split) / len(plains)
    return dict(chance)


def of_classes(
    kinds: Sequence[SchemaClass], classes: Sequence[float], levers: int, simplicity: float
) -> Iterator[tuple[int, Plain, float]]:
    """Class, structure and probability; classes that cannot have so many levers are impossible.

    Args:
        kinds: The classes of the grammar.
        classes: How probable they are, and the free form last.
        levers: Number of levers.
        simplicity: As for the free form.
    """
    all_of_them = [generated(kind, levers) for kind in kinds] + [free_form(levers, simplicity)]
    possible = sum(p for p, own in zip(classes, all_of_them, strict=True) if own)
    for index, (p, own) in enumerate(zip(classes, all_of_them, strict=True)):
        for plain, chance in own.items():
            yield index, plain, p / possible * chance


def fits_console(plain: Plain, solutions: int, action_limit: int) -> bool:
    """Whether there are so many solutions, each of which an attempt has room for."""
    schema = schema_of(plain)
    return len(schema.solutions) == solutions and schema.least_action_limit <= action_limit


# -- what happens ---------------------------------------------------------------------------------


class Outcome(NamedTuple):
    """One thing that can come of an action."""

    took_effect: bool
    pushed: int
    unlocked: bool
    new: bool


class World:
    """What would happen under one hypothesis, asked of the machine of its schema.

    Args:
        fsm: The machine.
        slots: The slot of each of its levers; all other slots never move.
    """

    def __init__(self, fsm: FSM, slots: Sequence[int]) -> None:
        self.fsm, self.slots = fsm, list(slots)

    @classmethod
    def of(cls, hypotheses: Hypotheses, index: int, strength: float = 1.0) -> World:
        """The world of one of many hypotheses."""
        positions = hypotheses.causes.shape[1] - 1
        threshold = hypotheses.threshold[index]
        slots = [slot for slot in range(positions) if threshold[slot] != NEVER]
        nodes = [*slots, positions]
        masks = hypotheses.causes[index, nodes].tolist()
        causes = tuple(
            frozenset(i for i, slot in enumerate(slots) if mask >> slot & 1) for mask in masks
        )
        return cls(machine(Plain(causes, tuple(threshold[nodes].tolist())), strength), slots)

    def state(self, pushed: int) -> int:
        """The machine's state while these slots are pushed and the door is closed."""
        return sum((pushed >> slot & 1) << lever for lever, slot in enumerate(self.slots))

    def outcomes(self, pushed: int, slot: int, found: Iterable[int]) -> dict[Outcome, float]:
        """What can come of pushing what is pulled, pulling what is pushed, or the door."""
        fsm, state = self.fsm, self.state(pushed)
        if slot == DOOR_SLOT:
            action = 2 * fsm.levers
        elif slot in self.slots:
            action = self.slots.index(slot) + fsm.levers * (pushed >> slot & 1)
        else:
            return {Outcome(False, pushed, bool(fsm.unlocked[state]), False): 1.0}
        chance, after = float(fsm.chance[state, action]), int(fsm.next_state[state, action])
        solution = fsm.solution[after]
        known = {int(fsm.solution[self.state(other)]) for other in found}
        new = bool(fsm.opened[after] and solution >= 0 and solution not in known)
        moved = pushed if slot == DOOR_SLOT else pushed ^ 1 << slot
        both = {
            Outcome(False, pushed, bool(fsm.unlocked[state]), False): 1 - chance,
            Outcome(True, moved, bool(fsm.unlocked[after]), new): chance,
        }
        return {outcome: p for outcome, p in both.items() if p > 0}


class Happening(NamedTuple):
    """One action of a subject, by position: what was seen before and after it."""

    before: tuple[int, ...]
    action: int
    after: tuple[int, ...]
    new: bool


def probability(room: Room, happenings: Iterable[Happening]) -> float:
    """How probable a room makes all that happened in a trial, colours aside."""
    positions = room.positions
    places = room.layout.places
    total, found = 1.0, set()
    for before, action, after, new in happenings:
        state = sum(before[place] << lever for lever, place in enumerate(places))
        reached = {}
        chance, moved = float(room.chance[state, action]), int(room.next_state[state, action])
        for p, to in ((1 - chance, state), (chance, moved)):
            if p > 0:
                seen = room.observation[to].tolist()
                solution = int(room.fsm.solution[to]) if room.fsm.opened[to] else -1
                key = (*seen[:positions], *seen[-2:], solution >= 0 and solution not in found)
                reached[key] = (p, solution)
        p, solution = reached.get((*after[:positions], *after[-2:], new), (0.0, -1))
        total *= p
        if new:
            found.add(solution)
    return total


def room_of(plain: Plain, places: Sequence[int], strength: float = 1.0, positions: int = 7) -> Room:
    """A room in which a structure's levers stand at these positions."""
    return Room(machine(plain, strength), Layout(tuple(places), positions))


def entropy(weights: Iterable[float]) -> float:
    """Bits, of probabilities that need not add up to one."""
    positive = [weight for weight in weights if weight > 0]
    total = sum(positive)
    return -sum(weight / total * math.log2(weight / total) for weight in positive)


def hypothesis_of(plain: Plain, slots: Sequence[int], positions: int, strength: int) -> Hypotheses:
    """One hypothesis as arrays: a structure whose levers stand in these slots."""
    schema = schema_of(plain)

    def mask(levers: Iterable[int]) -> int:
        return sum(1 << slots[lever] for lever in levers)

    causes = np.zeros((1, positions + 1), dtype=np.uint16)
    threshold = np.full((1, positions + 1), NEVER, dtype=np.uint8)
    causes[0, [*slots, positions]] = [mask(node) for node in plain.causes]
    threshold[0, [*slots, positions]] = plain.threshold
    solutions = [mask(map(schema.levers.index, levers)) for levers in schema.solutions]
    return Hypotheses(
        causes,
        threshold,
        np.array([mask(map(schema.levers.index, schema.inert))], dtype=np.uint16),
        np.array([solutions], dtype=np.uint16),
        np.array([strength], dtype=np.uint8),
    )

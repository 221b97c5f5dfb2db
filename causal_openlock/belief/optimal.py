"""The least expected number of attempts, by exact dynamic programming over beliefs.

A state is the set of possible hypotheses B, the solutions found, the pushed levers and the actions
left in the attempt. Its value is the expected number of further attempts until every solution is
found under the optimal policy (the Bellman equation, expectimax over beliefs):

    V(state) = min over actions of the sum over outcomes of P(outcome | B) V(next state)

Levers must move surely, so an action only splits B; sets of hypotheses are integers, a bit each.

Values are cached by state, up to renaming of the levers. An action is dropped once a lower bound
shows that another is as good: each solution left costs an attempt, and the present attempt saves
one only where it can still complete a solution.

Pulling a lever back never helps within the paper's three actions (enumerated up to four levers).
By default it is left out unless an attempt has two actions to spare, which a pull and the push that
it undoes cost. With four actions and more this can miss a better policy: pass ``pulls=True``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from itertools import combinations
from typing import NamedTuple

import numpy as np

from causal_openlock.belief.likelihoods import completes
from causal_openlock.belief.placements import TooLargeError
from causal_openlock.belief.planning import achievable
from causal_openlock.belief.structures import Hypotheses
from causal_openlock.schemas.fsm import BoolArray, FloatArray

NODE_LIMIT = 20_000
"""Searching more states than these is too large a problem; a few seconds."""
HYPOTHESIS_LIMIT = 5_000
"""More hypotheses than these are too large a problem."""
TIE = 1e-9
"""Relative difference below which values are equal but for rounding."""


class Point(NamedTuple):
    """A state of a trial."""

    possible: int  #: the possible hypotheses, as a bit mask
    found: tuple[int, ...]  #: the pushed levers with which solutions were found, in ascending order
    pushed: int  #: the pushed levers, as a bit mask of slots
    left: int  #: actions left in the attempt; with none left the attempt is over
    changed: bool = True  #: whether something is known that was not when the attempt began


class _Option(NamedTuple):
    """An action, the states it can lead to, and lower bounds of their values and of the sum."""

    bound: float
    action: int
    outcomes: dict[Point, float]


class Optimum:
    """The least expected number of attempts, and the actions that achieve it.

    Args:
        hypotheses: ``[H]`` different hypotheses with equally many solutions, each of which fits an
            attempt; strengths are ignored.
        weight: ``[H]`` their probabilities, up to a factor.
        action_limit: Actions in an attempt.
        node_limit: States to search before giving up; also an attribute that can be changed.
        pulls: Whether levers may be pulled back; by default if two actions can be spared.

    Raises:
        TooLargeError: If there are too many hypotheses.

    Example:
        >>> from causal_openlock import find_schema
        >>> from causal_openlock.belief.placements import mixture
        >>> round(Optimum(*mixture([(find_schema("CC3"), 1.0)], 3), 3).attempts(), 3)
        2.667
    """

    def __init__(
        self,
        hypotheses: Hypotheses,
        weight: FloatArray,
        action_limit: int,
        node_limit: float = NODE_LIMIT,
        pulls: bool | None = None,
    ) -> None:
        if len(hypotheses) > HYPOTHESIS_LIMIT:
            raise TooLargeError(f"{len(hypotheses):,} hypotheses are too many")
        self._own, self._limit, self.node_limit = hypotheses, action_limit, node_limit
        self._slots: int = hypotheses.causes.shape[1] - 1
        self._solutions: int = hypotheses.solutions.shape[1]
        longest = int(np.bitwise_count(hypotheses.solutions).max(initial=0))
        self._pulls = action_limit - longest - 1 >= 2 if pulls is None else pulls
        self._share = weight / weight.sum()
        self._everything = bits(self._share > 0)
        # States, and sets of hypotheses, are computed once for each instance.
        self._renamed = cache(Names(hypotheses, self._share).canonical)
        self._search, self._holds = cache(self._searched), cache(self._holding)
        self._finds, self._reach = cache(self._finding), cache(self._reaching)
        self._weight = cache(self._weighing)
        self.nodes = 0  #: states searched so far

    @property
    def start(self) -> Point:
        """The start of a trial."""
        return Point(self._everything, (), 0, self._limit)

    def attempts(self) -> float:
        """The least expected number of attempts until every solution is found.

        Raises:
            TooLargeError: If finding it takes more states than are allowed.
        """
        return self._attempts(self._everything, ())

    def best(self, point: Point) -> list[int]:
        """The best actions: pushes by slot, then pulls, and the door as ``2P``.

        If no action can do anything in the rest of the attempt, the door stands for any.
        """
        options = self._best_options(point)
        return sorted(option.action for option in options) or [2 * self._slots]

    def value(self, point: Point) -> float:
        """The least expected number of attempts still to come, the present one not counted."""
        return self._after(point) / self._weight(point.possible)

    def after(self, point: Point, action: int) -> list[tuple[float, Point]]:
        """The states that an action can lead to, with their probabilities.

        Args:
            point: A state with an action left.
            action: A push by slot, a pull, or the door as ``2P``; any other one does nothing.
        """
        outcomes = self._outcomes(point, action) or [point._replace(left=point.left - 1)]
        whole = self._weight(point.possible)
        return [(self._weight(outcome.possible) / whole, outcome) for outcome in outcomes]

    def most(self) -> int:
        """The largest number of attempts under an optimal policy for which it is least."""
        return int(self._followed(lambda possible, found: np.ones(1), np.maximum)[0])

    def by_solution(self, share: FloatArray) -> tuple[float, ...]:
        """Attempts for the first, second, ... solution, under one optimal policy.

        ``share``, ``[H]``, are probabilities; renaming levers must not change them. Of all optimal
        policies, the one that needs least with these probabilities counts, and of several such
        policies, the one that finds earlier solutions soonest.
        """

        def charge(possible: int, found: int) -> FloatArray:
            in_all_and_each = np.zeros(1 + self._solutions)
            in_all_and_each[[0, 1 + found]] = share[_flags(possible, len(share))].sum()
            return in_all_and_each

        return tuple(self._followed(charge, np.add)[1:].tolist())

    def _followed(self, charge: Callable[[int, int], FloatArray], join: np.ufunc) -> FloatArray:
        """What the attempts are charged, under the optimal policy that is charged least.

        An attempt is charged by the possible hypotheses and the number of solutions with which it
        begins; of several numbers, earlier ones matter first. ``join`` combines those of outcomes.
        """

        def begin(possible: int, found: tuple[int, ...]) -> FloatArray:
            """Charges of this attempt and all later ones."""
            if possible & (possible - 1) == 0 or len(found) == self._solutions:
                left = range(len(found), self._solutions)
                return sum((charge(possible, number) for number in left), 0.0 * charge(possible, 0))
            start = self._renamed(Point(possible, found, 0, self._limit, changed=False))
            return charge(possible, len(found)) + after(start)

        @cache
        def after(point: Point) -> FloatArray:
            """Charges to come, the present attempt's not counted."""
            if not point.left:
                return begin(point.possible, point.found)
            options = self._best_options(point)
            plans = [[*option.outcomes] for option in options] or [[point._replace(left=0)]]
            charges: list[FloatArray] = [join.reduce([*map(after, plan)]) for plan in plans]
            return min(charges, key=lambda numbers: numbers.round(10).tolist())

        return begin(self._everything, ())

    def _best_options(self, point: Point) -> list[_Option]:
        """The best actions."""
        tie, least, values = TIE * self._weight(point.possible), math.inf, []
        for option in self._options(point):
            values.append((self._value(option, least + tie), option))
            least = min(least, values[-1][0])
        return [option for value, option in values if value <= least + tie]

    # -- values, times the probability of the possible hypotheses --------------------------------

    def _attempts(self, possible: int, found: tuple[int, ...]) -> float:
        """The value of a state at the start of an attempt."""
        left = self._solutions - len(found)
        if not left or possible & (possible - 1) == 0:
            return self._weight(possible) * left
        start = Point(possible, found, 0, self._limit, changed=False)
        return self._weight(possible) + self._search(self._renamed(start))

    def _after(self, point: Point) -> float:
        """The value after an action."""
        if point.left:
            return self._search(self._renamed(point))
        # An attempt that changes nothing is never the best: do not search it again and again.
        return self._attempts(point.possible, point.found) if point.changed else math.inf

    def _searched(self, point: Point) -> float:
        self.nodes += 1
        if self.nodes > self.node_limit:
            raise TooLargeError(f"more than {self.node_limit:,} states")
        options = self._options(point)
        best = math.inf if options else self._after(point._replace(left=0))
        for option in options:
            best = min(best, self._value(option, best))
        return best

    def _options(self, point: Point) -> list[_Option]:
        """The actions that can do something, the lowest bound first."""
        options = []
        pulls = range(self._slots, 2 * self._slots) if self._pulls else ()
        for action in (*range(self._slots), *pulls, 2 * self._slots):
            if outcomes := self._outcomes(point, action):
                bounds = {outcome: self._bound(outcome) for outcome in outcomes}
                options.append(_Option(sum(bounds.values()), action, bounds))
        return sorted(options)

    def _value(self, option: _Option, limit: float) -> float:
        """The value of an action, or a lower bound of it that exceeds the limit."""
        value = option.bound
        for outcome, bound in option.outcomes.items():
            if value > limit:
                break
            value += self._after(outcome) - bound
        return value

    def _bound(self, point: Point) -> float:
        """A lower bound of the value: an attempt for each solution, less this one's."""
        possible, found, pushed, left, _ = point
        value = self._weight(possible) * (self._solutions - len(found))
        return value - self._weight(possible & self._reach(pushed, left, found)) if left else value

    def _outcomes(self, point: Point, action: int) -> list[Point]:
        """The states that an action can lead to; none if it is known to do nothing."""
        possible, found, pushed, left, changed = point
        door, slot = action == 2 * self._slots, action % self._slots
        does = door or (action >= self._slots) == bool(pushed >> slot & 1)
        works = possible & self._holds(self._slots if door else slot, pushed)
        if not (works and does and 0 <= action <= 2 * self._slots):
            return []
        if door:
            new = works & self._finds(pushed, found)
            more = tuple(sorted((*found, pushed)))
            parts = [(new, more, 0, 0), (works & ~new, found, 0, 0)]
        else:
            after = pushed ^ 1 << slot
            unlocks = works & self._holds(self._slots, after)
            parts = [(part, found, after, left - 1) for part in (unlocks, works & ~unlocks)]
        parts.append((possible & ~works, found, pushed, left - 1))
        return [
            Point(part, then, stand, left, changed or (part, then) != point[:2])
            for part, then, stand, left in parts
            if part
        ]

    # -- sets of hypotheses, cached ---------------------------------------------------------------

    def _weighing(self, possible: int) -> float:
        """The probability of a set of hypotheses."""
        return float(self._share[_flags(possible, len(self._share))].sum())

    def _holding(self, node: int, pushed: int) -> int:
        """The hypotheses under which a lever moves, or the door (the last node) is unlocked."""
        live = np.bitwise_count(self._own.causes[:, node] & np.uint16(pushed))
        return bits(live >= self._own.threshold[:, node])

    def _finding(self, pushed: int, found: tuple[int, ...]) -> int:
        """The hypotheses under which opening the door completes a new solution."""
        return bits(completes(self._own, slice(None), pushed, found))

    def _reaching(self, pushed: int, left: int, found: tuple[int, ...]) -> int:
        """The hypotheses under which ``left`` actions may still complete a new solution."""
        able = achievable(self._own, pushed, left, found, self._pulls)
        return bits(np.asarray(able.any(axis=1)))


class Names:
    """A canonical naming of levers, by what is believed about them.

    Args:
        own: ``[H]`` every hypothesis, each once.
        share: ``[H]`` their probabilities.
    """

    def __init__(self, own: Hypotheses, share: FloatArray) -> None:
        self._slots, self._many = own.causes.shape[1] - 1, len(own)
        structures = own.structures
        index = {label.tobytes(): at for at, label in enumerate(structures.labels())}
        # By two slots, the hypothesis that each becomes when they are swapped; H if there is none.
        self._swap = np.full((self._slots, self._slots, self._many), self._many)
        for first, second in combinations(range(self._slots), 2):
            order = np.arange(self._slots)
            order[[first, second]] = second, first
            image = structures.on_slots(order, self._slots).labels()
            to = np.array([index.get(label.tobytes(), self._many) for label in image])
            alike = np.append(share, np.nan)[to] == share
            self._swap[first, second] = self._swap[second, first] = np.where(alike, to, self._many)
        whole: BoolArray = np.logical_and.reduce(self._swap < self._many, axis=2)
        # Classes of slots that can be renamed, as the hypotheses together do not distinguish them.
        self._class = [min([s, *np.flatnonzero(whole[s]).tolist()]) for s in range(self._slots)]
        solves = (own.solutions[:, None] >> np.arange(self._slots)[:, None] & 1).sum(axis=2)
        opens = own.causes[:, self._slots, None] >> np.arange(self._slots) & 1
        # What distinguishes levers, [features, H, slots].
        self._features = np.stack([own.threshold[:, : self._slots], opens, solves])

    def canonical(self, point: Point) -> Point:
        """The same state with levers renamed in the order of what is believed about them."""
        held = _flags(point.possible, self._many)
        marks = self._features[:, held].sum(axis=1)
        order = sorted(
            range(self._slots),
            key=lambda slot: (
                self._class[slot],
                point.pushed >> slot & 1,
                sum(mask >> slot & 1 for mask in point.found),
                *marks[:, slot].tolist(),
            ),
        )
        # Levers exchange names within their class, one swap after another.
        found, pushed = point.found, point.pushed
        image_of, at = np.flatnonzero(held), list(range(self._slots))
        names = sorted(range(self._slots), key=lambda slot: (self._class[slot], slot))
        for slot, lever in zip(names, order, strict=True):
            if (now := at.index(lever)) != slot:
                image_of = self._swap[slot, now, image_of]
                found = tuple(sorted(swapped(mask, slot, now) for mask in found))
                pushed = swapped(pushed, slot, now)
                at[slot], at[now] = at[now], at[slot]
        image = np.zeros(self._many, dtype=bool)
        image[image_of] = True
        return point._replace(possible=bits(image), found=found, pushed=pushed)


def bits(flags: BoolArray) -> int:
    """A set of hypotheses, ``[H]`` whether each is in it, as a bit mask."""
    return int.from_bytes(np.packbits(flags, bitorder="little").tobytes(), "little")


def _flags(mask: int, many: int) -> BoolArray:
    data = np.frombuffer(mask.to_bytes((many + 7) // 8, "little"), dtype=np.uint8)
    return np.unpackbits(data, count=many, bitorder="little").astype(bool)


def swapped(mask: int, first: int, second: int) -> int:
    """Swap two slots in a set."""
    return mask ^ (1 << first | 1 << second) if (mask >> first ^ mask >> second) & 1 else mask

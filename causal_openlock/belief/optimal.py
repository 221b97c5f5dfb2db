"""The best that can be done: the least expected number of attempts, by exact dynamic programming.

A state is what is still possible, which solutions were found, what stands pushed, and how many
actions the attempt has left. Its value is the expected number of further attempts until every
solution is found, if every action is the best: the smallest value among the actions, where that
of an action is the mean over what can come of it (expectimax over beliefs). Levers must move
surely; then an action only ever splits the set of hypotheses, and sets are integers, a bit each.

Three things keep this small. Values are kept by state, and the states in which attempts begin also
by what they are but for the names of the levers. Levers that the belief cannot tell apart are
tried once. And an action is dropped as soon as a lower bound shows that another is as good: every
solution to be found costs an attempt, and the present one is of use only where it can still end
with one.

Pulling a lever back never helps within the paper's three actions, and is left out unless an attempt
has at least two actions to spare: so many are lost by a pull and the push that it undoes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from causal_openlock.belief.placements import TooLargeError
from causal_openlock.belief.space import Hypotheses
from causal_openlock.belief.symmetry import Symmetry, bits, swapped
from causal_openlock.world.fsm import BoolArray, FloatArray

NODE_LIMIT = 20_000
"""States that are looked at before a problem counts as too large; a few seconds."""
HYPOTHESIS_LIMIT = 5_000
"""Hypotheses from which on a problem counts as too large."""
TIE = 1e-9
"""Values that differ by less, as a share, are equal but for rounding."""


class Point(NamedTuple):
    """Where a trial stands.

    Attributes:
        possible: The hypotheses that are possible, as a bit mask.
        found: What stood pushed when solutions were found, in ascending order.
        pushed: What stands pushed, as a bit mask of slots.
        left: Actions left in the attempt.
    """

    possible: int
    found: tuple[int, ...]
    pushed: int
    left: int


Outcome = tuple[int, tuple[int, ...], int, int]
"""What can come of an action: the fields of a :class:`Point`; an attempt is over with none left."""


class _Option(NamedTuple):
    """An action, what can come of it, and lower bounds: of each outcome and of them all."""

    bound: float
    action: int
    outcomes: list[Outcome]
    bounds: list[float]


class Optimum:
    """The least expected number of attempts, and the actions that achieve it.

    Args:
        hypotheses: ``[H]`` what may be the case, each once, all with equally many solutions, each
            of which fits an attempt; strengths are left aside.
        weight: ``[H]`` their probabilities, in any unit.
        action_limit: Actions in an attempt.
        node_limit: States to look at before giving up; also an attribute, to be set anew.
        pulls: Whether levers may be pulled back; by default if two actions can be spared.

    Attributes:
        nodes: States looked at so far.

    Raises:
        TooLargeError: If there are too many hypotheses.
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
        share = weight / weight.sum()
        self._weights: list[tuple[float, int]] = [
            (weight, bits(np.equal(share, weight)))
            for weight in np.unique(share[share > 0]).tolist()
        ]
        self._everything = bits(share > 0)
        self._symmetry = Symmetry(hypotheses, share)
        self._values: dict[tuple[int, tuple[int, ...]], float] = {}
        self._within: dict[tuple[int, tuple[int, ...], int, int, bool], float] = {}
        self._moving: dict[tuple[int, int], int] = {}
        self._unlocking: dict[int, int] = {}
        self._finding: dict[tuple[int, tuple[int, ...]], int] = {}
        self._reaching: dict[tuple[int, int, tuple[int, ...]], int] = {}
        self.nodes = 0

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

        If nothing that is left of the attempt can do anything, it may as well be the door.
        """
        options = self._options(point.possible, point.found, point.pushed, point.left)
        tie = TIE * self._weight(point.possible)
        least, values = math.inf, {}
        for option in options:
            # The attempt is not held to have begun like this: to waste the rest of it has a value.
            values[option.action] = self._value(option, point.possible, point.found, 0, least + tie)
            least = min(least, values[option.action])
        alike = self._alike(point.possible, point.found, point.pushed)
        return sorted(
            same
            for action, value in values.items()
            if value <= least + tie
            for same in alike.get(action, (action,))
        ) or [2 * self._slots]

    def most(self) -> int:
        """The most attempts that it may come to, by one plan with the least expected number."""
        worst: dict[tuple[Outcome, bool], int] = {}

        def after(outcome: Outcome, began: int) -> int:
            """Attempts to come, the present one not counted."""
            possible, found, pushed, left = outcome
            if not left:
                to_find = self._solutions - len(found)
                if not to_find or possible & (possible - 1) == 0:
                    return to_find
                possible, found = self._symmetry.canonical(possible, found)
                return 1 + after((possible, found, 0, self._limit), possible)
            if (outcome, possible == began) not in worst:
                best, plan = math.inf, [(possible, found, 0, 0)]
                for option in self._options(possible, found, pushed, left):
                    value = self._value(option, possible, found, began, best)
                    if value < best:
                        best, plan = value, option.outcomes
                worst[outcome, possible == began] = max(
                    after(one, began if one[:2] == (possible, found) else 0) for one in plan
                )
            return worst[outcome, possible == began]

        return after((self._everything, (), 0, 0), 0)

    # -- values, in units of the probability of what is possible ---------------------------------

    def _attempts(self, possible: int, found: tuple[int, ...]) -> float:
        """The value of a state in which an attempt begins."""
        left = self._solutions - len(found)
        if not left or possible & (possible - 1) == 0:
            return self._weight(possible) * left
        possible, found = key = self._symmetry.canonical(possible, found)
        if key not in self._values:
            value = self._search(possible, found, 0, self._limit, possible)
            self._values[key] = self._weight(possible) + value
        return self._values[key]

    def _after(self, outcome: Outcome, began: int) -> float:
        """The value of what came of an action, in an attempt that began with these hypotheses."""
        possible, found, pushed, left = outcome
        if left:
            return self._search(possible, found, pushed, left, began)
        # An attempt that told nothing and found nothing is never the best: no need to go round.
        return math.inf if possible == began else self._attempts(possible, found)

    def _search(
        self, possible: int, found: tuple[int, ...], pushed: int, left: int, began: int
    ) -> float:
        key = (possible, found, pushed, left, possible == began)
        if key in self._within:
            return self._within[key]
        self.nodes += 1
        if self.nodes > self.node_limit:
            raise TooLargeError(f"more than {self.node_limit:,} states")
        options = self._options(possible, found, pushed, left)
        best = math.inf if options else self._after((possible, found, pushed, 0), began)
        for option in options:
            best = min(best, self._value(option, possible, found, began, best))
        self._within[key] = best
        return best

    def _options(
        self, possible: int, found: tuple[int, ...], pushed: int, left: int
    ) -> list[_Option]:
        """The actions that can do something, those with the lowest bounds first."""
        options = []
        for action, outcomes in self._actions(possible, found, pushed, left):
            bounds = [self._bound(outcome) for outcome in outcomes]
            options.append(_Option(sum(bounds), action, outcomes, bounds))
        return sorted(options)

    def _value(
        self, option: _Option, possible: int, found: tuple[int, ...], began: int, limit: float
    ) -> float:
        """The value of an action, or a lower bound of it that exceeds the limit."""
        value = option.bound
        for outcome, bound in zip(option.outcomes, option.bounds, strict=True):
            if value > limit:
                break
            same = began if outcome[:2] == (possible, found) else 0
            value += self._after(outcome, same) - bound
        return value

    def _bound(self, outcome: Outcome) -> float:
        """What the outcome is worth at least: an attempt for each solution, less this one's."""
        possible, found, pushed, left = outcome
        value = self._weight(possible) * (self._solutions - len(found))
        return value - self._weight(possible & self._reach(pushed, left, found)) if left else value

    def _actions(
        self, possible: int, found: tuple[int, ...], pushed: int, left: int
    ) -> Iterator[tuple[int, list[Outcome]]]:
        """Each action that can do something, once for levers that are alike, and its outcomes."""
        alike = self._alike(possible, found, pushed)
        for slot in range(self._slots):
            stands = pushed >> slot & 1
            if (stands and not self._pulls) or (not stands and slot not in alike):
                continue
            moving = possible & self._moves(pushed, slot)
            if not moving:
                continue
            after = pushed ^ 1 << slot
            unlocks = moving & self._unlocks(after)
            outcomes = [
                (part, found, now, left - 1)
                for part, now in (
                    (unlocks, after),
                    (moving & ~unlocks, after),
                    (possible & ~moving, pushed),
                )
                if part
            ]
            yield slot + self._slots * stands, outcomes
        if possible & self._unlocks(pushed):
            new = possible & self._finds(pushed, found)
            more = tuple(sorted((*found, pushed)))
            outcomes = [(new, more, 0, 0), (possible & ~new, found, 0, 0)]
            yield 2 * self._slots, [outcome for outcome in outcomes if outcome[0]]

    def _alike(
        self, possible: int, found: tuple[int, ...], pushed: int
    ) -> dict[int, tuple[int, ...]]:
        """The levers that are not pushed, in groups that the belief cannot tell apart."""
        groups: dict[int, tuple[int, ...]] = {}
        for slot in range(self._slots):
            if pushed >> slot & 1:
                continue
            for first, group in groups.items():
                if self._symmetry.swappable(possible, first, slot) and (
                    tuple(sorted(swapped(mask, first, slot) for mask in found)) == found
                ):
                    groups[first] = (*group, slot)
                    break
            else:
                groups[slot] = (slot,)
        return groups

    def _weight(self, possible: int) -> float:
        return sum((weight * (possible & who).bit_count() for weight, who in self._weights), 0.0)

    # -- what hypotheses say, as sets of them ----------------------------------------------------

    def _moves(self, pushed: int, slot: int) -> int:
        """Those under which a lever moves."""
        if (pushed, slot) not in self._moving:
            self._moving[pushed, slot] = bits(self._holds(pushed, slot))
        return self._moving[pushed, slot]

    def _unlocks(self, pushed: int) -> int:
        """Those under which the door is unlocked."""
        if pushed not in self._unlocking:
            self._unlocking[pushed] = bits(self._holds(pushed, self._slots))
        return self._unlocking[pushed]

    def _holds(self, pushed: int, node: int) -> BoolArray:
        live = np.bitwise_count(self._own.causes[:, node] & np.uint16(pushed))
        holds: BoolArray = live >= self._own.threshold[:, node]
        return holds

    def _to_find(self, found: tuple[int, ...]) -> BoolArray:
        """``[H, K]`` which solutions are not found yet."""
        sets = np.array(found, dtype=np.uint16)
        relevant = sets[:, None] & ~self._own.inert  # [F, H]
        done = self._own.solutions[None] == relevant[:, :, None]
        to_find: BoolArray = ~done.any(axis=0)
        return to_find

    def _finds(self, pushed: int, found: tuple[int, ...]) -> int:
        """Those under which opening the door completes a new solution."""
        if (pushed, found) not in self._finding:
            done = (np.uint16(pushed) & ~self._own.inert)[:, None]
            new = (self._own.solutions == done) & self._to_find(found)
            self._finding[pushed, found] = bits(new.any(axis=1))
        return self._finding[pushed, found]

    def _reach(self, pushed: int, left: int, found: tuple[int, ...]) -> int:
        """Those under which so many actions may still complete a new solution."""
        key = (pushed, left, found)
        if key not in self._reaching:
            stands = (np.uint16(pushed) & ~self._own.inert)[:, None]
            missing = np.bitwise_count(self._own.solutions ^ stands) + 1 <= left
            if not self._pulls:
                missing &= self._own.solutions & stands == stands
            useful: BoolArray = missing & self._to_find(found)
            self._reaching[key] = bits(np.logical_or.reduce(useful, axis=1))
        return self._reaching[key]

"""What an action is worth: information, and solutions.

The value of a plan is what it is expected to tell about the room, in bits, plus ``beta`` times the
probability that it completes a new solution. Plans are *closed loop*: what is done next depends on
what was seen, so a plan is a tree over the actions left in the attempt, and its value is computed
from the leaves up. The expected information of a tree is the entropy of its outcomes, less what
is pure chance in them; by the chain rule it adds up from action to action.

Where attempts are so long that the tree would have too many branches, it is cut, and what comes
after is taken to be worth what could still be solved if it were known there what is the case.

Pulling a lever back is left out: it never helps to find out, or to solve, within so few actions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from causal_openlock.belief.evidence import completes
from causal_openlock.belief.space import Hypotheses
from causal_openlock.belief.strength import Strengths
from causal_openlock.belief.structures import NEVER
from causal_openlock.world.fsm import BoolArray, FloatArray, IntArray

MOST_BRANCHES = 5000
"""Sequences of pushes that a plan goes through at most, about; seven levers are looked at for four
actions ahead, four levers for six."""
FEW_LEVERS = 7
MOST_PAIRS = 1_000_000
"""With more levers than these, also the most sequences times hypotheses; two actions are always
looked ahead."""
TIE = 1e-9
"""Values that differ by less are equal but for rounding."""


@dataclass(frozen=True)
class Objective:
    """What a plan is for.

    Attributes:
        information: Weight of expected information, per bit.
        beta: Weight of the probability of a new solution.
        horizon: Actions to look ahead; ``None`` looks to the end of the attempt.
    """

    information: float = 1.0
    beta: float = 3.0
    horizon: int | None = None


@dataclass(frozen=True)
class Situation:
    """Where an attempt stands.

    Attributes:
        pushed: What stands pushed, as a bit mask of slots.
        unlocked: Whether the door is unlocked.
        left: Actions left.
        found: What stood pushed when solutions were found.
    """

    pushed: int
    unlocked: bool
    left: int
    found: tuple[int, ...]


class Planner:
    """Values of actions under a belief.

    Args:
        hypotheses: ``[h]`` what is held possible.
        strengths: What their strengths stand for.
        objective: What plans are for.
        found: What stood pushed when solutions were found.
    """

    def __init__(
        self,
        hypotheses: Hypotheses,
        strengths: Strengths,
        objective: Objective,
        found: tuple[int, ...] = (),
    ) -> None:
        self._hypotheses, self._strengths, self._objective = hypotheses, strengths, objective
        self._found = np.array(found, dtype=np.uint16)
        self._door = hypotheses.causes.shape[1] - 1
        self._uncertain = len(strengths) > 1

    def values(self, weight: FloatArray, situation: Situation) -> FloatArray:
        """``[P + 1]`` value of pushing each lever, and the door last.

        Minus infinity for what stands pushed already, and for a locked door; zero for a lever that
        cannot move.

        Args:
            weight: ``[h]`` the belief.
            situation: Where the attempt stands.
        """
        self._seen: dict[tuple[bytes, int, int], float] = {}
        who = np.flatnonzero(weight > 0)
        share = weight[who] / weight[who].sum()
        left = min(situation.left, self._objective.horizon or situation.left)
        self._cut = max(0, left - self._depth(who, situation.pushed))
        values = np.full(self._door + 1, -np.inf)
        self._look(who, share, situation.pushed, situation.unlocked, left, values)
        return values

    def _depth(self, who: IntArray, pushed: int) -> int:
        """How many actions can be looked ahead without the tree of plans growing too large."""
        can_move = (self._hypotheses.threshold[who, : self._door] < NEVER).any(axis=0)
        choices = sum(1 for slot in np.flatnonzero(can_move).tolist() if not pushed >> slot & 1)
        most = MOST_BRANCHES
        if choices > FEW_LEVERS:
            most = min(most, max(MOST_PAIRS // len(who), 1))
        return max(2, int(math.log(most) / math.log(max(choices, 2))))

    def _look(
        self,
        who: IntArray,
        weight: FloatArray,
        pushed: int,
        unlocked: bool,
        left: int,
        values: FloatArray | None = None,
    ) -> float:
        """The value of the best plan, in units of the weights' sum."""
        known = len(who) == 1 and not self._uncertain
        if values is None and (known or left <= self._cut):
            return self._hope(who, weight, pushed, left)
        own = self._hypotheses
        slots = np.array([slot for slot in range(self._door) if not pushed >> slot & 1])
        best = 0.0
        if len(slots):
            mask = np.uint16(pushed)
            live = np.bitwise_count(own.causes[who[:, None], slots] & mask)
            threshold = own.threshold[who[:, None], slots]
            if self._uncertain:
                chance = self._strengths.chance[own.strength[who, None], live, threshold]
            else:
                chance = (live >= threshold).astype(float)
            after = (mask | np.left_shift(np.uint16(1), slots.astype(np.uint16))).astype(np.uint16)
            opens = (
                np.bitwise_count(own.causes[who, self._door, None] & after)
                >= own.threshold[who, self._door, None]
            )
            moves = weight[:, None] * chance
            unlocks = moves * opens
            total = weight.sum()
            moving, unlocking = moves.sum(axis=0), unlocks.sum(axis=0)
            outcomes = np.stack([total - moving, moving - unlocking, unlocking])
            worth = self._objective.information * (
                _bits(total) - _bits(outcomes).sum(axis=0) - self._luck(weight, chance)
            )
            worth[moving <= TIE * total] = 0.0
            if left > 1:
                for index in np.flatnonzero(moving > TIE * total):
                    if outcomes[0, index] > TIE * total:
                        stays = weight - moves[:, index]
                        worth[index] += self._child(who, stays, pushed, unlocked, left - 1)
                    for open_now in (False, True):
                        if outcomes[1 + open_now, index] > TIE * total:
                            part = unlocks[:, index] if open_now else (moves - unlocks)[:, index]
                            worth[index] += self._child(
                                who, part, int(after[index]), open_now, left - 1
                            )
            if values is not None:
                values[slots] = worth
            best = max(best, float(worth.max()))
        if unlocked:
            door = self._open(who, weight, pushed, left)
            if values is not None:
                values[self._door] = door
            best = max(best, door)
        return best

    def _child(
        self, who: IntArray, weight: FloatArray, pushed: int, unlocked: bool, left: int
    ) -> float:
        kept = weight > 0
        alive, share = who[kept], weight[kept]
        if self._uncertain:
            return self._look(alive, share, pushed, unlocked, left)
        # Without chance the weights follow from who is left, whatever the order of the pushes.
        key = (alive.tobytes(), pushed, left)
        if key not in self._seen:
            self._seen[key] = self._look(alive, share, pushed, unlocked, left)
        return self._seen[key]

    def _hope(self, who: IntArray, weight: FloatArray, pushed: int, left: int) -> float:
        """The value of what can still be solved, if it were known from here on what is the case."""
        own = self._hypotheses[who]
        solvable = achievable(own, pushed, left, self._found.tolist()).any(axis=1)
        return self._objective.beta * float(weight[solvable].sum())

    def _open(self, who: IntArray, weight: FloatArray, pushed: int, left: int) -> float:
        """The value of pushing the unlocked door."""
        own = self._hypotheses
        live = np.bitwise_count(own.causes[who, self._door] & np.uint16(pushed))
        chance = self._strengths.chance[own.strength[who], live, own.threshold[who, self._door]]
        many = np.full(len(who), pushed, dtype=np.uint16)
        found = np.broadcast_to(self._found, (len(who), len(self._found)))
        opens = weight * chance
        new = float((opens * completes(own, who, many, found)).sum())
        total, opening = weight.sum(), float(opens.sum())
        outcomes = np.array([total - opening, opening - new, new])
        gain = _bits(total) - _bits(outcomes).sum() - self._luck(weight, chance[:, None])[0]
        value = self._objective.information * gain + self._objective.beta * new
        if left > 1 and outcomes[0] > TIE * total:
            value += self._child(who, weight - opens, pushed, True, left - 1)
        return float(value)

    def _luck(self, weight: FloatArray, chance: FloatArray) -> FloatArray:
        """``[A]`` bits of the outcomes that are chance under every hypothesis."""
        if not self._uncertain:
            return np.zeros(chance.shape[1])
        return -(weight @ (_bits(chance) + _bits(1.0 - chance)))


def achievable(hypotheses: Hypotheses, pushed: int, left: int, found: Sequence[int]) -> BoolArray:
    """``[h, k]`` which solutions are new and can still be completed in the attempt.

    Args:
        hypotheses: ``[h]`` what is held possible.
        pushed: What stands pushed.
        left: Actions left, the push of the door included.
        found: What stood pushed when solutions were found.
    """
    relevant = ~hypotheses.inert[:, None]
    solutions, mask = hypotheses.solutions, np.uint16(pushed)
    able: BoolArray = mask & relevant & ~solutions == 0
    able &= np.bitwise_count(solutions & ~mask) < left
    for done in found:
        able &= np.uint16(done) & relevant != solutions
    return able


def thinned(weight: FloatArray, most: int) -> tuple[IntArray, FloatArray]:
    """The part of a belief that is planned with.

    Probabilities are rounded to 1/1023 of the greatest, so that beliefs that hardly differ have the
    same plan, and what is less than half of that is left out. If more than ``most`` hypotheses are
    left, as many points are spaced evenly over them, which is a sample without luck.

    Args:
        weight: ``[E]`` a belief; not all zero.
        most: The most hypotheses to plan with.

    Returns:
        ``[h]`` which hypotheses to plan with, and ``[h]`` their weights, whole numbers.
    """
    coarse = np.rint(weight / weight.max(initial=0.0) * 1023.0)
    which = np.flatnonzero(coarse)
    coarse = coarse[which]
    if len(which) > most:
        points = (np.arange(most) + 0.5) * coarse.sum() / most
        hit = np.searchsorted(coarse.cumsum(), points, side="right")
        chosen, counts = np.unique(hit, return_counts=True)
        return which[chosen], counts.astype(float)
    return which, coarse


def _bits(weight: FloatArray) -> FloatArray:
    """``w log2 w``, 0 at 0."""
    return weight * np.log2(np.maximum(weight, 1e-300))

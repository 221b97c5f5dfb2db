"""Plans by the value of their actions.

The value of a plan is its expected information gain about the room in bits, plus ``beta`` times the
probability that it completes a new solution. The expected information gain is the mutual
information between hypothesis h and outcome o, the entropy of the outcomes less what is pure
chance in them:

    EIG = H(o) - sum over h of P(h) H(o | h)

By the chain rule it adds up from action to action. Plans are *closed loop*: the next action depends
on what was observed, so a plan is a tree over the actions left in the attempt, and its value is
computed from the leaves up (expectimax).

Where attempts are so long that the tree would have too many branches, it is cut. A leaf there is
worth the probability that a new solution can still be completed by an actor that knows the truth.

Pulling a lever back is left out: within so few actions it helps neither to learn nor to solve.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from causal_openlock.belief.hypotheses import Strengths
from causal_openlock.belief.likelihoods import completes
from causal_openlock.belief.structures import NEVER, Hypotheses
from causal_openlock.contract.learner import View
from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray

MOST_BRANCHES = 5000
"""About the most sequences of pushes in a plan: four actions ahead with seven levers, six with
four."""
FEW_LEVERS = 7
MOST_PAIRS = 1_000_000
"""The most sequences times hypotheses in plans with more than ``FEW_LEVERS`` levers; plans always
look two actions ahead."""
TIE = 1e-9
"""Values that differ by less are equal but for rounding."""


@dataclass(frozen=True)
class Objective:
    """The objective that a plan maximises."""

    information: float = 1.0  #: weight of expected information, per bit
    beta: float = 3.0  #: weight of the probability of a new solution
    horizon: int | None = None  #: actions to look ahead; ``None`` looks to the end of the attempt


@dataclass(frozen=True)
class Situation:
    """The state of an attempt."""

    pushed: int  #: the pushed levers, as a bit mask of slots
    unlocked: bool  #: whether the door is unlocked
    left: int  #: actions left
    found: tuple[int, ...]  #: what was pushed when solutions were found

    @classmethod
    def of(
        cls, view: View, subject: int, slots: IntArray, found: tuple[int, ...] = ()
    ) -> Situation:
        """The state of a subject's attempt, given the slot of each position in its room.

        Once every solution is found, none counts as found: repeating one is as good as any.
        """
        seen = view.observation[subject]
        return cls(
            pushed=int((seen[: len(slots)].astype(np.int64) << slots).sum()),
            unlocked=bool(seen[-2] == 0),
            left=int(view.console.actions_left[subject]),
            found=found if view.console.solutions_left[subject] else (),
        )


@dataclass
class Planner:
    """Values of actions under a belief in ``[h]`` hypotheses with some strengths."""

    hypotheses: Hypotheses
    strengths: Strengths
    objective: Objective

    def values(self, weight: FloatArray, situation: Situation) -> FloatArray:
        """``[P + 1]`` value of pushing each lever, and the door last, given the posterior, ``[h]``.

        Minus infinity for levers that are pushed already, and for a locked door; zero for a lever
        that cannot move.
        """
        self._seen: dict[tuple[bytes, int, int], float] = {}
        self._solvable: dict[tuple[int, int], BoolArray] = {}
        self._found = situation.found
        self._door = self.hypotheses.causes.shape[1] - 1
        self._uncertain = len(self.strengths) > 1
        alive = np.flatnonzero(weight > 0)
        share = weight[alive] / weight[alive].sum()
        left = min(situation.left, self.objective.horizon or situation.left)
        self._cut = max(0, left - self._depth(alive, situation.pushed))
        return self._values(alive, share, situation.pushed, situation.unlocked, left)

    def _depth(self, alive: IntArray, pushed: int) -> int:
        """Number of actions to look ahead, so that the tree of plans does not grow too large."""
        can_move = (self.hypotheses.threshold[alive, : self._door] < NEVER).any(axis=0)
        choices = sum(1 for slot in np.flatnonzero(can_move).tolist() if not pushed >> slot & 1)
        most = MOST_BRANCHES
        if choices > FEW_LEVERS:
            most = min(most, max(MOST_PAIRS // len(alive), 1))
        return max(2, int(math.log(most) / math.log(max(choices, 2))))

    def _values(
        self, alive: IntArray, weight: FloatArray, pushed: int, unlocked: bool, left: int
    ) -> FloatArray:
        """``[P + 1]`` value of each push, in units of the weights' sum."""
        values, door = np.full(self._door + 1, -np.inf), self._door
        levers = [slot for slot in range(door) if not pushed >> slot & 1]
        nodes = np.array(levers + [door] * unlocked, dtype=int)
        own, mask = self.hypotheses, np.uint16(pushed)
        live = np.bitwise_count(own.causes[alive[:, None], nodes] & mask)
        threshold = own.threshold[alive[:, None], nodes]
        if self._uncertain:
            chance = self.strengths.chance[own.strength[alive, None], live, threshold]
        else:
            chance = (live >= threshold).astype(float)
        # What follows: a lever that moves unlocks the door, and the door opens for a new solution.
        after = (mask | np.left_shift(1, nodes)).astype(np.uint16)
        live = np.bitwise_count(own.causes[alive, door, None] & after)
        follows = live >= own.threshold[alive, door, None]
        if unlocked:
            follows[:, -1] = completes(own, alive, pushed, self._found)
        moves = weight[:, None] * chance
        both = moves * follows
        total = weight.sum()
        moving, following = moves.sum(axis=0), both.sum(axis=0)
        outcomes = np.stack([total - moving, moving - following, following])
        worth = self.objective.information * self._gain(outcomes, weight, chance)
        worth[moving <= TIE * total] = 0.0
        worth[nodes == door] += self.objective.beta * following[nodes == door]
        for index in np.flatnonzero(moving > TIE * total) if left > 1 else ():
            move, unlock, then = moves[:, index], both[:, index], int(after[index])
            branches = (
                (outcomes[0, index], weight - move, pushed, unlocked),
                (outcomes[1, index], move - unlock, then, False),
                (outcomes[2, index], unlock, then, True),
            )
            for likely, parts, at, opens in branches[: 1 if nodes[index] == door else 3]:
                if likely > TIE * total:
                    worth[index] += self._best(alive, parts, at, opens, left - 1)
        values[nodes] = worth
        return values

    def _best(
        self, alive: IntArray, weight: FloatArray, pushed: int, unlocked: bool, left: int
    ) -> float:
        """The value of the best plan, in units of the weights' sum."""
        possible = weight > 0
        alive, weight = alive[possible], weight[possible]
        # Without noise the weights depend on what is left alone, whatever the order of the pushes.
        key = (alive.tobytes(), pushed, left)
        if key in self._seen:
            return self._seen[key]
        if left <= self._cut or (len(alive) == 1 and not self._uncertain):
            best = self._optimistic(alive, weight, pushed, left)
        else:
            best = max(0.0, float(self._values(alive, weight, pushed, unlocked, left).max()))
        if not self._uncertain:
            self._seen[key] = best
        return best

    def _optimistic(self, alive: IntArray, weight: FloatArray, pushed: int, left: int) -> float:
        """Upper bound of the chance to solve: its value if the truth were known from here on."""
        if (pushed, left) not in self._solvable:
            able = achievable(self.hypotheses, pushed, left, self._found)
            self._solvable[pushed, left] = np.asarray(able.any(axis=1))
        return self.objective.beta * float(weight[self._solvable[pushed, left][alive]].sum())

    def _gain(self, outcomes: FloatArray, weight: FloatArray, chance: FloatArray) -> FloatArray:
        """``[A]`` bits of information that ``[3, A]`` outcomes give about the hypothesis."""
        gain = _bits(weight.sum()) - _bits(outcomes).sum(axis=0)
        if self._uncertain:  # less what is chance, given the hypothesis
            gain = gain + weight @ (_bits(chance) + _bits(1.0 - chance))
        return gain


def achievable(
    hypotheses: Hypotheses, pushed: int, left: int, found: Sequence[int], pulls: bool = False
) -> BoolArray:
    """``[h, k]`` which solutions are new and can still be completed in the attempt.

    ``left`` counts the push of the door; ``found`` is what was pushed when solutions were found.
    Levers that stand pushed can be pulled back only with ``pulls``.
    """
    relevant, solutions = ~hypotheses.inert[:, None], hypotheses.solutions
    stands = np.uint16(pushed) & relevant
    able: BoolArray = np.bitwise_count(solutions ^ stands) < left
    if not pulls:
        able &= stands & ~solutions == 0
    for done in found:
        able &= np.uint16(done) & relevant != solutions
    return able


def thinned(weight: FloatArray, most: int) -> tuple[IntArray, FloatArray]:
    """Hypotheses to plan with, ``[h]``, and ``[h]`` their weights, whole numbers.

    Probabilities are rounded to 1/1023 of the greatest, so that almost equal posteriors have the
    same plan; what is rounded to zero is left out. If more than ``most`` hypotheses are left, a
    systematic sample is taken: as many points, evenly spaced over their cumulative weights.
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

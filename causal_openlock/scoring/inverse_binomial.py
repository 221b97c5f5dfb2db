"""Log-likelihoods of learners that can only act: inverse binomial sampling.

Of a learner that gives no probabilities one can still ask again and again what it would do now. The
number K of draws until it does what the subject did gives an estimate of the log-probability, ::

    -(1 + 1/2 + ... + 1/(K - 1)),

that is right in the mean, whatever the probability is, with a variance of which 1 + 1/4 + ... +
1/(K - 1)² is right in the mean (van Opheusden, Acerbi & Ma 2020). A share of hits in a fixed number
of draws is not: its logarithm is too low, and without any hit it is infinite. Draws come in batches
without an order of their own, so what counts is the estimate's mean over all orders of the batch
with the first hit: as right in the mean, and much less variable, since all of its hits count.

That takes as many draws as are needed, 1/p in the mean, and so has no end where p is 0. A *lapse*,
a share of actions that are random, bounds p from below: p >= lapse / actions. Here draws stop at a
*limit*, and the rest of the sum is computed as if the probability were the share of the copies that
took the action. Where none did, that is the lapse alone, and the estimate is too low: with 256
copies, a lapse of .01 and 15 actions by up to .43 nats in the mean, where p is about .003, and with
the default limit, as many draws as a lapse needs in the mean to do an action (1,500 there), by .03
at most. Without lapses there is no such bound. Actions that reached the limit are marked.

Here many copies of the learner are shown, side by side, what the subject did. Each has random
numbers of its own, and what it would do is a draw. What is hidden in a learner, such as a plan, is
taken to last for an attempt at most: of later actions in an attempt, only those copies are asked
that did what the subject did from its beginning on, so that draws are from what is possible after
it. Where these are few, later actions reach the limit after few draws; the share is then mostly of
copies that did something else before, and the estimate may be off either way, by more than that.
Subjects are played again with more copies until every action has been hit, or the limit is reached.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from functools import lru_cache
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import comb, digamma, hyperu, polygamma

from causal_openlock.contract.learner import InformedLearner, Truth
from causal_openlock.contract.registry import create
from causal_openlock.experiment.declare import LearnerSpec
from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray
from causal_openlock.world.randomness import unrelated_generators

if TYPE_CHECKING:
    from causal_openlock.scoring.recorded import Recorded

FIRST_COPIES = 16
"""Copies of a subject when it is first played; then as many again, twice as many, and so on."""
MOST_COPIES = 640  #: most copies, of all subjects together, that are played at once
WITHOUT_LAPSES = 2048  #: the limit of draws where no action is a lapse
TERMS = 100_000  #: most terms of a sum that are added up one by one


def limit_of_draws(most: int | None, lapse: float, actions: int) -> int:
    """Return the most copies of a subject that are asked.

    >>> limit_of_draws(None, 0.01, 15), limit_of_draws(128, 0.01, 15)
    (1500, 128)

    Args:
        most: The limit; None for as many as a lapse needs in the mean to do an action.
        lapse: Share of actions that are taken to be random.
        actions: Number of actions to choose from.
    """
    if most is not None:
        return most
    return ceil(actions / lapse) if lapse else WITHOUT_LAPSES


class Tally:
    """The draws for each action of B subjects, so far; arrays are ``[B, T]``.

    Args:
        exists: Which actions there are.
        attempt: To which attempt they belong.
        lapse: The share of actions that are random.
        actions: How many there are to choose from.
    """

    def __init__(self, exists: BoolArray, attempt: IntArray, lapse: float, actions: int) -> None:
        self._attempt, self._lapse, self._by_lapse = attempt, lapse, lapse / actions
        self.open = exists.copy()  # which have not been hit yet
        self._misses = np.zeros(exists.shape, np.int64)  # in batches without a hit
        self._batch = np.zeros((2, *exists.shape), np.int64)  # draws and hits of the one with hits
        self._own = np.zeros(exists.shape, np.int64)  # by how many copies it was done, whatever
        self._asked = np.zeros(exists.shape, np.int64)  # came before, of how many

    def wanted(self) -> BoolArray:
        """Mask of the actions to ask for: those up to the last open one of an attempt."""
        wanted = self.open.copy()
        for moment in range(wanted.shape[1] - 2, -1, -1):
            same = self._attempt[:, moment] == self._attempt[:, moment + 1]
            wanted[:, moment] |= same & wanted[:, moment + 1]
        return wanted

    def note(
        self, subject: int, moment: int, own: BoolArray, valid: BoolArray, luck: FloatArray
    ) -> None:
        """Note the answers of some copies.

        Args:
            subject: Whose.
            moment: The number of the action.
            own: ``[N]`` which copies did what the subject did.
            valid: ``[N]`` which copies had done so since the attempt began.
            luck: ``[N]`` uniform numbers, for lapses.
        """
        place = subject, moment
        self._own[place] += own.sum()
        self._asked[place] += len(own)
        if self.open[place]:
            # A lapse hits with its share of one action, and otherwise misses.
            hit = np.where(luck < self._lapse, luck < self._by_lapse, own)[valid]
            self.open[place] = not hit.any()
            if hit.any():
                self._batch[:, *place] = len(hit), hit.sum()
            else:
                self._misses[place] += len(hit)

    def scores(self) -> dict[str, NDArray[Any]]:
        """``[B, T]`` scores from the draws so far; where there is no action, without meaning."""
        share = self._own / np.maximum(self._asked, 1)
        mixed = (1.0 - self._lapse) * share + self._by_lapse
        total, variance = np.zeros(share.shape), np.zeros(share.shape)
        for place in np.ndindex(share.shape):
            draws, hits = map(int, self._batch[:, *place])
            misses = int(self._misses[place])
            total[place], variance[place] = mean_over_orders(misses, draws, hits)
            if self.open[place]:
                total[place] -= expected_rest(misses, float(mixed[place]))
        return {
            "log_probability": total,
            "standard_error": np.sqrt(variance),
            **dict.fromkeys(("entropy", "highest"), np.full(total.shape, np.nan)),
            "impossible": self._own == 0,  # no copy did it
            "at_limit": self.open.copy(),
        }


@lru_cache(maxsize=4096)
def mean_over_orders(before: int, draws: int, hits: int) -> tuple[float, float]:
    """The estimate and its variance, as means over all orders of the last batch of draws.

    1 + 1/2 + ... + 1/n is the digamma function of n + 1, plus Euler's constant, and the sum of
    squares is the trigamma function's difference from pi²/6. The variance is less by that of the
    estimate over orders.

    >>> [round(value, 6) for value in mean_over_orders(0, 2, 1)]  # one order ends at once
    [-0.5, 0.25]

    Args:
        before: The misses in earlier batches.
        draws: The draws of the last batch; 0 if none of them has a hit.
        hits: How many of its draws are hits.
    """
    misses = np.arange(draws - hits + 1)
    orders = comb(draws - misses - 1, hits - 1)  # in which so many misses come first
    weights = orders / orders.sum() if hits else np.ones(1)
    last = before + misses + 1.0
    sums, squares = digamma(last) + np.euler_gamma, np.pi**2 / 6 - polygamma(1, last)
    mean = weights @ sums
    return -float(mean), max(float(weights @ (squares - (sums - mean) ** 2)), 0.0)


@lru_cache(maxsize=4096)
def expected_rest(misses: int, probability: float) -> float:
    """Expected remainder of the IBS sum after ``misses`` misses.

    >>> round(expected_rest(0, 0.25), 6), float(np.round(-np.log(0.25), 6))
    (1.386294, 1.386294)
    """
    if probability <= 0:
        return np.inf
    last = int(min(40.0 / probability, TERMS)) + 1
    steps = np.arange(1, last + 1)
    found = float(((1.0 - probability) ** steps / (misses + steps)).sum())
    if last <= TERMS:
        return found
    # The terms of a small probability hardly differ from each other: the integral of the others,
    # from midway, differs from their sum by less than 1e-10. U(1, 1, z) is exp(z) E1(z).
    fall, middle = -np.log1p(-probability), last + 0.5
    return found + float(np.exp(-fall * middle) * hyperu(1.0, 1.0, fall * (misses + middle)))


def tiled(given: Any, copies: int) -> Any:
    """A view or a step in which every subject has ``copies`` copies, side by side."""
    return replace(
        given,
        **{
            part.name: np.repeat(value, copies, axis=0)
            if isinstance(value := getattr(given, part.name), np.ndarray)
            else tiled(value, copies)
            for part in fields(given)
        },
    )


def by_draws(
    part: Recorded, scored: LearnerSpec, draws: int | None, lapse: float, actions: int
) -> dict[str, NDArray[Any]]:
    """``[B, T]`` scores of what subjects did, by asking copies up to :func:`limit_of_draws`."""
    tally = Tally(part.asked, part.starts.cumsum(axis=1), lapse, actions)
    asked, limit = 0, limit_of_draws(draws, lapse, actions)
    while asked < limit:
        copies = min(max(asked, FIRST_COPIES), limit - asked, MOST_COPIES)
        left = np.flatnonzero(tally.open.any(axis=1)).tolist()
        together = MOST_COPIES // copies
        for first in range(0, len(left), together):
            places = left[first : first + together]
            _ask(part, scored, places, range(asked, asked + copies), tally)
        asked += copies
    return tally.scores()


def _ask(
    part: Recorded, scored: LearnerSpec, places: Sequence[int], of_each: range, tally: Tally
) -> None:
    """Replay subjects with copies of the learner, numbered ``of_each``, and note what they do."""
    session, learner = part.session(scored, places), create(scored.learner, scored.parameters)
    copies = len(of_each)
    numbers = [part.numbers[place] * 10**6 + copy for place in places for copy in of_each]
    wanted, done, starts = (
        array[np.array(places)] for array in (tally.wanted(), part.actions, part.starts)
    )
    key = "/".join([scored.name, *map(str, part.group.values())])
    own, luck = (unrelated_generators(0, f"{use}/{key}", numbers) for use in ("copies", "lapses"))
    chance = np.stack([generator.random(done.shape[1]) for generator in luck])
    learner.begin(replace(session.brief, subjects=len(numbers), generators=own))

    def inform() -> None:
        if isinstance(learner, InformedLearner):
            learner.inform(Truth(session.truth.rooms, np.repeat(session.truth.room, copies)))

    inform()
    valid = np.ones((len(places), copies), dtype=bool)
    for moment in range(np.flatnonzero(wanted.any(axis=0))[-1] + 1):
        view = tiled(session.view, copies)
        valid[starts[:, moment]] = True
        if wanted[:, moment].any():
            asks = view.playing & np.repeat(wanted[:, moment], copies)
            answers = learner.act(replace(view, playing=asks)).reshape(len(places), copies)
            same = answers == done[:, moment][:, None]
            for row in np.flatnonzero(wanted[:, moment]).tolist():
                own_luck = chance[row * copies : (row + 1) * copies, moment]
                tally.note(places[row], moment, same[row], valid[row], own_luck)
            valid &= same | ~wanted[:, moment, None]
        step = session.step(done[:, moment])
        learner.learn(tiled(step, copies))
        if step.trial_over.any():
            inform()

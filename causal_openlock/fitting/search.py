"""The search for the parameters of least loss: evenly spread points, then a simplex.

A loss says how unlikely people's actions are, or how far means are from people's. Half of the sets
of parameters are spread evenly over the ranges (Halton's sequence). From the best of them, and once
that has arrived from the next best, the simplex of Nelder and Mead moves downhill. What is tried
next depends on the seed and on losses alone: the same search finds the same on any number of
workers, and after any interruption.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.stats import qmc

from causal_openlock.errors import LearnerError
from causal_openlock.fitting.plan import Chosen, Range
from causal_openlock.schemas.fsm import FloatArray

STARTS = 2  #: number of the best points from which the simplex begins
STEP = 0.1  #: size of the first simplex, as a share of each range
TOLERANCE = 1e-3  #: tolerance of parameters, as a share of their range, and of the loss
NEAR = 0.01  #: a value this near to a bound, as a share of the range, stands at it
NO_EFFECT = 1e-6
"""Differences below are rounding errors: of a loss, or of its slopes and curvatures."""
NONE = "none"  #: label in a table, instead of names of parameters


class Tried(NamedTuple):
    """A set of parameters, and its loss."""

    chosen: dict[str, int | float]
    loss: float


def spread(ranges: Mapping[str, Range], candidates: int, seed: int) -> FloatArray:
    """``[N, D]`` points that are spread evenly over all ranges, as shares of them.

    They are half of the candidates, or all where the simplex has nothing to move.
    """
    half = any(not bounds.whole for bounds in ranges.values())
    points: FloatArray = qmc.Halton(len(ranges), rng=seed).random(
        (candidates + 1) // 2 if half else candidates
    )
    return points


def search(
    ranges: Mapping[str, Range],
    losses: Callable[[Sequence[dict[str, int | float]]], Iterable[float]],
    candidates: int,
    seed: int,
) -> list[Tried]:
    """Search for the parameters of least loss.

    Whole numbers are chosen by the evenly spread points, and the simplex keeps them.

    Args:
        ranges: The bounds of each parameter.
        losses: Computes the losses of some sets of parameters, which do not depend on each other.
        candidates: Most sets to try.
        seed: Of the evenly spread points.

    Returns:
        All sets that were tried, in this order.

    >>> ranges = {"a": Range(0.0, 1.0), "b": Range(0.1, 10.0, log=True)}
    >>> tried = search(ranges, lambda sets: [(s["a"] - 0.3) ** 2 + s["b"] for s in sets], 60, 1)
    >>> {name: round(value, 2) for name, value in min(tried, key=lambda t: t.loss).chosen.items()}
    {'a': 0.3, 'b': 0.1}
    """
    free = [name for name, bounds in ranges.items() if not bounds.whole]
    points = [
        {name: ranges[name].at(share) for name, share in zip(ranges, point, strict=True)}
        for point in spread(ranges, candidates, seed)
    ]
    tried = [Tried(*both) for both in zip(points, losses(points), strict=True)]
    known = {tuple(chosen.values()): loss for chosen, loss in tried}

    def descend(start: Mapping[str, int | float]) -> None:
        def loss(place: FloatArray) -> float:
            moved = {name: ranges[name].at(x) for name, x in zip(free, place, strict=True)}
            chosen = {**start, **moved}
            key = tuple(chosen.values())
            if key not in known:
                (known[key],) = losses([chosen])
                tried.append(Tried(chosen, known[key]))
            return known[key]

        first = np.array([ranges[name].share(start[name]) for name in free])
        steps = np.where(first > 0.5, -STEP, STEP)  # away from the nearer bound
        minimize(
            loss,
            first,
            method="Nelder-Mead",
            bounds=[(0.0, 1.0)] * len(free),
            options={
                "maxfev": candidates - len(tried) + 1,  # the loss of the start is known
                "xatol": TOLERANCE,
                "fatol": TOLERANCE,
                "initial_simplex": np.vstack([first, first + np.diag(steps)]),
            },
        )

    for start, _ in sorted(tried, key=lambda one: one.loss)[: STARTS if free else 0]:
        if len(tried) < candidates:
            descend(start)
    return tried


def at_bound(ranges: Mapping[str, Range], chosen: Chosen) -> tuple[str, ...]:
    """The parameters that stand at a bound of what is searched; better values may lie beyond.

    >>> at_bound({"a": Range(0.0, 1.0), "b": Range(0.0, 1.0)}, {"a": 0.5, "b": 0.999})
    ('b',)
    """
    shares = {name: bounds.share(chosen[name]) for name, bounds in ranges.items()}
    return tuple(name for name, share in shares.items() if not NEAR < share < 1 - NEAR)


def without_effect(
    ranges: Mapping[str, Range], best: Chosen, loss: Callable[[Chosen], float]
) -> tuple[str, ...]:
    """The parameters at both of whose bounds the loss is the same as where it is least.

    >>> space = {"a": Range(0.0, 1.0), "b": Range(0.0, 1.0)}
    >>> without_effect(space, {"a": 0.5, "b": 0.5}, lambda chosen: (chosen["a"] - 0.5) ** 2)
    ('b',)
    """
    least = loss(best)
    return tuple(
        name
        for name, own in ranges.items()
        if all(abs(loss({**best, name: end}) - least) < NO_EFFECT for end in (own.low, own.high))
    )


def require_effect(idle: Sequence[Collection[str]], learner: str) -> None:
    """Refuse a parameter that makes no difference to any of some fits, each with its ``idle`` ones.

    Raises:
        LearnerError: If there is one.
    """
    first, *others = idle or [()]
    for name in first:
        if all(name in names for names in others):
            raise LearnerError(
                f"{name} makes no difference to how likely {learner} finds what was done, as it is "
                "set; take it out of what is searched, or set otherwise what it depends on (--fix)"
            )

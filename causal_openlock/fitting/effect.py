"""Parameters that make no difference: whatever a search returns, they are not identified."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

from causal_openlock.errors import LearnerError
from causal_openlock.fitting.search import Range

NO_EFFECT = 1e-6
"""Differences below are rounding errors: of a loss, or of its slopes and curvatures."""
ON_ACTIONS = "how likely {} finds what was done"


def without_effect(
    searched: Mapping[str, Range],
    best: Mapping[str, float],
    loss: Callable[[Mapping[str, float]], float],
) -> tuple[str, ...]:
    """The parameters at both of whose bounds the loss is the same as where it is least.

    >>> space = {"a": Range(0.0, 1.0), "b": Range(0.0, 1.0)}
    >>> without_effect(space, {"a": 0.5, "b": 0.5}, lambda chosen: (chosen["a"] - 0.5) ** 2)
    ('b',)
    """
    least = loss(best)
    return tuple(
        name
        for name, one in searched.items()
        if all(abs(loss({**best, name: end}) - least) < NO_EFFECT for end in (one.low, one.high))
    )


def require_effect(idle: Sequence[Collection[str]], on: str) -> None:
    """Refuse a parameter that makes no difference to any of some subjects, or fits.

    Args:
        idle: For each of them, the parameters that make none.
        on: To what they make none, in words.

    Raises:
        LearnerError: If there is such a parameter.
    """
    first, *others = idle or [()]
    for name in first:
        if all(name in one for one in others):
            raise LearnerError(
                f"{name} makes no difference to {on}, as it is set; take it out of what is "
                "searched, or set otherwise what it depends on (--fix)"
            )

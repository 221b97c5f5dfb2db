"""Marks at fitted parameters that are no estimates, and what they mean."""

from __future__ import annotations

from collections.abc import Collection

BOUND, IDLE = "*", "?"


def marked(value: float, name: str, at_bound: Collection[str], idle: Collection[str]) -> str:
    """The value of a parameter, with its mark.

    >>> marked(0.5, "a", ["a"], []), marked(0.5, "a", ["a"], ["a"]), marked(0.5, "a", [], [])
    ('0.5*', '0.5?', '0.5')
    """
    mark = IDLE if name in idle else BOUND if name in at_bound else ""
    return f"{value:.4g}{mark}"


def legend(at_bound: bool, idle: bool) -> list[str]:
    """What the marks mean that there are."""
    lines = []
    if at_bound:
        lines.append(f"{BOUND} at a bound of what was searched: better values may lie beyond it.")
    if idle:
        lines.append(f"{IDLE} makes no difference here: any other value would do as well.")
    return lines

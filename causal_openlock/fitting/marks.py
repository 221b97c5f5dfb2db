"""Marks at fitted parameters that are not estimates, and their meaning."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from causal_openlock.wording import joined, significant

BOUND, IDLE = "*", "?"


def marked(value: float, name: str, at_bound: Collection[str], idle: Collection[str]) -> str:
    """The value of a parameter, with its mark.

    >>> marked(0.5, "a", ["a"], []), marked(0.5, "a", ["a"], ["a"]), marked(10.0, "a", [], [])
    ('0.5*', '0.5?', '10')
    """
    mark = IDLE if name in idle else BOUND if name in at_bound else ""
    return f"{significant(value)}{mark}"


def rounded(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters for an experiment file, as they are printed: with six significant digits.

    >>> rounded({"concentration": 10.000000000000002, "policy": "thompson", "planned": 4000})
    {'concentration': 10, 'policy': 'thompson', 'planned': 4000}
    """
    return {
        name: significant(value, 6) if isinstance(value, float) else value
        for name, value in parameters.items()
    }


def legend(at_bound: Collection[str], idle: Collection[str]) -> list[str]:
    """Explanations of the marks, with their parameters; also where none stands at a bound.

    >>> legend([], [])
    ['No estimate is at a bound of what was searched.']
    """
    estimates = [name for name in at_bound if name not in idle]
    lines = ["No estimate is at a bound of what was searched."]
    if estimates:
        lines = [
            f"{BOUND} at a bound of what was searched ({joined(estimates)}): better values may "
            "lie beyond it."
        ]
    if idle:
        lines.append(f"{IDLE} makes no difference here: any other value would do as well.")
    return lines

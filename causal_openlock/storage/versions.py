"""The versions that results depend on: those here, and those that a results folder was made with.

The same code gives the same bytes with the same versions of what computes: Python, NumPy, torch,
numba, which compiles the rooms and the networks, networkx, and this package's results. With others
the last bits of a sum may differ, and a long training with them. So a folder says what it was made
with, and a comparison that was begun with other versions is not silently completed with these.
"""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from causal_openlock.version import RESULTS_VERSION

PACKAGES = ("numpy", "torch", "numba", "networkx")


@cache
def versions() -> Mapping[str, str]:
    """The versions of packages that results depend on, by name."""
    found = {"Python": platform.python_version(), "causal-openlock": RESULTS_VERSION}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def merged_versions(all_of_them: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The version of each package, or a list if there are several.

    >>> merged_versions([{"numpy": "2.0"}, {"numpy": ["2.1", "2.0"], "torch": "2.6"}])
    {'numpy': ['2.0', '2.1'], 'torch': '2.6'}
    """
    found: dict[str, dict[str, None]] = {}
    for versions in all_of_them:
        for package, held in versions.items():
            several = [held] if isinstance(held, str) else held
            found.setdefault(package, {}).update(dict.fromkeys(several))
    return {name: next(iter(held)) if len(held) == 1 else [*held] for name, held in found.items()}


def other_versions(made_with: Mapping[str, Any], here: Mapping[str, str]) -> str:
    """Stored versions that differ from those here, in words; empty if there are none.

    >>> other_versions({"numpy": "2.0", "torch": ["2.6", "2.7"]}, {"numpy": "2.1", "torch": "2.7"})
    'numpy 2.0 (here it is 2.1)'
    """
    return ", ".join(
        f"{name} {' and '.join(several)} (here it is {here[name]})"
        for name, held in made_with.items()
        if name in here and here[name] not in (several := [held] if isinstance(held, str) else held)
    )

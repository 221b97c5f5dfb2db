"""The versions that results depend on: those here, and those that a results folder was made with.

With others the last bits of a sum may differ, and a long training with them. So a comparison that
was begun with other versions is not silently completed with these.
"""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import version
from typing import Any

from causal_openlock.version import RESULTS_VERSION

Versions = Mapping[str, str | list[str]]
"""Versions by the name of the package; a list if cells were made with several."""
PACKAGES = ("numpy", "torch", "numba", "networkx")


@cache
def versions() -> dict[str, str]:
    """The versions of packages that results depend on, by name."""
    here = {"Python": platform.python_version(), "causal-openlock": RESULTS_VERSION}
    return {**here, **{package: version(package) for package in PACKAGES}}


def merged_versions(several: Sequence[Versions]) -> dict[str, Any]:
    """The version of each package, or a list if there are several.

    >>> merged_versions([{"numpy": "2.0"}, {"numpy": ["2.1", "2.0"], "torch": "2.6"}])
    {'numpy': ['2.0', '2.1'], 'torch': '2.6'}
    """
    merged: dict[str, dict[str, None]] = {}
    for made_with in several:
        for package in made_with:
            merged.setdefault(package, {}).update(dict.fromkeys(_listed(made_with[package])))
    return {name: [*of] if len(of) > 1 else next(iter(of)) for name, of in merged.items()}


def other_versions(made_with: Versions, here: Mapping[str, str]) -> str:
    """Stored versions that differ from those here, in words; empty if there are none.

    >>> other_versions({"numpy": "2.0", "torch": ["2.6", "2.7"]}, {"numpy": "2.1", "torch": "2.7"})
    'numpy 2.0 (here it is 2.1)'
    """
    return ", ".join(
        f"{name} {' and '.join(_listed(before))} (here it is {here[name]})"
        for name, before in made_with.items()
        if name in here and here[name] not in _listed(before)
    )


def _listed(version: str | list[str]) -> list[str]:
    return [version] if isinstance(version, str) else version

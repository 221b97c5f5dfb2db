"""Parts that packages register: learners, commands, topics of a report, references, results.

Each kind has a group of entry points. Any package can add to it, and what comes with the toolkit is
registered in the same way, so the core knows no guest by name::

    [project.entry-points."causal_openlock.learners"]
    mine = "my_package:MyLearner"
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from causal_openlock.errors import OpenLockError

LEARNERS = "causal_openlock.learners"
"""Learners: classes."""
COMMANDS = "causal_openlock.commands"
"""Commands of the command line: functions, or Typer apps."""
TOPICS = "causal_openlock.topics"
"""Ideas of a report: each a :class:`~causal_openlock.analysis.topic.Topic`."""
REFERENCES = "causal_openlock.references"
"""References that learners are compared with: functions that return a
:class:`~causal_openlock.analysis.results.references.Reference`."""
PLOTS = "causal_openlock.plots"
"""Plots of results: functions whose first argument is the results."""
RESULT_METHODS = "causal_openlock.results"
"""Methods and properties of :class:`~causal_openlock.comparison.results.Results`."""
SCHEMA_METHODS = "causal_openlock.schemas"
"""The same of :class:`~causal_openlock.schemas.schema.Schema`."""


def attribute_of(value: Any, group: str, name: str) -> Any:
    """Return a method or property that a package registers for objects of a class.

    Args:
        value: The object.
        group: The group of its class.
        name: The name asked for.

    Raises:
        AttributeError: If nothing is registered by that name.
    """
    # Copying and pickling ask for special methods before there is anything else.
    if name.startswith("_") or (entry := registered(group).get(name)) is None:
        raise AttributeError(f"{type(value).__name__} has no attribute {name!r}", name=name)
    return loaded(entry).__get__(value, type(value))


def loaded(entry: EntryPoint) -> Any:
    """Return what an entry point names.

    Raises:
        OpenLockError: If it cannot be imported; the message names the package.
    """
    try:
        return entry.load()
    except Exception as error:  # a module can fail in any way while it is imported
        kind = entry.group.rpartition(".")[2].removesuffix("s")
        raise OpenLockError(
            f"the {kind} {entry.name!r}, {_origin(entry)}, cannot be loaded "
            f"({type(error).__name__}: {error}); repair that package, or uninstall it"
        ) from error


def registered(group: str) -> Mapping[str, EntryPoint]:
    """Return the entry points of a group by name, sorted; loads none.

    Raises:
        OpenLockError: If two packages register the same name.
    """
    return _registered(group, tuple((place, _changed(place)) for place in sys.path))


@lru_cache(maxsize=16)
def _registered(group: str, places: tuple[tuple[str, int], ...]) -> dict[str, EntryPoint]:
    """Cache of :func:`registered`, until something is installed in one of the places."""
    found: dict[str, EntryPoint] = {}
    for entry in entry_points(group=group):
        other = found.setdefault(entry.name, entry)
        if other.value != entry.value:
            kind = group.rpartition(".")[2].removesuffix("s")
            raise OpenLockError(
                f"the {kind} {entry.name!r} is registered twice, as {_origin(other)} and as "
                f"{_origin(entry)}; uninstall one of these packages or rename its {kind}"
            )
    return dict(sorted(found.items()))


def _changed(place: str) -> int:
    try:
        return Path(place).stat().st_mtime_ns
    except OSError:
        return 0


def _origin(entry: EntryPoint) -> str:
    return f"{entry.value} by {entry.dist.name}" if entry.dist else entry.value

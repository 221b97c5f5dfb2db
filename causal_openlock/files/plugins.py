"""Parts that packages register: learners, commands, topics of a report and references.

Each kind has a group of entry points. Any package can add to it, and what comes with the toolkit is
registered in the same way, so the core knows no guest by name::

    [project.entry-points."causal_openlock.learners"]
    mine = "my_package:MyLearner"
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import EntryPoint, distributions, entry_points
from typing import Any

from causal_openlock.errors import OpenLockError, with_kind
from causal_openlock.version import __version__

LEARNERS = "causal_openlock.learners"  # classes
COMMANDS = "causal_openlock.commands"  # functions, or Typer apps
TOPICS = "causal_openlock.topics"  # each a causal_openlock.analysis.topic.Topic
REFERENCES = "causal_openlock.references"  # functions that return a Reference
TOOLKIT = "causal-openlock"


def registered(group: str) -> Mapping[str, EntryPoint]:
    """The entry points of a group by name, sorted; loads none.

    Two packages that register the same name are refused by an OpenLockError.
    """
    return _registered(group, tuple(sys.path))


@lru_cache(maxsize=16)
def _registered(group: str, path: tuple[str, ...]) -> dict[str, EntryPoint]:
    # entry_points() takes the first of what has the same name, which may be another version's.
    installed = [*distributions(name=TOOLKIT, path=[*path])]
    complete = [package for package in installed if package.entry_points]
    current = [package for package in complete if package.version == __version__] or complete
    for package in installed:
        if package not in current:
            warnings.warn(
                f"{package.locate_file('')} holds a causal_openlock-*.dist-info that is left over "
                f"from another version; remove it, and keep that of {__version__}",
                stacklevel=3,
            )
    entries: dict[str, EntryPoint] = {}
    for package in current[:1]:
        entries = {entry.name: entry for entry in package.entry_points.select(group=group)}
    for entry in entry_points(group=group):
        if entry.dist and entry.dist.name == TOOLKIT:
            continue
        if entries.setdefault(entry.name, entry).value != entry.value:
            raise OpenLockError(
                f"the {_described(entries[entry.name])} is registered twice, also as "
                f"{entry.value}; uninstall one of these packages, or rename it"
            )
    return dict(sorted(entries.items()))


def loaded(entry: EntryPoint) -> Any:
    """What an entry point names; OpenLockError if it cannot be imported, with the package."""
    try:
        return entry.load()
    except Exception as error:  # a module can fail in any way while it is imported
        raise OpenLockError(
            f"the {_described(entry)} cannot be loaded ({with_kind(error)}); repair that package, "
            "or uninstall it"
        ) from error


def _described(entry: EntryPoint) -> str:
    kind = entry.group.rpartition(".")[2].removesuffix("s")
    package = f" by {entry.dist.name}" if entry.dist else ""
    return f"{kind} {entry.name!r}, {entry.value}{package},"

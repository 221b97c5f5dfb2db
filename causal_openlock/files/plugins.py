"""Parts that packages register: learners, commands, topics of a report and references.

Each kind has a group of entry points. Any package can add to it, and what comes with the toolkit is
registered in the same way, so the core knows no guest by name::

    [project.entry-points."causal_openlock.learners"]
    mine = "my_package:MyLearner"
"""

from __future__ import annotations

import multiprocessing
import sys
import warnings
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import EntryPoint, EntryPoints, distributions, entry_points
from typing import Any

from causal_openlock.errors import OpenLockError
from causal_openlock.version import __version__

LEARNERS = "causal_openlock.learners"  # classes
COMMANDS = "causal_openlock.commands"  # functions, or Typer apps
TOPICS = "causal_openlock.topics"  # each a causal_openlock.analysis.topic.Topic
REFERENCES = "causal_openlock.references"  # functions that return a Reference
TOOLKIT = "causal-openlock"


def registered(group: str) -> Mapping[str, EntryPoint]:
    """Return the entry points of a group by name, sorted; loads none.

    Raises:
        OpenLockError: If two packages register the same name.
    """
    return _registered(group, tuple(sys.path))


def loaded(entry: EntryPoint) -> Any:
    """Return what an entry point names.

    Raises:
        OpenLockError: If it cannot be imported; the message names the package.
    """
    try:
        return entry.load()
    except Exception as error:  # a module can fail in any way while it is imported
        raise OpenLockError(
            f"the {_kind(entry.group)} {entry.name!r}, {_origin(entry)}, cannot be loaded "
            f"({type(error).__name__}: {error}); repair that package, or uninstall it"
        ) from error


@lru_cache(maxsize=16)
def _registered(group: str, path: tuple[str, ...]) -> dict[str, EntryPoint]:
    others = [entry for entry in entry_points(group=group) if not _is_ours(entry)]
    entries: dict[str, EntryPoint] = {}
    for entry in [*others, *_own_entry_points(path).select(group=group)]:
        other = entries.setdefault(entry.name, entry)
        if other.value != entry.value:
            raise OpenLockError(
                f"the {_kind(group)} {entry.name!r} is registered twice, as {_origin(other)} and "
                f"as {_origin(entry)}; uninstall one of these packages or rename its {_kind(group)}"
            )
    return dict(sorted(entries.items()))


@lru_cache(maxsize=4)
def _own_entry_points(path: tuple[str, ...]) -> EntryPoints:
    """What this package registers, whatever metadata of other versions stands before its own."""
    installed = [*distributions(name=TOOLKIT, path=[*path])]
    complete = [package for package in installed if package.entry_points]
    current = [package for package in complete if package.version == __version__] or complete
    for package in installed:
        if package not in current and multiprocessing.parent_process() is None:
            warnings.warn(
                f"{package.locate_file('')} holds a causal_openlock-*.dist-info that is left over "
                f"from another version; remove it, and keep that of {__version__}",
                stacklevel=2,
            )
    return current[0].entry_points if current else EntryPoints()


def _is_ours(entry: EntryPoint) -> bool:
    return entry.dist is not None and entry.dist.name == TOOLKIT


def _kind(group: str) -> str:
    return group.rpartition(".")[2].removesuffix("s")


def _origin(entry: EntryPoint) -> str:
    return f"{entry.value} by {entry.dist.name}" if entry.dist else entry.value

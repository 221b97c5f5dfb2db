"""Deleting one person's data, as they may ask for at any time.

A person is known by number and condition. What they did is deleted from ``cells/``,
``reactions/``, ``structures/`` and the logs; so are identifiers of a recruiting service. Everybody
else keeps their number. What else is in the folder, such as a report or a fit, may have been made
of everybody's data: it is named, not touched.
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from causal_openlock.errors import StoreError
from causal_openlock.play.participant import DATA, delete_files
from causal_openlock.play.people import People
from causal_openlock.play.person import LEARNER
from causal_openlock.play.recruiting import RECRUITED
from causal_openlock.storage.store import LOG, Store
from causal_openlock.storage.stored import StoredExperiment

OWN = (*DATA, "experiment.json", LOG, RECRUITED, "consent_*.md", ".*")
"""Files that ``play`` and ``import`` write themselves, and from which a person is deleted."""


def forget_person(
    folder: Path | str, subject: int, condition: str | None = None
) -> tuple[list[Path], list[str]]:
    """Delete all data of one person.

    Args:
        folder: A results folder of ``play`` or ``import``.
        subject: Number of the person in the condition.
        condition: Its name; it may be left out where there is one only.

    Returns:
        The files that were deleted, and the names of all else in the folder.

    Raises:
        StoreError: If it is not such a folder, it is in use, or there is no such person.
    """
    store = Store(folder)
    experiment = store.experiment()
    names = [one.name for one in experiment.conditions]
    if any(spec.learner != LEARNER for spec in experiment.learners):
        raise StoreError(f"{folder} is of learners; what people did is in a folder of play")
    if condition is None and len(names) > 1:
        raise StoreError(f"say which condition, with --condition: {', '.join(names)}")
    condition = condition or names[0]
    there = sorted(store.folder.iterdir())
    left = [path.name for path in there if not any(map(path.match, OWN))]
    if (store.folder / LOG).exists():
        people = People(
            folder,
            experiment.conditions,
            experiment.learners[0].protocol,
            seed=experiment.seed,
            command=experiment.command,
        )
        try:
            return people.forget(condition, subject), left
        finally:
            people.close()
    store.open(experiment, changed=False)
    try:
        mine = _files_of(store, experiment, condition, subject)
        if not mine:
            raise StoreError(f"{folder} has no person {subject} in {condition}")
        deleted = [path for name in mine for path in delete_files(store, name)]
        # Listed until they are gone, so that the same command deletes what a killed one has left.
        kept = [name for name in experiment.files if name not in mine]
        conditions = tuple(
            replace(one, rooms={k: v for k, v in one.rooms.items() if k != subject})
            if one.name == condition
            else one
            for one in experiment.conditions
        )
        store.declare(replace(experiment, conditions=conditions), kept)
        return deleted, left
    finally:
        store.close()


def _files_of(
    store: Store, experiment: StoredExperiment, condition: str, subject: int
) -> list[str]:
    """The names of a person's files that are listed, or there; one for each label they have."""
    there = {path.name for data in DATA for path in (store.folder / data).glob("*.parquet")}
    labels = "|".join(re.escape(spec.name) for spec in experiment.learners)
    middle = f"{re.escape(condition)}_{subject}-{subject}"
    form = re.compile(rf"({labels})_{middle}_[0-9a-f]{{12}}\.parquet")
    names = sorted(name for name in {*experiment.files, *there} if form.fullmatch(name))
    return [name for name in names if _is_of(store, name, condition)]


def _is_of(store: Store, name: str, condition: str) -> bool:
    """Whether a cell belongs to a condition: ``a_b_CE3`` can belong to ``CE3`` and to ``b_CE3``."""
    with suppress(StoreError):
        column = store.read(store.cells / name, columns=["condition"])["condition"]
        return set(column.to_pylist()) == {condition}
    return True  # it is deleted already, or damaged

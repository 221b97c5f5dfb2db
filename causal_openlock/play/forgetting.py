"""Deleting one person's data, as they may ask for at any time.

A person is known by number and condition. What they did is deleted from ``cells/``,
``reactions/``, ``structures/`` and the logs; what a recruiting service calls them, too. Everybody
else keeps their number. Files that were made of everybody's data, such as a report, are named, not
touched.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from causal_openlock.errors import StoreError
from causal_openlock.experiment.store import LOG, Store
from causal_openlock.play.people import RECRUITED, People, delete_files
from causal_openlock.play.person import LEARNER

DERIVED = ("report.html", "summary.csv", "tables", "figures", "scores", "record.csv", "minari")
"""What others commands write beside a record."""


def forget_person(
    folder: Path | str, subject: int, condition: str | None = None
) -> tuple[list[Path], list[str]]:
    """Delete all data of one person.

    Args:
        folder: A results folder of ``play`` or ``import``.
        subject: Number of the person in the condition.
        condition: Its name; it may be left out where there is one only.

    Returns:
        The files that were deleted, and the names of those that were made of the data, too.

    Raises:
        StoreError: If it is no such folder, it is in use, or there is no such person.
    """
    store = Store(folder)
    experiment = store.experiment()
    names = [one.name for one in experiment.conditions]
    if any(spec.learner != LEARNER for spec in experiment.learners):
        raise StoreError(f"{folder} is of learners; what people did is in a folder of play")
    if condition is None and len(names) > 1:
        raise StoreError(f"say which condition, with --condition: {', '.join(names)}")
    condition = condition or names[0]
    left = [name for name in DERIVED if (store.folder / name).exists()]
    if (store.folder / LOG).exists():
        people = People(
            folder,
            experiment.conditions,
            experiment.learners[0].protocol,
            seed=experiment.seed,
            command=experiment.command,
            recruiting=("",) if (store.folder / RECRUITED).exists() else (),
        )
        try:
            return people.forget(condition, subject), left
        finally:
            people.close()
    store.open(experiment, changed=False)
    try:
        marked = f"_{condition}_{subject}-{subject}_"
        mine = [name for name in experiment.files if marked in name]
        if not mine:
            raise StoreError(f"{folder} has no person {subject} in {condition}")
        # Not in the list of files before they are gone: it is what reports read.
        kept = [name for name in experiment.files if name not in mine]
        conditions = tuple(
            replace(one, rooms={k: v for k, v in one.rooms.items() if k != subject})
            if one.name == condition
            else one
            for one in experiment.conditions
        )
        store.list_files(replace(experiment, conditions=conditions), kept)
        return [path for name in mine for path in delete_files(store, name)], left
    finally:
        store.close()

"""Deleting one person's data, as they may ask for at any time.

A person is known by number and condition. What they did is deleted from ``cells/``,
``reactions/``, ``structures/`` and the logs; so are identifiers of a recruiting service. Everybody
else keeps their number. What else is in the folder, such as a report or a fit, may have been made
of everybody's data: it is named, not touched. Where the command was killed, it is given again.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from causal_openlock.errors import StoreError
from causal_openlock.experiment.beside_record import REACTIONS, STRUCTURES
from causal_openlock.experiment.declare import AGENT, PERSON
from causal_openlock.files.checksums import ChecksumError, read_table
from causal_openlock.play.log import Forgotten, Joined, Line, read_log, write_log
from causal_openlock.play.people import dealt
from causal_openlock.play.recruiting import RECRUITED, read_identifiers, write_identifiers
from causal_openlock.storage.folder_lock import locked
from causal_openlock.storage.store import LOG, Store, StoredExperiment

DATA = ("cells", REACTIONS, STRUCTURES)
"""The folders that have a file for each person."""
OWN = (*DATA, "experiment.json", LOG, RECRUITED, "consent_*.md", ".*")
"""Files that ``play`` and ``import`` write themselves, and from which a person is deleted."""


def forget_person(
    folder: Path | str, subject: int, condition: str | None = None
) -> tuple[list[Path], list[str]]:
    """Delete all data of one person from a results folder of ``play`` or ``import``.

    The person has a number in a condition, whose name may be left out if it is the only one.

    Returns:
        The files that were deleted, and the names of all else in the folder.

    Raises:
        StoreError: If it is not such a folder, it is in use, or there is no such person.
    """
    store = Store(folder)
    experiment = store.experiment()
    conditions = {one.name: one for one in experiment.conditions}
    if any(spec.learner not in (PERSON, AGENT) for spec in experiment.learners):
        raise StoreError(f"{folder} is of learners; what people did is in a folder of play")
    if not condition and len(conditions) > 1:
        raise StoreError(f"say which condition, with --condition: {', '.join(conditions)}")
    condition = condition or next(iter(conditions))
    if condition not in conditions:
        raise StoreError(f"{folder} has no condition {condition!r}; give {' or '.join(conditions)}")
    there = sorted(store.folder.iterdir())
    left = [path.name for path in there if not any(map(path.match, OWN))]
    with locked(store.folder):
        files = _files_of(store, experiment, condition, subject)
        lines, place = read_log(store.folder / LOG), ([*conditions].index(condition), subject)
        joined = [line.join for line in lines if isinstance(line, Joined)]
        numbers = [number for number in joined if dealt(experiment, number) == place]
        if not files and not numbers:
            raise StoreError(f"{folder} has no person {subject} in {condition}")
        paths = [store.folder / data / file for data in DATA for file in files]
        deleted = [path for path in paths if path.exists()]
        for path in deleted:
            path.unlink()
        # What they are found by comes last, for a command that was killed and is given again.
        played = conditions[condition]
        rooms = {number: own for number, own in played.rooms.items() if number != subject}
        conditions[condition] = replace(played, rooms=rooms)
        listed = [file for file in experiment.files if file not in files]
        store.declare(replace(experiment, conditions=(*conditions.values(),)), listed)
        for number in numbers:
            identifiers = read_identifiers(store.folder)
            if identifiers.pop(number, None):
                write_identifiers(store.folder, identifiers)
            write_log(store.folder / LOG, _without(lines, number))
    return deleted, left


def _without(lines: Sequence[Line], number: int) -> list[Line]:
    """A log without one person, who leaves a number."""
    gone = Forgotten(join=number, forgotten=True)
    others = [line for line in lines if getattr(line, "of", None) != number]
    return [gone if getattr(line, "join", None) == number else line for line in others]


def _files_of(
    store: Store, experiment: StoredExperiment, condition: str, subject: int
) -> list[str]:
    """The names of a person's files that are listed, or there; one for each label they have."""
    there = {path.name for data in DATA for path in (store.folder / data).glob("*.parquet")}
    end = f"_{condition}_{subject}-{subject}"
    names = sorted(
        name for name in {*experiment.files, *there} if name.rpartition("_")[0].endswith(end)
    )
    # a_b_CE3_0-0 can be of a in the condition b_CE3, or of a_b in CE3.
    return [name for name in names if _condition_of(store, name) in (condition, None)]


def _condition_of(store: Store, name: str) -> str | None:
    """The condition in a person's files; None if they are deleted already, or damaged."""
    for data in DATA:
        with suppress(OSError, ChecksumError, LookupError):
            table = read_table((store.folder / data / name).read_bytes(), ["condition"])
            return str(table["condition"][0])
    return None

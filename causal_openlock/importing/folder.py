"""Files of data as a results folder, which ``report`` and ``score`` read."""

from __future__ import annotations

import re
import shlex
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from statistics import median
from typing import Literal

from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.beside_record import REACTIONS, write_reactions
from causal_openlock.experiment.condition import SHOWN, Condition, find_condition
from causal_openlock.experiment.declare import Cell, Experiment, LearnerSpec
from causal_openlock.experiment.making import find_experiment, read_experiment
from causal_openlock.experiment.protocol import Name, find_protocol
from causal_openlock.experiment.record import played
from causal_openlock.files.atomic import folder_at, is_empty, move_into
from causal_openlock.files.validation import read
from causal_openlock.importing.reading import Action, actions_in, fault_at
from causal_openlock.importing.replaying import Replayed, replay
from causal_openlock.play.people import MOST_PEOPLE
from causal_openlock.play.person import LABEL, as_learner
from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.storage.store import Store
from causal_openlock.wording import counted, nearest
from causal_openlock.world.rewards import PAPER_REWARD, find_reward
from causal_openlock.world.room import Layout

SLOW = 60.0
"""Median seconds for an action from which on it is asked whether they are milliseconds."""


@dataclass(frozen=True)
class Imported:
    """Summary of an import."""

    subjects: int  #: how many subjects have a trial that is over
    attempts: int  #: how many attempts of trials that are over
    #: a sentence for each subject whose last trial is not over, and on times that are too long
    warnings: tuple[str, ...]


def import_files(
    files: Sequence[Path | str],
    out: Path | str,
    *,
    experiment: str | None = None,
    protocol: str = "human",
    seed: int = 0,
    learner: str = LABEL,
    layouts: Literal["named", "drawn"] = "named",
    tell: Callable[[str], None] = lambda _: None,
) -> Imported:
    """Play the actions in files again, and write them as a results folder.

    Subjects are numbered in the order in which they come in their condition; an export of this
    project keeps its numbers. What people and files are called is not kept.

    Args:
        files: CSV, perhaps compressed, or what jsPsych saves.
        out: A folder that does not exist, or is empty; not the working directory.
        experiment: An experiment, by name or file, that declares conditions, protocols and rewards
            that are not the toolkit's own; files of data name no schema by a path.
        protocol: The protocol, where the files name none.
        seed: The seed of rooms, where the files name neither it nor layouts.
        learner: The label of who played, where the files name none.
        layouts: Whether the files name the layout of each room, or subjects met those that the seed
            draws.
        tell: Told what code the experiment runs, before it runs.

    Raises:
        OpenLockError: If a file cannot be read, a row could not have happened, or the folder cannot
            be written; nothing has been written then.
    """
    folder = folder_at(out).resolve()
    if folder == Path.cwd():
        raise StoreError(f"{out} is the folder that you work in; name a new folder in it")
    if not is_empty(folder):
        raise StoreError(f"{out} is there already; choose another folder")
    known = read_experiment(find_experiment(experiment), tell=tell) if experiment else None
    actions = [*chain.from_iterable(actions_in(Path(file)) for file in files)]
    name, seed = _origin(actions, folder, seed)
    groups: dict[tuple[str, str, str], dict[str, list[Action]]] = {}
    for action in actions:
        group = action.learner or learner, action.condition, action.protocol or protocol
        groups.setdefault(group, {}).setdefault(action.subject, []).append(action)
    # Numbers of an export stay, but a folder has room for every one up to the highest.
    possible = {str(number) for number in range(MOST_PEOPLE)}
    numbered = all(action.experiment and action.subject in possible for action in actions)
    specs: dict[str, LearnerSpec] = {}
    conditions: dict[str, Condition] = {}
    numbers: dict[str, dict[str, int]] = {}
    rooms: dict[str, dict[int, tuple[Layout, ...]]] = {}
    most: dict[str, int] = {}
    replayed: list[Replayed] = []
    warnings: list[str] = []
    for (label, called, budget), subjects in groups.items():
        first = next(iter(subjects.values()))[0]
        with fault_at(first.place):
            spec = specs.setdefault(label, _spec(label, budget, known))
            condition = conditions.setdefault(called, _condition(called, known))
            if spec.protocol.name != budget:
                raise OpenLockError(
                    f"{label} has played under {spec.protocol.name}, and here under {budget}; give "
                    "learners under different protocols different labels"
                )
        own, met = numbers.setdefault(called, {}), rooms.setdefault(called, {})
        for subject, acted in subjects.items():
            number = own.setdefault(subject, int(subject) if numbered else len(own))
            most[label] = max(most.get(label, 0), number + 1)
            again = replay(acted, Cell(name, seed, spec, condition, number, 1), layouts == "drawn")
            replayed.append(again)
            layouts_met = again.cell.condition.rooms.get(number, ())
            if met.setdefault(number, layouts_met) != layouts_met:
                raise OpenLockError(
                    f"{acted[-1].place}: a subject of this name met other rooms with another "
                    "learner; call the subjects differently"
                )
            if again.left_out:
                warnings.append(
                    f"{acted[-1].place}: the last trial of subject {subject} is not over, and left "
                    f"out ({counted(again.left_out, 'action')})"
                )
    over = [again for again in replayed if again.record.num_rows]
    if not over:
        raise OpenLockError(
            f"{files[0]}: there is no action of a trial that is over; is this the right file?"
        )
    times = [action.reaction for action in actions if action.reaction is not None]
    if times and median(times) > SLOW:
        warnings.append(
            f"half of the reactions took more than {median(times):g} seconds; if these are "
            "milliseconds, divide the column by 1,000 and import again"
        )
    whole = Experiment(
        name=name,
        title="Imported",
        command=shlex.join(["causal-openlock", "import", "FILES", "--out", Path(out).as_posix()]),
        seed=seed,
        cell_size=1,
        conditions=tuple(replace(one, rooms=rooms[called]) for called, one in conditions.items()),
        learners=tuple(replace(spec, subjects=most[label]) for label, spec in specs.items()),
    )
    _write(folder, whole, over)
    attempts = sum(played(again.record).num_rows for again in over)
    return Imported(len(over), attempts, tuple(warnings))


def _origin(actions: Sequence[Action], folder: Path, seed: int) -> tuple[str, int]:
    """The name and seed of the experiment: those of an export, or the folder's and the given."""
    stated = {(action.experiment, action.seed) for action in actions if action.experiment}
    if len(stated) > 1:
        raise OpenLockError(
            "these files are of several experiments, or seeds; import each by itself, then read "
            "them together"
        )
    short = re.sub(r"[^A-Za-z0-9]+", "_", folder.name).strip("_")[:64] or "imported"
    name, seed = next(iter(stated), (short, seed))
    return read(Name, name), seed


def _condition(name: str, known: Experiment | None) -> Condition:
    """A condition of the experiment, or of the package: a name in a file opens no other file."""
    declared = {condition.name: condition for condition in known.conditions} if known else {}
    if name in declared:
        return declared[name]
    shown, packaged = name.startswith(f"{SHOWN}-"), bundled_schemas()
    schemas = name.removeprefix(f"{SHOWN}-").split("-")
    for schema in schemas:
        if schema not in packaged:
            raise OpenLockError(
                f"there is no schema {schema[:80]!r} in the package; {nearest(schema, packaged)}, "
                "or declare the condition in an experiment file, and name it with --from"
            )
    condition = find_condition([packaged[schema] for schema in schemas])
    return replace(condition, name=name, shown=True) if shown else condition


def _spec(label: str, protocol: str, known: Experiment | None) -> LearnerSpec:
    read(Name, label)
    specs = known.learners if known else ()
    budget = find_protocol(protocol, {spec.protocol.name: spec.protocol for spec in specs})
    rewards = {spec.name: spec.reward for spec in specs}
    reward = rewards.get(label) or find_reward(PAPER_REWARD)
    return as_learner(budget, reward, label)


def _write(folder: Path, experiment: Experiment, replayed: Sequence[Replayed]) -> None:
    """Write everything into a temporary folder first, so that it is whole or not there."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".importing-") as beside:
        store = Store(Path(beside) / "results")
        store.open(experiment, changed=False)
        for again in replayed:
            cell, done = again.cell, again.done
            store.write(cell, again.record)
            if any((taken["reaction"], taken["time"]) != (None, None) for taken in done):
                path = store.folder / REACTIONS / cell.file_name
                write_reactions(path, cell.condition.name, cell.first_subject, done)
        store.declare(experiment, [again.cell.file_name for again in replayed])
        store.close()
        move_into(store.folder, folder)

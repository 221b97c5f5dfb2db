"""Files of data as a results folder, which ``report`` and ``score`` read."""

from __future__ import annotations

import re
import shlex
import shutil
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.beside_record import REACTIONS, write_reactions
from causal_openlock.experiment.declare import (
    NAME_FORM,
    NAME_IN_WORDS,
    SHOWN,
    Cell,
    Condition,
    Experiment,
    LearnerSpec,
    find_condition,
    find_protocol,
)
from causal_openlock.experiment.file import find_experiment, read_experiment
from causal_openlock.experiment.record import played, with_times
from causal_openlock.experiment.session import AT_ONCE
from causal_openlock.files.atomic import folder_at, is_empty, move_into
from causal_openlock.files.digest import digest
from causal_openlock.importing.csv_tables import Table, experiment_of, table_actions
from causal_openlock.importing.imported_actions import ActionEntry
from causal_openlock.importing.jspsych import jspsych_actions
from causal_openlock.importing.replaying import Checked, play_again
from causal_openlock.importing.text import is_json
from causal_openlock.play.people import MOST_PEOPLE
from causal_openlock.play.person import LABEL, LEARNER
from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.schemas.schema import Schema
from causal_openlock.storage.folder_lock import locked
from causal_openlock.storage.store import Store
from causal_openlock.wording import counted, nearest
from causal_openlock.world.rewards import PAPER_REWARD, find_reward
from causal_openlock.world.room import Layout

BESIDE = ".importing-"
"""The beginning of the name of the temporary folder, next to ``out``."""


@dataclass(frozen=True)
class Imported:
    """Summary of an import.

    Attributes:
        subjects: How many subjects have a trial that is over.
        attempts: How many attempts of trials that are over.
        left_out: A sentence for each subject whose last trial is not over.
        remarks: Sentences on how tables were read, where that is not as usual.
    """

    subjects: int
    attempts: int
    left_out: tuple[str, ...]
    remarks: tuple[str, ...] = ()


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

    Subjects are numbered in the order in which they come in their condition. What they were called
    is not kept, nor are the names of the files; only this project's own CSV keeps its numbers,
    unless they are far apart.

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
    paths, folder = [*map(Path, files)], folder_at(out).resolve()
    if folder == Path.cwd():
        raise StoreError(f"{out} is the folder that you work in; name a new folder in it")
    if not is_empty(folder):
        raise StoreError(f"{out} is there already; choose another folder")
    _check_each_once(paths)
    known = read_experiment(find_experiment(experiment), tell=tell) if experiment else None
    stated, remarks = [], []
    for path in paths:
        table = None if is_json(path) else Table.opened(path)
        stated.append(experiment_of(table) if table else None)
        remarks += table.remarks() if table else []
    heads = {head for head in stated if head}
    if len(heads) > 1:
        raise OpenLockError(
            "these files are of several experiments, or seeds; import each by itself, then read "
            "them together"
        )
    short = re.sub(r"[^A-Za-z0-9]+", "_", folder.name).strip("_")[:64] or "imported"
    name, seed = next(iter(heads), (short, seed))
    for called in (name, learner):
        if not re.fullmatch(NAME_FORM, called):
            raise OpenLockError(f"{called!r} cannot be a name here; it must be {NAME_IN_WORDS}")
    groups = _grouped((one for path in paths for one in _actions_of(path)), learner, protocol)
    in_condition: dict[str, dict[str, None]] = defaultdict(dict)
    for (_, called, _), subjects in groups.items():
        in_condition[called].update(dict.fromkeys(subjects))
    numbers = {called: _numbers([*names], all(stated)) for called, names in in_condition.items()}
    specs: dict[str, LearnerSpec] = {}
    conditions: dict[str, Condition] = {}
    found: list[tuple[LearnerSpec, Checked]] = []
    for (label, called, budget), subjects in groups.items():
        first = next(iter(subjects.values()))[0]
        try:
            spec = specs.setdefault(label, _spec(label, budget, known))
            condition = conditions.setdefault(called, _condition(called, known))
        except OpenLockError as error:
            raise first.place.fault(str(error)) from None
        if spec.protocol.name != budget:
            raise first.place.fault(
                f"{label} has played under {spec.protocol.name}, and here under {budget}; give "
                "learners under different protocols different labels"
            )
        number = numbers[called]
        several, those = [*subjects.values()], [number[name] for name in subjects]
        for at in range(0, len(several), AT_ONCE):
            these = slice(at, at + AT_ONCE)
            drawn = layouts == "drawn"
            checked = play_again(several[these], those[these], condition, spec, name, seed, drawn)
            found += [(spec, one) for one in checked]
    if not any(one.record.num_rows for _, one in found):
        raise OpenLockError(f"{paths[0]}: there is no trial that is over; is this the right file?")
    command = shlex.join(["causal-openlock", "import", "FILES", "--out", Path(out).as_posix()])
    _write(folder, name, seed, command, [*specs.values()], [*conditions.values()], found)
    return Imported(
        sum(one.record.num_rows > 0 for _, one in found),
        sum(played(one.record).num_rows for _, one in found),
        tuple(
            f"{one.entries[-1].place}: the last trial of subject {one.entries[-1].subject} is not "
            f"over, and left out ({counted(one.left_out, 'action')})"
            for _, one in found
            if one.left_out
        ),
        tuple(remarks),
    )


def _check_each_once(paths: Sequence[Path]) -> None:
    """Refuse two files of the same content: one person would be two subjects."""
    seen: dict[str, Path] = {}
    for path in paths:
        content = path.read_bytes() if path.is_file() else b""
        other = seen.setdefault(digest(content), path)
        if other is not path and content:
            raise OpenLockError(
                f"{other} and {path} have the same content, so that one person would be two "
                "subjects; leave one out"
            )


def _actions_of(path: Path) -> Iterator[ActionEntry]:
    return jspsych_actions(path) if is_json(path) else table_actions(Table.opened(path))


def _grouped(
    entries: Iterable[ActionEntry], learner: str, protocol: str
) -> dict[tuple[str, str, str], dict[str, list[ActionEntry]]]:
    """Actions by learner, condition and protocol, by subject."""
    groups: dict[tuple[str, str, str], dict[str, list[ActionEntry]]] = defaultdict(dict)
    unnamed: dict[str, Path] = {}
    for one in entries:
        file = one.place.file
        if not one.named and unnamed.setdefault(one.subject, file) != file:
            raise one.place.fault(
                f"neither this file nor {unnamed[one.subject]} says whose it is, and their names "
                "are alike; rename one, or add subject to the entries"
            )
        if one.learner and not re.fullmatch(NAME_FORM, one.learner):
            raise one.place.fault(f"{one.learner!r} is not a label; one is {NAME_IN_WORDS}")
        group = groups[one.learner or learner, one.condition, one.protocol or protocol]
        group.setdefault(one.subject, []).append(one)
    return groups


def _numbers(names: Sequence[str], own: bool) -> dict[str, int]:
    """The subjects' numbers: those of our own files, else in the order of appearance."""
    if own and all(name.isascii() and name.isdecimal() and len(name) < 9 for name in names):
        numbers = {name: int(name) for name in names}
        # A folder has room for every number up to the highest.
        few = max(numbers.values()) < max(MOST_PEOPLE, len(names))
        if few and len({*numbers.values()}) == len(names):
            return numbers
    return {name: number for number, name in enumerate(names)}


def _condition(name: str, known: Experiment | None) -> Condition:
    declared = {one.name: one for one in known.conditions} if known else {}
    if name in declared:
        return declared[name]
    shown = name.startswith(f"{SHOWN}-")
    schemas = [_bundled_schema(part) for part in name.removeprefix(f"{SHOWN}-").split("-")]
    condition = find_condition(schemas)
    return replace(condition, name=name, shown=True) if shown else condition


def _bundled_schema(name: str) -> Schema:
    """A schema of the package: what files of data name opens no other file."""
    known = bundled_schemas()
    if name not in known:
        raise OpenLockError(
            f"there is no schema {name[:80]!r} in the package; {nearest(name, known)}, or declare "
            "the condition in an experiment file, and name it with --from"
        )
    return known[name]


def _spec(label: str, protocol: str, known: Experiment | None) -> LearnerSpec:
    specs = known.learners if known else ()
    budgets = {one.protocol.name: one.protocol for one in specs}
    rewards = {one.name: one.reward for one in specs}
    reward = rewards.get(label) or find_reward(PAPER_REWARD)
    budget = find_protocol(protocol, budgets)
    return LearnerSpec(learner=LEARNER, name=label, protocol=budget, reward=reward, subjects=1)


def _write(
    folder: Path,
    name: str,
    seed: int,
    command: str,
    specs: Sequence[LearnerSpec],
    conditions: Sequence[Condition],
    found: Sequence[tuple[LearnerSpec, Checked]],
) -> None:
    """Write everything into a temporary folder first, so that it is whole or not there."""
    most = {spec.name: 1 + max(o.subject for s, o in found if s is spec) for spec in specs}
    rooms: dict[str, dict[int, tuple[Layout, ...]]] = {one.name: {} for one in conditions}
    for _, one in found:
        own = one.condition.rooms.get(one.subject, ())
        if rooms[one.condition.name].setdefault(one.subject, own) != own:
            raise one.entries[0].place.fault(
                f"subject {one.subject} of two learners has met different rooms; call the subjects "
                "differently"
            )
    experiment = Experiment(
        name=name,
        title="Imported",
        command=command,
        seed=seed,
        cell_size=1,
        conditions=tuple(replace(one, rooms=rooms[one.name]) for one in conditions),
        learners=tuple(replace(spec, subjects=most[spec.name]) for spec in specs),
    )
    with _beside(folder) as beside:
        store = Store(beside / "results")
        store.open(experiment, changed=False)
        cells = []
        for spec, one in found:
            if not one.record.num_rows:
                continue
            cell = Cell(name, seed, spec, one.condition, one.subject, 1)
            ends = [taken.time for taken in one.done if taken.attempt_over]
            store.write(cell, with_times(one.record, ends[: one.record.num_rows]))
            if any((entry.reaction, entry.time) != (None, None) for entry in one.entries):
                path = store.folder / REACTIONS / cell.file_name
                write_reactions(path, one.condition.name, one.subject, one.done)
            cells.append(cell)
        store.declare(experiment, [cell.file_name for cell in cells])
        store.close()
        move_into(store.folder, folder)


@contextmanager
def _beside(folder: Path) -> Iterator[Path]:
    """A folder for a while; those that killed imports have left are removed."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    for left in folder.parent.glob(f"{BESIDE}*"):
        with suppress(StoreError), locked(left):  # another import may be at work
            shutil.rmtree(left, ignore_errors=True)
    with (
        tempfile.TemporaryDirectory(dir=folder.parent, prefix=BESIDE) as name,
        locked(Path(name)),
    ):
        yield Path(name)

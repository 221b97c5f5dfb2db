"""Files of data as a results folder, which ``report`` and ``score`` read."""

from __future__ import annotations

import re
import shlex
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.experiment import Cell, Experiment, LearnerSpec
from causal_openlock.experiment.file import find_experiment, read_experiment
from causal_openlock.experiment.file_format import NAME_FORM, NAME_IN_WORDS
from causal_openlock.experiment.protocol import Condition, find_protocol
from causal_openlock.experiment.record import with_times
from causal_openlock.experiment.store import Store
from causal_openlock.formats.schema_file import find_schema
from causal_openlock.importing.actions import ActionEntry
from causal_openlock.importing.checking import Checked, play_again
from causal_openlock.importing.jspsych import jspsych_actions
from causal_openlock.importing.tables import experiment_of, table_actions
from causal_openlock.play.person import LABEL, LEARNER
from causal_openlock.play.reactions import FOLDER, reactions_table, write_reactions
from causal_openlock.wording import counted
from causal_openlock.world.rewards import PAPER_REWARD, find_reward
from causal_openlock.world.room import Layout

AT_ONCE = 40
"""So many subjects are played again at once."""


@dataclass(frozen=True)
class Imported:
    """What was imported.

    Attributes:
        subjects: How many subjects have a trial that is over.
        attempts: How many attempts of trials that are over.
        left_out: A sentence for each subject whose last trial is not over.
    """

    subjects: int
    attempts: int
    left_out: tuple[str, ...]


def import_files(
    files: Sequence[Path | str],
    out: Path | str,
    *,
    experiment: str | None = None,
    protocol: str = "human",
    seed: int = 0,
    learner: str = LABEL,
) -> Imported:
    """Play again what files tell of, and write it as a results folder.

    Subjects are numbered in the order in which they come in their condition, unless all there are
    called by numbers; what they were called is not kept.

    Args:
        files: CSV, perhaps compressed, or the JSON of jsPsych.
        out: A folder that does not exist, or is empty.
        experiment: An experiment, by name or file, that declares conditions, protocols and rewards
            that are not the toolkit's own.
        protocol: The protocol, where the files name none.
        seed: The seed of rooms, where the files name neither it nor layouts.
        learner: The label of who played, where the files name none.

    Raises:
        OpenLockError: If a file cannot be read, a row could not have happened, or the folder cannot
            be written; nothing has been written then.
    """
    paths, folder = [*map(Path, files)], Path(out)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise StoreError(f"{folder} is there already; choose another folder")
    known = read_experiment(find_experiment(experiment)) if experiment else None
    heads = {head for path in paths if path.suffix != ".json" and (head := experiment_of(path))}
    if len(heads) > 1:
        raise OpenLockError(
            "these files are of several experiments, or seeds; import each by itself, then read "
            "them together"
        )
    stem = re.sub(r"\W+", "_", paths[0].name.partition(".")[0]) or "imported"
    name, seed = next(iter(heads), (stem, seed))
    for called in (name, learner):
        if not re.fullmatch(NAME_FORM, called):
            raise OpenLockError(f"{called!r} cannot be a name here; it must be {NAME_IN_WORDS}")
    groups = _grouped((one for path in paths for one in _actions_of(path)), learner, protocol)
    in_condition: dict[str, dict[str, None]] = defaultdict(dict)
    for (_, called, _), subjects in groups.items():
        in_condition[called].update(dict.fromkeys(subjects))
    numbers = {called: _numbers([*names]) for called, names in in_condition.items()}
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
            checked = play_again(several[these], those[these], condition, spec, name, seed)
            found += [(spec, one) for one in checked]
    if not any(one.record.num_rows for _, one in found):
        raise OpenLockError(f"{paths[0]}: there is no trial that is over; is this the right file?")
    _write(folder, name, seed, paths, [*specs.values()], [*conditions.values()], found)
    return Imported(
        sum(one.record.num_rows > 0 for _, one in found),
        sum(one.record.num_rows for _, one in found),
        tuple(
            f"{one.entries[-1].place}: the last trial of subject {one.entries[-1].subject} is not "
            f"over, and left out ({counted(one.left_out, 'action')})"
            for _, one in found
            if one.left_out
        ),
    )


def _actions_of(path: Path) -> Iterator[ActionEntry]:
    return jspsych_actions(path) if path.suffix == ".json" else table_actions(path)


def _grouped(
    entries: Iterable[ActionEntry], learner: str, protocol: str
) -> dict[tuple[str, str, str], dict[str, list[ActionEntry]]]:
    """Actions by learner, condition and protocol, by subject."""
    groups: dict[tuple[str, str, str], dict[str, list[ActionEntry]]] = defaultdict(dict)
    for one in entries:
        if one.learner and not re.fullmatch(NAME_FORM, one.learner):
            raise one.place.fault(f"{one.learner!r} is no label; one is {NAME_IN_WORDS}")
        group = groups[one.learner or learner, one.condition, one.protocol or protocol]
        group.setdefault(one.subject, []).append(one)
    return groups


def _numbers(names: Sequence[str]) -> dict[str, int]:
    if all(name.isascii() and name.isdecimal() and len(name) < 9 for name in names):
        numbers = {name: int(name) for name in names}
        if len({*numbers.values()}) == len(names):
            return numbers
    return {name: number for number, name in enumerate(names)}


def _condition(name: str, known: Experiment | None) -> Condition:
    declared = {one.name: one for one in known.conditions} if known else {}
    return declared.get(name) or Condition.named(name, find_schema)


def _spec(label: str, protocol: str, known: Experiment | None) -> LearnerSpec:
    specs = known.learners if known else ()
    budgets = {one.protocol.name: one.protocol for one in specs}
    rewards = {one.name: one.reward for one in specs}
    reward = rewards.get(label) or find_reward(PAPER_REWARD)
    return LearnerSpec(label, LEARNER, {}, find_protocol(protocol, budgets), reward, 1)


def _write(
    folder: Path,
    name: str,
    seed: int,
    paths: Sequence[Path],
    specs: Sequence[LearnerSpec],
    conditions: Sequence[Condition],
    found: Sequence[tuple[LearnerSpec, Checked]],
) -> None:
    """Write everything beside the folder first, so that it is whole or not there."""
    most = {spec.name: 1 + max(o.subject for s, o in found if s is spec) for spec in specs}
    rooms: dict[str, dict[int, tuple[Layout, ...]]] = {one.name: {} for one in conditions}
    for _, one in found:
        own = one.condition.rooms.get(one.subject, ())
        if rooms[one.condition.name].setdefault(one.subject, own) != own:
            raise one.entries[0].place.fault(
                f"subject {one.subject} of two learners has met different rooms; call the subjects "
                "differently"
            )
    words = ["causal-openlock", "import", *map(str, paths), "--out", folder.as_posix()]
    experiment = Experiment(
        name,
        "Imported",
        seed,
        1,
        tuple(replace(one, rooms=rooms[one.name]) for one in conditions),
        tuple(replace(spec, subjects=most[spec.name]) for spec in specs),
        shlex.join(words),
    )
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".importing-") as beside:
        store = Store(Path(beside) / "results")
        store.open(experiment, changed=False)
        cells = []
        for spec, one in found:
            if not one.record.num_rows:
                continue
            cell = Cell(name, seed, spec, one.condition, one.subject, 1)
            ends = [taken.time for taken in one.done if taken.attempt_over]
            store.write(cell, with_times(one.record, ends[: one.record.num_rows]))
            if any(entry.reaction is not None for entry in one.entries):
                table = reactions_table(one.condition.name, one.subject, one.done)
                write_reactions(store.folder / FOLDER / cell.file_name, table)
            cells.append(cell)
        store.declare(experiment, cells, experiment.identity)
        store.close()
        store.folder.replace(folder)

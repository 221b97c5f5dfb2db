"""Results folders under anything that happens to them: the record stays what it would have been.

Comparisons are played, killed (SIGKILL), stopped (Ctrl-C) or left without disk space at any sync
of a file, played in shards, and their files are cut, flipped, emptied
and deleted in between. Whatever happened, the record equals an undisturbed one in every cell that
is there, or an error names the file. Ten times as much::

    TIMES=10 .venv/bin/python -m pytest -n0 -s tests/storage/test_folder_machine.py
"""

import multiprocessing
import os
import shutil
import signal
import tempfile
from functools import cache
from pathlib import Path
from typing import ClassVar

import pyarrow as pa
import pytest
from hypothesis import Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

from causal_openlock.contract.one_subject import OneSubjectLearner
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.making import read_experiment
from causal_openlock.files.seal import STATE
from causal_openlock.running.runner import run
from causal_openlock.running.worker import Watching
from causal_openlock.storage.folder_lock import Shard
from causal_openlock.storage.store import Store

pytestmark = pytest.mark.slow

TIMES = int(os.environ.get("TIMES", "1"))
TEXT = """\
name: disturbed
seed: {seed}
subjects: {subjects}
cell_size: 2
protocol: short
protocols: {{short: {{attempt_limit: 3, training_trials: 1, baseline_trials: 1}}}}
conditions: [noisy_CC3-CE4]
learners: [{learners}]
"""
THREE = "bayes, tabular_q, 'test_folder_machine:Remembers'"
DDQN = "{learner: ddqn, parameters: {batch_size: 4, hidden_units: 8, replay_size: 20}}"
FORMS = {
    "first": (5, 4, THREE),
    "more subjects": (5, 5, THREE),
    "one learner less": (5, 4, "bayes, tabular_q"),
    "another parameter": (5, 4, "bayes, {learner: tabular_q, parameters: {learning_rate: 0.3}}"),
    "with a network": (5, 4, f"bayes, {DDQN}"),
    "another seed": (6, 4, "tabular_q"),
}
FULL = "a full disk"
ENDS = [signal.SIGKILL, signal.SIGINT, FULL]


class Remembers(OneSubjectLearner):
    """Repeats what moved something. Its players can hold anything, so they are pickled."""

    def begin(self):
        self.good = []

    def act(self, observation):
        if self.good and self.generator.random() < 0.5:
            return int(self.generator.choice(self.good))
        return int(self.generator.integers(self.brief.actions))

    def learn(self, moment):
        if (moment.outcome != moment.observation).any():
            self.good.append(moment.action)


@cache
def form(name):
    seed, subjects, learners = FORMS[name]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "experiment.yaml")
        file.write_text(TEXT.format(seed=seed, subjects=subjects, learners=learners))
        return read_experiment(file)


def contents(table):
    """What a record says, however its names are coded."""
    table = table.drop_columns(["wall_time"])
    names = [pa.string() if pa.types.is_dictionary(kind) else kind for kind in table.schema.types]
    return table.cast(pa.schema(zip(table.column_names, names, strict=True)))


@cache
def undisturbed(name):
    """The record of each cell of a form, by the name of its file, played without checkpoints."""
    with tempfile.TemporaryDirectory() as folder:
        store = run(form(name), Path(folder, "out"), workers=0, watching=Watching(float("inf")))
        return {path.name: contents(store.read(path)) for path in store.files()[0]}


def plays(name, folder, told, end=None, syncs=0, **options):
    """Play a form in this process, with a checkpoint after each step, until it is disturbed.

    At the sync with the number ``syncs`` it ends by a signal, or the disk is full. Warnings, and
    the error, are written to the file ``told``.
    """
    done = 0

    def sync(descriptor):
        nonlocal done
        done += 1
        if end == FULL and syncs <= done < syncs + 3:
            raise OSError(28, "No space left on device")
        if end != FULL and done == syncs:
            os.kill(os.getpid(), end)

    os.fsync = sync
    said = []
    try:
        watching = Watching(checkpoint_every=0)
        run(form(name), folder, workers=0, warn=said.append, watching=watching, **options)
    except OpenLockError as error:
        said.append(f"error: {error}")
    except KeyboardInterrupt:
        pass
    told.write_text("\n".join(said))


def begun(*words, **options):
    """Call `plays` in a process of its own, forked from this one, which has loaded everything."""
    fork = multiprocessing.get_context("fork")
    process = fork.Process(target=plays, args=words, kwargs=options)
    process.start()
    return process


def files_of(folder, *suffixes):
    return sorted(path for path in folder.rglob("*") if path.suffix in suffixes)


class Folder(RuleBasedStateMachine):
    happened: ClassVar[set[str]] = set()
    """What has happened at least once, to see that the machine does what it is for."""

    def __init__(self):
        super().__init__()
        self.around = Path(tempfile.mkdtemp())
        self.folder, self.told = self.around / "out", self.around / "told"
        self.declared = self.folder / "experiment.json"
        self.spoiled = {}  # of each damaged file, its content and what it was before

    def teardown(self):
        shutil.rmtree(self.around)

    def damaged(self):
        """The files that are still as they were damaged."""
        found = {p for p, (now, _) in self.spoiled.items() if p.exists() and p.read_bytes() == now}
        self.spoiled = {path: self.spoiled[path] for path in found}
        self.happened |= {"damaged"} if found else set()
        return found

    def excuses(self, name):
        """What a refusal to play a form may name, given what was done to the folder before."""
        if self.declared in self.damaged():
            return ["experiment.json is damaged"]
        if not self.declared.exists():
            return ["there is no experiment.json"]
        other = Store(self.folder).experiment().seed != form(name).seed
        return ["holds another experiment (disturbed, seed"] if other else []

    def check_said(self, said, excuses):
        """Everything said names a file; returns whether the form was refused."""
        assert all(str(self.folder) in line for line in said), said
        refused = [line for line in said if line.startswith("error: ")]
        assert len(refused) <= 1
        assert not refused or any(one in refused[0] for one in excuses), (refused, excuses)
        return bool(refused)

    def check_played(self, name):
        """Everything is there, and nothing else is left of any run."""
        there, missing = Store(self.folder).files()
        assert {path.name for path in there} == set(undisturbed(name))
        assert not missing
        assert {p.suffix for p in (self.folder / "cells").iterdir()} == {".parquet"}
        assert not files_of(self.folder, ".partial")
        assert self.declared not in self.damaged()

    @rule(name=st.sampled_from([*FORMS]))
    def run(self, name):
        excuses, said = self.excuses(name), []
        before = {path: path.read_bytes() for path in files_of(self.folder, ".parquet", ".json")}
        done = {path.name for path in before if path.suffix == ".parquet"}
        must = "another" in str(excuses) and done and not done & set(undisturbed(name))
        try:
            run(form(name), self.folder, workers=0, warn=said.append)
        except OpenLockError as error:
            said.append(f"error: {error}")
        if not self.check_said(said, excuses):
            assert not must
            self.check_played(name)
        elif "another" in said[-1]:
            assert before == {path: path.read_bytes() for path in before}

    @rule(name=st.sampled_from([*FORMS]), end=st.sampled_from(ENDS), syncs=st.integers(1, 30))
    def end(self, name, end, syncs):
        excuses, before = self.excuses(name), {*files_of(self.folder, ".partial")}
        self.told.unlink(missing_ok=True)
        process = begun(name, self.folder, self.told, end, syncs)
        process.join()
        if process.exitcode:
            assert (end, process.exitcode) == (signal.SIGKILL, -signal.SIGKILL)
            self.happened.add("killed")
            return
        if end == FULL:
            excuses.append("No space left on device")
        said = self.told.read_text().splitlines()
        if any("No space" in line for line in said):
            self.happened.add("full disk")
        self.check_said(said, excuses)
        assert {*files_of(self.folder, ".partial")} <= before  # it tidied up

    @rule(
        name=st.sampled_from(["first", "more subjects", "with a network"]), syncs=st.integers(1, 60)
    )
    def two_shards_of_which_one_is_killed(self, name, syncs):
        excuses = self.excuses(name)
        told = [self.around / f"told{number}" for number in (1, 2)]
        first = begun(name, self.folder, told[0], signal.SIGKILL, syncs, shard=Shard(1, 2))
        second = begun(name, self.folder, told[1], shard=Shard(2, 2))
        first.join()
        second.join()
        assert second.exitcode == 0
        if self.check_said(told[1].read_text().splitlines(), excuses):
            return
        cells = [cell.file_name for cell in Shard(2, 2).of(form(name).cells())]
        assert all((self.folder / "cells" / cell).exists() for cell in cells)

    @precondition(lambda self: files_of(self.folder, ".parquet", ".checkpoint"))
    @rule(
        which=st.floats(0, 1, exclude_max=True),
        suffix=st.sampled_from([".parquet", ".json", ".checkpoint"]),
        how=st.sampled_from(["cut", "flip", "empty", "delete"]),
        place=st.floats(0, 1, exclude_max=True),
    )
    def damage(self, which, suffix, how, place):
        paths = files_of(self.folder, suffix) or files_of(self.folder, ".parquet", ".checkpoint")
        path = paths[int(which * len(paths))]
        content = path.read_bytes()
        at = int(place * len(content))
        if how == "delete":
            path.unlink()
        elif content:
            flipped = bytes([content[at] ^ 1 << at % 8])
            changed = content[:at] + flipped + content[at + 1 :]
            changed = {"cut": content[:at], "flip": changed, "empty": b""}[how]
            before = self.spoiled[path][1] if path in self.damaged() else content
            path.write_bytes(changed)
            self.spoiled[path] = changed, before
            if changed == before:  # the same bit twice
                del self.spoiled[path]

    @invariant()
    def the_record_is_undisturbed_or_the_fault_is_named(self):
        store, damaged = Store(self.folder), self.damaged()
        cells = {name: table for form in FORMS for name, table in undisturbed(form).items()}
        try:
            record, about = store.record()
        except OpenLockError as error:
            said = str(error)
            if not self.declared.exists():
                assert "holds no results" in said
            elif self.declared in damaged:
                assert f"{self.declared} is damaged" in said
            elif not [1 for name in store.experiment().files if (store.cells / name).exists()]:
                assert "holds no cell yet" in said
            else:
                assert any(f"{path} is damaged" in said for path in damaged - {self.declared}), said
            return
        there, missing = store.files()
        assert self.declared not in damaged
        assert {*about.missing} == {path.stem for path in missing}
        assert contents(record).equals(pa.concat_tables(cells[path.name] for path in there))


def test_whatever_happens_to_a_folder_its_record_is_undisturbed(tmp_path, monkeypatch):
    monkeypatch.setenv(STATE, str(tmp_path))
    run_state_machine_as_test(
        Folder,
        settings=settings(
            max_examples=18 * TIMES,
            stateful_step_count=8,
            deadline=None,
            derandomize=TIMES == 1,
            phases=[Phase.generate],  # shrinking takes minutes, and steps are few
        ),
    )
    assert Folder.happened >= {"killed", "full disk", "damaged"}

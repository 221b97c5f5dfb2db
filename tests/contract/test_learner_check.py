"""Before a new learner plays, a few steps show whether it keeps to what is its own."""

from __future__ import annotations

import random
import sys
from pathlib import Path

import numpy as np
import pytest

from causal_openlock.contract.learner import Learner
from causal_openlock.contract.one_subject import OneSubjectLearner
from causal_openlock.contract.probes import GlobalRandomness
from causal_openlock.experiment.experiment import Cell
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.session import Session
from causal_openlock.running import learner_check
from causal_openlock.running.worker import Watching, play_cell
from causal_openlock.storage.store import Store
from support.command import at_once, modules_of
from support.documents import DOCS, code
from support.processes import start_prepared


class Tidy(Learner):
    """Draws from its own generators and leaves everything as it is."""

    def begin(self, brief):
        self.brief = brief

    def act(self, view):
        actions = self.brief.actions
        return np.array([int(own.integers(actions)) for own in self.brief.generators])


class Draws(Tidy):
    def act(self, view):
        return np.random.randint(0, self.brief.actions, self.brief.subjects)  # noqa: NPY002


class DrawsForOne(OneSubjectLearner):
    def act(self, observation):
        return random.randrange(self.brief.actions)


class Seeds(Tidy):
    def begin(self, brief):
        super().begin(brief)
        random.seed(5)  # other tests seed with 0


class DrawsFromTorch(Tidy):
    def act(self, view):
        import torch

        return torch.randint(self.brief.actions, (self.brief.subjects,)).numpy()


class Writes(Tidy):
    def act(self, view):
        view.observation[0, 0] ^= 1
        return super().act(view)


class WritesLater(Tidy):
    """Keeps what it is shown and changes it afterwards, in a way that NumPy does not notice."""

    def learn(self, step):
        import torch

        if (kept := getattr(self, "kept", None)) is not None:
            torch.from_numpy(kept).fill_(7)
        self.kept = step.reward


class WritesForOne(OneSubjectLearner):
    def act(self, observation):
        observation[0] = 1
        return 0


class DoesBoth(Draws):
    def learn(self, step):
        step.reward.clip(-1, 1, out=step.reward)


class Fails(Tidy):
    def act(self, view):
        raise KeyError("it has lost its map")


class Leaves(Tidy):
    def act(self, view):
        sys.exit("enough")


class ReadsBuffers(Tidy):
    """What compiled code says that wants a writable buffer in order to read it."""

    def act(self, view):
        raise ValueError("buffer source array is read-only")


def cell_of(kind: type, folder: Path, extra: str = "") -> Cell:
    path = folder / "small.yaml"
    path.write_text(
        f"name: small\nsubjects: 2\nconditions: [CC3-CE4]\n{extra}"
        f"learners: ['{__name__}:{kind.__name__}']\n",
        encoding="utf-8",
    )
    return read_experiment(path).cells()[0]


SHARED = "it uses or seeds the random numbers of {}, which all code shares"
CHANGES = "{} changes an array that it is given ({}); let it work on a copy"


@pytest.mark.parametrize(
    ("kind", "says"),
    [
        (Tidy, []),
        (Draws, [SHARED.format("numpy.random")]),
        (DrawsForOne, [SHARED.format("random")]),
        (Seeds, [SHARED.format("random")]),
        (DrawsFromTorch, [SHARED.format("torch")]),
        (Writes, [CHANGES.format("act", "assignment destination is read-only")]),
        (WritesForOne, []),  # its observation is a copy of its own
        (WritesLater, [CHANGES.format("learn", "reward")]),
        (
            DoesBoth,
            [
                CHANGES.format("learn", "output array is read-only"),
                SHARED.format("numpy.random"),
            ],
        ),
        (Fails, []),
        (Leaves, []),
        (ReadsBuffers, []),
    ],
)
def test_a_few_steps_tell_what_a_learner_does_to_others(
    kind: type, says: list[str], tmp_path: Path
) -> None:
    before = GlobalRandomness.now()
    found = learner_check.check_learner(cell_of(kind, tmp_path))
    assert not before.differs_from(GlobalRandomness.now())
    assert len(found) == len(says)
    for sentence, start in zip(found, says, strict=True):
        assert sentence.startswith(start)


def test_a_look_changes_nothing_of_what_is_played(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = cell_of(DoesBoth, tmp_path)
    np.random.seed(4)  # noqa: NPY002
    entry = cell.spec
    session = Session(cell.condition, entry.protocol, 2, reward=entry.reward, learner=entry.name)
    expected = session.play(DoesBoth()).drop_columns(["wall_time", "experiment"])
    monkeypatch.setattr(learner_check, "_seen", set())
    for looks in (2, 0):  # the second time, this process has seen the learner
        np.random.seed(4)  # noqa: NPY002
        store = Store(tmp_path / f"out{looks}")
        store.cells.mkdir(parents=True)
        told = play_cell(cell, str(store.folder), Watching())
        assert [line.startswith("DoesBoth: ") for line in told] == [True] * looks
        record = store.read(store.path(cell)).replace_schema_metadata(None)
        assert record.drop_columns(["wall_time", "experiment"]).equals(expected)


def test_learners_of_the_toolkit_are_not_looked_at(tmp_path: Path) -> None:
    path = tmp_path / "ours.yaml"
    path.write_text("name: ours\nconditions: [CC3]\nlearners: [random]\n", encoding="utf-8")
    before = set(learner_check._seen)
    assert learner_check.check_new_learner(read_experiment(path).cells()[0]) == []
    assert learner_check._seen == before


def test_a_look_is_short_whatever_the_budget(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps: list[int] = []
    taken = Session.step
    monkeypatch.setattr(
        Session, "step", lambda session, action: [steps.append(1), taken(session, action)][1]
    )
    learner_check.check_learner(cell_of(Tidy, tmp_path, "protocol: rl\n"))
    assert len(steps) == 24


def test_compare_says_so_once_and_plays_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "untidy.py").write_text(
        "import random\n"
        "from causal_openlock import OneSubjectLearner\n\n\n"
        "class Untidy(OneSubjectLearner):\n"
        "    def act(self, observation):\n"
        "        observation[:] = 0\n"
        "        return random.randrange(self.brief.actions)\n",
        encoding="utf-8",
    )
    words = "compare -c CC3 -c CE3 -l untidy:Untidy -l random --subjects 2 --workers 2 -o out"
    monkeypatch.setenv("COLUMNS", "200")
    start_prepared(monkeypatch)
    with modules_of(tmp_path):
        done = at_once(*words.split(), cwd=tmp_path, workers=True)
    assert done.status == 0, done.stderr
    told = [line for line in (done.stdout + done.stderr).splitlines() if "warning: " in line]
    assert [line.count("Untidy: ") for line in told] == [1]
    assert sum("random numbers of random, which all code shares" in line for line in told) == 1
    assert "report: out/report.html" in done.stdout


def test_who_draws_with_torch_is_told_what_to_do_there(tmp_path: Path) -> None:
    (said,) = learner_check.check_learner(cell_of(DrawsFromTorch, tmp_path))
    assert "torch.Generator().manual_seed" in said
    (other,) = learner_check.check_learner(cell_of(Draws, tmp_path))
    assert "torch" not in other


def test_the_network_of_the_guide_keeps_to_its_own_randomness(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    guide = (DOCS / "howto" / "learner.md").read_text(encoding="utf-8")
    (text,) = [one for one in code(guide, "python") if "class Network" in one]
    (tmp_path / "my_network.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    path = tmp_path / "small.yaml"
    path.write_text(
        "name: small\nconditions: [CC3]\nlearners: ['my_network:Network']\n", encoding="utf-8"
    )
    with modules_of(tmp_path):
        assert learner_check.check_learner(read_experiment(path).cells()[0]) == []

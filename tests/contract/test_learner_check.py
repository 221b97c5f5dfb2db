"""Before a new learner plays, a few steps show whether it keeps to what is its own."""

import random

import numpy as np
import pytest

from causal_openlock.contract.learner import Learner
from causal_openlock.contract.one_subject import OneSubjectLearner
from causal_openlock.contract.probes import GlobalRandomness
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
        observation[0] = 1  # which is a copy of its own
        return random.randrange(self.brief.actions)


class Seeds(Tidy):
    def begin(self, brief):
        super().begin(brief)
        random.seed(5)  # other tests seed with 0


class WritesLater(Tidy):
    """Keeps what it is shown and changes it afterwards, in a way that NumPy does not notice."""

    def learn(self, step):
        import torch

        if (kept := getattr(self, "kept", None)) is not None:
            torch.from_numpy(kept).fill_(7)
        self.kept = step.reward


class DoesBoth(Draws):
    def learn(self, step):
        step.reward.clip(-1, 1, out=step.reward)


class Fails(Tidy):
    def act(self, view):
        raise SystemExit("it has lost its map")


def cell_of(learner, folder):
    path = folder / "small.yaml"
    path.write_text(
        f"name: small\nsubjects: 2\nconditions: [CC3-CE4]\nlearners: ['{learner}']\n",
        encoding="utf-8",
    )
    return read_experiment(path).cells()[0]


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        (Tidy, []),
        (Draws, ["numpy.random"]),
        (DrawsForOne, ["numbers of random,"]),
        (Seeds, ["numbers of random,"]),
        (WritesLater, ["learn changes an array that it is given (reward)"]),
        (DoesBoth, ["learn changes an array", "numpy.random"]),
        (Fails, []),
    ],
)
def test_a_few_steps_tell_what_a_learner_does_to_others(kind, names, tmp_path):
    before = GlobalRandomness.now()
    found = learner_check.check_learner(cell_of(f"{__name__}:{kind.__name__}", tmp_path))
    assert not before.differs_from(GlobalRandomness.now())
    assert len(found) == len(names)
    for sentence, name in zip(found, names, strict=True):
        assert name in sentence


def test_a_check_changes_nothing_of_what_is_played(tmp_path, monkeypatch):
    cell = cell_of(f"{__name__}:DoesBoth", tmp_path)
    np.random.seed(4)  # noqa: NPY002
    entry = cell.spec
    session = Session(cell.condition, entry.protocol, 2, reward=entry.reward, learner=entry.name)
    expected = session.play(DoesBoth()).drop_columns(["wall_time", "experiment"])
    monkeypatch.setattr(learner_check, "_seen", set())
    for checked in (2, 0):  # the second time, this process has seen the learner
        np.random.seed(4)  # noqa: NPY002
        store = Store(tmp_path / f"out{checked}")
        store.cells.mkdir(parents=True)
        told = play_cell(cell, str(store.folder), Watching())
        assert [line.startswith("DoesBoth: ") for line in told] == [True] * checked
        record = store.read(store.path(cell)).replace_schema_metadata(None)
        assert record.drop_columns(["wall_time", "experiment"]).equals(expected)


def test_compare_says_so_once_and_plays_on(tmp_path, monkeypatch):
    (tmp_path / "untidy.py").write_text(
        "import random\n"
        "from causal_openlock import OneSubjectLearner\n\n\n"
        "class Untidy(OneSubjectLearner):\n"
        "    def act(self, observation):\n"
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
    assert "report: out/report.html" in done.stdout


def test_the_network_of_the_guide_keeps_to_its_own_randomness(tmp_path, monkeypatch):
    guide = (DOCS / "howto" / "learner.md").read_text(encoding="utf-8")
    (text,) = [one for one in code(guide, "python") if "class Network" in one]
    (tmp_path / "my_network.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with modules_of(tmp_path):
        assert learner_check.check_learner(cell_of("my_network:Network", tmp_path)) == []

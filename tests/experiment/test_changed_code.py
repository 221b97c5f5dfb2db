"""Results of code that has changed are not taken for those of the code as it is."""

import importlib
import sys

import pytest

from causal_openlock.contract.registry import origin
from causal_openlock.errors import CellsFailed
from causal_openlock.experiment.making import read_experiment
from causal_openlock.running.runner import run
from causal_openlock.running.workers import ThisProcess
from causal_openlock.storage.store import Store
from support.command import at_once, modules_of

FILES = {
    "a_mine.py": """\
from dataclasses import dataclass
from pathlib import Path
from a_base import Base
from a_helper import FIRST

class Mine(Base):
    def act(self, observation):
        return FIRST + self.more

@dataclass(frozen=True)
class Settings:
    table: str = "table.txt"

class Reads(Base):
    Parameters = Settings

    @classmethod
    def artifact_hash(cls, parameters):
        return Path(parameters.table).read_text() or 3

    def act(self, observation):
        return int(Path(self.parameters.table).read_text())
""",
    "a_base.py": "import causal_openlock\n\n"
    "class Base(causal_openlock.OneSubjectLearner):\n    more = 0\n",
    "a_helper.py": "FIRST = 7\n",
    "table.txt": "7",
    "a_reward.py": "from a_helper import FIRST\n\ndef pay(e):\n    return FIRST * 1.0 * e.opens\n",
}
EXPERIMENT = """\
name: e
subjects: 1
conditions: [CC3]
protocol: {attempt_limit: 2, baseline_trials: 1}
learners: [LEARNER]
"""
MINE, READS, PAID = "'a_mine:Mine'", "'a_mine:Reads'", "{learner: oracle, reward: 'a_reward:pay'}"
CHANGED = "FIRST = 3 + 5\n"
"""Of another length: in the same second Python would not notice a change else."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    with modules_of(tmp_path):
        yield tmp_path


def compared(folder, learner):
    (folder / "e.yaml").write_text(EXPERIMENT.replace("LEARNER", learner))
    with modules_of(folder):
        return at_once("compare", "e.yaml", "-o", "out")


@pytest.mark.parametrize(
    ("learner", "column", "file", "text"),
    [
        (MINE, "actions", "a_helper.py", CHANGED),
        (MINE, "actions", "a_base.py", FILES["a_base.py"].replace("= 0", "= 1 + 0")),
        (READS, "actions", "table.txt", "8"),
        (PAID, "reward", "a_helper.py", CHANGED),
    ],
    ids=["helper", "base class", "data", "reward"],
)
def test_what_has_changed_is_played_as_it_is_now(folder, learner, column, file, text):
    for largest in (7, 8):
        done = compared(folder, learner)
        assert done.status == 0, done.stderr
        values = Store(folder / "out").record([column])[0][column].to_pandas()
        assert values.explode().max() == largest
        (folder / file).write_text(text)


def test_a_hash_that_cannot_be_made_is_refused(folder):
    (folder / "empty.txt").touch()
    for table, why in (("gone.txt", "fails (FileNotFoundError"), ("empty.txt", "returned 3")):
        learner = f"{{learner: 'a_mine:Reads', parameters: {{table: {table}}}}}"
        done = compared(folder, learner)
        assert done.status == 2
        assert "artifact_hash of a_mine:Reads" in done.stderr
        assert why in done.stderr


def test_a_process_that_imported_other_code_does_not_play(folder):
    compared(folder, MINE)
    assert origin("a_mine:Mine") == origin("a_mine:Mine", imported=True)
    (folder / "a_helper.py").write_text(CHANGED)
    experiment = read_experiment(folder / "e.yaml")
    with pytest.raises(CellsFailed, match="it was changed meanwhile"):
        run(experiment, folder / "new", executor=ThisProcess())
    importlib.reload(sys.modules["a_helper"])
    importlib.reload(sys.modules["a_mine"])
    run(experiment, folder / "new", executor=ThisProcess())


def test_a_reward_that_was_changed_after_it_was_declared_does_not_play(folder):
    compared(folder, PAID)
    experiment = read_experiment(folder / "e.yaml")
    (folder / "a_helper.py").write_text(CHANGED)
    importlib.reload(sys.modules["a_helper"])
    importlib.reload(sys.modules["a_reward"])
    with pytest.raises(CellsFailed, match=r"the code of a_reward:pay is .* was changed meanwhile"):
        run(experiment, folder / "new", executor=ThisProcess())

"""Results of code that has changed are not taken for those of the code as it is."""

from __future__ import annotations

import importlib
import linecache
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

import causal_openlock as ol
from causal_openlock.contract.registry import origin
from causal_openlock.errors import CellsFailed, LearnerError, RewardError
from causal_openlock.experiment.file import read_experiment
from causal_openlock.running.runner import run
from causal_openlock.storage.store import Store
from causal_openlock.world.reward_code import _loaded, own_reward
from support.command import AtOnce, at_once, modules_of

MINE = """\
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from causal_openlock import OneSubjectLearner
from a_base import Base
from a_helper import FIRST

class Mine(Base):
    def act(self, observation):
        return FIRST + self.more

@dataclass(frozen=True)
class Settings:
    table: str = "table.txt"

class Reads(OneSubjectLearner):
    Parameters = Settings

    @classmethod
    def artifact_hash(cls, parameters):
        return sha256(Path(parameters.table).read_bytes()).hexdigest()

    def begin(self):
        self.first = int(Path(self.parameters.table).read_text())

    def act(self, observation):
        return self.first

class Odd(Reads):
    @classmethod
    def artifact_hash(cls, parameters):
        return 3
"""
FILES = {
    "a_mine.py": MINE,
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
protocols: {short: {attempt_limit: 2, baseline_trials: 1}}
protocol: short
learners: [LEARNER]
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    with modules_of(tmp_path):
        yield tmp_path
    _loaded.cache_clear()


def played(folder: Path, learner: str, column: str) -> set[float]:
    """The values that a column has after a comparison, the same command each time.

    What is changed in between has another length: in the same second Python would not notice.
    """
    (folder / "e.yaml").write_text(EXPERIMENT.replace("LEARNER", learner))
    with modules_of(folder):
        done = at_once("compare", "e.yaml", "-o", "out")
    _loaded.cache_clear()
    assert done.status == 0, done.stderr
    values = Store(folder / "out").record([column])[0][column].to_pylist()
    return set(values if column == "reward" else [one for own in values for one in own])


@pytest.mark.parametrize(
    ("learner", "file", "text"),
    [
        ("'a_mine:Mine'", "a_helper.py", "FIRST = 3 + 5\n"),
        ("'a_mine:Mine'", "a_base.py", FILES["a_base.py"].replace("= 0", "= 1 + 0")),
        ("'a_mine:Reads'", "table.txt", "8"),
    ],
    ids=["helper", "base class", "data"],
)
def test_what_a_learner_is_made_of_is_played_as_it_is_now(
    folder: Path, learner: str, file: str, text: str
) -> None:
    assert played(folder, learner, "actions") == {7}
    (folder / file).write_text(text)
    assert played(folder, learner, "actions") == {8}


def test_a_reward_whose_helper_changed_pays_as_it_does_now(folder: Path) -> None:
    learner = "{learner: oracle, reward: 'a_reward:pay'}"
    assert max(played(folder, learner, "reward")) == 7
    (folder / "a_helper.py").write_text("FIRST = 2000\n")
    assert max(played(folder, learner, "reward")) == 2000


@pytest.mark.parametrize(
    ("learner", "says"),
    [
        (
            "{learner: 'a_mine:Reads', parameters: {table: gone}}",
            "artifact_hash of a_mine:Reads fa",
        ),
        ("'a_mine:Odd'", "artifact_hash of a_mine:Odd has to return a text, and returned 3"),
    ],
)
def test_a_hash_that_cannot_be_made_is_one_sentence(folder: Path, learner: str, says: str) -> None:
    (folder / "e.yaml").write_text(EXPERIMENT.replace("LEARNER", learner))
    done = at_once("compare", "e.yaml", "-o", "out")
    assert done.status == 2
    assert says in done.stderr


def test_a_process_that_imported_other_code_does_not_play(folder: Path) -> None:
    (folder / "e.yaml").write_text(EXPERIMENT.replace("LEARNER", "'a_mine:Mine'"))
    assert origin("a_mine:Mine") == origin("a_mine:Mine", imported=True)
    (folder / "a_helper.py").write_text("FIRST = 3 + 5\n")
    experiment = read_experiment(folder / "e.yaml")
    with pytest.raises(CellsFailed, match="it was changed meanwhile"):
        run(experiment, folder / "out", executor=AtOnce())
    importlib.reload(sys.modules["a_helper"])
    importlib.reload(sys.modules["a_mine"])
    run(experiment, folder / "out", executor=AtOnce())


def test_a_reward_is_reloaded_and_old_code_is_not_taken_for_new(folder: Path) -> None:
    sys.path.append(str(folder))
    first = own_reward("a_reward:pay")
    (folder / "a_helper.py").write_text("FIRST = 3 + 5\n")
    with pytest.raises(RewardError, match=r"has changed since it was imported .* importlib.reload"):
        own_reward("a_reward:pay")
    importlib.reload(sys.modules["a_helper"])
    importlib.reload(sys.modules["a_reward"])
    assert own_reward("a_reward:pay").source != first.source


@pytest.mark.parametrize(
    "cell",
    [
        "import a_helper\nclass Mine(ol.OneSubjectLearner):\n"
        "    def act(self, seen):\n        return a_helper.FIRST\n",
        "class Mine(ol.OneSubjectLearner):\n"
        "    def act(self, seen):\n        import a_helper\n        return a_helper.FIRST\n",
        "from a_object import ONE\nclass Mine(ol.OneSubjectLearner):\n"
        "    def act(self, seen):\n        return ONE.first()\n",
    ],
    ids=["imported", "imported late", "an object"],
)
def test_a_module_next_to_a_notebook_counts(
    folder: Path, monkeypatch: pytest.MonkeyPatch, cell: str
) -> None:
    sys.path.append(str(folder))
    (folder / "a_object.py").write_text(
        "import a_helper\nclass One:\n    def first(self):\n        return a_helper.FIRST\n"
        "ONE = One()\n"
    )
    main = ModuleType("__main__")
    monkeypatch.setitem(sys.modules, "__main__", main)
    name, text = "/tmp/ipykernel_1/1.py", f"import causal_openlock as ol\n{cell}"
    lines = text.splitlines(keepends=True)
    monkeypatch.setitem(linecache.cache, name, (len(text), None, lines, name))
    exec(compile(text, name, "exec"), vars(main))
    before = origin("__main__:Mine")
    assert origin("__main__:Mine") == before
    (folder / "a_helper.py").write_text("FIRST = 3 + 5\n")
    assert origin("__main__:Mine") != before


def test_a_cluster_is_not_sent_what_changed_since_it_was_declared(folder: Path) -> None:
    from causal_openlock.running.carried_code import carry

    (folder / "e.yaml").write_text(
        EXPERIMENT.replace("LEARNER", "{learner: 'a_mine:Mine', reward: 'a_reward:pay'}")
    )
    experiment = read_experiment(folder / "e.yaml")
    assert [cell.identity for cell in experiment.cells()]
    assert {*carry(experiment, folder / "out").files} == {
        *("a_mine.py", "a_base.py", "a_helper.py", "a_reward.py")
    }
    (folder / "a_helper.py").write_text("FIRST = 3 + 5\n")
    with pytest.raises(LearnerError, match="the file of a_mine:Mine has changed since"):
        carry(experiment, folder / "out")


def test_a_package_that_is_edited_where_it_is_counts_by_its_code(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    about = folder / "installed" / "edited_learners-0.3.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: edited-learners\nVersion: 0.3\n")
    (about / "entry_points.txt").write_text("[causal_openlock.learners]\nedited = a_mine:Mine\n")
    (about / "direct_url.json").write_text('{"url": "file:///x", "dir_info": {"editable": true}}')
    sys.path += [str(folder), str(folder / "installed")]
    first = origin("edited")
    assert first.startswith("edited-learners 0.3+")
    (folder / "a_helper.py").write_text("FIRST = 3 + 5\n")
    assert origin("edited") != first == origin("edited", imported=True)
    (about / "direct_url.json").write_text('{"url": "file:///x", "dir_info": {}}')
    assert origin("edited") == "edited-learners 0.3"


def test_bundled_learners_are_what_they_were() -> None:
    assert {name: origin(name).split()[0] for name in ("bayes", "ddqn")} == {
        "bayes": "causal-openlock",
        "ddqn": "causal-openlock",
    }
    assert not ol.make_experiment(["CC3"], ["bayes"]).learners[0].origin.artifact_hash

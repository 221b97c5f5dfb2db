"""Classes of a running notebook: what goes to workers, and what is kept as source."""

import linecache
import os
import subprocess
import sys
import zipfile
from types import ModuleType

import pytest

import causal_openlock as ol
from causal_openlock.contract.registry import learner_class, origin, parameter_table
from causal_openlock.envs.single import OpenLockEnv
from causal_openlock.errors import ExperimentError, LearnerError, StoreError
from causal_openlock.export.bundle import write_bundle
from causal_openlock.usercode import session_code
from causal_openlock.usercode.session_code import packed, session_source, unpack
from causal_openlock.world.rewards import find_reward

HEAD = """\
import threading
import numpy as np
import causal_openlock as ol
from dataclasses import dataclass
from functools import cache, partial
from math import sqrt
SCALE = 3
W = np.zeros(5000)
WORDS = {"one", "two", "three", "four"}
results = object()
class Conf:
    pass
CONF = Conf()
CONF.x = 1
def step(a, b):
    return a + b
@cache
def table(n):
    return n * SCALE
half = lambda x: x // 2 * SCALE
shift = partial(step, 2)
"""
LEARNER = """\
@dataclass(frozen=True)
class Settings:
    rate: float = 0.5

class Mine(ol.OneSubjectLearner):
    Parameters = Settings
    def begin(self):
        self.results, results = Settings(1.0), np.zeros(1)
    def act(self, observation):
        return int(sqrt(table(0)) + half(0) + 0 * (shift(1) + W[0] + CONF.x + len(WORDS)))
"""
REWARD = """\
def eager(events):
    return SCALE * events.opens - 0.1
"""
NAME = "__main__:Mine"


@pytest.fixture
def run(monkeypatch):
    """Runs a cell in a notebook's ``__main__``."""
    main = ModuleType("__main__")
    monkeypatch.setitem(sys.modules, "__main__", main)
    number = 0

    def run_cells(*texts):
        nonlocal number
        for text in texts:
            number += 1
            name = f"/tmp/ipykernel_1/{number}.py"
            lines = text.splitlines(keepends=True)
            monkeypatch.setitem(linecache.cache, name, (len(text), None, lines, name))
            exec(compile(text, name, "exec"), vars(main))

    return run_cells


def arrive(content, monkeypatch):
    """Unpack in another process what was packed in this one; returns its ``__main__``."""
    worker = ModuleType("__main__")
    monkeypatch.setitem(sys.modules, "__main__", worker)
    monkeypatch.setattr(session_code, "_OWN", "another process")
    unpack(content)
    return worker


def test_all_that_a_learner_uses_arrives(run, monkeypatch):
    run(HEAD, LEARNER)
    content = packed([NAME, "ddqn"])
    before = learner_class(NAME)
    unpack(content)  # packed here: nothing is defined again
    assert learner_class(NAME) is before
    worker = arrive(content, monkeypatch)
    assert "results" not in vars(worker)  # another name, which it does not use
    assert [row.default for row in parameter_table(NAME)] == [0.5]
    assert worker.Mine().act(None) == 0
    assert worker.table.cache_info().currsize == 1


def test_results_and_bundles_have_the_source_and_need_no_definitions(run, monkeypatch, tmp_path):
    run(HEAD, REWARD, LEARNER)
    eager = vars(sys.modules["__main__"])["eager"]
    learners = [learner_class(NAME), ol.learner("random", reward=eager)]
    experiment = ol.make_experiment(["CC3"], learners, subjects=1)
    reward = experiment.learners[1].reward
    assert (reward.name, reward.source[:9]) == ("__main__:eager", "eager.py ")
    sources = {session_source(NAME), session_source("__main__:eager")}
    sent = packed([NAME, reward.name])
    store = ol.run(experiment, tmp_path / "r", workers=0)
    stored = {path.stem.partition("_")[0]: path for path in (tmp_path / "r" / "code").iterdir()}
    assert {path.read_text() for path in stored.values()} == sources
    monkeypatch.setitem(sys.modules, "__main__", ModuleType("__main__"))
    assert ol.open_results(tmp_path / "r").learners == ("Mine", "random")
    warnings = write_bundle(store, tmp_path / "b.zip")
    assert [line.partition(" was defined in a notebook")[0] for line in warnings[:2]] == [
        "Mine",
        "the reward of random",
    ]
    with zipfile.ZipFile(tmp_path / "b.zip") as bundle:
        bundle.extractall(tmp_path / "again")
    folder = tmp_path / "again" / "comparison"
    again = ol.read_experiment(folder / "experiment.yaml").learners
    assert learner_class(again[0].learner).__name__ == "Mine"
    assert again[1].reward.name == f"{stored['eager'].stem}:eager"
    stored["Mine"].write_text("import os\n")
    with pytest.raises(StoreError, match="is not the source of Mine"):
        write_bundle(store, tmp_path / "b.zip")

    assert {"eager", "SCALE"} <= vars(arrive(sent, monkeypatch)).keys()
    elsewhere = OpenLockEnv("CC3", layout="trial1", reward=reward, episode="trial")
    elsewhere.reset(seed=0)
    assert elsewhere.step(14)[1] == pytest.approx(-0.1)


def test_what_changes_after_it_was_declared_does_not_play(run, tmp_path):
    run(HEAD, REWARD, LEARNER)
    main = vars(sys.modules["__main__"])
    before = find_reward(main["eager"])
    rewarded = ol.make_experiment(["CC3"], ["random"], subjects=1, reward=main["eager"])
    experiment = ol.make_experiment(["CC3"], [learner_class(NAME), "random"], subjects=1)
    assert experiment.identity  # it is declared
    run(REWARD.replace("0.1", "0.2"))
    assert find_reward(main["eager"]) != before
    run("SCALE = 9\n")
    for declared, named in ((rewarded, "__main__:eager"), (experiment, "__main__:Mine")):
        with pytest.raises(LearnerError, match=f"the code of {named} is .* was declared as"):
            ol.run(declared, tmp_path / named[-4:], workers=0)
    assert {*ol.open_results(tmp_path / "Mine").trials["learner"]} == {"random"}


def test_what_workers_could_not_find_or_get_is_refused(run):
    run("def outer():\n    def inner(events):\n        return events.opens\n    return inner\n")
    main = vars(sys.modules["__main__"])
    with pytest.raises(ExperimentError, match="define it with def at the top level of a notebook"):
        find_reward(main["outer"]())
    run(HEAD, "LOCK = threading.Lock()\n")
    exec(LEARNER, main)
    with pytest.raises(LearnerError, match="the source of Mine cannot be found"):
        origin(NAME)
    run("class Mine(ol.OneSubjectLearner):\n    def act(self, seen):\n        return bool(LOCK)\n")
    with pytest.raises(LearnerError, match=r"LOCK, which .* cannot be sent .* workers=0"):
        packed([NAME])


@pytest.mark.parametrize(
    "change",
    [
        "W[2500] = 7",
        "def step(a, b):\n    return a - b\nshift = partial(step, 2)",
        "@cache\ndef table(n):\n    return n + 1",
        "half = lambda x: x // 3 * SCALE",
        "WORDS.add('five')",
        "SCALE = 8",
    ],
)
def test_what_decides_its_play_is_in_the_hash(run, change):
    run(HEAD, LEARNER)
    before = origin(NAME)
    assert origin(NAME) == before
    run(change)
    assert origin(NAME) != before


def test_the_hash_is_the_same_in_every_process(tmp_path):
    script = tmp_path / "script.py"
    last = "from causal_openlock.contract.registry import origin\nprint(origin('__main__:Mine'))\n"
    script.write_text(HEAD + LEARNER + last)
    command = [sys.executable, script]
    hashes = {
        subprocess.check_output(command, env={**os.environ, "PYTHONHASHSEED": seed})
        for seed in ("1", "5")
    }
    assert len(hashes) == 1

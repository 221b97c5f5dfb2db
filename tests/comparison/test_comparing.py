"""What ``compare`` takes, what it plays, and how it stops and goes on."""

import os
import signal
from pathlib import Path
from typing import ClassVar

import numpy as np
import pandas as pd
import pytest

import causal_openlock as ol
from causal_openlock.errors import Interrupted, LearnerError
from support.processes import start_prepared

pytestmark = pytest.mark.slow

VAULT = ol.schema("vault: key & second -> door; dial -> second")


class Persistent(ol.OneSubjectLearner):
    """Push the door, always; notes in which process it acts."""

    processes: ClassVar[set[int]] = set()

    def act(self, observation):
        self.processes.add(os.getpid())
        return self.brief.actions - 1


class Failing(ol.OneSubjectLearner):
    """It does not work."""

    def act(self, observation):
        return 1 // 0


class Stopped(ol.OneSubjectLearner):
    """Somebody presses the stop button while it thinks, the first time."""

    stops = 1

    def act(self, observation):
        if Stopped.stops:
            Stopped.stops -= 1
            raise KeyboardInterrupt
        return 0


def played_at(results, learner="oracle"):
    """When each attempt was over, in seconds: equal only if nothing was played again."""
    attempts = results.attempts
    return attempts.loc[attempts["learner"] == learner, "wall_time"].tolist()


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "e.yaml"
    path.write_text("name: e\nconditions: [CC3]\nsubjects: 2\nlearners: [oracle, random]\n")
    return path


# -- what it takes ---------------------------------------------------------------------------------


def test_conditions_in_every_form(tmp_path):
    (tmp_path / "v.yaml").write_text(VAULT.to_yaml())
    forms = ["CC4", "CC3-CC4", VAULT, ["CC3", VAULT], ("CC3", "CE3", "CC4"), "A -> door"]
    made = ol.make_experiment(forms, "oracle")
    assert [condition.name for condition in made.conditions] == [
        *("CC4", "CC3-CC4", "vault", "CC3-vault", "CC3-CE3-CC4", "schema"),
    ]
    last = made.conditions[-2]
    assert [[trials.schema.name for trials in part] for part in (last.train, last.test)] == [
        ["CC3", "CE3"],
        ["CC4"],
    ]
    for paths in (tmp_path / "v.yaml", [tmp_path / "v.yaml", Path("CC3")]):
        assert ol.make_experiment(paths, "oracle").conditions[0].name == "vault"
    names = iter(["oracle"])
    assert ol.compare(pd.Index(["CC3"]), names, subjects=1, workers=0).learners == ("oracle",)


def test_learners_in_every_form():
    slow = ol.learner("ddqn", learning_rate=0.0005, label="slow")
    learners = ["bayes", slow, Persistent]
    made = ol.make_experiment(["CC3"], learners, title="Mine", subjects=np.int64(1))
    assert [spec.name for spec in made.learners] == ["bayes", "slow", "Persistent"]
    assert made.learners[1].parameters["learning_rate"] == 0.0005
    assert made.learners[2].learner == f"{__name__}:Persistent"
    assert (made.title, made.learners[0].subjects) == ("Mine", 1)
    (spec,) = ol.make_experiment(["CC3"], {Persistent}).learners
    assert spec.learner == made.learners[2].learner


def test_declared_experiment_is_that_of_a_file(tmp_path):
    (tmp_path / "e.yaml").write_text(
        "name: comparison\nseed: 3\nsubjects: 2\nconditions: [CC3, CC3-CC4]\n"
        "learners: [oracle, {learner: ddqn, name: slow, parameters: {learning_rate: 0.0005}}]\n"
    )
    slow = ol.learner("ddqn", learning_rate=0.0005, label="slow")
    made = ol.make_experiment(["CC3", ["CC3", "CC4"]], ["oracle", slow], seed=3, subjects=2)
    assert made.identity == ol.read_experiment(tmp_path / "e.yaml").identity


def test_arguments_change_what_is_played():
    results = ol.compare(
        ["CC3"],
        ["random"],
        subjects=2,
        protocol={"based_on": "human", "baseline_trials": 3},
        attempt_limit=4,
        reward={"preset": "basic", "unlock": 1},
        cell_size=1,
        seed=5,
        name="named",
        workers=0,
    )
    experiment = results.experiment
    assert (experiment.name, experiment.seed, len(experiment.files)) == ("named", 5, 2)
    assert len(results.trials) == 2 * 3
    assert results.attempts["attempt"].max() <= 4
    opened, unlocked = results.attempts["opened"], results.attempts["unlocked"]
    assert (results.attempts["reward"] == 50 * opened + unlocked).all()


# -- what it plays ---------------------------------------------------------------------------------


def test_what_was_played_is_not_played_again():
    one = ol.compare(["CC3"], ["oracle"], subjects=2, seed=71, workers=0)
    two = ol.compare(["CC3"], ["oracle", "random"], subjects=2, seed=71, workers=0)
    assert two.learners == ("oracle", "random")
    assert one.folders != two.folders
    assert played_at(one) == played_at(two)


def test_file_plays_into_a_folder_and_learners_are_added(file, tmp_path):
    out = tmp_path / "out"
    first = ol.compare(file, ["oracle"], out=out, workers=0)
    before = played_at(first)
    whole = ol.compare(file, out=out, workers=0)
    assert whole.learners == ("oracle", "random")
    assert whole.folders == (out,)
    assert played_at(whole) == before
    assert played_at(ol.compare(ol.read_experiment(file), out=out, workers=0)) == before
    assert ol.compare(file, ["random"], subjects=1, workers=0).learners == ("random",)
    file.write_text(file.read_text().replace("name: e", "name: own"))
    before = played_at(ol.compare(file, out=tmp_path / "own", workers=0))
    again = ol.compare(file, ["win_stay", "oracle"], out=tmp_path / "own", workers=0)
    assert (again.experiment.name, again.learners) == ("own", ("win_stay", "oracle"))
    assert played_at(again) == before


def test_workers_decide_which_process_plays(monkeypatch):
    start_prepared(monkeypatch)
    Persistent.processes.clear()
    assert len(ol.compare(["CC3", "CE3"], Persistent, subjects=1, workers=0).headline) == 2
    assert Persistent.processes == {os.getpid()}
    Persistent.processes.clear()
    assert ol.compare(["CC3"], [Persistent], subjects=1, workers=1).learners == ("Persistent",)
    assert not Persistent.processes


@pytest.fixture
def heard():
    """Ctrl-C is heard, which a process in the background ignores."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heard")
def test_stopping_keeps_what_is_done():
    both = {"subjects": 2, "seed": 72, "workers": 0}
    ol.compare(["CC3"], ["oracle"], **both)
    with pytest.raises(Interrupted, match="1 of 2 cells") as caught:
        ol.compare(["CC3"], ["oracle", Stopped], **both)
    assert caught.value._render_traceback_() == [str(caught.value)]  # in a notebook
    results = ol.compare(["CC3"], ["oracle", Stopped], **both)
    assert len(results.trials) == 2 * 2 * 5


def test_cells_that_fail_are_warned_of_and_named():
    with pytest.warns(UserWarning, match="failed: ZeroDivisionError") as warned:
        results = ol.compare(["CC3"], [Failing, "oracle"], subjects=2, workers=0)
    assert {Path(warning.filename).name for warning in warned} == {Path(__file__).name}
    assert results.warnings[0].startswith("1 cell of 2 missing: the learner Failing in CC3")
    every = pytest.raises(LearnerError, match="every cell failed")
    with every, pytest.warns(UserWarning, match="failed"):
        ol.compare(["CC3"], [Failing], subjects=2, workers=0)

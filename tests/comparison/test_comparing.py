"""What ``compare`` takes, what it plays, and how it stops and goes on."""

import os
import signal
from pathlib import Path
from typing import ClassVar

import pandas as pd
import pytest

import causal_openlock as ol
from causal_openlock.errors import Interrupted, LearnerError
from support.processes import start_prepared

pytestmark = pytest.mark.slow


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


def test_conditions_and_learners_may_be_any_iterable():
    made = ol.make_experiment(pd.Index(["CE3", "CC3"]), iter(["oracle", Persistent]))
    assert [condition.name for condition in made.conditions] == ["CE3", "CC3"]
    assert [spec.learner for spec in made.learners] == ["oracle", f"{__name__}:Persistent"]
    (spec,) = ol.make_experiment(["CC3"], {Persistent}).learners
    assert spec.name == "Persistent"


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

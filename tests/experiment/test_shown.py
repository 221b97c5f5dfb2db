"""Training that is shown: each solution of each room once, and nothing of it is a result."""

from dataclasses import replace

import numpy as np
import pytest

from causal_openlock.contract.registry import create
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.making import make_experiment
from causal_openlock.experiment.session import Session
from openlock_learners.random import RandomLearner
from support.session_play import HUMAN, RL, Scripted, named, play, trials_of

SHOWN = "shown-CC3-CC4"
PLAYED = replace(named(SHOWN), name="same", shown=False)
"""The same condition, and the same rooms, as the condition ``same`` whose training is shown."""


@pytest.mark.parametrize(
    "protocol",
    [HUMAN, replace(RL, attempt_limit=9, train_loops=1, test_loops=1)],
    ids=["human", "rl"],
)
def test_each_solution_is_shown_once_in_the_room_then_the_test_is_played(protocol):
    record = play(create("oracle"), SHOWN, protocol, 30)
    shown = record[record["phase"] == "shown"]
    assert shown["new_solution"].all()
    assert (trials_of(shown)["attempts"] == 2).all()
    assert shown.groupby("subject")["trial"].max().eq(6).all()
    rest = record[record["phase"] != "shown"]
    assert set(rest["phase"]) == {"test"}
    assert set(rest["schema"]) == {"CC4"}
    # Orders are drawn for each subject and room: about as often the one as the other.
    first = shown.loc[shown["attempt"] == 1, "solution"]
    assert 60 < (first == 0).sum() < 120


def test_what_subjects_do_is_what_they_were_shown_and_then_they_act_themselves():
    learner = Scripted([], [], afterwards=0)  # it does nothing of its own
    session = Session(named(SHOWN), HUMAN, 2)
    session.begin(learner)
    steps = session.steps(learner)
    taken = [next(steps) for _ in range(6 * 2 * 3)]
    assert session.shown is None
    assert all((step.view.trial <= 6).all() for step in taken)
    assert next(steps).view.trial.tolist() == [7, 7]
    assert session.record().num_rows == 2 * 6 * 2


@pytest.mark.parametrize("name", ["bayes", "win_stay"])
def test_being_shown_teaches_what_doing_the_same_teaches(name):
    sessions = [Session(one, HUMAN, 2) for one in (replace(PLAYED, shown=True), PLAYED)]
    learners = [create(name) for _ in sessions]
    for session, learner in zip(sessions, learners, strict=True):
        session.begin(learner)
    before = learners[0].probabilities(sessions[0].view)
    for _ in range(6 * 2 * 3):
        action = sessions[0].shown
        for session, learner in zip(sessions, learners, strict=True):
            learner.probabilities(session.view)
            learner.learn(session.step(action))
    after = [one.probabilities(own.view) for one, own in zip(learners, sessions, strict=True)]
    np.testing.assert_array_equal(*after)
    assert not np.array_equal(before, after[0])


class Alone(RandomLearner):
    learns_from_others = False


def test_who_learns_from_its_own_actions_alone_is_shown_nothing():
    with pytest.raises(OpenLockError, match="Alone"):
        Session(named(SHOWN), HUMAN, 1).play(Alone())
    made = make_experiment([SHOWN, "CC3-CC4"], ["random", Alone], subjects=1)
    ((who, left_out),) = made.not_applicable.items()
    assert (who, [*left_out]) == ("Alone", [SHOWN])

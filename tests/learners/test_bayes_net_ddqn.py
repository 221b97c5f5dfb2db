"""A DDQN that explores by expected information, beside one that explores by chance."""

from collections import Counter

import numpy as np
import pytest

from causal_openlock.contract.registry import create
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.experiment.session import Session
from openlock_learners.bayes_net_ddqn import BayesNetDDQN, BayesNetDDQNParameters
from openlock_learners.ddqn import DDQN, DDQNParameters
from support.session_play import HUMAN, named, one_room

pytestmark = pytest.mark.slow

SMALL = {
    "hidden_layers": 1,
    "hidden_units": 8,
    "batch_size": 8,
    "replay_size": 40,
    "target_period": 10,
}
ON = Protocol("on", 60, stop_when_solved=False, baseline_trials=2)


def guided(**parameters):
    return BayesNetDDQN(BayesNetDDQNParameters(**SMALL, **parameters))


def plain(**parameters):
    return DDQN(DDQNParameters(**SMALL, **parameters))


def begun(learner, condition, protocol, subjects):
    condition = named(condition) if isinstance(condition, str) else condition
    session = Session(condition, protocol, subjects, seed=1)
    learner.begin(session.brief)
    return session


def test_only_what_it_explores_is_different_and_only_while_there_is_something_to_learn():
    """A DDQN that is told everything that the other does would have done the same, but for that."""
    learner, shadow = guided(epsilon_decay=0.997), plain(epsilon_decay=0.997)
    room = one_room("CC3", "trial1", 2)
    session = begun(learner, room, ON, 3)
    begun(shadow, room, ON, 3)
    told = Counter()
    while not session.over:
        view = session.view
        odds, others = learner.probabilities(view), shadow.probabilities(view)
        for row, epsilon in enumerate(shadow.exploration.epsilon.tolist()):
            if learner.gains(row, view).sum() < 1e-9:
                told["knows"] += 1
                told["is certain"] += learner.belief(row).entropy < 1e-9
                assert np.array_equal(odds[row], others[row])
            else:
                told["asks"] += 1
                gains = learner.gains(row, view)
                explored = epsilon * (gains / gains.sum() - 1 / 15)
                assert odds[row] - others[row] == pytest.approx(explored)
        step = session.step(learner.act(view))
        learner.learn(step)
        shadow.act(view)
        shadow.learn(step)
    assert min(told.values()) > 20
    assert np.array_equal(learner.q.online, shadow.q.online)
    assert np.array_equal(learner.exploration.epsilon, shadow.exploration.epsilon)


def test_what_the_structure_learner_believes_at_first_is_a_parameter():
    learner = create("bayes_net_ddqn", {**SMALL, "noise": 0.5, "concentration": 4.0})
    assert isinstance(learner, BayesNetDDQN)
    learner.begin(Session(named("CC3"), HUMAN, 1).brief)
    assert learner.beliefs.unsure.all()
    assert learner.beliefs.settings.concentration == 4.0

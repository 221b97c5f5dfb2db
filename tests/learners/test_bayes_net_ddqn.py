"""A DDQN that explores by expected information, beside one that explores by chance."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.stats import chisquare

from causal_openlock.contract.registry import create
from causal_openlock.experiment.declare import Protocol
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
        for row, epsilon in enumerate(shadow.epsilon.tolist()):
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
    assert torch.equal(learner.q.online.parameters, shadow.q.online.parameters)
    assert np.array_equal(learner.epsilon, shadow.epsilon)


@pytest.mark.parametrize("before", [(), (0,), (0, 1)], ids=["nothing", "one", "two"])
def test_while_there_is_something_to_learn_it_explores_in_proportion_to_the_gains(before):
    """In the first room, after the same actions for all."""
    many = 800
    learner = guided(epsilon_min=1.0, epsilon_after_trial=None)
    learner.parameters = replace(learner.parameters, hidden_units=1)
    session = begun(learner, one_room("CC3", "trial1"), HUMAN, many)
    places = session.truth.rooms[0].layout.places
    for lever in before:
        learner.act(session.view)
        learner.beliefs.update(session.step(np.full(many, places[lever])))
    counts = np.bincount(learner.act(session.view), minlength=15)
    gains = learner.gains(0, session.view)
    for subject in (1, many - 1):
        assert learner.gains(subject, session.view) == pytest.approx(gains)
    assert not counts[gains == 0].any()
    assert not gains[7:14].any()
    assert (gains > 0).sum() >= 3
    expected = many * gains / gains.sum()
    alive = expected > 0
    assert chisquare(counts[alive], expected[alive]).pvalue > 1e-3
    assert chisquare(counts[alive]).pvalue < 1e-3  # which all alike would not be


def test_what_the_structure_learner_believes_at_first_is_a_parameter():
    learner = create("bayes_net_ddqn", {**SMALL, "noise": 0.5, "concentration": 4.0})
    assert isinstance(learner, BayesNetDDQN)
    learner.begin(Session(named("CC3"), HUMAN, 1).brief)
    assert learner.beliefs.unsure.all()
    assert learner.beliefs.knowledge.prior.concentration == 4.0

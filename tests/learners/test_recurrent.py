"""The recurrent learner: what it remembers, and where its values end."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from causal_openlock.experiment.protocol import Protocol
from causal_openlock.experiment.session import Session
from openlock_learners.recurrent import Recurrent, RecurrentParameters
from support.session_play import one_room

pytestmark = pytest.mark.slow

ROOM = one_room("CC3", "trial1")
PROTOCOL = Protocol("t", attempt_limit=12, stop_when_solved=False, baseline_trials=3)
SMALL = RecurrentParameters(
    hidden_units=8,
    burn_in=4,
    unroll=7,
    batch_size=3,
    train_period=2,
    replay_size=50,
    target_period=10,
    epsilon_decay=0.97,
)


def play(learner, session, actions):
    """Make all subjects do the same; the learner is told, and not asked."""
    for action in actions:
        learner.learn(session.step(np.full(session.subjects, action)))


@pytest.mark.parametrize("reset", ["trial", "condition"])
def test_it_remembers_across_attempts_until_the_memory_is_reset(reset):
    session = Session(ROOM, replace(PROTOCOL, attempt_limit=2), 2)
    learner = Recurrent(replace(SMALL, reset=reset))
    learner.begin(session.brief)
    start = session.view
    first = learner._perception.inputs(start), learner._hidden_state
    play(learner, session, [0, 14, 14])
    # The room and its levers are as they were at the start of the trial.
    assert np.array_equal(session.view.observation, start.observation)
    values = [
        learner.q.values(torch.from_numpy(first[0]), torch.from_numpy(memory))[0]
        for memory in (first[1], learner._hidden_state)
    ]
    assert (values[0] - values[1]).abs().max() > 1e-3
    play(learner, session, [14, 14, 14])
    after = learner._perception.inputs(session.view), learner._hidden_state
    alike = [np.array_equal(one, other) for one, other in zip(first, after, strict=True)]
    assert alike == [reset == "trial"] * 2


def test_what_it_perceives_is_the_room_its_last_action_and_the_console():
    session = Session(ROOM, PROTOCOL, 1, reward="basic")
    learner = Recurrent(SMALL)
    learner.begin(session.brief)
    room = session.truth.rooms[0]
    solution = room.action_of(room.schema.solutions[0])
    play(learner, session, solution)
    action, told = np.eye(15)[solution[-1]], [np.log(51), 1]  # the door moved, and paid 50
    console = [1 / 3, (len(room.schema.solutions) - 1) / 3, 11 / 12, 1]
    expected = [*session.view.observation[0], *action, *told, *console]
    assert learner._perception.inputs(session.view)[0] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("over_attempts", "resets"), [(False, "trial"), (True, "condition")])
def test_values_end_with_the_attempt_or_the_trial(over_attempts, resets):
    session = Session(ROOM, replace(PROTOCOL, attempt_limit=2, baseline_loops=2), 1)
    learner = Recurrent(replace(SMALL, bootstrap_over_attempts=over_attempts, reset=resets))
    learner.begin(session.brief)
    play(learner, session, [14] * 9)
    ends = [6] if over_attempts else [3, 6, 9]
    assert (np.flatnonzero(learner._replay._not_done[0, :9] == 0) + 1).tolist() == ends
    assert learner._replay._begins[0, :9].tolist() == [0] * 6 + [6 * (resets == "trial")] * 3

"""The recurrent learner: what it remembers, how it is trained, and that memory makes it able."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from causal_openlock.contract.learner import Brief, Console, Step, View
from causal_openlock.experiment.declare import Protocol, find_condition
from causal_openlock.experiment.session import Session
from openlock_learners.recurrent import Recurrent, RecurrentParameters
from support.plain_recurrent import PlainNetwork, PlainRecurrent
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


def in_double(learner):
    """Let a learner that has begun compute in float64."""
    q, replay = learner.q, learner._replay
    q.online.double()
    q.target.double()
    values, losses = q.values, q.losses
    q.values = lambda inputs, state: values(inputs.double(), state.double())

    def doubled(batch):
        floats = ("inputs", "state", "reward", "not_done", "mask")
        return losses(batch._replace(**{f: getattr(batch, f).astype(np.float64) for f in floats}))

    q.losses = doubled
    learner._hidden_state = learner._hidden_state.astype(np.float64)
    replay._state = replay._state.astype(np.float64)
    replay._reward = replay._reward.astype(np.float64)


def play(learner, session, actions):
    """Make all subjects do the same; the learner is asked, told, and not obeyed."""
    for action in actions:
        learner.act(session.view)
        learner.learn(session.step(np.full(session.subjects, action)))


# -- the same as a plain one, and each agent the same as alone ------------------------------------


@pytest.mark.parametrize(("reset", "over_attempts"), [("trial", False), ("condition", True)])
def test_a_recurrent_ddqn_in_plain_torch_follows_the_same_course(reset, over_attempts):
    session = Session(find_condition("CC3"), PROTOCOL, 3, seed=5)
    learner = Recurrent(replace(SMALL, reset=reset, bootstrap_over_attempts=over_attempts))
    learner.begin(session.brief)
    in_double(learner)
    drawn = []
    for streams in (learner._luck, learner._batches):
        uniform = streams.uniform
        streams.uniform = lambda of=uniform: drawn.append(of()) or drawn[-1]

    agent = 1
    plain = PlainRecurrent(PlainNetwork(learner.q.online, agent), learner.parameters)
    greedily = 0
    while not session.over:
        drawn.clear()
        action = learner.act(session.view)
        explores, which = drawn.pop()[agent]
        greedily += explores >= plain.epsilon
        assert action[agent] == plain.act(session.view, agent, explores, which)
        step = session.step(action)
        learner.learn(step)
        plain.learn(step, agent, lambda: drawn[-1][agent])
        assert learner.exploration.epsilon[agent] == pytest.approx(plain.epsilon)
    assert plain.updates == learner.q.updates > 45
    assert greedily > 50
    assert plain.online.distance(learner.q.online, agent) < 1e-7
    assert plain.target.distance(learner.q.target, agent) < 1e-7


# -- memory ---------------------------------------------------------------------------------------


TRIALS = 160


class Forgetful(Recurrent):
    """The control: its state is reset with every step."""

    def learn(self, step):
        super().learn(step)
        self._hidden_state[:] = 0


def share_right(learner, trials, subjects=8):
    """How often the learner is right in the last trials of a task that asks for memory.

    A trial has two attempts of two actions. What is seen in the first moment alone says which
    action will earn something in the last; what is done in between is not the learner's choice, so
    that it cannot hand the answer on to itself by its actions.
    """
    generators = tuple(np.random.default_rng(index) for index in range(subjects))
    learner.begin(Brief(subjects, 1, ("push", "pull", "push_door"), 2, 2, trials, generators))
    answers = np.random.default_rng(0).integers(2, size=(trials + 1, subjects))
    ones, nothing = np.ones(subjects, dtype=np.int64), np.zeros((subjects, 4), dtype=np.int8)

    def view(time):
        trial, moment = divmod(time, 4)
        attempt, used = divmod(moment, 2)
        observation = nothing.copy()
        if moment == 0:
            observation[:, 0] = answers[trial]
        console = Console(ones, ones, ones * (2 - attempt), (ones * (2 - used)).astype(np.uint8))
        return View(observation, console, ones * (trial + 1), ones * (attempt + 1), ones == 1)

    right = np.zeros((trials, subjects))
    for time in range(4 * trials):
        trial, moment = divmod(time, 4)
        action = learner.act(view(time))
        if moment == 3:
            right[trial] = action == answers[trial]
        learner.learn(
            Step(
                view=view(time),
                action=action if moment == 3 else ones * 2,
                outcome=nothing,
                reward=right[trial],
                attempt_over=ones * (moment % 2) == 1,
                trial_over=ones * moment == 3,
                new_solution=ones == 0,
                next=view(time + 1),
            )
        )
    return float(right[-60:].mean())


REMEMBERS = RecurrentParameters(
    hidden_units=16,
    burn_in=2,
    unroll=4,
    train_period=2,
    learning_rate=0.01,
    epsilon_min=0.05,
    epsilon_after_trial=None,
)


def test_with_memory_it_solves_what_cannot_be_solved_without():
    # One action in twenty is random, and two in three of those are wrong.
    assert share_right(Recurrent(replace(REMEMBERS, reset="condition")), TRIALS) > 0.9
    forgetful = Forgetful(replace(REMEMBERS, burn_in=0))
    assert 0.4 < share_right(forgetful, TRIALS) < 0.6


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


def test_a_subject_that_has_finished_learns_no_more():
    protocol = replace(PROTOCOL, attempt_limit=12, stop_when_solved=True, baseline_trials=1)
    session = Session(ROOM, protocol, 2)
    room = session.truth.rooms[0]
    solve = [action for solution in room.schema.solutions for action in room.action_of(solution)]
    learner = Recurrent(replace(SMALL, unroll=3, train_period=1))
    learner.begin(session.brief)
    for action in solve:
        learner.act(session.view)
        learner.learn(session.step(np.array([action, 14])))
    assert session.view.playing.tolist() == [False, True]
    before = [PlainNetwork(learner.q.online, subject) for subject in range(2)]
    epsilon = learner.exploration.epsilon.copy()
    assert learner.q.updates == 3
    play(learner, session, [14] * 9)
    assert learner.q.updates == 12
    assert before[0].distance(learner.q.online, 0) == 0.0
    assert before[1].distance(learner.q.online, 1) > 1e-3
    assert learner._replay.count.tolist() == [6, 15]
    assert learner.exploration.epsilon[0] == epsilon[0] == 0.5
    assert learner.exploration.epsilon[1] < epsilon[1]

"""The DDQN: its network, its course of learning, and what it counts."""

from dataclasses import replace

import numpy as np
import pytest

from causal_openlock.experiment.protocol import Protocol
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import find_schema
from openlock_learners.ddqn import DDQN, DDQNParameters, SemiMarkovDDQN, SemiMarkovDDQNParameters
from openlock_learners.networks.double_q_loops import layer_of
from support.session_play import one_room

pytestmark = pytest.mark.slow

CC3, CC4 = find_schema("CC3"), find_schema("CC4")
HUMAN = Protocol("t", attempt_limit=30, stop_when_solved=True, baseline_trials=2)
ROOM, ROOM4 = one_room("CC3", "trial1"), one_room("CC4", "trial7")
FEW = {"hidden_layers": 1, "hidden_units": 8, "batch_size": 8}


def begun(settings, *, kind=DDQN, condition=ROOM, subjects=1, reward="paper", **changed):
    """A learner that has begun, and its session."""
    session = Session(condition, replace(HUMAN, **changed), subjects, reward=reward)
    learner = kind(settings)
    learner.begin(session.brief)
    return learner, session


def play(learner, session, actions):
    """Make all subjects do the same; the learner is asked, told, and not obeyed."""
    for action in actions:
        learner.act(session.view)
        learner.learn(session.step(np.full(session.subjects, action)))


def solving(session, *solutions):
    """The actions that open the door in these ways, one after the other."""
    room = session.truth.rooms[0]
    return [a for number in solutions for a in room.action_of(room.schema.solutions[number])]


def test_the_network_has_the_shape_of_figure_5():
    learner, _ = begun(None, subjects=2)
    layers = [layer_of(learner.q.online[1], learner.q.sizes, number) for number in range(5)]
    shapes = [weights.shape for weights, _ in layers]
    assert shapes == [(16, 128), (128, 128), (128, 128), (128, 128), (128, 15)]
    assert learner.q.online.shape == (2, 53_647)
    for (weights, _), bound in zip(layers, [1 / 4, *[128**-0.5] * 4], strict=True):
        assert 0.97 * bound < np.abs(weights).max() <= bound


@pytest.mark.parametrize("over_attempts", [False, True])
def test_a_value_ends_with_the_attempt_or_reaches_over_it(over_attempts):
    settings = DDQNParameters(bootstrap_over_attempts=over_attempts)
    learner, session = begun(settings, attempt_limit=2)
    lever = session.truth.rooms[0].action_of(["L0"])[0]
    play(learner, session, [lever, 14, 14, 14, 14, 14])
    before, _, after, _, not_done = learner._replay.rings[:, 0, :6].astype(int).tolist()
    # Two attempts of three actions, and the trial is over with the second.
    assert not_done == ([1, 1, 1, 1, 1, 0] if over_attempts else [1, 1, 0, 1, 1, 0])
    third, start = learner._table.rows[after[2]], learner._table.rows[before[3]]
    assert np.array_equal(third, start) == over_attempts


@pytest.mark.parametrize(
    ("settings", "course"),
    [
        # Two trials of two attempts of three actions; then the third trial begins.
        ({}, [0.995**n for n in (1, 2, 3, 4, 5)] + [0.5 * 0.995**n for n in range(6)] + [0.5]),
        (
            {"epsilon_decay": 0.25, "epsilon_after_trial": None},
            [0.25, 0.0625, 0.015625] + [0.01] * 9,
        ),
        (
            {"epsilon_decay": 0.9, "epsilon_decays_with": "attempt", "epsilon_after_trial": None},
            [1, 1, 0.9, 0.9, 0.9, 0.81, 0.81, 0.81, 0.729, 0.729, 0.729, 0.6561],
        ),
        (
            {"epsilon_decay": 0.9, "epsilon_decays_with": "trial", "epsilon_after_trial": None},
            [1, 1, 1, 1, 1, 0.9, 0.9, 0.9, 0.9, 0.9, 0.9, 0.81],
        ),
    ],
)
def test_epsilon_shrinks_to_a_floor_and_returns_after_each_trial(settings, course):
    settings = DDQNParameters(batch_size=2000, **settings)
    learner, session = begun(settings, attempt_limit=2, baseline_loops=3)
    seen = []
    for _ in course:
        play(learner, session, [14])
        seen.append(learner.exploration.epsilon[0])
    assert seen == pytest.approx(course)


def test_training_begins_when_there_is_a_batch_and_follows_every_action():
    learner, session = begun(DDQNParameters(batch_size=5, hidden_units=4, gradient_steps=3))
    updates = []
    for _ in range(7):
        play(learner, session, [14])
        updates.append(learner.q.updates)
    assert updates == [0, 0, 0, 0, 3, 6, 9]


def test_in_one_room_it_learns_to_open_the_door():
    settings = DDQNParameters(
        hidden_layers=2, hidden_units=32, learning_rate=0.003, epsilon_decay=0.998, epsilon_min=0.05
    )
    protocol = Protocol("long", attempt_limit=500, stop_when_solved=False, baseline_trials=1)
    record = Session(ROOM, protocol, 8).play(DDQN(settings)).to_pandas()
    opened = record.set_index(["subject", "attempt"])["opened"].unstack()
    assert (opened.loc[:, 1:100].mean(axis=1) < 0.1).all()
    # One action in twenty is random still, so that of three all are greedy in six of seven.
    assert (opened.loc[:, 401:500].mean(axis=1) > 0.5).all()


SEMI = SemiMarkovDDQNParameters(**FEW)


@pytest.mark.parametrize("bits", [1, 3, 5])
def test_each_solution_found_sets_one_more_bit_until_all_are_set(bits):
    learner, session = begun(
        replace(SEMI, solution_bits=bits), kind=SemiMarkovDDQN, condition=ROOM4, subjects=2
    )
    assert learner.q.sizes[0] == 16 + bits
    play(learner, session, solving(session, 0, 0, 2, 1)[:12])  # one found again does not count
    rows = learner._table.rows[learner._replay.rings[0, 1, :12].astype(int)]
    counts = np.repeat([0, 1, 1, 2], 3)
    assert rows[:, 16:].tolist() == [
        [float(bit < count) for bit in range(bits)] for count in counts
    ]
    assert np.array_equal(rows[0:3, :16], rows[3:6, :16])


@pytest.mark.parametrize("over_attempts", [False, True])
def test_what_follows_a_solution_knows_of_it(over_attempts):
    settings = replace(SEMI, bootstrap_over_attempts=over_attempts)
    learner, session = begun(settings, kind=SemiMarkovDDQN, condition=ROOM4)
    play(learner, session, solving(session, 0, 1))
    rows = learner._table.rows[learner._replay.rings[2, 0, :6].astype(int)]
    assert rows[:, 16:].sum(axis=1).tolist() == [0, 0, 1, 1, 1, 2]

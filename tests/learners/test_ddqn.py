"""The DDQN: its network, its course of learning, and a second one written in plain torch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from causal_openlock.contract.registry import create
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.protocol import Condition, Protocol, Trials
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import find_schema
from causal_openlock.world.room import Layout
from openlock_learners.ddqn import DDQN, DDQNParameters, SemiMarkovDDQN
from support.checkpoints import kept_and_resumed, same
from support.plain_ddqn import PlainDDQN, distance, plain_network

pytestmark = pytest.mark.slow

CC3 = find_schema("CC3")
HUMAN = Protocol("t", attempt_limit=30, stop_when_solved=True, baseline_trials=2)


def one_room(layout: str = "trial1") -> Condition:
    """A condition whose trials are all in the same room."""
    return Condition("room", (Trials(CC3, (Layout.of(CC3, layout),)),))


def test_the_network_has_the_shape_of_figure_5() -> None:
    session = Session(one_room(), HUMAN, 2)
    learner = DDQN()
    learner.begin(session.brief)
    stack = learner.q.online
    shapes = [tuple(weight.shape[1:]) for weight in stack.weights]
    assert shapes == [(16, 128), (128, 128), (128, 128), (128, 128), (128, 15)]
    # 16*128 + 128, three times 128*128 + 128, and 128*15 + 15.
    each = (2048 + 128) + 3 * (16384 + 128) + (1920 + 15)
    assert each == 53_647
    assert stack.parameters.numel() == 2 * each
    bounds = [1 / 4, *[128**-0.5] * 4]
    for weight, bound in zip(stack.weights, bounds, strict=True):
        assert 0.97 * bound < weight.abs().max() <= bound


@pytest.fixture
def double_precision() -> Iterator[None]:
    """So that rounding hides nothing."""
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)


@pytest.mark.usefixtures("double_precision")
@pytest.mark.parametrize("double", [True, False])
@pytest.mark.parametrize("over_attempts", [False, True])
def test_a_ddqn_in_plain_torch_follows_the_same_course(over_attempts: bool, double: bool) -> None:
    settings = DDQNParameters(
        hidden_layers=2,
        hidden_units=16,
        batch_size=8,
        replay_size=60,
        target_period=20,
        epsilon_decay=0.97,
        double=double,
        bootstrap_over_attempts=over_attempts,
    )
    protocol = replace(HUMAN, stop_when_solved=False, baseline_trials=3)
    session = Session(Condition.named("CC3", find_schema), protocol, 3, seed=5)
    learner = DDQN(settings)
    learner.begin(session.brief)
    drawn: list[Any] = []
    for streams in (learner._exploration, learner._batches):
        uniform = streams.uniform
        streams.uniform = lambda of=uniform: drawn.append(of()) or drawn[-1]  # type: ignore[method-assign]

    agent = 1
    plain = PlainDDQN(plain_network(learner.q.online, agent), settings)
    greedily = 0
    while not session.over:
        drawn.clear()
        action = learner.act(session.view)
        explores, which = drawn.pop()[agent]
        greedily += explores >= plain.epsilon
        assert action[agent] == plain.act(session.view.observation[agent], explores, which)
        step = session.step(action)
        learner.learn(step)
        after = step.next.observation if over_attempts else step.outcome
        ends = step.trial_over if over_attempts else step.attempt_over
        plain.learn(
            (
                step.view.observation[agent],
                action[agent],
                step.reward[agent],
                after[agent],
                bool(ends[agent]),
            ),
            bool(step.trial_over[agent]),
            lambda: drawn[-1][agent],
        )
        assert learner.epsilon[agent] == pytest.approx(plain.epsilon)
    assert plain.updates > 200
    assert greedily > 100
    assert distance(plain.online, learner.q.online, agent) < 1e-7
    assert distance(plain.target, learner.q.target, agent) < 1e-7


@pytest.mark.usefixtures("double_precision")
@pytest.mark.parametrize("prioritised", [False, True])
def test_subjects_trained_together_are_the_subjects_trained_alone(prioritised: bool) -> None:
    settings = DDQNParameters(
        hidden_layers=2,
        hidden_units=24,
        batch_size=8,
        replay_size=60,
        target_period=20,
        prioritised=prioritised,
    )
    condition = Condition.named("CE3-CC4", find_schema)
    numbers = [4, 0, 7]

    def trained(subjects: list[int]) -> DDQN:
        session = Session(condition, HUMAN, subjects, seed=2)
        learner = DDQN(settings)
        session.play(learner)
        return learner

    together = trained(numbers)
    for agent, number in enumerate(numbers):
        alone = trained([number])
        assert alone.q.updates > 300
        network = plain_network(alone.q.online, 0)
        assert distance(network, together.q.online, agent) < 1e-7
        assert together.epsilon[agent] == alone.epsilon[0]


# -- the course of learning -----------------------------------------------------------------------


def play(learner: DDQN, session: Session, actions: list[int]) -> None:
    """Make all subjects do the same; the learner is asked, told, and not obeyed."""
    for action in actions:
        learner.act(session.view)
        learner.learn(session.step(np.full(session.subjects, action)))


def test_a_value_ends_with_the_attempt_or_reaches_over_it() -> None:
    for over_attempts in (False, True):
        session = Session(one_room(), replace(HUMAN, attempt_limit=2), 1)
        learner = DDQN(DDQNParameters(bootstrap_over_attempts=over_attempts))
        learner.begin(session.brief)
        lever = session.truth.rooms[0].action_of(["L0"])[0]
        play(learner, session, [lever, 14, 14, 14, 14, 14])
        before, _, after, _, not_done = learner._replay.rings[:, 0, :6].astype(int).tolist()
        # Two attempts of three actions, and the trial is over with the second.
        assert not_done == ([1, 1, 1, 1, 1, 0] if over_attempts else [1, 1, 0, 1, 1, 0])
        third = learner._table.rows[after[2]]
        start = learner._table.rows[before[3]]
        assert np.array_equal(third, start) == over_attempts


@pytest.mark.parametrize(
    ("kind", "reward", "differs"),
    [
        (DDQN, "unique_solutions", True),
        (DDQN, "basic", False),
        (SemiMarkovDDQN, "unique_solutions", False),  # with its count it is another state
    ],
)
def test_in_the_memory_a_repeated_solution_has_two_rewards_if_solutions_are_paid_once(
    kind: type[DDQN], reward: str, differs: bool
) -> None:
    session = Session(one_room(), HUMAN, 1, reward=reward)
    learner = kind()
    learner.begin(session.brief)
    solution = session.truth.rooms[0].action_of(CC3.solutions[0])
    play(learner, session, solution * 3)
    before, action, after, rewards, _ = learner._replay.rings[:, 0, :9].tolist()
    paid: dict[Any, list[float]] = {}
    for key, value in zip(zip(before, action, after, strict=True), rewards, strict=True):
        paid.setdefault(key, []).append(value)
    twice = [values for values in paid.values() if len(set(values)) > 1]
    assert twice == ([[10, 0, 0], [50, 0, 0]] if differs else [])


def test_epsilon_shrinks_with_every_action_and_returns_after_each_trial() -> None:
    session = Session(one_room(), replace(HUMAN, attempt_limit=4, baseline_loops=3), 2)
    learner = DDQN(DDQNParameters(batch_size=2000))
    learner.begin(session.brief)
    assert learner.epsilon.tolist() == [1.0, 1.0]
    for action in range(1, 12):
        play(learner, session, [14])
        assert learner.epsilon == pytest.approx([0.995**action] * 2)
    play(learner, session, [14])
    assert learner.epsilon.tolist() == [0.5, 0.5]
    play(learner, session, [14] * 11)
    assert learner.epsilon == pytest.approx([0.5 * 0.995**11] * 2)
    play(learner, session, [14])
    assert learner.epsilon.tolist() == [0.5, 0.5]


def test_epsilon_has_a_floor_and_may_stay_after_a_trial() -> None:
    session = Session(one_room(), replace(HUMAN, attempt_limit=4, baseline_loops=3), 1)
    learner = DDQN(DDQNParameters(epsilon_decay=0.5, epsilon_after_trial=None, batch_size=2000))
    learner.begin(session.brief)
    course = []
    for _ in range(30):
        play(learner, session, [14])
        course.append(learner.epsilon[0])
    assert course[:7] == [0.5, 0.25, 0.125, 0.0625, 0.03125, 0.015625, 0.01]
    assert set(course[6:]) == {0.01}


@pytest.mark.parametrize(
    ("moment", "course"),
    [
        # Two trials of two attempts of three actions; then the third trial begins.
        ("attempt", [1, 1, 0.9, 0.9, 0.9, 0.81, 0.81, 0.81, 0.729, 0.729, 0.729, 0.6561]),
        ("trial", [1, 1, 1, 1, 1, 0.9, 0.9, 0.9, 0.9, 0.9, 0.9, 0.81]),
    ],
)
def test_epsilon_may_shrink_more_seldom(moment: Any, course: list[float]) -> None:
    session = Session(one_room(), replace(HUMAN, attempt_limit=2, baseline_loops=3), 1)
    settings = DDQNParameters(
        epsilon_decay=0.9, epsilon_decays_with=moment, epsilon_after_trial=None, batch_size=2000
    )
    learner = DDQN(settings)
    learner.begin(session.brief)
    seen = []
    for _ in course:
        play(learner, session, [14])
        seen.append(learner.epsilon[0])
    assert seen == pytest.approx(course)


def test_the_bias_of_priorities_is_undone_more_and_more() -> None:
    protocol = replace(HUMAN, attempt_limit=4, baseline_loops=3)  # 36 actions in three trials
    for actions, upto in ((None, 36), (9, 9)):
        session = Session(one_room(), protocol, 2)
        settings = DDQNParameters(
            prioritised=True,
            importance_start=0.4,
            importance_actions=actions,
            hidden_units=4,
            batch_size=8,
        )
        learner = DDQN(settings)
        learner.begin(session.brief)
        for action in range(37):
            assert learner.importance == pytest.approx([min(0.4 + 0.6 * action / upto, 1.0)] * 2)
            if not session.over:
                play(learner, session, [14])


def test_several_gradient_steps_may_follow_an_action() -> None:
    session = Session(one_room(), HUMAN, 1)
    learner = DDQN(DDQNParameters(batch_size=5, hidden_units=4, gradient_steps=3))
    learner.begin(session.brief)
    play(learner, session, [14] * 7)
    assert learner.q.updates == 9


def test_units_that_nothing_switches_on_are_counted_as_dead() -> None:
    learner = DDQN(DDQNParameters(device="cpu", hidden_layers=2, hidden_units=8, batch_size=4))
    session = Session(one_room(), HUMAN, 2)
    learner.begin(session.brief)
    for _ in range(12):
        learner.learn(session.step(learner.act(session.view)))
    with torch.no_grad():
        learner.q.online.parameters.zero_()
        for bias in learner.q.online.biases[:-1]:
            bias[:] = 1.0
        assert learner.metrics()["dead_units"] == 0.0
        # Three of eight units in one of two layers, for one of two subjects.
        learner.q.online.biases[0][1, 0, :3] = -1.0
    assert learner.metrics()["dead_units"] == 3 / 32


def test_epsilon_is_the_share_of_random_actions() -> None:
    session = Session(one_room(), replace(HUMAN, stop_when_solved=False), 200)
    settings = DDQNParameters(epsilon_start=0.3, hidden_units=4, hidden_layers=1)
    learner = DDQN(settings)
    learner.begin(session.brief)
    best = learner.q.greedy(session.view.observation)
    # A random action is the best one by chance once in 15.
    shares = [(learner.act(session.view) != best).mean() for _ in range(50)]
    assert np.mean(shares) == pytest.approx(0.3 * 14 / 15, abs=0.015)


def test_training_begins_when_there_is_a_batch_and_goes_on_with_every_action() -> None:
    session = Session(one_room(), HUMAN, 2)
    learner = DDQN(DDQNParameters(batch_size=10, hidden_units=4))
    learner.begin(session.brief)
    play(learner, session, [14] * 9)
    assert learner.q.updates == 0
    play(learner, session, [14] * 5)
    assert learner.q.updates == 5


def test_a_batch_larger_than_the_memory_is_refused() -> None:
    with pytest.raises(LearnerError, match=r"64 transitions .* 50; make replay_size at least"):
        create("ddqn", {"replay_size": 50})


def test_a_subject_that_has_finished_learns_no_more() -> None:
    session = Session(one_room(), replace(HUMAN, attempt_limit=8), 2)
    room = session.truth.rooms[0]
    solve = [action for solution in CC3.solutions for action in room.action_of(solution)]
    learner = DDQN(DDQNParameters(batch_size=2, hidden_units=8))
    learner.begin(session.brief)
    for action in solve:
        learner.act(session.view)
        learner.learn(session.step(np.array([action, 14])))
    assert session.view.playing.tolist() == [False, True]
    before = [plain_network(learner.q.online, subject) for subject in range(2)]
    epsilon = learner.epsilon.copy()
    assert learner._replay.length.tolist() == [6, 6]
    play(learner, session, [14] * 9)
    assert distance(before[0], learner.q.online, 0) == 0.0
    assert distance(before[1], learner.q.online, 1) > 1e-4
    assert learner._replay.length.tolist() == [6, 15]
    assert learner.epsilon[0] == epsilon[0] == 0.5
    assert learner.epsilon[1] == pytest.approx(epsilon[1] * 0.995**9)


# -- as a whole -----------------------------------------------------------------------------------


@pytest.mark.parametrize("prioritised", [False, True])
def test_a_checkpoint_resumed_gives_the_same_weights(prioritised: bool) -> None:
    settings = DDQNParameters(
        batch_size=8, hidden_units=8, replay_size=20, target_period=5, prioritised=prioritised
    )
    protocol = replace(HUMAN, attempt_limit=12, stop_when_solved=False)
    sessions = [Session(one_room(), protocol, 3) for _ in range(2)]
    first, second = (DDQN(settings) for _ in sessions)
    kept = kept_and_resumed(first, second, sessions, steps=30)
    assert not same(kept, first.state_dict())


@pytest.mark.parametrize(("seed", "prioritised"), [(0, False), (1, False), (2, False), (0, True)])
def test_in_one_room_it_learns_to_open_the_door(seed: int, prioritised: bool) -> None:
    settings = DDQNParameters(
        hidden_layers=2,
        hidden_units=32,
        learning_rate=0.003,
        epsilon_decay=0.998,
        epsilon_min=0.05,
        prioritised=prioritised,
    )
    protocol = Protocol("long", attempt_limit=500, stop_when_solved=False, baseline_trials=1)
    record = Session(one_room(), protocol, 8, seed=seed).play(DDQN(settings)).to_pandas()
    opened = record.set_index(["subject", "attempt"])["opened"].unstack()
    assert (opened.loc[:, 1:100].mean(axis=1) < 0.1).all()
    # One action in twenty is random still, so that of three all are sample_actions in six of seven.
    assert (opened.loc[:, 401:500].mean(axis=1) > 0.5).all()

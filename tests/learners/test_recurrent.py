"""The recurrent learner: what it remembers, how it is trained, and that memory makes it able."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from causal_openlock.contract.learner import Brief, Console, Step, View
from causal_openlock.contract.registry import create
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.protocol import Condition, Protocol, Trials
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import find_schema
from causal_openlock.world.room import Layout
from openlock_learners.networks.perception import Perception
from openlock_learners.networks.recurrent_q import RecurrentDoubleQ, StackedRecurrentNetwork
from openlock_learners.networks.sequence_buffer import Sequences
from openlock_learners.recurrent import Recurrent, RecurrentParameters
from support.checkpoints import kept_and_resumed, same
from support.plain_recurrent import PlainNetwork, PlainRecurrent

pytestmark = pytest.mark.slow

CC3 = find_schema("CC3")
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


def one_room() -> Condition:
    """A condition whose trials are all in the same room."""
    return Condition("room", (Trials(CC3, (Layout.of(CC3, "trial1"),)),))


def in_double(learner: Recurrent) -> None:
    """Let a learner that has begun compute in float64."""
    q, replay = learner.q, learner._replay
    q.online.double()
    q.target.double()
    values, losses = q.values, q.losses
    q.values = lambda inputs, state: values(inputs.double(), state.double())  # type: ignore[method-assign]

    def doubled(batch: Sequences) -> torch.Tensor:
        floats = ("inputs", "state", "reward", "not_done", "mask")
        return losses(replace(batch, **{f: getattr(batch, f).astype(np.float64) for f in floats}))

    q.losses = doubled  # type: ignore[method-assign]
    learner._hidden_state = learner._hidden_state.astype(np.float64)
    replay._state = replay._state.astype(np.float64)
    replay._reward = replay._reward.astype(np.float64)


def play(learner: Recurrent, session: Session, actions: list[int]) -> None:
    """Make all subjects do the same; the learner is asked, told, and not obeyed."""
    for action in actions:
        learner.act(session.view)
        learner.learn(session.step(np.full(session.subjects, action)))


# -- the same as a plain one, and each agent the same as alone ------------------------------------


@pytest.mark.parametrize(
    ("cell", "reset", "over_attempts"),
    [("gru", "trial", False), ("gru", "condition", True), ("lstm", "trial", True)],
)
def test_a_recurrent_ddqn_in_plain_torch_follows_the_same_course(
    cell: Any, reset: Any, over_attempts: bool
) -> None:
    session = Session(Condition.named("CC3", find_schema), PROTOCOL, 3, seed=5)
    learner = Recurrent(
        replace(SMALL, cell=cell, reset=reset, bootstrap_over_attempts=over_attempts)
    )
    learner.begin(session.brief)
    in_double(learner)
    drawn: list[Any] = []
    for streams in (learner._exploration, learner._batches):
        uniform = streams.uniform
        streams.uniform = lambda of=uniform: drawn.append(of()) or drawn[-1]  # type: ignore[method-assign]

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
        assert learner.epsilon[agent] == pytest.approx(plain.epsilon)
    assert plain.updates == learner.q.updates > 45
    assert greedily > 50
    assert plain.online.distance(learner.q.online, agent) < 1e-7
    assert plain.target.distance(learner.q.target, agent) < 1e-7


@pytest.mark.parametrize(
    ("cell", "units", "sequences"), [("gru", 8, 3), ("gru", 13, 2), ("lstm", 16, 1), ("lstm", 5, 4)]
)
def test_agents_trained_together_are_exactly_each_alone(
    cell: Any, units: int, sequences: int
) -> None:
    protocol = replace(PROTOCOL, baseline_trials=2)
    settings = replace(SMALL, unroll=5, cell=cell, hidden_units=units, batch_size=sequences)

    def trained(subjects: list[int]) -> tuple[Recurrent, list[Any]]:
        session = Session(Condition.named("CC3", find_schema), protocol, subjects)
        learner = Recurrent(settings)
        learner.begin(session.brief)
        done = []
        while not session.over:
            done.append(learner.act(session.view))
            learner.learn(session.step(done[-1]))
        return learner, np.array(done).T.tolist()

    together, done = trained([0, 1, 2])
    assert together.q.updates > 25
    for agent in (0, 2):
        alone, did = trained([agent])
        assert did[0] == done[agent]
        assert (alone._hidden_state[0] == together._hidden_state[agent]).all()
        assert PlainNetwork(alone.q.online, 0).distance(together.q.online, agent) == 0
        # And they are not all alike.
        assert PlainNetwork(alone.q.online, 0).distance(together.q.online, agent - 1) > 0.1


# -- memory ---------------------------------------------------------------------------------------


TRIALS = 160


class Forgetful(Recurrent):
    """The control: its state is reset with every step."""

    def learn(self, step: Step) -> None:
        super().learn(step)
        self._hidden_state[:] = 0


def share_right(learner: Recurrent, trials: int, subjects: int = 8) -> float:
    """How often the learner is right in the last trials of a task that asks for memory.

    A trial has two attempts of two actions. What is seen in the first moment alone says which
    action will earn something in the last; what is done in between is not the learner's choice, so
    that it cannot hand the answer on to itself by its actions.
    """
    generators = tuple(np.random.default_rng(index) for index in range(subjects))
    learner.begin(Brief(subjects, 1, ("push", "pull", "push_door"), 2, 2, trials, generators))
    answers = np.random.default_rng(0).integers(2, size=(trials + 1, subjects))
    ones, nothing = np.ones(subjects, dtype=np.int64), np.zeros((subjects, 4), dtype=np.int8)

    def view(time: int) -> View:
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


@pytest.mark.parametrize(("cell", "reset"), [("gru", "condition"), ("lstm", "trial")])
def test_with_memory_it_solves_what_cannot_be_solved_without(cell: Any, reset: Any) -> None:
    # One action in twenty is random, and two in three of those are wrong.
    assert share_right(Recurrent(replace(REMEMBERS, cell=cell, reset=reset)), TRIALS) > 0.9


@pytest.mark.parametrize("unroll", [1, 4])
def test_without_memory_it_does_not(unroll: int) -> None:
    learner = Forgetful(replace(REMEMBERS, burn_in=0, unroll=unroll))
    assert 0.4 < share_right(learner, TRIALS) < 0.6


def test_it_remembers_across_attempts_until_the_memory_is_reset() -> None:
    for reset in ("trial", "condition"):
        session = Session(one_room(), replace(PROTOCOL, attempt_limit=2), 2)
        learner = Recurrent(replace(SMALL, reset=reset))
        learner.begin(session.brief)
        start = session.view
        first = learner._perception.inputs(start), learner._hidden_state
        play(learner, session, [0, 14, 14])
        # The room and its levers are as they were at the start of the trial.
        assert np.array_equal(session.view.observation, start.observation)
        assert (learner._hidden_state != 0).all()
        values = [
            learner.q.values(torch.from_numpy(first[0]), torch.from_numpy(memory))[0]
            for memory in (first[1], learner._hidden_state)
        ]
        assert (values[0] - values[1]).abs().max() > 1e-3
        play(learner, session, [14, 14, 14])
        after = learner._perception.inputs(session.view), learner._hidden_state
        alike = [np.array_equal(one, other) for one, other in zip(first, after, strict=True)]
        assert alike == [reset == "trial"] * 2


def test_what_it_perceives_on_a_worked_example() -> None:
    session = Session(one_room(), replace(PROTOCOL, attempt_limit=10), 1, reward="basic")
    perception = Perception(session.brief)
    assert perception.size == 16 + 15 + 2 + 4
    never = perception.inputs(session.view)[0]
    assert never[:16].tolist() == session.view.observation[0].tolist()
    assert never[16:].tolist() == pytest.approx([0] * 17 + [0, 2 / 3, 1, 1])
    for action in session.truth.rooms[0].action_of(CC3.solutions[0]):
        perception.note(session.step([action]))
    opened = perception.inputs(session.view)[0]
    assert opened[16:31].tolist() == [0] * 14 + [1]  # it pushed the door,
    assert opened[31:33].tolist() == pytest.approx([np.log(51), 1])  # which earned 50 and moved;
    assert opened[33:].tolist() == pytest.approx([1 / 3, 1 / 3, 0.9, 1])  # one solution is left.
    perception.note(session.step([14]))
    failed = perception.inputs(session.view)[0]
    assert failed[16:33].tolist() == [0] * 14 + [1, 0, 0]
    assert failed[33:].tolist() == pytest.approx([1 / 3, 1 / 3, 0.9, 2 / 3])


# -- training -------------------------------------------------------------------------------------


def made_up(burn_in: int, unroll: int, agents: int = 2, number: int = 3) -> Sequences:
    """Sequences of nothing in particular, in float64."""
    rng = np.random.default_rng(1)
    shape = (agents, unroll, number)
    return Sequences(
        inputs=rng.normal(size=(agents, burn_in + unroll + 1, number, 5)),  # type: ignore[arg-type]
        state=rng.normal(size=(agents, number, 6)),  # type: ignore[arg-type]
        burn_in_mask=rng.random((agents, burn_in, number)) < 0.7,
        action=rng.integers(4, size=shape),
        reward=rng.normal(size=shape),  # type: ignore[arg-type]
        not_done=(rng.random(shape) < 0.8).astype(np.float64),  # type: ignore[arg-type]
        mask=np.ones(shape),  # type: ignore[arg-type]
    )


def test_no_gradient_flows_into_the_burn_in() -> None:
    generators = [np.random.default_rng(index) for index in range(2)]
    network = StackedRecurrentNetwork("gru", 5, 6, 4, generators).double()
    q = RecurrentDoubleQ(network, 0.001, 0.8, None)

    def judged(batch: Sequences) -> tuple[torch.Tensor, torch.Tensor]:
        losses = q.losses(batch)
        weights = network.cell.hidden_weight, network.cell.input_weight
        return losses.detach(), torch.cat(torch.autograd.grad(losses.sum(), weights), dim=1)

    whole = made_up(burn_in=4, unroll=3)
    # The state after the burn-in, step by step, and then as if it had been given.
    state = torch.from_numpy(whole.state)
    for time in range(4):
        _, after = network.cell(torch.from_numpy(whole.inputs[:, time : time + 1]), state)
        state = torch.where(torch.from_numpy(whole.burn_in_mask[:, time, :, None]), after, state)
    given = replace(
        whole,
        inputs=whole.inputs[:, 4:],
        state=state.detach().numpy(),
        burn_in_mask=whole.burn_in_mask[:, :0],
    )
    for one, other in zip(judged(whole), judged(given), strict=True):
        assert torch.allclose(one, other, rtol=0, atol=1e-12)
    # Both the burn-in and the state that it begins with make a difference.
    warmer = whole.inputs.copy()
    warmer[:, :4] *= 2
    for other in (replace(whole, state=-whole.state), replace(whole, inputs=warmer)):
        assert ((judged(whole)[0] - judged(other)[0]).abs() > 1e-5).all()


def test_it_trains_at_its_period_once_it_has_seen_a_sequence() -> None:
    session = Session(one_room(), PROTOCOL, 2)
    learner = Recurrent(replace(SMALL, unroll=10, train_period=4))
    learner.begin(session.brief)
    course = []
    for _ in range(24):
        play(learner, session, [14])
        course.append(learner.q.updates)
    assert course == [0] * 11 + [1] * 4 + [2] * 4 + [3] * 4 + [4]


def test_epsilon_is_as_that_of_the_ddqn() -> None:
    session = Session(one_room(), replace(PROTOCOL, attempt_limit=4, baseline_loops=2), 2)
    learner = Recurrent(replace(SMALL, epsilon_decay=0.995))
    learner.begin(session.brief)
    play(learner, session, [14] * 11)
    assert learner.epsilon == pytest.approx([0.995**11] * 2)
    play(learner, session, [14])
    assert learner.epsilon.tolist() == [0.5, 0.5]


def test_a_subject_that_has_finished_learns_no_more() -> None:
    protocol = replace(PROTOCOL, attempt_limit=12, stop_when_solved=True, baseline_trials=1)
    session = Session(one_room(), protocol, 2)
    room = session.truth.rooms[0]
    solve = [action for solution in CC3.solutions for action in room.action_of(solution)]
    learner = Recurrent(replace(SMALL, unroll=3, train_period=1))
    learner.begin(session.brief)
    for action in solve:
        learner.act(session.view)
        learner.learn(session.step(np.array([action, 14])))
    assert session.view.playing.tolist() == [False, True]
    before = [PlainNetwork(learner.q.online, subject) for subject in range(2)]
    epsilon = learner.epsilon.copy()
    assert learner.q.updates == 3
    play(learner, session, [14] * 9)
    assert learner.q.updates == 12
    assert before[0].distance(learner.q.online, 0) == 0.0
    assert before[1].distance(learner.q.online, 1) > 1e-3
    assert learner._replay.count.tolist() == [6, 15]
    assert learner.epsilon[0] == epsilon[0] == 0.5
    assert learner.epsilon[1] < epsilon[1]


# -- as a whole -----------------------------------------------------------------------------------


@pytest.mark.parametrize("cell", ["gru", "lstm"])
def test_a_checkpoint_resumed_gives_the_same_weights(cell: Any) -> None:
    sessions = [Session(one_room(), PROTOCOL, 3) for _ in range(2)]
    first, second = (Recurrent(replace(SMALL, cell=cell)) for _ in sessions)
    # In the midst of an attempt, between two gradient steps.
    kept = kept_and_resumed(first, second, sessions, steps=29)
    assert not same(kept["q"], first.state_dict()["q"])


def test_a_sequence_longer_than_the_memory_is_refused() -> None:
    with pytest.raises(LearnerError, match=r"has 46 steps, and only 40 .* larger than burn_in"):
        create("recurrent", {"replay_size": 40})

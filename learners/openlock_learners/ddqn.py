"""Double deep Q-learning, as in the paper, with and without a count of what was found.

A network of four hidden layers of 128 units maps the 16 bits of the room to the values of its 15
actions (paper, Figure 5). Actions are chosen epsilon-greedily; epsilon starts at 1, shrinks by
.995 with every action to .01, and is set to .5 at the end of each trial, so that the learner
explores the next room. What the paper leaves open (optimizer, loss, batch, replay, target network,
whether values reach over the end of an attempt) is a parameter here.

:class:`DDQN` sees the room and nothing of what came before in the trial: it cannot know which
solutions it has found. :class:`SemiMarkovDDQN` sees in a few more bits how many. All subjects of a
cell are trained at once by compiled loops, each with a network, a replay buffer and randomness of
its own (:mod:`openlock_learners.networks.double_q`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from causal_openlock.contract.learner import Brief, Learner, Observations, Step, View
from causal_openlock.contract.parameters import Count, Positive, Share
from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.world.randomness import Streams
from openlock_learners.exploration import Exploration, ExplorationParameters
from openlock_learners.networks.denormals import denormals_flushed
from openlock_learners.networks.replay_buffer import Batch, ObservationTable, ReplayBuffer

if TYPE_CHECKING:
    from openlock_learners.networks.double_q import DoubleQ
    from openlock_learners.networks.double_q_loops import Floats


@dataclass(frozen=True)
class DDQNParameters(ExplorationParameters):
    """Hyper-parameters; the defaults are the paper's, or documented choices where it is silent."""

    gamma: Annotated[Share, "discount factor (paper: .8)"] = 0.8
    learning_rate: Annotated[Positive, "of Adam (paper: .001)"] = 0.001
    epsilon_decays_with: Annotated[
        Literal["action", "attempt", "trial"], "what it shrinks with every (paper: not given)"
    ] = "action"
    hidden_layers: Annotated[Count, "layers between input and output (paper: 4)"] = 4
    hidden_units: Annotated[Count, "units in each of them (paper: 128)"] = 128
    batch_size: Annotated[Count, "transitions in a gradient step (paper: not given)"] = 64
    gradient_steps: Annotated[Count, "with every action (paper: not given)"] = 1
    replay_size: Annotated[Count, "transitions remembered (authors' program: 2,000)"] = 2000
    target_period: Annotated[
        Count | None, "gradient steps between updates of the target network; null never updates it"
    ] = 100
    double: Annotated[
        bool,
        "whether the online network chooses the action that the target network evaluates (van "
        "Hasselt et al. 2016); false is a DQN (Mnih et al. 2015)",
    ] = True
    bootstrap_over_attempts: Annotated[
        bool, "whether a value reaches over the end of an attempt into the room put back"
    ] = False

    def __post_init__(self) -> None:
        if self.batch_size > self.replay_size:
            raise ValueError(
                f"a batch of {self.batch_size} transitions can never be drawn from "
                f"{self.replay_size}; make replay_size at least batch_size"
            )


class DDQN(Learner):
    """Double Q-learning with experience replay, one gradient step with every action."""

    Parameters = DDQNParameters
    parameters: DDQNParameters

    def begin(self, brief: Brief) -> None:
        """Make a network, a replay buffer and streams of randomness for each subject."""
        from openlock_learners.networks.double_q import DoubleQ

        settings = self.parameters
        self.brief = brief
        weights, exploration, batches = zip(
            *(generator.spawn(3) for generator in brief.generators), strict=True
        )
        self._luck = Streams(exploration, width=2)
        self._batches = Streams(batches, width=settings.batch_size, block=64)
        hidden = [settings.hidden_units] * settings.hidden_layers
        self.q: DoubleQ = DoubleQ(
            [self._inputs, *hidden, brief.actions],
            weights,
            settings.learning_rate,
            settings.gamma,
            settings.target_period,
            settings.double,
        )
        self._table = ObservationTable(self._inputs)
        self._replay = ReplayBuffer(brief.subjects, settings.replay_size)
        self.exploration = Exploration(settings, brief.subjects)
        self._errors: Floats | None = None

    @property
    def _inputs(self) -> int:
        return self.brief.observation_size

    def _network_input(self, observation: Observations, found: IntArray) -> Observations:
        """``[B, in]`` the networks' inputs, from observations and ``[B]`` solutions found."""
        return observation

    def act(self, view: View) -> IntArray:
        """``[B]`` epsilon-greedy actions."""
        uniform = self._luck.uniform()
        explores = uniform[:, 0] < self.exploration.epsilon
        actions = (uniform[:, 1] * self.brief.actions).astype(np.int64)
        if not explores.all():
            inputs = self._network_input(view.observation, view.console.solutions_found)
            actions = np.where(explores, actions, self.q.greedy(inputs, ~explores))
        return actions

    def probabilities(self, view: View) -> FloatArray:
        """``[B, A]`` exploration and the greedy action, mixed by epsilon."""
        inputs = self._network_input(view.observation, view.console.solutions_found)
        greedy = np.eye(self.brief.actions)[self.q.greedy(inputs, np.ones(len(inputs), dtype=bool))]
        return self.exploration.mixed(greedy, self._exploring(view))

    def _exploring(self, view: View) -> FloatArray:
        """``[B, A]`` the probability of each action of those that explore."""
        return np.full((self.brief.subjects, self.brief.actions), 1.0 / self.brief.actions)

    def learn(self, step: Step) -> None:
        """Add the transition to the buffer, take a gradient step, and lower epsilon."""
        playing, settings = step.view.playing, self.parameters
        self._add_transition(step, np.flatnonzero(playing))
        trains = playing & (self._replay.length >= settings.batch_size)
        if trains.any():
            for _ in range(settings.gradient_steps):
                batch = self._replay.sample(self._batches.uniform())
                with denormals_flushed():
                    self._errors = self.q.update(batch, trains)
        decays = {"action": playing, "attempt": step.attempt_over, "trial": step.trial_over}
        self.exploration.decay(step, decays[settings.epsilon_decays_with])

    def _add_transition(self, step: Step, who: IntArray) -> None:
        found = step.view.console.solutions_found
        before = self._network_input(step.view.observation, found)
        if self.parameters.bootstrap_over_attempts:
            after = self._network_input(step.next.observation, step.next.console.solutions_found)
            done = step.trial_over
        else:
            after = self._network_input(step.outcome, found + step.new_solution)
            done = step.attempt_over
        known = len(self._table.rows)
        transition = Batch(
            before=self._table.number(before[who]),
            action=step.action[who],
            after=self._table.number(after[who]),
            reward=step.reward[who],
            not_done=~done[who],
        )
        self._replay.add(who, transition)
        if len(self._table.rows) > known:
            self.q.observe(self._table.rows)

    def updates_made(self) -> int:
        """Gradient steps."""
        return self.q.updates

    def metrics(self) -> dict[str, float]:
        """Epsilon, loss of the last minibatch, and values of the observations met so far."""
        metrics = {"epsilon": float(self.exploration.epsilon.mean())}
        if self._errors is not None:
            size = np.abs(self._errors)
            metrics["loss"] = float(np.where(size < 1, size**2 / 2, size - 0.5).mean())
            metrics["max_q"] = float(self.q.values().max(axis=2).mean())
        return metrics


@dataclass(frozen=True)
class SemiMarkovDDQNParameters(DDQNParameters):
    """Hyper-parameters: those of :class:`DDQN`, and how many solutions are counted."""

    solution_bits: Annotated[
        Count, "solutions that are counted; finding more looks like finding this number"
    ] = 3


class SemiMarkovDDQN(DDQN):
    """A DDQN that sees how many solutions of the trial it has found.

    The count is appended to the observation in unary: one bit for each solution found so far. How
    many there are is not shown, which is why the number of bits is a parameter; three are enough
    for the paper's rooms.
    """

    Parameters = SemiMarkovDDQNParameters
    parameters: SemiMarkovDDQNParameters

    @property
    def _inputs(self) -> int:
        return self.brief.observation_size + self.parameters.solution_bits

    def _network_input(self, observation: Observations, found: IntArray) -> Observations:
        bits = found[:, None] > np.arange(self.parameters.solution_bits)
        return np.concatenate([observation, bits.astype(observation.dtype)], axis=1)

"""A Q-learner with a recurrent network: it can know what it did in a trial, and what it led to.

The DDQN sees the room and nothing else, so that it cannot know which solutions it has found. This
learner's network is recurrent: it perceives the room, the console, its own last action and what
that led to, and carries a hidden state from action to action, across the attempts of a trial. The
hidden state is reset at the end of each trial or only at the start of the condition.

It is trained as R2D2 is (Kapturowski et al., 2019): on sequences of steps, which begin with the
hidden state that was stored with their first step; some steps of burn-in bring that state up to
date before the others are learned from, by double Q-learning. Exploration is the DDQN's. All
subjects of a cell are trained at once, each with a network, a replay buffer and randomness of its
own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from causal_openlock.contract.learner import Brief, Learner, Step, View
from causal_openlock.contract.parameters import Count, Positive, Share, Whole
from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.world.randomness import Streams
from openlock_learners.exploration import Exploration, ExplorationParameters
from openlock_learners.networks.denormals import denormals_flushed
from openlock_learners.networks.perception import Perception
from openlock_learners.networks.sequence_buffer import SequenceBuffer

if TYPE_CHECKING:
    from torch import Tensor

    from openlock_learners.networks.recurrent_q import RecurrentDoubleQ


@dataclass(frozen=True)
class RecurrentParameters(ExplorationParameters):
    """Hyper-parameters; those that the DDQN has too have its defaults."""

    hidden_units: Annotated[
        Count, "units of the recurrent layer, and of the hidden layer behind it"
    ] = 64
    reset: Annotated[
        Literal["trial", "condition"],
        "what the memory lasts for: each trial by itself, or the whole condition",
    ] = "trial"
    burn_in: Annotated[Whole, "steps that bring a sequence's state up to date: five attempts"] = 15
    unroll: Annotated[Count, "steps of a sequence that are learned from: ten attempts"] = 30
    batch_size: Annotated[Count, "sequences in a gradient step"] = 8
    train_period: Annotated[Count, "actions between gradient steps"] = 4
    replay_size: Annotated[Count, "steps remembered for training"] = 2000
    gamma: Annotated[Share, "discount factor"] = 0.8
    learning_rate: Annotated[Positive, "of Adam"] = 0.001
    target_period: Annotated[
        Count | None,
        "gradient steps between updates of the target network (by default as many actions as the "
        "DDQN's); null never updates it",
    ] = 25
    bootstrap_over_attempts: Annotated[
        bool, "whether a value reaches over the end of an attempt into the room put back"
    ] = False

    def __post_init__(self) -> None:
        longest = self.burn_in + self.unroll + 1
        if longest > self.replay_size:
            raise ValueError(
                f"a sequence with burn-in has {longest} steps, and only {self.replay_size} are "
                "remembered; make replay_size larger than burn_in + unroll"
            )


class Recurrent(Learner):
    """Double Q-learning with a memory of the trial, trained on sequences with burn-in (R2D2)."""

    Parameters = RecurrentParameters
    parameters: RecurrentParameters

    def begin(self, brief: Brief) -> None:
        """Make a network, a replay buffer and streams of randomness for each subject."""
        from openlock_learners.networks.recurrent_q import RecurrentDoubleQ, StackedRecurrentNetwork

        settings = self.parameters
        self.brief = brief
        weights, exploration, batches = zip(
            *(generator.spawn(3) for generator in brief.generators), strict=True
        )
        self._perception = Perception(brief)
        inputs, hidden = self._perception.size, settings.hidden_units
        network = StackedRecurrentNetwork(inputs, hidden, brief.actions, weights)
        self.q: RecurrentDoubleQ = RecurrentDoubleQ(
            network, settings.learning_rate, settings.gamma, settings.target_period
        )
        self._hidden_state = np.zeros((brief.subjects, hidden), dtype=np.float32)
        self._replay = SequenceBuffer(
            brief.subjects, settings.replay_size, settings.burn_in, settings.unroll, inputs, hidden
        )
        self._luck = Streams(exploration, width=2)
        self._batches = Streams(batches, width=2 * settings.batch_size, block=64)
        self.exploration = Exploration(settings, brief.subjects)
        self._evaluated: View | None = None
        self._losses: Tensor | None = None

    def act(self, view: View) -> IntArray:
        """``[B]`` epsilon-greedy actions."""
        uniform = self._luck.uniform()
        random = (uniform[:, 1] * self.brief.actions).astype(np.int64)
        return np.where(uniform[:, 0] < self.exploration.epsilon, random, self._greedy(view))

    def _evaluate(self, view: View) -> None:
        """Evaluate the networks in what is perceived, unless that was done."""
        from torch import from_numpy

        if view is not self._evaluated:
            self._evaluated, self._inputs = view, self._perception.inputs(view)
            found = self.q.values(from_numpy(self._inputs), from_numpy(self._hidden_state))
            self._values, self._next_state = found

    def _greedy(self, view: View) -> IntArray:
        """``[B]`` the best actions."""
        self._evaluate(view)
        best: IntArray = self._values.argmax(dim=1).numpy()
        return best

    def probabilities(self, view: View) -> FloatArray:
        """``[B, A]`` a random and the greedy action, mixed by epsilon."""
        greedy = np.eye(self.brief.actions)[self._greedy(view)]
        return self.exploration.mixed(greedy, 1.0 / self.brief.actions)

    def learn(self, step: Step) -> None:
        """Add the step to the buffer, take a gradient step if one is due, and lower epsilon."""
        from torch import from_numpy

        self._evaluate(step.view)
        settings, playing = self.parameters, step.view.playing
        resets = step.trial_over & playing & (settings.reset == "trial")
        done = step.trial_over if settings.bootstrap_over_attempts else step.attempt_over
        self._replay.add(
            playing, self._inputs, self._hidden_state, step.action, step.reward, ~done, resets
        )
        after = self._next_state.numpy()
        self._hidden_state = np.where(playing[:, None], after, self._hidden_state)
        self._perception.note(step)
        self._hidden_state[resets] = 0
        self._perception.forget(resets)
        count = self._replay.count
        trains = playing & (count > settings.unroll) & (count % settings.train_period == 0)
        if trains.any():
            batch = self._replay.sample(self._batches.uniform())
            with denormals_flushed():
                self._losses = self.q.update(batch, from_numpy(trains))
        self.exploration.decay(step)

    def updates_made(self) -> int:
        """Gradient steps."""
        return self.q.updates

    def metrics(self) -> dict[str, float]:
        """Epsilon, the loss of the last minibatch, and the values of what was seen last."""
        metrics = {"epsilon": float(self.exploration.epsilon.mean())}
        if self._losses is not None:
            metrics["loss"] = float(self._losses.mean())
        if self._evaluated is not None:
            metrics["max_q"] = float(self._values.amax(dim=1).mean())
        return metrics

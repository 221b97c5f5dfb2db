"""Double deep Q-learning, as in the paper.

A network of four hidden layers of 128 units maps the 16 bits of the room to the values of its 15
actions (paper, Figure 5). Actions are chosen epsilon-greedily; epsilon starts at 1, shrinks by
.995 with every action to .01, and is set to .5 at the end of each trial, so that the learner does
not cling to the room it leaves. What the paper leaves open (optimiser, loss, batch, replay,
target network, whether values reach over the end of an attempt) is a parameter here.

The learner sees the room and nothing of what came before in the trial: it cannot know which
solutions it has found. All subjects of a cell are trained at once, each with a network, a replay
memory and randomness of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from causal_openlock.fsm import BoolArray, FloatArray, IntArray
from causal_openlock.learner import Brief, Learner, Step, View
from causal_openlock.randomness import Streams
from learners.replay import ObservationTable, Replay

if TYPE_CHECKING:
    from learners.stacked import StackedDoubleQ

Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=1)]


@dataclass(frozen=True)
class DDQNParameters:
    """Hyper-parameters; the defaults are the paper's, or documented choices where it is silent."""

    gamma: Annotated[Share, "discount factor (paper: .8)"] = 0.8
    learning_rate: Annotated[float, Field(gt=0), "of Adam (paper: .001)"] = 0.001
    epsilon_start: Annotated[Share, "share of random actions at first (paper: 1)"] = 1.0
    epsilon_min: Annotated[Share, "and at least (paper: .01)"] = 0.01
    epsilon_decay: Annotated[Share, "factor with every action (paper: .995)"] = 0.995
    epsilon_after_trial: Annotated[Share | None, "set at each trial's end (paper: .5)"] = 0.5
    hidden_layers: Annotated[Count, "layers between input and output (paper: 4)"] = 4
    hidden_units: Annotated[Count, "units in each of them (paper: 128)"] = 128
    batch_size: Annotated[Count, "transitions in a gradient step (paper: not given)"] = 64
    replay_size: Annotated[Count, "transitions remembered (authors' program: 2,000)"] = 2000
    target_period: Annotated[
        Count | None, "gradient steps between updates of the target network; null never updates it"
    ] = 100
    bootstrap_over_attempts: Annotated[
        bool, "whether a value reaches over the end of an attempt into the room put back"
    ] = False
    threads: Annotated[Count, "of torch; more than one gains nothing at this size"] = 1

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
        """Make a network, a replay memory and streams of randomness for each subject."""
        import torch

        from learners.stacked import StackedDoubleQ

        settings = self.parameters
        torch.set_num_threads(settings.threads)
        # Sparse rewards let Adam's moments decay into denormal numbers, which are slow.
        torch.set_flush_denormal(True)
        self._torch = torch
        self.brief = brief
        weights, exploration, batches = zip(
            *(generator.spawn(3) for generator in brief.generators), strict=True
        )
        hidden = [settings.hidden_units] * settings.hidden_layers
        self.q: StackedDoubleQ = StackedDoubleQ(
            [brief.observation_size, *hidden, brief.actions],
            weights,
            settings.learning_rate,
            settings.gamma,
            settings.target_period,
        )
        self._exploration = Streams(exploration, width=2)
        self._batches = Streams(batches, width=settings.batch_size, block=64)
        self._table = ObservationTable(brief.observation_size)
        self._replay = Replay(brief.subjects, settings.replay_size)
        self.epsilon = np.full(brief.subjects, settings.epsilon_start)

    def act(self, view: View) -> IntArray:
        """``[B]`` epsilon-greedy actions."""
        draws = self._exploration.uniform()
        explores = draws[:, 0] < self.epsilon
        actions = self._explore(view, explores, draws[:, 1])
        if not explores.all():
            seen = self._torch.from_numpy(view.observation.astype(np.float32))
            greedy: IntArray = self.q.greedy(seen).numpy()
            actions = np.where(explores, actions, greedy)
        return actions

    def _explore(self, view: View, explores: BoolArray, draw: FloatArray) -> IntArray:
        """``[B]`` an action for those that explore, by a number in [0, 1) each."""
        return (draw * self.brief.actions).astype(np.int64)

    def learn(self, step: Step) -> None:
        """Remember what happened, take one gradient step, and cool down."""
        settings = self.parameters
        if settings.bootstrap_over_attempts:
            after, goes_on = step.next.observation, ~step.trial_over
        else:
            after, goes_on = step.outcome, ~step.attempt_over
        playing = np.flatnonzero(step.view.playing)
        known = len(self._table.rows)
        self._replay.add(
            playing,
            self._table.number(step.view.observation[playing]),
            step.action[playing],
            step.reward[playing],
            self._table.number(after[playing]),
            goes_on[playing],
        )
        if len(self._table.rows) > known:
            self._observe()
        self._train(step.view.playing & (self._replay.length >= settings.batch_size))
        cooled = np.maximum(self.epsilon * settings.epsilon_decay, settings.epsilon_min)
        if settings.epsilon_after_trial is not None:
            cooled[step.trial_over] = settings.epsilon_after_trial
        self.epsilon = np.where(step.view.playing, cooled, self.epsilon)

    def _train(self, trains: BoolArray) -> None:
        if not trains.any():
            return
        from_numpy = self._torch.from_numpy
        batch = self._replay.sample(self._batches.uniform())
        before, action, reward, after, goes_on = map(from_numpy, batch)
        agents = None if trains.all() else from_numpy(trains)
        self.q.update(before, action, reward, after, goes_on, agents)

    def _observe(self) -> None:
        self.q.observe(self._torch.from_numpy(self._table.rows))

    def state_dict(self) -> dict[str, Any]:
        """Networks, memories, randomness and epsilon."""
        return {
            "q": self.q.state_dict(),
            "table": self._table.state_dict(),
            "replay": self._replay.state_dict(),
            "exploration": self._exploration.state_dict(),
            "batches": self._batches.state_dict(),
            "epsilon": self.epsilon.copy(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.q.load_state_dict(state["q"])
        self._table.load_state_dict(state["table"])
        self._observe()
        self._replay.load_state_dict(state["replay"])
        self._exploration.load_state_dict(state["exploration"])
        self._batches.load_state_dict(state["batches"])
        self.epsilon = state["epsilon"].copy()

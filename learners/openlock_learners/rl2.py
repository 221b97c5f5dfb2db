"""A learner that was trained to find out, after RL² (Duan et al., 2016; Wang et al., 2016).

Its network was trained by policy gradient in rooms of many schemas, in layouts other than those
that are tested (:mod:`openlock_learners.meta.training`). Now its weights are frozen, and it finds
out how a room works in its hidden state alone, which is carried from attempt to attempt, and also
from trial to trial unless it is reset. It perceives what the recurrent Q-learner perceives: the
room, the console, its own last action and what that led to. In one thing the network that comes
with the package is not RL²: it was trained for what each trial earns, not a whole life
(``credit: life`` does that).

It can also continue to learn while it plays: then every subject has a network of its own, which
begins with the trained weights and follows the same policy gradient, on the experiment's reward.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from causal_openlock.contract.learner import Brief, Learner, Step, View
from causal_openlock.contract.parameters import Count, Share
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.declare import PAPER_ACTION_LIMIT
from causal_openlock.files.digest import digest
from causal_openlock.schemas.fsm import FloatArray
from openlock_learners.networks.denormals import denormals_flushed
from openlock_learners.networks.perception import Perception

if TYPE_CHECKING:
    from openlock_learners.networks.ppo import PPO, Floats, Rollout


@dataclass(frozen=True)
class RL2Parameters:
    """Hyper-parameters; those below ``learns`` matter only if it does."""

    checkpoint: Annotated[
        str | None, "file of the trained network; null takes the one that comes with the package"
    ] = None
    reset: Annotated[
        Literal["trial", "condition"],
        "what the memory lasts for: each trial by itself, or the whole condition",
    ] = "condition"
    greedy: Annotated[
        bool, "whether it takes the likeliest action, and does not draw from its policy"
    ] = False
    learns: Annotated[bool, "whether its weights continue to change while it plays"] = False
    unroll: Annotated[Count, "actions between two updates: ten attempts"] = 30
    epochs: Annotated[Count, "how often these actions are gone through"] = 2
    learning_rate: Annotated[float, Field(gt=0), "of Adam"] = 0.0001
    gamma: Annotated[Share, "discount factor"] = 0.97
    decay: Annotated[Share, "lambda of the advantage estimate"] = 0.95
    clip: Annotated[float, Field(gt=0), "share by which an action's chance may move"] = 0.2
    entropy_weight: Annotated[float, Field(ge=0), "what undecidedness is worth"] = 0.002
    reward_scale: Annotated[
        float, Field(gt=0), "divides the experiment's reward: a plain solution then earns 1"
    ] = 60.0
    threads: Annotated[Count, "of torch; more than one gains nothing at this size"] = 1


class RL2(Learner):
    """A recurrent policy, meta-trained over many rooms and schemas: it learns in its memory."""

    Parameters = RL2Parameters
    parameters: RL2Parameters

    @classmethod
    def artifact_hash(cls, parameters: RL2Parameters) -> str:
        """A hash of the trained network."""
        from openlock_learners.networks.network_file import BUNDLED, MOST_BYTES

        path = Path(parameters.checkpoint or BUNDLED)
        try:
            fits = not path.exists() or (path.is_file() and path.stat().st_size <= MOST_BYTES)
            weights = path.read_bytes() if fits else b""
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise LearnerError(f"the network of rl2 cannot be read: {path}: {reason}") from None
        if not fits:
            raise LearnerError(f"{path} is not a checkpoint of rl2; name a file of its weights")
        return digest(weights)

    @classmethod
    def prior_attempts(cls, parameters: RL2Parameters) -> int:
        """The attempts of its meta-training, of three actions each."""
        from openlock_learners.networks.network_file import BUNDLED, trained_actions

        return trained_actions(parameters.checkpoint or BUNDLED) // PAPER_ACTION_LIMIT

    def begin(self, brief: Brief) -> None:
        """Load the network, once for each subject."""
        from openlock_learners.networks.network_file import BUNDLED, read_network
        from openlock_learners.networks.ppo import PPO, PPOSettings

        settings = self.parameters
        self.brief = brief
        # One for each subject also where all are the same, so that each is evaluated by itself.
        self.network, self.about = read_network(settings.checkpoint or BUNDLED, brief.subjects)
        if self.network.positions not in (None, brief.positions):
            raise LearnerError(
                f"this network of rl2 is for rooms of {self.network.positions} positions and this "
                f"one has {brief.positions}; train one of kind levers, which fits them all"
            )
        self.trainer: PPO | None = None
        if settings.learns:
            ppo = PPOSettings(
                learning_rate=settings.learning_rate,
                gamma=settings.gamma,
                gae_lambda=settings.decay,
                clip=settings.clip,
                epochs=settings.epochs,
                minibatches=1,
            )
            self.trainer = PPO(self.network, ppo)
        self._perception = Perception(brief)
        size = self.network.state_size(brief.positions)
        self._hidden_state = np.zeros((brief.subjects, size), dtype=np.float32)
        self._fresh = np.zeros(brief.subjects, dtype=bool)
        self._logits: Floats = np.zeros((brief.subjects, brief.actions), dtype=np.float32)
        self._values: Floats = np.zeros(brief.subjects, dtype=np.float32)
        self._begin_rollout()

    def _begin_rollout(self) -> None:
        self._steps: list[dict[str, Any]] = []
        self._state_before = self._hidden_state.copy()

    def _evaluate(self, view: View) -> tuple[Any, Any, Any]:
        """``[B, A]`` logits, ``[B]`` values and ``[B, S]`` the next hidden state."""
        from torch import from_numpy

        self._inputs = self._perception.inputs(view)
        given = self._inputs, self._hidden_state, self._fresh
        found = self.network.step(*(from_numpy(part)[:, None] for part in given))
        logits, values, state = (part[:, 0].numpy() for part in found)
        return logits, values, state

    def probabilities(self, view: View) -> FloatArray:
        """``[B, A]`` probabilities of the policy; :meth:`learn` keeps the next hidden state."""
        from openlock_learners.networks.ppo import action_odds

        self._logits, self._values, self._next_hidden_state = self._evaluate(view)
        if self.parameters.greedy:
            return np.eye(self.brief.actions)[self._logits.argmax(axis=1)]
        odds = action_odds(self._logits)
        return odds / odds.sum(axis=1, keepdims=True)

    def memory(self) -> tuple[FloatArray, FloatArray]:
        """``[B, P, H]`` hidden states of the levers, and ``[B, G]`` of the room.

        They are those before the network perceives what the last action led to.

        Raises:
            LearnerError: If its network has no states of levers.
        """
        if self.network.sizes.kind != "levers":
            raise LearnerError(
                "this network of rl2 has no state for each lever; take a kind levers"
            )
        size, state = self.network.sizes, self._hidden_state.astype(float)
        levers = state[:, : self.brief.positions * size.lever]
        return levers.reshape(len(state), -1, size.lever), state[:, levers.shape[1] :]

    def untrain(self, generator: np.random.Generator) -> None:
        """Give its network the random weights of one that was never trained; after ``begin``."""
        from openlock_learners.networks.recurrent_policy import make_policy

        fresh = make_policy(self.network.sizes, self.brief.positions, [generator]).state_dict()
        kept = self.network.state_dict()
        self.network.load_state_dict({name: fresh[name].expand_as(kept[name]) for name in kept})

    def learn(self, step: Step) -> None:
        """Keep the hidden state, or reset it; update the weights if they change and it is time."""
        playing = step.view.playing
        if self.trainer is not None:
            self._steps.append(self._rollout_step(step))
        self._hidden_state = np.where(playing[:, None], self._next_hidden_state, self._hidden_state)
        self._perception.note(step)
        self._fresh = step.trial_over & playing & (self.parameters.reset == "trial")
        self._perception.forget(self._fresh)
        if self.trainer is not None and len(self._steps) == self.parameters.unroll:
            with denormals_flushed():
                self.trainer.update(self._rollout(step.next), self.parameters.entropy_weight)
            self._begin_rollout()

    def _rollout_step(self, step: Step) -> dict[str, Any]:
        from openlock_learners.networks.ppo import log_prob

        action = np.where(step.view.playing, step.action, 0)
        return {
            "inputs": self._inputs,
            "fresh": self._fresh,
            "action": action,
            "log_prob": log_prob(self._logits, action),
            "value": self._values,
            "reward": (step.reward / self.parameters.reward_scale).astype(np.float32),
            "done": step.trial_over.copy(),
            "mask": step.view.playing.copy(),
        }

    def _rollout(self, after: View) -> Rollout:
        """The steps since the last update, ``[B, T, 1]``."""
        from torch import from_numpy

        from openlock_learners.networks.ppo import Rollout

        _, values, _ = self._evaluate(after)
        state, bootstrap = map(from_numpy, (self._state_before, values))
        steps = Rollout.stacked(self._steps, self.brief.subjects)
        return Rollout(**steps, state=state[:, None], bootstrap=bootstrap[:, None])

    def metrics(self) -> dict[str, float]:
        """Entropy of the policy, in nats, and the mean of its values."""
        probs = np.exp(self._logits - self._logits.max(axis=1, keepdims=True))
        probs /= probs.sum(axis=1, keepdims=True)
        entropy = -(probs * np.log(probs + 1e-12)).sum(axis=1)
        return {"entropy": float(entropy.mean()), "value": float(self._values.mean())}

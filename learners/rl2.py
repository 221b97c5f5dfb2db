"""A learner that has learned to find out: RL² (Duan et al., 2016; Wang et al., 2016).

Its network was trained by policy gradient in rooms of many schemas, in layouts other than those
that are tested (:mod:`learners.meta.training`). Now its weights are frozen, and it finds out how a
room works with its memory alone, which is carried from attempt to attempt, and also from trial to
trial unless it is reset. What it perceives is what the recurrent Q-learner perceives: the room, the
console, its own last action and what came of it.

It can also go on learning while it plays: then every subject has a network of its own, which
begins with the trained weights and follows the same policy gradient, on the experiment's reward.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from causal_openlock.contract.learner import Brief, Learner, Step, View
from causal_openlock.errors import LearnerError
from causal_openlock.world.fsm import IntArray
from causal_openlock.world.randomness import Streams
from learners.networks.denormals import denormals_flushed
from learners.networks.perception import Perception

if TYPE_CHECKING:
    from learners.networks.actor_critic import Floats, Rollout

Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=1)]


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
    learns: Annotated[bool, "whether its weights go on changing while it plays"] = False
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
        from learners.networks.network_file import BUNDLED, MOST_BYTES

        path = Path(parameters.checkpoint or BUNDLED)
        try:
            if path.exists() and not (path.is_file() and path.stat().st_size <= MOST_BYTES):
                raise LearnerError(f"{path} is no checkpoint of rl2; name a file of its weights")
            return hashlib.sha256(path.read_bytes()).hexdigest()[:16]
        except (OSError, ValueError) as error:
            said = getattr(error, "strerror", None) or error
            raise LearnerError(f"the network of rl2 cannot be read: {path}: {said}") from None

    def begin(self, brief: Brief) -> None:
        """Load the network, once for each subject."""
        import torch

        from learners.networks.actor_critic import PolicyGradient, Trainer
        from learners.networks.network_file import BUNDLED, read_network

        settings = self.parameters
        torch.set_num_threads(settings.threads)
        self._torch = torch
        self.brief = brief
        # One for each subject also where all are the same, so that each is evaluated by itself.
        self.network, self.about = read_network(settings.checkpoint or BUNDLED, brief.subjects)
        if self.network.positions not in (None, brief.positions):
            raise LearnerError(
                f"this network of rl2 knows rooms of {self.network.positions} positions and this "
                f"one has {brief.positions}; train one of kind levers, which knows them all"
            )
        self.trainer: Trainer | None = None
        if settings.learns:
            gradient = PolicyGradient(
                learning_rate=settings.learning_rate,
                gamma=settings.gamma,
                decay=settings.decay,
                clip=settings.clip,
                epochs=settings.epochs,
                minibatches=1,
            )
            self.trainer = Trainer(self.network, gradient)
        self._perception = Perception(brief)
        self._streams = Streams(brief.generators)
        size = self.network.state_size(brief.positions)
        self._memory = np.zeros((brief.subjects, size), dtype=np.float32)
        self._fresh = np.zeros(brief.subjects, dtype=bool)
        self._logits: Floats = np.zeros((brief.subjects, brief.actions), dtype=np.float32)
        self._values: Floats = np.zeros(brief.subjects, dtype=np.float32)
        self._begin_rollout()

    def _begin_rollout(self) -> None:
        self._steps: list[dict[str, Any]] = []
        self._memory_before = self._memory.copy()

    def _think(self, view: View) -> tuple[Any, Any, Any]:
        """``[B, A]`` logits, ``[B]`` values and ``[B, S]`` what will be remembered."""
        self._inputs = self._perception.inputs(view)
        from_numpy = self._torch.from_numpy
        with self._torch.no_grad():
            logits, values, memory = self.network(
                from_numpy(self._inputs)[:, None, None],
                from_numpy(self._memory)[:, None],
                from_numpy(self._fresh)[:, None, None],
            )
        return (
            logits.reshape(self.brief.subjects, -1).numpy(),
            values.reshape(self.brief.subjects).numpy(),
            memory.reshape(self.brief.subjects, -1).numpy(),
        )

    def act(self, view: View) -> IntArray:
        """``[B]`` what the policy says; what is perceived is remembered once it is acted on."""
        from learners.networks.actor_critic import chosen

        self._logits, self._values, self._memory_after = self._think(view)
        uniform = self._streams.uniform()
        if self.parameters.greedy:
            likeliest: IntArray = self._logits.argmax(axis=1)
            return likeliest
        return chosen(self._logits, uniform)

    def learn(self, step: Step) -> None:
        """Remember, and forget at the end of what the memory lasts for."""
        playing = step.view.playing
        if self.trainer is not None:
            self._steps.append(self._happened(step))
        self._memory = np.where(playing[:, None], self._memory_after, self._memory)
        self._perception.note(step)
        self._fresh = step.trial_over & playing & (self.parameters.reset == "trial")
        self._perception.forget(self._fresh)
        if self.trainer is not None and len(self._steps) == self.parameters.unroll:
            with denormals_flushed():
                self.trainer.update(self._rollout(step.next), self.parameters.entropy_weight)
            self._begin_rollout()

    def _happened(self, step: Step) -> dict[str, Any]:
        from learners.networks.actor_critic import log_chance

        action = np.where(step.view.playing, step.action, 0)
        return {
            "inputs": self._inputs,
            "fresh": self._fresh,
            "action": action,
            "log_chance": log_chance(self._logits, action),
            "value": self._values,
            "reward": (step.reward / self.parameters.reward_scale).astype(np.float32),
            "over": step.trial_over.copy(),
            "counts": step.view.playing.copy(),
        }

    def _rollout(self, after: View) -> Rollout:
        """The steps since the last update, ``[B, T, 1]``."""
        from learners.networks.actor_critic import Rollout

        from_numpy = self._torch.from_numpy
        stacked = {
            name: from_numpy(np.stack([step[name] for step in self._steps], axis=1)).unsqueeze(2)
            for name in self._steps[0]
        }
        _, values, _ = self._think(after)
        state = from_numpy(self._memory_before)[:, None]
        return Rollout(**stacked, state=state, bootstrap=from_numpy(values)[:, None])

    def metrics(self) -> dict[str, float]:
        """How undecided the policy is, in nats, and what it expects still to earn."""
        chances = np.exp(self._logits - self._logits.max(axis=1, keepdims=True))
        chances /= chances.sum(axis=1, keepdims=True)
        entropy = -(chances * np.log(chances + 1e-12)).sum(axis=1)
        return {"entropy": float(entropy.mean()), "value": float(self._values.mean())}

    def state_dict(self) -> dict[str, Any]:
        """Memory and randomness; networks and the steps since the last update if it learns."""
        import copy

        return {
            "memory": self._memory.copy(),
            "fresh": self._fresh.copy(),
            "perception": self._perception.state_dict(),
            "streams": self._streams.state_dict(),
            "trainer": copy.deepcopy(self.trainer.state_dict()) if self.trainer else None,
            "steps": list(self._steps),
            "memory_before": self._memory_before.copy(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        import copy

        self._memory, self._fresh = state["memory"].copy(), state["fresh"].copy()
        self._perception.load_state_dict(state["perception"])
        self._streams.load_state_dict(state["streams"])
        if self.trainer is not None:
            self.trainer.load_state_dict(copy.deepcopy(state["trainer"]))
        self._steps = list(state["steps"])
        self._memory_before = state["memory_before"].copy()

"""A learner that was trained to find out, after RL² (Duan et al., 2016; Wang et al., 2016).

Its network was trained by policy gradient in rooms of many schemas, in layouts other than those
that are tested (:mod:`openlock_learners.meta.training`). Now its weights are frozen, and it finds
out how a room works in its hidden state alone, which is carried from attempt to attempt, and also
from trial to trial unless it is reset. It perceives what the recurrent Q-learner perceives: the
room, the console, its own last action and what that led to. In one thing the network that comes
with the package is not RL²: it was trained for what each trial earns, not a whole life
(``credit: life`` does that).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from causal_openlock.contract.learner import Brief, Learner, Step, View
from causal_openlock.experiment.protocol import PAPER_ACTION_LIMIT
from causal_openlock.files.checksums import digest
from causal_openlock.schemas.fsm import FloatArray
from openlock_learners.networks.perception import Perception
from openlock_learners.trained_file import BUNDLED, content_of


@dataclass(frozen=True)
class RL2Parameters:
    """Hyper-parameters."""

    checkpoint: Annotated[
        str | None, "file of the trained network; null takes the one that comes with the package"
    ] = None
    reset: Annotated[
        Literal["trial", "condition"],
        "what the memory lasts for: each trial by itself, or the whole condition",
    ] = "condition"


class RL2(Learner):
    """A recurrent policy, trained before in rooms of which half have the paper's schemas."""

    Parameters = RL2Parameters
    parameters: RL2Parameters

    @classmethod
    def artifact_hash(cls, parameters: RL2Parameters) -> str:
        """A hash of the trained network."""
        return digest(content_of(parameters.checkpoint or BUNDLED))

    @classmethod
    def prior_attempts(cls, parameters: RL2Parameters) -> int:
        """The attempts of its meta-training, of three actions each."""
        from openlock_learners.networks.network_file import trained_actions

        return trained_actions(parameters.checkpoint or BUNDLED) // PAPER_ACTION_LIMIT

    def begin(self, brief: Brief) -> None:
        """Load the network."""
        from openlock_learners.networks.network_file import read_network

        super().begin(brief)
        self.network, _ = read_network(self.parameters.checkpoint or BUNDLED)
        self._perception = Perception(brief)
        size = self.network.state_size(brief.positions)
        self.hidden_state = np.zeros((brief.subjects, size), dtype=np.float32)
        self._evaluated: View | None = None

    def _evaluate(self, view: View) -> None:
        """Evaluate the network in what is perceived, unless that was done."""
        import torch

        if view is not self._evaluated:
            inputs = torch.from_numpy(self._perception.inputs(view))
            with torch.no_grad():
                found = self.network.step(inputs, torch.from_numpy(self.hidden_state))
            self._evaluated, (self._logits, self._values, self._next_state) = view, found

    def probabilities(self, view: View) -> FloatArray:
        """``[B, A]`` probabilities of the policy."""
        self._evaluate(view)
        odds: FloatArray = self._logits.double().softmax(dim=1).numpy()
        return odds

    def learn(self, step: Step) -> None:
        """Move on to the next hidden state, or reset it."""
        self._evaluate(step.view)
        playing, after = step.view.playing, self._next_state.numpy()
        self.hidden_state = np.where(playing[:, None], after, self.hidden_state)
        self._perception.note(step)
        ends = step.trial_over & playing & (self.parameters.reset == "trial")
        self.hidden_state[ends] = 0.0
        self._perception.forget(ends)

    def metrics(self) -> dict[str, float]:
        """Entropy of the policy, in nats, and the mean of its values."""
        log_probs = self._logits.log_softmax(dim=1)
        entropy = -(log_probs.exp() * log_probs).sum(dim=1)
        return {"entropy": float(entropy.mean()), "value": float(self._values.mean())}

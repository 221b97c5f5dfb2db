"""Epsilon-greedy exploration, with the epsilons of the paper's DDQN."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from causal_openlock.contract.learner import Step
from causal_openlock.contract.parameters import Share
from causal_openlock.schemas.fsm import BoolArray, FloatArray


@dataclass(frozen=True)
class ExplorationParameters:
    """Hyper-parameters of exploration; the defaults are the paper's."""

    epsilon_start: Annotated[Share, "share of random actions at first (paper: 1)"] = 1.0
    epsilon_min: Annotated[Share, "and at least (paper: .01)"] = 0.01
    epsilon_decay: Annotated[Share, "factor by which it shrinks (paper: .995)"] = 0.995
    epsilon_after_trial: Annotated[
        Share | None, "set at each trial's end (paper: .5); null continues the decay"
    ] = 0.5


class Exploration:
    """The shares of random actions of B subjects."""

    def __init__(self, settings: ExplorationParameters, subjects: int) -> None:
        self.settings = settings
        self.epsilon: FloatArray = np.full(subjects, settings.epsilon_start)  #: ``[B]`` the shares

    def mixed(self, greedy: FloatArray, random: FloatArray | float) -> FloatArray:
        """``[B, A]`` probabilities of actions, from those of greedy and of random ones."""
        share = self.epsilon[:, None]
        return share * random + (1.0 - share) * greedy

    def decay(self, step: Step, decays: BoolArray | None = None) -> None:
        """Lower epsilon after a step, for those ``[B]`` where it ``decays``; by default for all."""
        settings, playing = self.settings, step.view.playing
        decays = playing if decays is None else playing & decays
        lowered = self.epsilon * settings.epsilon_decay
        np.maximum(lowered, settings.epsilon_min, out=self.epsilon, where=decays)
        if settings.epsilon_after_trial is not None:
            self.epsilon[step.trial_over & playing] = settings.epsilon_after_trial

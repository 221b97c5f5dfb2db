"""Learners written for a single subject, with plain numbers.

A :class:`PerSubjectAdapter` gives each subject an instance of its own and plays them as one
:class:`~causal_openlock.contract.learner.Learner`. The registry takes either kind.
"""

from __future__ import annotations

import operator
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from causal_openlock.contract.learner import Brief, Learner, LearnerBase, Observations, Step, View
from causal_openlock.errors import LearnerError
from causal_openlock.schemas.fsm import IntArray


@dataclass(frozen=True)
class Moment:
    """A :class:`Step` of one subject, in plain numbers."""

    observation: Observations  #: ``[2P + 2]`` what was seen before the action
    action: int
    outcome: Observations  #: ``[2P + 2]`` what was seen right after it
    reward: float
    attempt_over: bool
    trial_over: bool
    new_solution: bool
    solutions_left: int  #: still to be found in the trial


class OneSubjectLearner(LearnerBase, ABC):
    """A learner written for a single subject; each subject gets an instance of its own.

    ``self.brief``, for this subject alone, and ``self.generator``, its only source of randomness,
    are set before :meth:`begin` is called.

    Example:
        >>> class Dice(OneSubjectLearner):
        ...     def act(self, observation):
        ...         return int(self.generator.integers(self.brief.actions))
        >>> learner = PerSubjectAdapter(Dice)  # plays many subjects, each with its own Dice
    """

    brief: Brief
    generator: np.random.Generator

    def begin(self) -> None:
        """Get ready to play."""

    @abstractmethod
    def act(self, observation: Observations) -> int:
        """The action for an observation, ``[2P + 2]`` of 0 and 1."""

    def learn(self, moment: Moment) -> None:
        """Learn from what the action led to."""


class PerSubjectAdapter(Learner):
    """Plays B instances of a :class:`OneSubjectLearner` as one learner."""

    learns_from_others: bool  # type: ignore[misc]  # as the class of its players says
    resumable: bool  # type: ignore[misc]

    def __init__(self, single: type[OneSubjectLearner], parameters: Any = None) -> None:
        super().__init__(single.Parameters() if parameters is None else parameters)
        self.single = single
        self.learns_from_others, self.resumable = single.learns_from_others, single.resumable

    def begin(self, brief: Brief) -> None:
        """Make one player for each subject."""
        self._players: list[OneSubjectLearner] = []
        for generator in brief.generators:
            player = self.single(self.parameters)
            player.brief = replace(brief, subjects=1, generators=(generator,))
            player.generator = generator
            player.begin()
            self._players.append(player)

    def act(self, view: View) -> IntArray:
        """Ask each player that still plays."""
        actions = np.zeros(len(self._players), dtype=np.int64)
        for subject in np.flatnonzero(view.playing):
            # Players may change the observation that they get, but learn from the original one.
            answer = self._players[subject].act(view.observation[subject].copy())
            try:
                actions[subject] = operator.index(answer)
            except (TypeError, OverflowError):  # NumPy would silently round 2.7
                raise LearnerError(
                    f"{self.single.__name__} has to answer with an integer, the index of an "
                    f"action, and answered {answer!r}"
                ) from None
        return actions

    def updates_made(self) -> int | None:
        """Those of all players."""
        counts = [player.updates_made() for player in self._players]
        return None if None in counts else sum(count or 0 for count in counts)

    def learn(self, step: Step) -> None:
        """Let each player learn from its own step."""
        left = step.view.console.solutions_left - step.new_solution
        for subject in np.flatnonzero(step.view.playing):
            self._players[subject].learn(
                Moment(
                    step.view.observation[subject],
                    int(step.action[subject]),
                    step.outcome[subject],
                    float(step.reward[subject]),
                    bool(step.attempt_over[subject]),
                    bool(step.trial_over[subject]),
                    bool(step.new_solution[subject]),
                    int(left[subject]),
                )
            )

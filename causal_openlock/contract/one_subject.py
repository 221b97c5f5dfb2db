"""Learners written for a single subject.

A :class:`~causal_openlock.contract.learner.Learner` plays many subjects at once, which is fast and
asks for arrays. A :class:`OneSubjectLearner` answers for one subject in plain numbers; each subject
gets an instance of its own, and a :class:`PerSubjectAdapter` of them plays as one learner. The
registry takes either.

Such an instance can hold anything, so its state is a pickle. It carries a seal
(:mod:`causal_openlock.files.seal`), and is read only if this user has made it for the same class.
"""

from __future__ import annotations

import operator
import pickle
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from causal_openlock.contract.learner import (
    Brief,
    Learner,
    NoParameters,
    Observations,
    Step,
    View,
)
from causal_openlock.errors import LearnerError
from causal_openlock.files.seal import is_sealed, seal
from causal_openlock.world.fsm import IntArray


@dataclass(frozen=True)
class Moment:
    """A :class:`Step` of one subject, in plain numbers.

    Attributes:
        observation: ``[2P + 2]`` what was seen before the action.
        action: What was done.
        outcome: ``[2P + 2]`` what was seen right after it.
        reward: The reward for it.
        attempt_over: Whether the attempt ended with it.
        trial_over: Whether the trial ended with it.
        new_solution: Whether it completed a solution not found before in the trial.
        solutions_left: Solutions still to be found in the trial.
    """

    observation: Observations
    action: int
    outcome: Observations
    reward: float
    attempt_over: bool
    trial_over: bool
    new_solution: bool
    solutions_left: int


class OneSubjectLearner(ABC):
    """A learner written for a single subject; each subject gets an instance of its own.

    ``self.brief``, which tells of this subject alone, and ``self.generator``, the one source of
    randomness in it, are set before :meth:`begin` is called.

    Args:
        parameters: An instance of the class's ``Parameters``; by default their defaults.

    Example:
        >>> class Dice(OneSubjectLearner):
        ...     def act(self, observation):
        ...         return int(self.generator.integers(self.brief.actions))
        >>> learner = PerSubjectAdapter(Dice)  # plays many subjects, each with its own Dice
    """

    Parameters: ClassVar[type] = NoParameters
    brief: Brief
    generator: np.random.Generator

    def __init__(self, parameters: Any = None) -> None:
        self.parameters = self.Parameters() if parameters is None else parameters

    def begin(self) -> None:
        """Get ready to play."""

    @abstractmethod
    def act(self, observation: Observations) -> int:
        """The action for what is seen: ``[2P + 2]`` of 0 and 1."""

    def learn(self, moment: Moment) -> None:
        """Take in what the action led to."""


class PerSubjectAdapter(Learner):
    """Plays B instances of a :class:`OneSubjectLearner` as one learner."""

    def __init__(self, single: type[OneSubjectLearner], parameters: Any = None) -> None:
        super().__init__(single.Parameters() if parameters is None else parameters)
        self.single = single
        self._players: list[OneSubjectLearner] = []

    def begin(self, brief: Brief) -> None:
        """Make one player for each subject."""
        self._players = []
        for generator in brief.generators:
            player = self.single(self.parameters)
            player.brief = replace(brief, subjects=1, generators=(generator,))
            player.generator = generator
            player.begin()
            self._players.append(player)

    def act(self, view: View) -> IntArray:
        """Ask each player that still plays."""
        # What a player writes into what it is shown must not change what it learns from.
        self._seen = view.observation.copy()
        actions = np.zeros(len(self._players), dtype=np.int64)
        for subject in np.flatnonzero(view.playing):
            answer = self._players[subject].act(view.observation[subject])
            try:
                actions[subject] = operator.index(answer)
            except TypeError:  # an array would round 2.7 off without a word
                raise LearnerError(
                    f"{self.single.__name__} has to answer with the index of an action, an "
                    f"integer, and answered {answer!r}"
                ) from None
        return actions

    def learn(self, step: Step) -> None:
        """Tell each player what its own action led to."""
        left = step.view.console.solutions_left - step.new_solution
        for subject in np.flatnonzero(step.view.playing):
            self._players[subject].learn(
                Moment(
                    observation=self._seen[subject],
                    action=int(step.action[subject]),
                    outcome=step.outcome[subject],
                    reward=float(step.reward[subject]),
                    attempt_over=bool(step.attempt_over[subject]),
                    trial_over=bool(step.trial_over[subject]),
                    new_solution=bool(step.new_solution[subject]),
                    solutions_left=int(left[subject]),
                )
            )

    @property
    def _kind(self) -> str:
        return f"players of {self.single.__module__}:{self.single.__qualname__}"

    def state_dict(self) -> dict[str, Any]:
        """Everything that the players hold, generators included, under seal."""
        players = pickle.dumps([vars(player) for player in self._players])
        return {"players": players, "seal": seal(players, self._kind)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Give each player back what it held.

        Raises:
            LearnerError: If this user has not made the state, with the same class.
        """
        players = state.get("players", b"")
        if not is_sealed(players, state.get("seal"), self._kind):
            raise LearnerError(
                f"what {self.single.__name__} held was not kept by this user on this machine, and "
                "to read it could run any program"
            )
        for player, kept in zip(self._players, pickle.loads(players), strict=True):
            vars(player).update(kept)

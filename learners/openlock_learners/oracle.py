"""The oracle: it knows the schema and the layout, and carries out the solutions.

The lower bound of every comparison: as many attempts as the room has solutions (two with the
paper's three levers, three with four). It takes the solutions one by one, pushes the next lever
that is not pushed yet, and then the door; where a push fails in a noisy room, it tries again.
"""

from __future__ import annotations

import numpy as np

from causal_openlock.contract.learner import Brief, InformedLearner, Truth, View
from causal_openlock.schemas.fsm import FloatArray


class Oracle(InformedLearner):
    """Carries out the known solutions, one after another."""

    def begin(self, brief: Brief) -> None:
        """Store the size of the room."""
        super().begin(brief)
        self._door = 2 * brief.positions
        self._plans = np.zeros((0, 0, 0), dtype=np.int64)
        self._room = np.zeros(brief.subjects, dtype=np.int64)

    def inform(self, truth: Truth) -> None:
        """Store the actions of each solution of each room."""
        self._room = truth.room
        if len(self._plans) == len(truth.rooms):
            return
        solutions = max(len(room.schema.solutions) for room in truth.rooms)
        length = max(len(levers) for room in truth.rooms for levers in room.schema.solutions)
        self._plans = np.full((len(truth.rooms), solutions, length + 1), self._door)
        for index, room in enumerate(truth.rooms):
            for which, levers in enumerate(room.schema.solutions):
                self._plans[index, which, : len(levers) + 1] = room.action_of(levers)

    def probabilities(self, view: View) -> FloatArray:
        """``[B, A]`` 1 for the next push of the current solution, and 0 for everything else."""
        # Solutions are carried out in order, so the number found is the index of the present one.
        present = np.minimum(view.console.solutions_found, self._plans.shape[1] - 1)
        plan = self._plans[self._room, present]
        everyone = np.arange(len(plan))[:, None]
        pushed = (plan < self._door) & (view.observation[everyone, plan % self._door] == 1)
        following = np.take_along_axis(plan, (~pushed).argmax(axis=1)[:, None], axis=1)[:, 0]
        return np.eye(self.brief.actions)[following]

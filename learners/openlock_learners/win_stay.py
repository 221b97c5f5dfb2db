"""Win-stay, lose-shift on pairs of levers: never repeat what failed, stay near what worked.

The oldest heuristic of trial and error (Robbins 1952; Nowak & Sigmund 1993), in the form that this
task takes it: an attempt pushes two levers, one after the other, and then the door. (Where attempts
have more actions, one lever less than actions.) In one room

* a sequence that was carried out is not carried out again, whether it failed (it would fail again)
  or opened the door (it would not count again); nor is one that would begin in the same way, where
  the lock opened before its end;
* after a success the next sequences keep as many levers in their places as possible, since a
  solution with one lever changed is the likeliest other solution;
* before the first success, sequences that worked in earlier rooms come first.

It knows neither causes nor roles, and learns nothing from which levers moved. When nothing
is left untried, as in a room that does not always obey, it starts over.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np

from causal_openlock.contract.learner import Brief, Learner, Step, View
from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray


class WinStay(Learner):
    """Never repeats a failed pair of levers, and stays near those that worked."""

    def begin(self, brief: Brief) -> None:
        """List all sequences of different levers."""
        super().begin(brief)
        self._positions = brief.positions
        length = min(brief.action_limit - 1, brief.positions)
        self._sequences = np.array([*permutations(range(brief.positions), length)])
        nothing = np.zeros((brief.subjects, len(self._sequences)), dtype=bool)
        self._tried, self._won, self._won_before = nothing, nothing.copy(), nothing.copy()
        self._same = ~nothing  # sequences that agree with what was done in the attempt
        self._place = np.zeros(brief.subjects, dtype=np.int64)  # actions of the attempt so far

    def _actions(self, view: View) -> IntArray:
        """``[B, C]`` what carrying out each sequence asks for now: its lever, or the door."""
        place = np.minimum(self._place, self._sequences.shape[1] - 1)
        door = (view.console.actions_left == 1) | (view.observation[:, -2] == 0)
        door |= self._place > place
        return np.where(door[:, None], 2 * self._positions, self._sequences[:, place].T)

    def probabilities(self, view: View) -> FloatArray:
        """``[B, A]`` averaged over the sequences that it may be carrying out."""
        positions, actions = self._positions, self._actions(view)
        found = np.zeros((len(actions), 2 * positions + 1))
        for subject in np.flatnonzero(view.playing).tolist():
            odds = self._odds(subject)
            # Another subject may have done what no sequence asks for; then any of them goes on.
            odds = odds & self._same[subject] if (odds & self._same[subject]).any() else odds
            found[subject] = np.bincount(actions[subject, odds], minlength=2 * positions + 1)
        return found / np.maximum(found.sum(axis=1, keepdims=True), 1.0)

    def _odds(self, subject: int) -> BoolArray:
        """``[C]`` the sequences to draw from."""
        if self._tried[subject].all():
            self._tried[subject] = self._won[subject]
        open_to_try = ~self._tried[subject]
        nearness = self._won_before[subject].astype(int)
        if self._won[subject].any():
            worked = self._sequences[self._won[subject]]
            same = (self._sequences[:, None] == worked).sum(axis=2)
            nearness = same.max(axis=1)
        best: BoolArray = open_to_try & (nearness == nearness[open_to_try].max(initial=0))
        return best if best.any() else np.ones_like(best)

    def learn(self, step: Step) -> None:
        """Note what was tried and what worked."""
        playing = step.view.playing
        self._same &= self._actions(step.view) == step.action[:, None]
        self._place = np.where(step.attempt_over, 0, self._place + 1)
        ended = np.flatnonzero(playing & step.attempt_over)
        self._tried[ended] |= self._same[ended]
        won = ended[step.new_solution[ended]]
        self._won[won] |= self._same[won]
        self._same[ended] = True
        over = np.flatnonzero(playing & step.trial_over)
        self._won_before[over] |= self._won[over]
        self._tried[over] = self._won[over] = False

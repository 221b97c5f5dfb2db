"""Replay of sequences of steps, for recurrent networks of B subjects at once.

The steps between two resets of the hidden state are a segment (a trial, or a whole condition), and
no sequence crosses the border of a segment: the network must not carry over in replay what it
forgot in play.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray

Floats = NDArray[np.float32]


class Sequences(NamedTuple):
    """M sequences for each of N agents: K steps of burn-in, U steps to learn from, and one more.

    Time is the second axis; the first step to learn from is in column K. A sequence that has fewer
    steps is padded with copies of that step, which ``burn_in_mask`` and ``mask`` leave out.
    """

    inputs: Floats  # [N, K + U + 1, M, in] what was perceived; the last is what follows step U
    state: Floats  # [N, M, S] hidden state before the first step that is there
    burn_in_mask: BoolArray  # [N, K, M] whether the step is there
    action: IntArray  # [N, U, M] what was done
    reward: Floats  # [N, U, M] what it earned
    not_done: Floats  # [N, U, M] 1 where the value of what follows counts, else 0
    mask: Floats  # [N, U, M] 1 where the step is there, else 0


class SequenceBuffer:
    """B rings of steps with the hidden state before each, so that any step can begin a sequence.

    A ring holds ``capacity`` steps; a new one then overwrites the oldest. Sequences have K steps of
    ``burn_in`` and U, ``unroll``, to learn from. ``inputs`` and ``state`` are how many numbers are
    perceived at a time, and in a hidden state.
    """

    def __init__(
        self, subjects: int, capacity: int, burn_in: int, unroll: int, inputs: int, state: int
    ) -> None:
        self.capacity, self.burn_in, self.unroll = capacity, burn_in, unroll
        self.count: IntArray = np.zeros(subjects, dtype=np.int64)  #: ``[B]`` steps ever added
        self._segment: IntArray = np.zeros(subjects, dtype=np.int64)
        self._begins = np.zeros((subjects, capacity), dtype=np.int64)
        self._inputs = np.zeros((subjects, capacity, inputs), dtype=np.float32)
        self._state = np.zeros((subjects, capacity, state), dtype=np.float32)
        self._action = np.zeros((subjects, capacity), dtype=np.int64)
        self._reward = np.zeros((subjects, capacity), dtype=np.float32)
        self._not_done = np.zeros((subjects, capacity), dtype=np.float32)

    def add(
        self,
        playing: BoolArray,
        inputs: Floats,
        state: Floats,
        action: IntArray,
        reward: FloatArray,
        not_done: BoolArray,
        resets: BoolArray,
    ) -> None:
        """Add one step for each subject that is ``playing``, with the hidden state before it.

        Arguments are ``[B]``. Where the hidden state ``resets`` after the step, ``not_done`` must
        be false.
        """
        who = np.flatnonzero(playing)
        slot = self.count[who] % self.capacity
        self._begins[who, slot] = self._segment[who]
        self._inputs[who, slot] = inputs[who]
        self._state[who, slot] = state[who]
        self._action[who, slot] = action[who]
        self._reward[who, slot] = reward[who]
        self._not_done[who, slot] = not_done[who]
        self.count[who] += 1
        self._segment[resets] = self.count[resets]

    def sample(self, uniform: FloatArray) -> Sequences:
        """Sequences drawn with replacement, for each subject from its own ring.

        A step is drawn, and then its place in the sequence, by ``[B, 2 M]`` numbers in [0, 1). The
        newest step is never learned from, since what follows it is not known yet.
        """
        which, where = np.split(uniform, 2, axis=1)
        # Steps are numbered from a subject's first, and are in the ring at their remainder.
        newest = self.count[:, None] - 1
        oldest = np.maximum(self.count[:, None] - self.capacity, 0)
        drawn = oldest + (which * np.maximum(newest - oldest, 0)).astype(np.int64)
        segment = np.take_along_axis(self._begins, drawn % self.capacity, axis=1)
        first = np.maximum(segment, oldest)
        start = np.maximum(drawn - (where * self.unroll).astype(np.int64), first)

        subject = np.arange(len(self.count))[:, None, None]
        step = start[:, None] + np.arange(-self.burn_in, self.unroll + 1)[None, :, None]
        inside = (
            (step >= first[:, None])
            & (step <= newest[:, None])
            & (self._begins[subject, step % self.capacity] == segment[:, None])
        )
        slot = np.where(inside, step, start[:, None]) % self.capacity
        learned = slot[:, self.burn_in : -1]
        begins = np.maximum(start - self.burn_in, first) % self.capacity
        return Sequences(
            inputs=self._inputs[subject, slot],
            state=self._state[subject[:, 0], begins],
            burn_in_mask=inside[:, : self.burn_in],
            action=self._action[subject, learned],
            reward=self._reward[subject, learned],
            not_done=self._not_done[subject, learned],
            mask=(inside & (step < newest[:, None]))[:, self.burn_in : -1].astype(np.float32),
        )

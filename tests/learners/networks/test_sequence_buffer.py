"""Sequences for replay: whole, in order, and never across a reset of the memory."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from openlock_learners.networks.sequence_buffer import SequenceBuffer


@settings(max_examples=60, deadline=None)
@given(
    lengths=st.lists(st.integers(1, 12), min_size=1, max_size=6),
    open_end=st.integers(0, 9),
    capacity=st.integers(8, 40),
    burn_in=st.integers(0, 3),
    unroll=st.integers(1, 4),
)
def test_sequences_never_cross_a_reset(lengths, open_end, capacity, burn_in, unroll):
    segments = np.repeat(np.arange(len(lengths) + 1), [*lengths, open_end])
    total = len(segments)
    replay = SequenceBuffer(2, capacity, burn_in, unroll, 1, 1)
    for step, segment in enumerate(segments):
        last = step + 1 < total and segments[step + 1] != segment
        last |= open_end == 0 and step == total - 1
        for who in (0, 1):  # Inputs tell the step; states tell the step from the other end.
            number = np.array([[step + 1000 * who]], dtype=np.float32)
            not_done, resets = np.array([not last]), np.array([last])
            replay.add(np.array([who]), number, -number, *([[step]] * 2), not_done, resets)
    drawn = np.random.default_rng(0).random((2, 2 * 300))
    batch = replay.sample(drawn)
    learned = set()
    for who, sequence in np.ndindex(2, 300 if total > 1 else 0):
        seen = batch.inputs[who, :, sequence, 0].astype(int) - 1000 * who
        start = seen[burn_in]
        burns = seen[:burn_in][batch.burn_in_mask[who, :, sequence]].tolist()
        counts = batch.mask[who, :, sequence] == 1
        learns = seen[burn_in:-1][counts].tolist()
        # All of it is of one segment, remembered, in order, and whole on both sides.
        oldest = max(0, total - capacity)
        assert set(segments[seen]) == {segments[start]}
        assert seen.min() >= oldest
        assert seen.max() < total
        assert [*burns, *learns] == list(range(start - len(burns), start + len(learns)))
        before = np.flatnonzero(segments[oldest:start] == segments[start])
        assert len(burns) == min(burn_in, len(before))
        after = np.flatnonzero(segments[start : total - 1] == segments[start])
        assert len(learns) == min(unroll, len(after)) > 0
        assert batch.state[who, sequence, 0] == -(start - len(burns) + 1000 * who)
        assert batch.action[who, counts, sequence].tolist() == learns
        # Where there is a value after a step, the input that follows is there.
        for at in np.flatnonzero(batch.not_done[who, :, sequence] * counts):
            assert seen[burn_in + at + 1] == seen[burn_in + at] + 1
        learned.update(learns)
    # Every step that is remembered is learned from, but for the newest.
    assert total == 1 or learned == set(range(max(0, total - capacity), total - 1))

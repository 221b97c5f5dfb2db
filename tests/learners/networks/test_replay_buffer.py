"""What is remembered: rings of transitions, numbered observations, and whole sequences."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from openlock_learners.networks.replay_buffer import Batch, ObservationTable, ReplayBuffer
from openlock_learners.networks.sequence_buffer import SequenceBuffer


def filled(replay, many):
    """Transition *t* of subject *s* is marked 100 s + t in every column."""
    who = np.arange(len(replay.length))
    for t in range(many):
        mark = 100 * who + t
        even = np.full(len(who), t % 2 == 0)
        replay.add(who, Batch(mark, mark, mark, mark.astype(float), even))
    return replay


def test_a_full_ring_overwrites_its_oldest_transition():
    assert filled(ReplayBuffer(2, 5), many=3).length.tolist() == [3, 3]
    replay = filled(ReplayBuffer(2, 5), many=12)
    assert replay.length.tolist() == [5, 5]
    before, action, after, reward, not_done = replay.rings
    assert sorted(before[1].tolist()) == [107, 108, 109, 110, 111]
    for column in (action, reward, after):
        assert np.array_equal(column, before)
    assert np.array_equal(not_done, before % 2 == 0)


def test_samples_are_uniform_and_from_the_ring_of_the_subject():
    replay = filled(ReplayBuffer(3, 8), many=5)
    luck = np.random.default_rng(0).random((3, 20_000))
    before, action, reward, after, not_done = replay.sample(luck)
    for subject in range(3):
        marks, counts = np.unique(before[subject], return_counts=True)
        assert marks.tolist() == [100 * subject + t for t in range(5)]
        assert ((counts - 4000) ** 2 / 4000).sum() < 18.5  # chi-square of 4 degrees: p = .001
    for column in (action, reward, after):
        assert np.array_equal(column, before)
    assert np.array_equal(not_done, before % 2 == 0)
    edge = replay.sample(np.full((3, 1), np.nextafter(1.0, 0.0)))[0]
    assert edge[:, 0].tolist() == [4, 104, 204]


def test_observations_are_numbered_in_order_of_appearance():
    table = ObservationTable(4)
    a, b, c = np.array([[0, 0, 0, 0], [1, 0, 0, 1], [1, 0, 0, 0]], dtype=np.int8)
    assert table.number(np.stack([b, a, b])).tolist() == [0, 1, 0]
    assert table.number(np.stack([a, c, c, b])).tolist() == [1, 2, 2, 0]
    assert table.number(np.zeros((0, 4), dtype=np.int8)).tolist() == []
    assert table.rows.tolist() == [b.tolist(), a.tolist(), c.tolist()]


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
        # Inputs tell the step; states tell the step from the other end.
        number = np.array([[step], [step + 1000]], dtype=np.float32)
        both, ends = np.full(2, step), np.full(2, last)
        replay.add(np.ones(2, dtype=bool), number, -number, both, both, ~ends, ends)
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

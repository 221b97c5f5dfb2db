"""What is remembered: rings of transitions, by what they are drawn, and numbered observations."""

import numpy as np

from openlock_learners.networks.replay_buffer import ObservationTable, ReplayBuffer


def filled(replay, many):
    """Transition *t* of subject *s* is marked 100 s + t in every column."""
    who = np.arange(len(replay.length))
    for t in range(many):
        mark = 100 * who + t
        replay.add(who, mark, mark, mark.astype(float), mark, np.full(len(who), t % 2 == 0))
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

"""What is remembered: rings of transitions, and by what they are drawn."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from openlock_learners.networks.replay_buffer import (
    ObservationTable,
    PrioritisedReplayBuffer,
    ReplayBuffer,
)
from support.checkpoints import same


def filled(
    subjects: int, capacity: int, many: int, replay: ReplayBuffer | None = None
) -> ReplayBuffer:
    """Transition *t* of subject *s* is marked 100 s + t in every column."""
    replay = replay or ReplayBuffer(subjects, capacity)
    who = np.arange(subjects)
    for t in range(many):
        mark = 100 * who + t
        replay.add(who, mark, mark, mark.astype(float), mark, np.full(subjects, t % 2 == 0))
    return replay


def test_a_full_ring_overwrites_its_oldest_transition() -> None:
    replay = filled(2, capacity=5, many=3)
    assert replay.length.tolist() == [3, 3]
    replay = filled(2, capacity=5, many=12)
    assert replay.length.tolist() == [5, 5]
    before, action, after, reward, not_done = replay.rings
    assert sorted(before[1].tolist()) == [107, 108, 109, 110, 111]
    for column in (action, reward, after):
        assert np.array_equal(column, before)
    assert np.array_equal(not_done, before % 2 == 0)


def test_rings_fill_each_at_its_own_pace() -> None:
    replay = ReplayBuffer(3, 4)
    for t in range(6):
        who = np.array([0, 2]) if t < 3 else np.array([2])
        replay.add(who, who * 10 + t, who, who.astype(float), who, who > 0)
    assert replay.length.tolist() == [3, 0, 4]
    assert replay.rings[0].tolist() == [[0, 1, 2, 0], [0, 0, 0, 0], [24, 25, 22, 23]]
    late = replay.sample(np.full((3, 1), 0.99))[0]
    assert late[:, 0].tolist() == [2, 0, 23]


def test_samples_are_uniform_and_from_the_subject_s_own_ring() -> None:
    replay = filled(3, capacity=8, many=5)
    luck = np.random.default_rng(0).random((3, 20_000))
    before, action, reward, after, not_done, weight, slot = replay.sample(luck)
    assert (weight == 1).all()
    assert (np.take_along_axis(replay.rings[0], slot, axis=1) == before).all()
    for subject in range(3):
        marks, counts = np.unique(before[subject], return_counts=True)
        assert marks.tolist() == [100 * subject + t for t in range(5)]
        assert ((counts - 4000) ** 2 / 4000).sum() < 18.5  # chi-square of 4 degrees: p = .001
    for column in (action, reward, after):
        assert np.array_equal(column, before)
    assert np.array_equal(not_done, before % 2 == 0)
    edge = replay.sample(np.full((3, 1), np.nextafter(1.0, 0.0)))[0]
    assert edge[:, 0].tolist() == [4, 104, 204]


# -- priorities -----------------------------------------------------------------------------------


def prioritised(priorities: list[list[float]], alpha: float = 1.0) -> PrioritisedReplayBuffer:
    """A ring for each list, as if its errors had been these."""
    errors = np.array(priorities)
    subjects, many = errors.shape
    replay = PrioritisedReplayBuffer(subjects, many + 3, alpha)
    filled(subjects, many + 3, many, replay)
    slots = np.tile(np.arange(many), (subjects, 1))
    replay.update_priorities(slots, errors, np.ones(subjects, dtype=bool))
    return replay


@pytest.mark.parametrize("alpha", [0.0, 0.5, 1.0])
def test_transitions_are_drawn_in_proportion_to_their_priorities(alpha: float) -> None:
    errors = np.array([[1.0, -4.0, 0.0, 9.0], [2.0, 2.0, 2.0, -2.0]])
    replay = prioritised(errors.tolist(), alpha)
    luck = np.random.default_rng(0).random((2, 40_000))
    before = replay.sample(luck).before
    for subject in range(2):
        expected = np.abs(errors[subject]) ** alpha
        counts = np.bincount(before[subject] - 100 * subject, minlength=4)
        assert len(counts) == 4  # nothing from the places that are still empty
        # Drawn by strata, they differ from what is expected by less than one draw in a border.
        assert counts == pytest.approx(40_000 * expected / expected.sum(), abs=12)


def test_one_transition_comes_from_each_part_of_the_priorities() -> None:
    replay = prioritised([[1.0, 1.0, 1.0, 5.0]])
    for luck in (0.01, 0.5, 0.99):
        drawn = replay.sample(np.full((1, 8), luck)).slot[0].tolist()
        assert drawn == [0, 1, 2, 3, 3, 3, 3, 3]


def test_importance_weights_undo_the_bias() -> None:
    replay = prioritised([[1.0, 3.0, 4.0, 8.0]])
    luck = np.full((1, 16), 0.5)
    chance = np.array([1, 3, 4, 8]) / 16
    for beta in (0.0, 0.4, 1.0):
        batch = replay.sample(luck, beta)
        weights = (4 * chance) ** -beta
        expected = (weights / weights.max())[batch.slot[0]]
        assert batch.weight[0] == pytest.approx(expected, rel=1e-5)
    # With beta 1, what is drawn more often counts by so much less: sums are those of all alike.
    weight = replay.sample(np.full((1, 1600), 0.5), 1.0)
    sums = np.bincount(weight.slot[0], weight.weight[0], minlength=4)
    assert sums == pytest.approx([100.0] * 4, rel=1e-4)


def test_beta_may_differ_between_subjects() -> None:
    replay = prioritised([[1.0, 3.0], [1.0, 3.0]])
    weight = replay.sample(np.full((2, 4), 0.5), np.array([0.0, 1.0])).weight
    assert weight[0].tolist() == [1.0] * 4
    assert weight[1].tolist() == pytest.approx([1.0] + [1 / 3] * 3, rel=1e-5)


def test_a_new_transition_has_the_highest_priority_so_far() -> None:
    replay = prioritised([[1.0, 6.0], [1.0, 0.5]])
    who = np.array([0, 1])
    replay.update_priorities(np.array([[1], [1]]), np.ones((2, 1)), np.array([True, False]))
    replay.add(who, who, who, who.astype(float), who, who > 0)
    assert replay.priority[:, 2].tolist() == pytest.approx([6.0, 1.0], rel=1e-5)
    assert replay.priority[:, 1].tolist() == pytest.approx([1.0, 0.5], rel=1e-5)


def test_a_loaded_memory_draws_the_same() -> None:
    replay = prioritised([[1.0, 6.0, 2.0]], 0.6)
    other = PrioritisedReplayBuffer(1, 6, 0.6)
    kept = replay.state_dict()
    other.load_state_dict(kept)
    luck = np.random.default_rng(1).random((1, 64))
    assert same(tuple(replay.sample(luck)), tuple(other.sample(luck)))
    filled(1, 6, 2, other)
    other.update_priorities(np.array([[0]]), np.ones((1, 1)) * 50, np.array([True]))
    assert same(kept, replay.state_dict())


# -- observations ---------------------------------------------------------------------------------


def test_the_table_numbers_observations_in_order_of_appearance() -> None:
    table = ObservationTable(4)
    a, b, c = np.array([[0, 0, 0, 0], [1, 0, 0, 1], [1, 0, 0, 0]], dtype=np.int8)
    assert table.number(np.stack([b, a, b])).tolist() == [0, 1, 0]
    assert table.number(np.stack([a, c, c, b])).tolist() == [1, 2, 2, 0]
    assert table.number(np.zeros((0, 4), dtype=np.int8)).tolist() == []
    assert table.rows.tolist() == [b.tolist(), a.tolist(), c.tolist()]
    kept = copy.deepcopy(table.state_dict())
    other = ObservationTable(4)
    other.load_state_dict(table.state_dict())
    assert other.number(np.stack([c, a ^ 1])).tolist() == [2, 3]
    assert same(table.state_dict(), kept)


def test_a_state_and_an_action_with_two_rewards_differ() -> None:
    replay = ReplayBuffer(3, 6)
    # Of two subjects the same pairs; the first is paid alike for each, the second not for (0, 1).
    for before, action, first, second in [
        (0, 1, 60, 60),
        (0, 2, 0, 0),
        (1, 1, 5, 5),
        (0, 1, 60, 0),
    ]:
        who, of = np.arange(2), np.full(2, before)
        paid = np.array([first, second], dtype=float)
        replay.add(who, of, np.full(2, action), paid, of, np.ones(2, dtype=bool))
    pairs, transitions = replay.differing()
    assert pairs.tolist() == [0, 1 / 3, 0]
    assert transitions.tolist() == [0, 2 / 4, 0]


def test_what_was_overwritten_differs_no_more() -> None:
    replay = ReplayBuffer(1, 2)
    one, done = np.zeros(1, dtype=np.int64), np.ones(1, dtype=bool)
    for reward, share in [(60.0, 0.0), (0.0, 1.0), (0.0, 0.0)]:
        replay.add(one, one, one, np.array([reward]), one, done)
        assert replay.differing().tolist() == [[share], [share]]

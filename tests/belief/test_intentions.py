"""What a subject may intend: all that it could draw, and what is left after what it did."""

import pytest

from causal_openlock.belief.intentions import Intentions
from causal_openlock.belief.planning import Situation


def at(pushed, unlocked=False):
    return Situation(pushed, unlocked, left=3 - pushed.bit_count(), found=())


def test_what_was_done_tells_what_is_intended():
    plans = [(0.5, (0, 1)), (0.3, (0, 2)), (0.2, (1, 0))]
    mind = Intentions(lapse=0.0, actions=15)
    assert mind.next(at(0b000), 7, lambda: plans)[:2] == pytest.approx([0.8, 0.2])
    mind.acted(0, over=False)
    odds = mind.next(at(0b001), 7, lambda: plans)
    assert odds[[1, 2]] == pytest.approx([5 / 8, 3 / 8])
    mind.acted(1, over=False)
    assert mind.next(at(0b011, unlocked=True), 7, lambda: plans)[7] == 1  # the door
    mind.acted(7, over=True)
    assert mind.next(at(0b000), 7, lambda: plans)[:2] == pytest.approx([0.8, 0.2])


def test_a_plan_fails_where_a_lever_does_not_move_and_without_one_any_is_pushed():
    mind = Intentions(lapse=0.0, actions=15)
    mind.next(at(0), 7, lambda: [(1.0, (0, 1))])
    mind.acted(0, over=False)
    assert mind.next(at(0), 7, lambda: [(1.0, (3, 4))])[3] == 1
    assert mind.next(at(0), 7, lambda: [(1.0, None)]).tolist() == [1 / 7] * 7 + [0.0]


def test_a_lapse_leaves_the_intention_as_it_is():
    plans = [(0.5, (0, 1)), (0.5, (2, 1))]
    mind = Intentions(lapse=0.15, actions=15)
    mind.next(at(0b000), 7, lambda: plans)
    mind.acted(0, over=False)
    # Lever 0 was meant with .85 / 2, and pushed in a lapse with .01, whatever is meant.
    meant, lapsed = 0.85 * 0.5, 0.01
    odds = mind.next(at(0b001), 7, lambda: [(0.5, (3,)), (0.5, (2, 1))])
    share = meant / (meant + lapsed)
    # After a lapse nothing is carried out yet, and a plan is drawn anew.
    assert odds[1] == pytest.approx(share)
    assert odds[[2, 3]].sum() == pytest.approx(1 - share)

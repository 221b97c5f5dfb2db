"""Intentions: drawn as probable as they are, new, in time, and in an order that works."""

import math
from collections import defaultdict
from functools import cache

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from causal_openlock.belief.hypotheses import RoomSight, enumerate_space, strengths
from causal_openlock.belief.intentions import Intentions, drawn_solutions
from causal_openlock.belief.planning import Situation
from causal_openlock.belief.structures import Hypotheses
from oracle import DOOR
from support.belief_arrays import lever_set, mask, rules_in

START = Situation(pushed=0, unlocked=False, left=3, found=())


@cache
def hypotheses():
    return enumerate_space(RoomSight(7, 4, 3, 3), strengths(0.0), math.log(2.0)).hypotheses


def some(count, seed):
    """Some hypotheses about a room and how probable they are."""
    every, rng = hypotheses(), np.random.default_rng(seed)
    chosen = rng.choice(len(every), size=count, replace=False)
    return every[np.sort(chosen)], rng.dirichlet(np.full(count, 0.7))


def drawn(*situation, by_weight=True):
    """The plans that may be drawn, with their probabilities."""
    return {plan: chance for chance, plan in drawn_solutions(*situation, by_weight)}


def situation_in(hypotheses, index, at):
    """Rules, what stands pushed, and what was found; levers that the rules lack left out."""
    rules = rules_in(hypotheses, index)
    active = frozenset(rules.levers)
    return (
        rules,
        lever_set(at.pushed) & active,
        frozenset(lever_set(levers) & active for levers in at.found),
    )


def completed(hypotheses, index, at):
    """The new solutions that can still be completed, by pushing everything in every order."""
    rules, start, found = situation_in(hypotheses, index, at)
    done = set()

    def go_on(pushed, left):
        if left and any(seen.new for seen in rules.outcomes(pushed, DOOR, found)):
            done.add(rules.solution(pushed))
        for slot in set(rules.levers) - pushed if left > 1 else ():
            if rules.holds(slot, pushed):
                go_on(pushed | {slot}, left - 1)

    go_on(start, at.left)
    return done


def carried_out(hypotheses, index, at, order):
    """Whether pushing these levers and then the door brings a new solution in time."""
    rules, pushed, found = situation_in(hypotheses, index, at)
    for slot in order:
        if slot in pushed or not rules.holds(slot, pushed):
            return False
        pushed |= {slot}
    seen = rules.outcomes(pushed, DOOR, found)
    return len(order) < at.left and any(outcome.new for outcome in seen)


@st.composite
def situations(draw):
    """A belief, and an attempt that has begun in a way that some hypothesis explains."""
    hypotheses, weight = some(draw(st.integers(1, 12)), draw(st.integers(0, 10_000)))
    own = draw(st.integers(0, len(weight) - 1))
    rules, pushed = rules_in(hypotheses, own), frozenset()
    found = draw(st.lists(st.sampled_from(hypotheses.solutions[own].tolist()), max_size=2))
    steps = draw(st.lists(st.sampled_from(rules.levers), max_size=2))
    for slot in steps:
        pushed |= {slot} if rules.holds(slot, pushed) else set()
    left = draw(st.integers(1, 3 - len(steps)))
    at = Situation(mask(pushed), rules.holds(DOOR, pushed), left, tuple(found))
    return hypotheses, weight, at


@settings(max_examples=100, deadline=None)
@given(situations(), st.booleans())
def test_solutions_are_drawn_as_probable_as_they_are_and_work(situation, by_weight):
    hypotheses, weight, at = situation
    weight[1::4] = 0.0  # who forgets keeps what is ruled out for the rest of the attempt
    able = [completed(hypotheses, index, at) if w else set() for index, w in enumerate(weight)]
    assume(any(able))
    pushed, expected, plans = lever_set(at.pushed), defaultdict(float), defaultdict(float)
    if by_weight:
        total = sum(w for w, goals in zip(weight, able, strict=True) if goals)
        for w, goals in zip(weight, able, strict=True):
            for goal in goals:
                expected[goal - pushed] += w / total / len(goals)
    else:
        allowed = set().union(*able)
        for goal in allowed:
            expected[goal - pushed] += 1 / len(allowed)
    for plan, chance in drawn(hypotheses, weight, at, by_weight=by_weight).items():
        plans[frozenset(plan)] += chance
        assert any(
            carried_out(hypotheses, index, at, plan)
            and any(set(plan) == goal - pushed for goal in goals)
            for index, goals in enumerate(able)
        )
    assert plans == pytest.approx(expected)


def test_in_which_order_is_up_to_the_hypotheses_that_allow_it():
    """Levers 0 and 1 solve under both hypotheses, in either order."""
    threshold = np.full((2, 8), 15, dtype=np.uint8)
    threshold[:, 7] = 1
    threshold[0, :2], threshold[1, :2] = (0, 1), (1, 0)
    causes = np.zeros((2, 8), dtype=np.uint16)
    causes[0, [1, 7]] = 1, 2
    causes[1, [0, 7]] = 2, 1
    inert, solutions = np.full(2, 0b1111100, np.uint16), np.full((2, 1), 3, np.uint16)
    both = Hypotheses(causes, threshold, inert, solutions, np.zeros(2, dtype=np.uint8))
    plans = drawn(both, np.array([0.25, 0.75]), START, by_weight=False)
    assert plans == pytest.approx({(0, 1): 0.25, (1, 0): 0.75})


@pytest.mark.parametrize("by_weight", [True, False])
def test_what_does_not_fit_any_more_is_begun_and_where_nothing_is_left_nothing_is(by_weight):
    hypotheses, weight = some(5, 2)
    late = Situation(0, False, 1, ())
    assert not any(completed(hypotheses, index, late) for index in range(5))
    for plan in drawn(hypotheses, weight, late, by_weight=by_weight):
        assert mask(plan) in hypotheses.solutions
    single, sure = some(1, 2)
    done = Situation(0, False, 3, tuple(single.solutions[0].tolist()))
    assert drawn(single, sure, done, by_weight=by_weight) == {None: 1.0}
    nothing = hypotheses[np.zeros(0, dtype=np.int64)]
    assert drawn(nothing, np.zeros(0), START, by_weight=by_weight) == {None: 1.0}


# -- what a subject may intend --------------------------------------------------------------------


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

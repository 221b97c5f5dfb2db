"""Intentions: drawn as probable as they are, new, in time, and in an order that works."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from functools import cache

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from causal_openlock.belief.hypotheses import RoomSight, enumerate_space, strengths
from causal_openlock.belief.planning import Situation, sample_solution
from causal_openlock.belief.structures import Hypotheses
from causal_openlock.schemas.fsm import FloatArray
from support.belief_by_hand import World

ROOM, LONG = RoomSight(7, 4, 3, 3), RoomSight(7, 3, 1, 5)
START = Situation(pushed=0, unlocked=False, left=3, found=())


@cache
def hypotheses_of(sight: RoomSight) -> Hypotheses:
    return enumerate_space(sight, strengths(0.0, 1.0, 1.0, 1), math.log(2.0), 20_000).hypotheses


def some(count: int, seed: int, sight: RoomSight = ROOM) -> tuple[Hypotheses, FloatArray]:
    """Some hypotheses about a room and how probable they are."""
    every = hypotheses_of(sight)
    rng = np.random.default_rng(seed)
    chosen = rng.choice(len(every), size=count, replace=False)
    return every[np.sort(chosen)], rng.dirichlet(np.full(count, 0.7))


def levers(mask: int) -> frozenset[int]:
    return frozenset(slot for slot in range(7) if mask >> slot & 1)


def completed(hypotheses: Hypotheses, index: int, situation: Situation) -> set[frozenset[int]]:
    """The new solutions that can still be completed, by pushing everything in every order."""
    world = World.of(hypotheses, index)
    fsm = world.fsm
    done: set[frozenset[int]] = set()

    def go_on(pushed: int, left: int) -> None:
        if left and fsm.unlocked[world.state(pushed)]:
            outcomes = world.outcomes(pushed, -1, situation.found)
            if any(outcome.new for outcome in outcomes):
                door_at = fsm.next_state[world.state(pushed), 2 * fsm.levers]
                number = fsm.solution[door_at]
                names = fsm.schema.solutions[number]
                done.add(frozenset(world.slots[fsm.schema.levers.index(name)] for name in names))
        for slot in world.slots if left > 1 else ():
            if not pushed >> slot & 1:
                for outcome in world.outcomes(pushed, slot, ()):
                    if outcome.took_effect:
                        go_on(outcome.pushed, left - 1)

    go_on(situation.pushed, situation.left)
    return done


def carried_out(hypotheses: Hypotheses, index: int, situation: Situation, order) -> bool:
    """Whether pushing these levers and then the door brings a new solution in time."""
    world = World.of(hypotheses, index)
    pushed = situation.pushed
    for slot in order:
        (outcome,) = world.outcomes(pushed, slot, ())
        if not outcome.took_effect:
            return False
        pushed = outcome.pushed
    state = world.state(pushed)
    if len(order) >= situation.left or not world.fsm.unlocked[state]:
        return False
    return any(outcome.new for outcome in world.outcomes(pushed, -1, situation.found))


@st.composite
def situations(draw: st.DrawFn) -> tuple[Hypotheses, FloatArray, Situation]:
    """A belief, and an attempt that has begun in a way that some hypothesis explains."""
    hypotheses, weight = some(draw(st.integers(1, 12)), draw(st.integers(0, 10_000)))
    own = draw(st.integers(0, len(weight) - 1))
    world = World.of(hypotheses, own)
    found = draw(st.lists(st.sampled_from(hypotheses.solutions[own].tolist()), max_size=2))
    pushed = 0
    steps = draw(st.lists(st.sampled_from(world.slots), max_size=2))
    for slot in steps:
        if not pushed >> slot & 1:
            pushed = max(outcome.pushed for outcome in world.outcomes(pushed, slot, ()))
    unlocked = bool(world.fsm.unlocked[world.state(pushed)])
    left = draw(st.integers(1, 3 - len(steps)))
    return hypotheses, weight, Situation(pushed, unlocked, left, tuple(found))


NUMBERS = st.floats(0, 1, exclude_max=True)


@settings(max_examples=150, deadline=None)
@given(situations(), NUMBERS, NUMBERS, st.booleans())
def test_what_is_intended_works_if_a_hypothesis_is_right(given_, one, other, by_weight):
    hypotheses, weight, situation = given_
    possible = [completed(hypotheses, index, situation) for index in range(len(weight))]
    assume(any(possible))
    order = sample_solution(hypotheses, weight, situation, (one, other), by_weight)
    assert order is not None
    assert any(
        carried_out(hypotheses, index, situation, order) and goal >= set(order)
        for index, goals in enumerate(possible)
        for goal in goals
    )


@settings(max_examples=60, deadline=None)
@given(situations(), NUMBERS, NUMBERS, st.booleans())
def test_what_can_be_done_is_done_in_the_order_of_the_one_hypothesis_held(
    given_, one, other, by_weight
):
    hypotheses, _, situation = given_
    alone = hypotheses[np.array([0])]
    goals = completed(alone, 0, situation)
    order = sample_solution(alone, np.ones(1), situation, (one, other), by_weight)
    if goals:
        assert order is not None
        assert any(set(order) == goal - levers(situation.pushed) for goal in goals)
        assert carried_out(alone, 0, situation, order)


def test_three_levers_one_after_another_are_pushed_in_their_order():
    hypotheses, _ = some(300, 0, LONG)
    orders = set()
    for index in np.flatnonzero(np.bitwise_count(hypotheses.solutions[:, 0]) == 3).tolist():
        alone = hypotheses[np.array([index])]
        situation = Situation(0, False, 5, ())
        order = sample_solution(alone, np.ones(1), situation, (0.3, 0.3), True)
        assert order is not None
        assert carried_out(alone, 0, situation, order)
        orders.add(order)
    assert len(orders) > 20
    assert any(list(order) != sorted(order) for order in orders)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("found", [0, 1])
def test_thompson_draws_hypotheses_as_probable_as_they_are(seed, found):
    hypotheses, weight = some(8, seed)
    known = (int(hypotheses.solutions[3, 1]),) * found
    situation = Situation(0, False, 3, known)
    exact: dict[frozenset[int], float] = defaultdict(float)
    able = [completed(hypotheses, index, situation) for index in range(8)]
    total = sum(w for w, goals in zip(weight, able, strict=True) if goals)
    for w, goals in zip(weight, able, strict=True):
        for goal in goals:
            exact[goal] += w / total / len(goals)
    steps = 400  # one number decides the hypothesis, the other its solution
    drawn: Counter[frozenset[int]] = Counter()
    for i in range(steps):
        for j in range(6):  # 1, 2 or 3 solutions are left, which 6 divides
            draws = ((i + 0.5) / steps, (j + 0.5) / 6)
            order = sample_solution(hypotheses, weight, situation, draws, by_weight=True)
            assert order is not None
            drawn[frozenset(order)] += 1
    assert set(drawn) <= set(exact)
    assert levers(known[0]) not in drawn if found else True
    for goal, p in exact.items():
        # A step of a ladder can be off by one draw at either end, for each hypothesis.
        assert drawn[goal] / (6 * steps) == pytest.approx(p, abs=8 / steps)


@pytest.mark.parametrize("seed", range(3))
def test_any_consistent_solution_is_as_probable_as_any_other(seed):
    hypotheses, weight = some(10, seed)
    known = (int(hypotheses.solutions[3, 1]),)
    situation = Situation(0, False, 3, known)
    allowed = set().union(*(completed(hypotheses, index, situation) for index in range(10)))
    steps = 50 * len(allowed)
    drawn = Counter(
        frozenset(
            sample_solution(hypotheses, weight, situation, ((i + 0.5) / steps, 0.4), False) or ()
        )
        for i in range(steps)
    )
    assert drawn == dict.fromkeys(allowed, 50)


def test_in_which_order_is_up_to_the_hypotheses_that_allow_it():
    """Levers 0 and 1 solve under both hypotheses, in either order."""
    threshold = np.full((2, 8), 15, dtype=np.uint8)
    threshold[:, 7] = 1
    threshold[0, :2], threshold[1, :2] = (0, 1), (1, 0)
    causes = np.zeros((2, 8), dtype=np.uint16)
    causes[0, [1, 7]] = 1, 2
    causes[1, [0, 7]] = 2, 1
    both = Hypotheses(
        causes,
        threshold,
        np.array([0b1111100, 0b1111100], dtype=np.uint16),
        np.array([[3], [3]], dtype=np.uint16),
        np.zeros(2, dtype=np.uint8),
    )
    weight = np.array([0.25, 0.75])
    for i in range(100):
        order = sample_solution(both, weight, START, (0.5, (i + 0.5) / 100), by_weight=False)
        assert order == ((0, 1) if i < 25 else (1, 0))


@pytest.mark.parametrize("by_weight", [True, False])
def test_what_is_impossible_is_never_intended(by_weight):
    """Who forgets keeps hypotheses that are ruled out for the rest of the attempt."""
    hypotheses, weight = some(10, 1)
    weight[[0, 4, 7, 9]] = 0.0
    kept = weight > 0
    allowed = set().union(
        *(completed(hypotheses, index, START) for index in np.flatnonzero(kept).tolist())
    )
    for one in np.linspace(0, 1, 60, endpoint=False).tolist():
        for other in (0.0, 0.3, 0.99):
            order = sample_solution(hypotheses, weight, START, (one, other), by_weight)
            assert frozenset(order or ()) in allowed
            alone = sample_solution(hypotheses[kept], weight[kept], START, (one, other), by_weight)
            assert order == alone


@pytest.mark.parametrize("by_weight", [True, False])
def test_what_does_not_fit_any_more_is_begun_all_the_same(by_weight):
    hypotheses, weight = some(5, 2)
    late = Situation(0, False, 1, ())
    assert not any(completed(hypotheses, index, late) for index in range(5))
    order = sample_solution(hypotheses, weight, late, (0.5, 0.5), by_weight)
    assert order
    assert frozenset(order) in set(map(levers, hypotheses.solutions.ravel().tolist()))


@pytest.mark.parametrize("by_weight", [True, False])
def test_where_nothing_is_left_nothing_is_intended(by_weight):
    hypotheses, weight = some(1, 2)
    found = tuple(hypotheses.solutions[0].tolist())
    done = Situation(0, False, 3, found)
    assert sample_solution(hypotheses, weight, done, (0.5, 0.5), by_weight) is None
    nothing = hypotheses[np.zeros(0, dtype=np.int64)]
    assert sample_solution(nothing, np.zeros(0), START, (0.5, 0.5), by_weight) is None

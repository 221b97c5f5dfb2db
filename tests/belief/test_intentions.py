"""What a subject may intend: all that it could draw, and what is left after what it did."""

from collections import Counter

import numpy as np
import pytest
from scipy import stats

from causal_openlock import PROTOCOLS, Session, create
from causal_openlock.belief import intentions
from causal_openlock.belief.intentions import Intention, Intentions, courses, drawn_solutions
from causal_openlock.belief.planning import (
    Situation,
    _in_order,
    fitting_solutions,
    sample_solution,
)
from causal_openlock.experiment.declare import find_condition

DRAWS = 1500


def seen(learner, schema, steps, **parameters):
    session = Session(find_condition(schema), PROTOCOLS["human"], 1, seed=3)
    made = create(learner, parameters)
    session.begin(made)
    for _ in range(steps):
        made.learn(session.step(made.act(session.view)))
    made.act(session.view)  # so that it has seen the room
    return session, made


@pytest.mark.parametrize("by_weight", [True, False])
@pytest.mark.parametrize(("schema", "steps"), [("CC3", 0), ("CC3", 7), ("CE4", 4)])
def test_what_may_be_drawn_is_as_likely_as_it_is_drawn(schema, steps, by_weight):
    session, learner = seen("bayes", schema, steps)
    belief = learner.belief(0)
    possible = belief.space.hypotheses[belief.which]
    situation = Situation.of(session.view, 0, belief.slots, belief.found)
    drawn_from = drawn_solutions(possible, belief.weight, situation, by_weight)
    odds = {plan: chance for chance, plan in drawn_from}
    assert sum(odds.values()) == pytest.approx(1)
    rng = np.random.default_rng(0)
    drawn = Counter(
        sample_solution(possible, belief.weight, situation, tuple(rng.random(2)), by_weight)
        for _ in range(DRAWS)
    )
    assert set(drawn) <= set(odds)
    off = [(drawn[plan] - DRAWS * chance) ** 2 / (DRAWS * chance) for plan, chance in odds.items()]
    assert sum(off) < stats.chi2.ppf(0.999, len(odds))


@pytest.mark.parametrize("sorts", [False, True])
@pytest.mark.parametrize(("schema", "steps"), [("CC3", 5), ("two_of_four", 0), ("chain3", 2)])
def test_what_may_be_drawn_is_what_all_draws_come_to(schema, steps, sorts, monkeypatch):
    """Every hypothesis and each of its solutions, one after another, by the rule for one."""
    monkeypatch.setattr(intentions, "DENSE", 0 if sorts else 4096)
    session, learner = seen("bayes", schema, steps)
    belief = learner.belief(0)
    possible = belief.space.hypotheses[belief.which]
    situation = Situation.of(session.view, 0, belief.slots, belief.found)
    fitting = fitting_solutions(possible, belief.weight, situation)
    expected = Counter()
    for row, column in zip(*np.nonzero(fitting), strict=True):
        solution = int(possible.solutions[row, column])
        plan = _in_order(possible, row, solution, situation.pushed)
        expected[plan] += belief.weight[row] / fitting[row].sum()
    drawn = drawn_solutions(possible, belief.weight, situation, by_weight=True)
    assert {plan for _, plan in drawn} == set(expected)
    for chance, plan in drawn:
        assert chance == pytest.approx(expected[plan] / expected.total(), abs=1e-9)


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


def test_a_plan_fails_where_a_lever_does_not_move():
    mind = Intentions(lapse=0.0, actions=15)
    mind.next(at(0), 7, lambda: [(1.0, (0, 1))])
    mind.acted(0, over=False)
    assert mind.next(at(0), 7, lambda: [(1.0, (3, 4))])[3] == 1


def test_a_lapse_leaves_the_intention_as_it_is():
    plans = [(0.5, (0, 1)), (0.5, (2, 1))]
    mind = Intentions(lapse=0.15, actions=15)
    mind.next(at(0b000), 7, lambda: plans)
    mind.acted(0, over=False)
    # Lever 0 was meant with .85 / 2, and pushed in a lapse with .01, whatever is meant.
    meant, lapsed = 0.85 * 0.5, 0.01
    odds = mind.next(at(0b001), 7, lambda: plans)
    share = meant / (meant + lapsed)
    # After a lapse nothing is carried out yet, and a plan is drawn anew.
    assert odds[1] == pytest.approx(share + (1 - share) * 0.0)
    assert odds[[0, 2]].sum() == pytest.approx(1 - share)


def test_without_a_plan_any_lever_is_as_likely():
    ways = list(courses(Intention(), at(0), 7, lambda: [(1.0, None)]))
    assert [way.slot for way in ways] == [*range(7)]
    assert {way.chance for way in ways} == {1 / 7}

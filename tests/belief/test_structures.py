"""Structures as arrays, and how probable they make what happens, against the oracle."""

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.special import betaln

from causal_openlock.belief import likelihoods
from causal_openlock.belief.hypotheses import Strengths, at_least, strengths
from causal_openlock.belief.likelihoods import Event, likelihood
from causal_openlock.belief.structures import gate_dags, merge
from causal_openlock.testing import schemas
from oracle import DOOR, NOTHING, Seen, structure
from support.belief_arrays import (
    arrays_of,
    hypothesis_of,
    key_of,
    keys_of,
    lever_set,
    mask,
    partition,
    rules_in,
    seen_of,
)

POSITIONS = 7


@settings(max_examples=60, deadline=None)
@given(schemas(max_levers=6))
def test_a_structure_does_what_its_schema_does(schema):
    key, n = key_of(schema), len(schema.levers)
    own, rules = arrays_of([key]), structure(*key)
    works = own.working()[0]
    for state in range(1 << n):
        pushed = lever_set(state)
        holds = [rules.holds(node, pushed) for node in (*range(n), DOOR)]
        assert own.holds(state)[0].tolist() == holds
        assert works[state] == (holds[-1] and rules.pushable(pushed))
    assert {lever_set(m) for m in np.flatnonzero(own.solutions()[0])} == rules.solutions
    assert lever_set(own.inert()[0]) == rules.inert
    order = np.random.default_rng(n).permutation(n)
    (renamed,) = keys_of(own.on_slots(order, n))
    assert structure(*renamed).key == rules.at(dict(enumerate(order.tolist()))).key


@pytest.mark.parametrize(("levers", "orders", "dags"), [(3, 25, 79), (4, 543, 3377)])
def test_there_are_as_many_as_others_counted(levers, orders, dags):
    # Counted by recurrence: of the levers alone (OEIS A003024), and with the door as only sink.
    every = gate_dags(levers)
    assert len(np.unique(every.causes[:, :levers], axis=0)) == orders
    assert len(np.unique(every.causes[every.inert() == 0], axis=0)) == dags


@pytest.mark.parametrize("strength", [1.0, 0.7])
@pytest.mark.parametrize(("levers", "action_limit"), [(1, 2), (2, 1), (2, 3), (2, 4), (3, 2),
                                                      (3, 3), (4, 3)])  # fmt: skip
def test_behaviours_are_equal_exactly_if_no_attempt_tells_them_apart(
    levers, action_limit, strength
):
    every = gate_dags(levers)
    if levers == 4:  # some that are thought to be alike, and some more
        _, alike = merge(every.behaviour(action_limit, uncertain=strength < 1))
        generator = np.random.default_rng(0)
        large = generator.permutation(np.flatnonzero(np.bincount(alike) > 1))[:10]
        pairs = [generator.permutation(np.flatnonzero(alike == group))[:3] for group in large]
        every = every[np.unique([*np.concatenate(pairs), *generator.permutation(len(every))[:20]])]
    _, alike = merge(every.behaviour(action_limit, uncertain=strength < 1))
    seen = partition(seen_of(key, action_limit, strength) for key in keys_of(every))
    assert partition(alike.tolist()) == seen
    assert levers < 3 or 1 < max(seen) + 1 < len(every)


def chance_of(hypotheses, how, node, pushed, seen, found):
    event = Event(
        slot=likelihoods.DOOR if node == DOOR else node,
        pushed=mask(pushed),
        took_effect=seen.moved,
        unlocked=seen.unlocked,
        new=seen.new,
        found=found,
    )
    return float(likelihood(hypotheses, np.array([0]), how, event)[0])


@settings(max_examples=50, deadline=None)
@given(st.data())
def test_a_likelihood_is_the_chance_that_the_oracle_gives(data):
    key = key_of(data.draw(schemas(max_levers=5)))
    strength = data.draw(st.sampled_from([1.0, 0.85, 0.4]))
    slots = data.draw(st.permutations(range(POSITIONS)))[: len(key[0]) - 1]
    noisy = strength if strength < 1 else 0.5
    how = Strengths(
        np.array([1.0, noisy]), np.full(2, 0.5), np.stack([at_least(1.0), at_least(noisy)])
    )
    hypothesis = hypothesis_of(key, slots, POSITIONS, int(strength < 1))
    rules, reached = rules_in(hypothesis, 0, strength), {NOTHING}
    assert rules.key == structure(*key, strength).at(dict(enumerate(slots))).key
    while more := {s.pushed for p in reached for n in rules.levers for s in rules.outcomes(p, n)}:
        if more <= reached:
            break
        reached |= more
    states = sorted(reached, key=sorted)
    solved = [pushed for pushed in states if rules.solution(pushed)]
    found = data.draw(st.lists(st.sampled_from(solved), max_size=3)) if solved else []
    padded = (*map(mask, found), *[0] * data.draw(st.integers(0, 2)))
    for pushed in data.draw(st.lists(st.sampled_from(states), max_size=8)) + solved[:4]:
        for node in [*range(POSITIONS), *([DOOR] if rules.holds(DOOR, pushed) else [])]:
            expected, total = rules.outcomes(pushed, node, frozenset(found)), 0.0
            for moved, unlocked, new in product((False, True), repeat=3):
                if new and (node != DOOR or not moved):
                    continue  # only an open door completes anything
                after = pushed ^ {node} if moved and node != DOOR else pushed
                seen = Seen(moved, after, unlocked, moved and node == DOOR, new)
                chance = chance_of(hypothesis, how, node, pushed, seen, padded)
                assert chance == pytest.approx(expected.get(seen, 0.0), abs=1e-12)
                total += chance
            assert total == pytest.approx(1.0)


@pytest.mark.parametrize("strength", [0.0, 0.3, 0.85, 1.0])
def test_enough_causes_transmit_as_often_as_the_binomial_says(strength):
    chance = at_least(strength)
    for pushed, k in product(range(13), range(16)):
        expected = stats.binom.sf(k - 1, pushed, strength)
        assert chance[pushed, k] == pytest.approx(expected, abs=1e-12)


def test_a_few_strengths_stand_for_the_whole_beta_distribution():
    alpha, beta, nodes = 4.0, 1.0, 5
    how = strengths(0.25, nodes)
    assert (how.value[0], how.prior[0]) == (1.0, pytest.approx(0.75))
    assert how.prior.sum() == pytest.approx(1.0)
    share = how.prior[1:] / how.prior[1:].sum()
    chance = how.chance[1:, 1, 1]  # one cause, and it is pushed
    assert chance == pytest.approx(how.value[1:])
    for moved in range(2 * nodes):
        for stuck in range(2 * nodes - moved):  # up to degree 2 nodes - 1, where it is exact
            seen = share * chance**moved * (1 - chance) ** stuck
            marginal = math.exp(betaln(alpha + moved, beta + stuck) - betaln(alpha, beta))
            assert seen.sum() == pytest.approx(marginal, rel=1e-9)
    certain = strengths(0.0, 5)
    assert (certain.value.tolist(), certain.prior.tolist()) == ([1.0], [1.0])

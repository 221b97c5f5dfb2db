"""Likelihoods are what the machine of a schema would do, and strengths are learned as they are."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.special import betaln

from causal_openlock.belief.hypotheses import Strengths, at_least, strengths
from causal_openlock.belief.likelihoods import DOOR, Event, Events, likelihood
from causal_openlock.belief.structures import Hypotheses
from causal_openlock.schemas.schema import Schema
from causal_openlock.testing import schemas
from support.belief_by_hand import (
    DOOR_SLOT,
    Outcome,
    Plain,
    World,
    hypothesis_of,
    machine,
    plain_of,
)

POSITIONS = 7
CERTAIN = 0  # index of the strength 1


def both(strength: float) -> Strengths:
    return Strengths(
        np.array([1.0, strength]),
        np.array([0.5, 0.5]),
        np.stack([at_least(1.0), at_least(strength)]),
    )


def chance_of(
    hypothesis: Hypotheses,
    how: Strengths,
    slot: int,
    pushed: int,
    outcome: Outcome,
    found: list[int],
) -> float:
    event = Event(
        slot=DOOR if slot == DOOR_SLOT else slot,
        pushed=pushed,
        took_effect=outcome.took_effect,
        unlocked=outcome.unlocked,
        new=outcome.new,
        found=tuple(found),
    )
    return float(likelihood(hypothesis, np.array([0]), how, event)[0])


def reachable(world: World) -> list[int]:
    """What can stand pushed, as masks of slots, while the door is closed."""
    reached, new = {0}, [0]
    while new:
        pushed = new.pop()
        for slot in world.slots:
            for outcome in world.outcomes(pushed, slot, []):
                if outcome.pushed not in reached:
                    reached.add(outcome.pushed)
                    new.append(outcome.pushed)
    return sorted(reached)


@settings(max_examples=50, deadline=None)
@given(st.data())
def test_a_likelihood_is_the_chance_that_the_machine_gives(data):
    plain = plain_of(data.draw(schemas(max_levers=5)))
    levers = len(plain.causes) - 1
    strength = data.draw(st.sampled_from([1.0, 0.85, 0.4]))
    slots = data.draw(st.permutations(range(POSITIONS)))[:levers]
    how, index = both(strength if strength < 1 else 0.5), int(strength < 1)
    hypothesis = hypothesis_of(plain, slots, POSITIONS, index)
    world = World(machine(plain, strength), slots)
    states = reachable(world)
    solved = [pushed for pushed in states if world.fsm.solution[world.state(pushed)] >= 0]
    found = data.draw(st.lists(st.sampled_from(solved), max_size=3)) if solved else []
    padded = [*found, *[0] * data.draw(st.integers(0, 2))]
    for pushed in data.draw(st.lists(st.sampled_from(states), max_size=8)) + solved[:4]:
        unlocked = bool(world.fsm.unlocked[world.state(pushed)])
        for slot in [*range(POSITIONS), *([DOOR_SLOT] if unlocked else [])]:
            expected = world.outcomes(pushed, slot, found)
            total = 0.0
            for effect, open_now, new in product((False, True), repeat=3):
                if new and (slot != DOOR_SLOT or not effect):
                    continue  # only an open door completes anything
                moved = pushed ^ 1 << slot if effect and slot != DOOR_SLOT else pushed
                outcome = Outcome(effect, moved, open_now, new)
                chance = chance_of(hypothesis, how, slot, pushed, outcome, padded)
                assert chance == pytest.approx(expected.get(outcome, 0.0), abs=1e-12)
                total += chance
            assert total == pytest.approx(1.0)


def test_the_same_solution_with_an_inert_lever_pushed_is_not_new():
    # L2 is free and does nothing: pushing it too changes neither the solution nor its novelty.
    schema = Schema("one", ["L0", "L1", "L2"], {"L0": ["L1"], "L1": ["door"]}, inert=["L2"])
    hypothesis = hypothesis_of(plain_of(schema), [0, 1, 2], POSITIONS, CERTAIN)
    how = strengths(0.0, 1.0, 1.0, 1)
    for found, new in (([], True), ([0b011], False), ([0b111], False)):
        outcome = Outcome(True, 0b111, True, new)
        assert chance_of(hypothesis, how, DOOR_SLOT, 0b111, outcome, found) == 1.0
        assert chance_of(hypothesis, how, DOOR_SLOT, 0b111, outcome._replace(new=not new),
                         found) == 0.0  # fmt: skip


def test_events_are_taken_one_hypothesis_each():
    free = hypothesis_of(_one_lever(), [0], POSITIONS, CERTAIN)
    elsewhere = hypothesis_of(_one_lever(), [1], POSITIONS, CERTAIN)
    whole = Hypotheses.joined([free, elsewhere])
    which = np.array([0, 1, 1, 0])
    events = Events(
        slot=np.array([0, 0, 1, 1]),
        pushed=np.zeros(4, dtype=np.uint16),
        took_effect=np.array([True, True, True, True]),
        unlocked=np.array([True, True, True, True]),
        new=np.zeros(4, dtype=bool),
        found=np.zeros((4, 0), dtype=np.uint16),
    )
    told = likelihood(whole, which, strengths(0.0, 1.0, 1.0, 1), events)
    assert told.tolist() == [1.0, 0.0, 1.0, 0.0]


def _one_lever() -> Plain:
    return plain_of(Schema("one", ["L0"], {"L0": ["door"]}))


# -- strengths ------------------------------------------------------------------------------------


@pytest.mark.parametrize("strength", [0.0, 0.3, 0.85, 1.0])
def test_enough_causes_transmit_as_often_as_the_binomial_says(strength):
    chance = at_least(strength)
    for pushed, k in product(range(13), range(16)):
        expected = stats.binom.sf(k - 1, pushed, strength)
        assert chance[pushed, k] == pytest.approx(expected, abs=1e-12)
    if strength == 1.0:
        assert set(np.unique(chance)) == {0.0, 1.0}


@pytest.mark.parametrize(("alpha", "beta"), [(4.0, 1.0), (1.0, 1.0), (2.5, 0.7)])
def test_a_few_strengths_stand_for_the_whole_beta_distribution(alpha, beta):
    nodes = 5
    how = strengths(0.25, alpha, beta, nodes)
    assert how.value[CERTAIN] == 1.0
    assert how.prior[CERTAIN] == pytest.approx(0.75)
    assert how.prior.sum() == pytest.approx(1.0)
    share = how.prior[1:] / how.prior[1:].sum()
    chance = how.chance[1:, 1, 1]  # one cause, and it is pushed
    assert chance == pytest.approx(how.value[1:])
    for moved in range(2 * nodes):
        for stuck in range(2 * nodes - moved):  # up to degree 2 nodes - 1, where it is exact
            seen = share * chance**moved * (1 - chance) ** stuck
            marginal = math.exp(betaln(alpha + moved, beta + stuck) - betaln(alpha, beta))
            assert seen.sum() == pytest.approx(marginal, rel=1e-9)
            if moved + stuck < 2 * nodes - 1:
                mean = (seen * chance).sum() / seen.sum()
                assert mean == pytest.approx((alpha + moved) / (alpha + beta + moved + stuck))


def test_ten_nodes_follow_the_conjugate_posterior_through_likelihoods():
    how = strengths(0.5, 4.0, 1.0, 10)
    plain = plain_of(Schema("chain", ["L0", "L1"], {"L0": ["L1"], "L1": ["door"]}))
    hypotheses = hypothesis_of(plain, [0, 1], POSITIONS, 0).repeated(len(how))
    weight, which = how.prior.copy(), np.arange(len(how))
    moves = [True, True, False, True, False, True]
    for moved in moves:
        event = Event(slot=1, pushed=0b01, took_effect=moved, unlocked=moved, new=False)
        weight *= likelihood(hypotheses, which, how, event)
    assert weight[CERTAIN] == 0.0  # it failed once
    assert weight.sum() == pytest.approx(0.5 * math.exp(betaln(8, 3) - betaln(4, 1)))
    assert weight @ how.value / weight.sum() == pytest.approx(8 / 11)


def test_without_noise_there_is_certainty_alone():
    how = strengths(0.0, 4.0, 1.0, 5)
    assert how.value.tolist() == [1.0]
    assert how.prior.tolist() == [1.0]

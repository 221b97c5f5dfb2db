"""What one room teaches for the next: classes of schemas, marks of active levers, strengths."""

from collections import defaultdict
from functools import cache
from itertools import permutations

import numpy as np
import pytest

from causal_openlock.belief.grammar import class_prior
from causal_openlock.belief.hypotheses import RoomSight, enumerate_space, strengths
from causal_openlock.belief.knowledge import RULE_CHANGES, BeliefParameters, Knowledge
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.schemas.schema import Schema
from support.belief_arrays import (
    arrays_of,
    fits,
    key_of,
    key_of_rules,
    keys_of,
    of_classes,
    rules_in,
    seen_of,
)
from support.belief_play import Played
from support.session_play import SCHEMAS, named

CERTAIN = strengths(0.0)
SIMPLICITY, FREE_FORM = 0.7, 0.1
CHAIN = Schema("chain2", ["L0", "L1"], {"L0": ["L1"], "L1": ["door"]})
FORK = Schema("fork", ["L0", "L1", "L2"], {"L0": ["L1", "L2"], "L1": ["door"], "L2": ["door"]})


def new(concentration=1.0, by_colour=0.5, subjects=1):
    prior = BeliefParameters(concentration, SIMPLICITY, FREE_FORM, by_colour, 0.1)
    return Knowledge(subjects, 7, prior, CERTAIN)


@cache
def space_of(levers, solutions):
    return enumerate_space(RoomSight(7, levers, solutions, 3), CERTAIN, SIMPLICITY)


@cache
def alike(schema):
    """The space of rooms of this schema; hypotheses that act as it does, whichever lever is which.

    With each comes what it does, by slot.
    """
    levers = len(schema.levers)
    space = space_of(levers, len(schema.solutions))
    own = arrays_of([key_of(schema)])
    orders = permutations(range(levers))
    wanted = {seen_of(keys_of(own.on_slots(order, levers))[0], 3) for order in orders}
    found = {}
    for index in range(int(space.ends[0])):  # the grey levers come first
        seen = seen_of(key_of_rules(rules_in(space.hypotheses, index))[1], 3)
        if seen in wanted:
            found[index] = seen
    return space, found


def learn(knowledge, schema, slots=None):
    """A room is left in which it has become certain what governs it: the schema."""
    space, found = alike(schema)
    (index,) = [i for i, seen in found.items() if seen == seen_of(key_of(schema), 3)]
    slots = np.arange(7) if slots is None else slots
    knowledge.absorb(0, space, np.array([index]), np.array([1.0]), slots)
    return index


def expected(knowledge, schema):
    """How probable it is that the next room, of so many levers and solutions, acts like this."""
    space, found = alike(schema)
    weight = space.prior(
        knowledge.classes(0), knowledge.rules[0], knowledge.by_position(0), np.ones(1)
    )
    grey = slice(0, int(space.ends[0]))
    return float(weight[list(found)].sum() / weight[grey].sum())


@pytest.mark.parametrize(("before", "same", "other"), [("CC3", "CC4", "CE4"),
                                                       ("CE3", "CE4", "CC4")])  # fmt: skip
def test_three_levers_teach_what_four_do(before, same, other):
    naive, taught = new(), new()
    learn(taught, SCHEMAS[before])
    assert expected(taught, SCHEMAS[same]) > 0.7
    assert expected(taught, SCHEMAS[same]) > 3 * expected(naive, SCHEMAS[same])
    assert expected(taught, SCHEMAS[other]) < 0.9 * expected(naive, SCHEMAS[other])


@pytest.mark.parametrize("concentration", [0.3, 2.0])
def test_transfer_from_two_levers_to_three_is_that_of_enumeration(concentration):
    knowledge = new(concentration)
    learn(knowledge, CHAIN)

    prior = class_prior(SIMPLICITY, FREE_FORM)
    chain, counts = seen_of(key_of(CHAIN), 3), np.zeros(len(prior))
    for kind, key, chance in of_classes(prior, 2, SIMPLICITY):
        counts[kind] += chance * (fits(key, 1, 3) and seen_of(key, 3) == chain)
    counts /= counts.sum()
    assert knowledge.rooms[0] == pytest.approx(counts, abs=1e-12)

    classes = (counts + concentration * prior) / (1 + concentration)
    assert knowledge.classes(0) == pytest.approx(classes, abs=1e-12)
    behaviours = defaultdict(float)
    for _, key, chance in of_classes(classes, 3, SIMPLICITY):
        if fits(key, 2, 3):
            behaviours[seen_of(key, 3)] += chance
    _, found = alike(FORK)
    assert len(found) == 3
    by_hand = sum(behaviours[seen] for seen in found.values()) / sum(behaviours.values())
    assert expected(knowledge, FORK) == pytest.approx(by_hand, abs=1e-12)
    assert by_hand > expected(new(concentration), FORK)


def test_a_room_that_is_left_in_doubt_is_shared_out():
    doubt, cause, effect = new(), new(), new()
    space, _ = alike(SCHEMAS["CC3"])
    which = [learn(cause, SCHEMAS["CC3"]), learn(effect, SCHEMAS["CE3"])]
    doubt.absorb(0, space, np.sort(which), np.array([0.25, 0.75])[np.argsort(which)], np.arange(7))
    assert doubt.rooms[0] == pytest.approx(0.25 * cause.rooms[0] + 0.75 * effect.rooms[0])


def test_grey_levers_that_are_active_make_the_rule_near_certain():
    knowledge = new()
    prior = knowledge.rules[0].copy()
    assert prior == pytest.approx([0.45, 0.05, 0.5])
    learn(knowledge, SCHEMAS["CC3"])
    by_hand = prior * [1.0, 0.0, 0.5**7]
    by_hand /= by_hand.sum()
    # Places learn from a room as far as it was by position that its levers were marked.
    assert knowledge.active[0] == pytest.approx(by_hand[2] * np.array([1, 1, 1, 0, 0, 0, 0]))
    assert knowledge.visits[0] == pytest.approx(by_hand[2])
    by_hand = (1 - RULE_CHANGES) * by_hand + RULE_CHANGES * prior
    assert knowledge.rules[0] == pytest.approx(by_hand)
    for _ in range(3):
        learn(knowledge, SCHEMAS["CE3"], np.roll(np.arange(7), 2))
    assert knowledge.rules[0, 0] > 0.998
    assert knowledge.rules[0].sum() == pytest.approx(1.0)
    assert (knowledge.rules[0] > 0).all()


def test_levers_of_both_colours_that_are_active_speak_for_places():
    knowledge = new(by_colour=0.9)
    space = space_of(3, 2)
    mixed = int(np.flatnonzero(space.active == 0b0001001)[0])  # a grey one and a white one
    one = np.array([space.ends[mixed] - 1])
    slots = np.array([3, 0, 1, 2, 4, 5, 6])
    for visit in range(1, 4):
        knowledge.absorb(0, space, one, np.array([1.0]), slots)
        assert knowledge.rules[0, 2] == pytest.approx(1 - RULE_CHANGES * 0.9)
        assert knowledge.active[0].tolist() == [visit, visit, 0, 0, 0, 0, 0]
        often, never = (visit + 1) / (visit + 2), 1 / (visit + 2)
        assert knowledge.by_position(0) == pytest.approx([often] * 2 + [never] * 5)


def test_strengths_are_learned_across_rooms():
    protocol = Protocol("brief", 20, stop_when_solved=False, baseline_trials=4)
    played = Played(named("noisy_CC3"), BeliefParameters(noise=0.3), protocol, range(3))
    known = played.beliefs.knowledge
    value = strengths(0.3).value
    assert known.strengths.shape == (3, len(value))
    rooms = np.zeros(3)
    for _, step in played.moments(4 * 20 * 3):
        rooms += step.trial_over
        assert known.rooms.sum(axis=1) == pytest.approx(rooms)  # each finished room counts once
        assert known.rules.sum(axis=1) == pytest.approx(1.0)
        assert known.strengths.sum(axis=1) == pytest.approx(1.0)
    assert rooms.tolist() == [4, 4, 4]
    assert known.strengths[:, 0].max() < 1e-6  # levers do fail
    assert np.abs(known.strengths @ value - 0.8).mean() < 0.06

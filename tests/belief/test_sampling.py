"""Sampled structures: as probable as enumeration has them, and what rests on them."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chisquare

from causal_openlock.belief import beliefs as beliefs_module
from causal_openlock.belief import catalogue as catalogue_module
from causal_openlock.belief import hypotheses as space_module
from causal_openlock.belief.catalogue import distance, free_form_weight
from causal_openlock.belief.hypotheses import RoomSight, Space, at_least, strengths
from causal_openlock.belief.likelihoods import DOOR, Event
from causal_openlock.belief.marginals import Posterior
from causal_openlock.belief.sampling import Sampler, sampled
from causal_openlock.belief.structures import gate_dags
from causal_openlock.experiment.condition import Condition, Trials
from causal_openlock.schemas.schema import Gate, Schema
from oracle import DOOR as ORACLES_DOOR
from oracle import NOTHING, free_form, likelihood, structure
from support.belief_arrays import arrays_of, key_of_rules, keys_of, lever_set, mask, rules_in
from support.belief_arrays import fits as fits_oracle
from support.belief_play import KNOWN, LONG, Played
from support.session_play import SCHEMAS

SIMPLICITY = math.log(2.0)
DRAWS = 40_000


def node_of(slot):
    return ORACLES_DOOR if slot == DOOR else slot


def happened_in(key, strength, moments, seed):
    """Events of some actions in a room, white levers among them; the door is pushed at times."""
    rng, rules = np.random.default_rng(seed), structure(*key, strength)
    events, pushed = [], NOTHING
    for _ in range(moments):
        unlocked = rules.holds(ORACLES_DOOR, pushed)
        slot = DOOR if unlocked and rng.random() < 0.5 else int(rng.integers(len(key[0]) + 1))
        outcomes = rules.outcomes(pushed, node_of(slot))
        seen = [*outcomes][rng.choice(len(outcomes), p=[*outcomes.values()])]
        events.append(Event(slot, mask(pushed), seen.moved, seen.unlocked, False))
        # Opened doors close again, and now and then everything is put back.
        pushed = NOTHING if rng.random() < 0.2 else seen.pushed
    return events


def by_hand(key, strength, events):
    """Probability of events by the oracle; solutions aside."""
    rules, total = structure(*key, strength), 1.0
    for slot, pushed, took_effect, unlocked, *_ in events:
        if slot == DOOR and not rules.holds(ORACLES_DOOR, lever_set(pushed)):
            return 0.0  # the door had not been unlocked
        outcomes = rules.outcomes(lever_set(pushed), node_of(slot))
        told = (took_effect, unlocked)
        total *= sum(p for seen, p in outcomes.items() if (seen.moved, seen.unlocked) == told)
    return total


def likelihoods(structures, strength, events):
    """The same for many structures, in their terms: how many causes are pushed, and the gate."""
    n, chance = structures.levers, at_least(strength)
    total = np.ones(len(structures))
    for slot, pushed, took_effect, unlocked, *_ in events:
        node = n if slot == DOOR else slot
        after = pushed ^ (1 << slot) if took_effect and slot != DOOR else pushed
        if node < n or slot == DOOR:
            live = np.bitwise_count(structures.causes[:, node] & np.uint16(pushed))
            works = chance[live, structures.threshold[:, node]]
            total *= works if took_effect else 1.0 - works
        total *= structures.holds(after)[:, n] == unlocked
    return total


def labels(structures):
    return [row.tobytes() for row in structures.labels()]


def causes(*levers):
    return tuple(map(frozenset, levers))


CHAIN = causes((), {0}, {1}, {2}), (0, 1, 1, 1)
BOTH = causes((), (), {0, 1}, {0, 2}), (0, 0, 2, 1)
FOUR = causes((), {0}, {0, 1}, {1}, {2, 3}), (0, 1, 1, 1, 1)


@pytest.mark.parametrize(
    ("key", "strength", "moments"),
    [(CHAIN, 1.0, 0), (CHAIN, 1.0, 3), (BOTH, 1.0, 9), (CHAIN, 0.7, 6), (BOTH, 0.7, 25)],
)
def test_three_levers_are_drawn_as_probable_as_they_are(key, strength, moments):
    events, every = happened_in(key, strength, moments, 4), free_form(3, SIMPLICITY)
    weight = np.array([prior * by_hand(rules, strength, events) for rules, prior in every.items()])
    sampler = Sampler(3, SIMPLICITY, strength, events)
    assert sampler.evidence == pytest.approx(weight.sum(), rel=1e-9)
    drawn = Counter(labels(sampler.draw(DRAWS, np.random.default_rng(1))[0]))
    names = labels(arrays_of([*every]))
    assert not set(drawn) - {name for name, w in zip(names, weight, strict=True) if w > 0}
    expected = DRAWS * weight / weight.sum()
    observed = np.array([drawn[name] for name in names])
    rare = expected < 10
    pooled = [np.append(x[~rare], x[rare].sum()) for x in (observed, expected)]
    pooled = [x[pooled[1] > 0] for x in pooled]
    if len(pooled[0]) > 1:
        assert chisquare(*pooled).pvalue > 1e-3
    else:
        assert (observed > 0).sum() == 1


def test_the_likelihood_of_draws_is_that_by_hand():
    events = happened_in(BOTH, 0.7, 25, 4)
    sampler = Sampler(3, SIMPLICITY, 0.7, events)
    drawn = sampler.draw(50, np.random.default_rng(0))[0]
    exact = [by_hand(key, 0.7, events) for key in keys_of(drawn)]
    assert sampler.likelihood(drawn) == pytest.approx(exact, rel=1e-9)


def test_a_white_lever_that_does_not_move_tells_nothing():
    told = [Event(0, 0b00, True, False, False), Event(1, 0b01, True, True, False)]
    plain = Sampler(3, SIMPLICITY, 1.0, told)
    for white in (3, 4):  # also while the door is unlocked
        more = [*told, *[Event(white, 0b11, False, True, False)] * 2]
        assert Sampler(3, SIMPLICITY, 1.0, more).evidence == pytest.approx(plain.evidence)


def test_of_what_cannot_be_nothing_is_drawn():
    both = [Event(0, 0, True, False, False), Event(0, 0, False, False, False)]
    sampler = Sampler(5, SIMPLICITY, 1.0, both)
    assert sampler.evidence == 0
    assert len(sampler.draw(100, np.random.default_rng(0))[0]) == 0
    sight = RoomSight(7, 5, 4, 3)
    own = sampled(sampler, sight, 100, np.random.default_rng(0))
    assert len(own) == 0
    assert len(Space(sight, strengths(0.0), ((tuple(range(5)), own),))) == 0
    # With noise, an enabled lever can both move and fail to.
    both = [Event(1, 1, True, False, False), Event(1, 1, False, False, False)]
    assert Sampler(5, SIMPLICITY, 0.8, both).evidence > 0


@pytest.mark.parametrize(
    ("key", "strength", "moments", "solutions"),
    [(FOUR, 1.0, 0, 3), (FOUR, 1.0, 0, 1), (FOUR, 1.0, 3, 3), (FOUR, 0.8, 8, 3), (BOTH, 1.0, 2, 1)],
)
def test_how_many_draws_fit_the_console_is_how_probable_that_is(key, strength, moments, solutions):
    n = len(key[0]) - 1
    events = happened_in(key, strength, moments, 6)
    everything = gate_dags(n)
    promised = distance(everything, solutions, 3) == 0
    if n == 3:
        exact = [fits_oracle(one, solutions, 3) for one in keys_of(everything)]
        assert promised.tolist() == exact
    weight = free_form_weight(n, SIMPLICITY) * likelihoods(everything, strength, events)
    sampler = Sampler(n, SIMPLICITY, strength, events)
    estimates = []
    for seed in range(20):
        own = sampled(sampler, RoomSight(7, n, solutions, 3), 400, np.random.default_rng(seed))
        assert not distance(own.members, solutions, 3).any()
        assert len(set(labels(own.members))) == len(own)
        estimates.append(own.chance @ likelihoods(own.members, strength, events))
    share = weight[promised].sum()
    # 400 accepted draws, or all that 48,000 bring: at worst a standard error of 1 in 20 each.
    assert np.mean(estimates) == pytest.approx(share, rel=0.05)
    assert np.std(estimates) < 0.1 * share


@pytest.fixture
def three_are_many(monkeypatch):
    """Structures of four levers are sampled, as those of five are."""

    def forget():
        catalogue_module.catalogue.cache_clear()
        beliefs_module.enumerated.cache_clear()

    forget()
    for module in (catalogue_module, space_module, beliefs_module):
        monkeypatch.setattr(module, "FREE_FORM_LEVERS", 3)
    yield
    forget()


def solving(belief):
    """How probable each set of positions is a solution."""
    solutions = belief.space.hypotheses.solutions[belief.which]
    weight = np.bincount(solutions.ravel(), np.repeat(belief.weight, solutions.shape[1]))
    slots = range(len(belief.slots))
    return {
        frozenset(belief.positions[[slot for slot in slots if mask >> slot & 1]].tolist()):
        float(weight[mask]) for mask in np.unique(solutions).tolist()
    }  # fmt: skip


def course(schema, prior, seed, actions, luck=0):
    """Arrows and solutions before each of some actions, which depend on the seed alone."""
    schema = SCHEMAS[schema] if isinstance(schema, str) else schema
    played = Played(Condition("room", (Trials(schema),)), prior, LONG, [seed])
    played.beliefs._generators = (np.random.default_rng(luck),)
    seen = []
    for _ in played.moments(actions):
        classes = played.beliefs.knowledge.classes(0)
        edges = Posterior.of(played.belief(), classes).expected().edges
        seen.append({**dict(np.ndenumerate(edges)), **solving(played.belief())})
    assert played.beliefs.unsure[0] == (prior.noise > 0)
    return seen


NOISY = Schema(
    "noisy",
    ["L0", "L1", "L2", "L3"],
    {"L0": {"L1": 0.7, "L2": 0.7}, "L1": {"door": 0.7}, "L2": {"door": 0.7}, "L3": {"L2": 0.7}},
)
JOINT = Schema(
    "joint",
    ["L0", "L1", "L2", "L3"],
    {"L0": ["L2", "L3"], "L1": ["L3"], "L2": ["door"], "L3": ["door"]},
)


@pytest.mark.parametrize(
    ("schema", "prior"),
    [
        ("CC4", KNOWN),
        (JOINT, replace(KNOWN, free_form=0.97)),  # nearly all that is believed rests on draws
        (NOISY, replace(KNOWN, noise=0.5)),
    ],
    ids=["a class", "free form", "noisy"],
)
def test_a_sampled_belief_agrees_with_the_enumerated_one(schema, prior, request, monkeypatch):
    exact = course(schema, prior, 2, 14)
    request.getfixturevalue("three_are_many")
    monkeypatch.setattr(beliefs_module, "PARTICLES", 4000)
    runs = [course(schema, prior, 2, 14, luck) for luck in range(4)]
    for moment, truth in enumerate(exact):
        asked = set(truth).union(*(run[moment] for run in runs))
        errors = [[run[moment].get(a, 0.0) - truth.get(a, 0.0) for a in asked] for run in runs]
        # One run has a standard error of some hundredths at worst, and the mean of four half.
        assert 0 < np.abs(errors).max() < 0.13
        assert np.abs(np.mean(errors, axis=0)).max() < 0.045


FIVE = Schema(
    "five",
    [f"L{lever}" for lever in range(5)],
    {"L0": ["L1", "L2"], "L3": ["L2", "L4"], "L1": ["door"], "L2": ["door"], "L4": ["door"]},
    gates={"L2": Gate("all")},
)


@pytest.mark.parametrize("seed", range(4))
def test_what_is_still_possible_of_five_levers_explains_all_that_happened(seed):
    condition = Condition("five", (Trials(FIVE),))
    played = Played(condition, KNOWN, LONG, [seed])
    again = 0
    for view, _ in played.moments(60):
        belief, limit = played.belief(), 4
        again += belief.drawn != len(belief.space.blocks[-1][1])
        places = [p for p in range(7) if view.observation[0, 7 + p]]
        possible = belief.which[belief.weight > 0]
        assert belief.possible
        assert belief.weight.sum() == pytest.approx(1)
        for index in possible[:: 1 + len(possible) // 3].tolist():
            slots, key = key_of_rules(rules_in(belief.space.hypotheses, index))
            at = belief.positions[[*slots]].tolist()
            assert sorted(at) == places
            assert fits_oracle(key, len(FIVE.solutions), limit)
            assert likelihood(structure(*key).at(dict(enumerate(at))), played.happened[0]) == 1
    assert not again

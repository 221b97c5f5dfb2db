"""Posteriors: those of the oracle, never without the truth, and everyone's own."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from causal_openlock.belief.knowledge import BeliefParameters
from causal_openlock.testing import schemas
from oracle import Rules
from support.belief_arrays import key_of_rules, seen_of
from support.belief_play import KNOWN, LONG, Played, active_sets, by_behaviour, enumerated, rooms_of

pytestmark = pytest.mark.slow


def agree(ours, expected):
    ours = {key: value for key, value in ours.items() if value > 1e-12}
    expected = {key: value for key, value in expected.items() if value > 1e-12}
    assert ours.keys() == expected.keys()
    for key, value in expected.items():
        assert ours[key] == pytest.approx(value, abs=1e-9)


def grey_of(played):
    return tuple(np.flatnonzero(played.session.view.observation[0, 7:14]).tolist())


@pytest.mark.parametrize(
    ("schema", "noise"),
    [("CC3", 0.0), ("CE3", 0.0), ("chain3", 0.0), ("two_keys", 0.0), ("CE3", 0.4),
     ("noisy_CC3", 0.4)],
)  # fmt: skip
def test_a_posterior_is_that_of_enumeration(schema, noise):
    played = Played(rooms_of(schema), replace(KNOWN, noise=noise, simplicity=0.4, free_form=0.3))
    sizes = []
    for moment, _ in enumerate(played.moments(30)):
        if moment in (0, 4, 29):
            expected = enumerated(played, {grey_of(played): 1.0})
            agree(by_behaviour(played.belief()), expected)
            sizes.append(len(expected))
    assert sizes[0] > sizes[-1] or noise  # something was found out


def test_a_posterior_over_active_levers_is_that_of_enumeration():
    # Colour may mark the active levers, or position: then each is active with probability 1/2.
    played = Played(rooms_of("CC3"), replace(KNOWN, by_colour=0.3), lively=0.4)
    for _ in played.moments(7):
        pass
    grey = grey_of(played)
    actives = {
        places: 0.7 * 0.5**7 + 0.3 * (places == grey)
        for places in active_sets(played.belief())
        if len(places) <= 3
    }
    assert len(actives) > 50
    # The room of white levers is listed too, and improbable; it is left out on both sides.
    ours = {key: value for key, value in by_behaviour(played.belief()).items() if len(key[0]) <= 3}
    total = sum(ours.values())
    agree({key: value / total for key, value in ours.items()}, enumerated(played, actives))


@settings(max_examples=6, deadline=None)
@given(schemas(max_levers=4, stochastic=True), st.integers(0, 99), st.sampled_from([0.0, 0.3]))
def test_the_truth_is_never_ruled_out(schema, subject, noise):
    played = Played(rooms_of(schema), BeliefParameters(noise=noise), LONG, [subject])
    layout = played.session.truth.rooms[0].layout
    for _ in played.moments(40):
        pass
    unsure, belief = bool(played.beliefs.unsure[0]), played.belief()
    assert not unsure or noise or not schema.deterministic
    if not belief or not (unsure or schema.deterministic):
        return
    rules = Rules.of(schema).at(dict(zip(schema.levers, layout.places, strict=True)))
    places, key = key_of_rules(rules)
    true = places, seen_of(key, belief.space.sight.action_limit, 0.7 if unsure else 1.0)
    assert sum(p for key, p in by_behaviour(belief).items() if key[:2] == true) > 0


def test_who_expected_no_noise_ends_where_one_who_expected_it_does():
    thoughts = 0
    for subject in range(4):
        pair = [
            Played(rooms_of("noisy_CC3"), replace(KNOWN, noise=noise), LONG, [subject])
            for noise in (0.0, 0.5)
        ]
        for moment, _ in enumerate(zip(*(played.moments(40) for played in pair), strict=True)):
            surprised, warned = pair
            if surprised.beliefs.unsure[0] and moment % 3 == 0:
                agree(by_behaviour(surprised.belief()), by_behaviour(warned.belief()))
                thoughts += 1
    assert thoughts > 10


@pytest.mark.parametrize(
    ("share", "prior", "schema"),
    [(0.25, KNOWN, "CE3"), (1.0, KNOWN, "CE3"), (0.25, BeliefParameters(), "CE3"),
     (0.25, BeliefParameters(noise=0.4), "noisy_CC3")],
)  # fmt: skip
def test_after_each_attempt_a_share_of_the_evidence_is_lost(share, prior, schema):
    plain = Played(rooms_of(schema), prior)
    lossy = Played(rooms_of(schema), replace(prior, forgetting=share))
    start, attempts = None, 0
    for (_, step), _ in zip(plain.moments(25), lossy.moments(25), strict=True):
        belief = lossy.belief()
        start = belief.start if start is None else start
        assert belief.start is start
        if not attempts:  # until an attempt ends nothing is forgotten
            known = dict(zip(plain.belief().which, plain.belief().weight, strict=True))
            kept = np.array([known.get(index, 0.0) for index in belief.which])
            lost = share if step.attempt_over[0] else 0.0
            expected = (1 - lost) * kept + lost * start
            assert belief.weight == pytest.approx(expected)
            assert expected.max() > start.max() or share == 1
        attempts += bool(step.attempt_over[0])
        assert belief.weight.sum() == pytest.approx(1.0)
        if step.attempt_over[0] and share == 1:
            assert belief.weight == pytest.approx(start)
    assert attempts > 5


@pytest.mark.parametrize("schema", ["CE3", "noisy_CC3"])
def test_who_forgets_failures_keeps_the_attempts_that_found_something(schema):
    noise = 0.4 if schema == "noisy_CC3" else 0.0
    prior = replace(KNOWN, forgetting=1.0, forgets="failures", noise=noise)
    played = Played(rooms_of(schema), prior)
    kept, since, solutions = [], 0, 0
    for _, step in played.moments(110):
        if not step.attempt_over[0] or played.belief() is None:
            continue
        attempt, since = played.happened[0][since:], len(played.happened[0])
        if step.new_solution[0]:
            kept += attempt
            solutions += 1
            whole, played.happened[0] = played.happened[0], [*kept]
            agree(by_behaviour(played.belief()), enumerated(played, {grey_of(played): 1.0}))
            played.happened[0] = whole
    assert solutions == (2 if schema == "CE3" else 1)

"""Rooms of many levers: what is looked at is counted and bounded, and said before it is done."""

from dataclasses import replace

import numpy as np
import pytest

from causal_openlock import Session
from causal_openlock.belief import beliefs, sampling
from causal_openlock.belief.catalogue import distance
from causal_openlock.belief.hypotheses import RoomSight
from causal_openlock.belief.likelihoods import Event
from causal_openlock.belief.sampling import Sampler, metropolis, sampled
from causal_openlock.experiment.condition import find_condition
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.schemas.schema import Schema
from openlock_learners.bayes import Bayes
from oracle import structure
from support.belief_arrays import fits as fits_oracle
from support.belief_arrays import keys_of, lever_set
from support.command import at_once

pytestmark = pytest.mark.slow

SIMPLICITY = float(np.log(2.0))
SIGHT = RoomSight(positions=12, grey=12, solutions=8, action_limit=3)


def pairs(levers, roots):
    """Each root enables some of the other levers, and each of these unlocks the door."""
    names = [f"L{index}" for index in range(levers)]
    edges = {name: ["door"] for name in names[roots:]}
    for index, leaf in enumerate(names[roots:]):
        edges.setdefault(names[index % roots], []).append(leaf)
    return Schema(f"pairs{levers}", names, edges)


TWELVE = pairs(12, 4)


@pytest.fixture
def looked_at(monkeypatch):
    """How many structures each look was at."""
    counts = []

    def counted(structures, *promise):
        counts.append(len(structures))
        return distance(structures, *promise)

    monkeypatch.setattr(sampling, "distance", counted)
    return counts


@pytest.mark.parametrize("levers", [1, 3, 6, 7, 9, 12])
def test_solutions_of_many_levers_are_the_oracles(levers):
    structures = Sampler(levers, SIMPLICITY, 1.0).draw(12, np.random.default_rng(levers))[0]
    keys = keys_of(structures)
    for key, row in zip(keys, structures.solutions(), strict=True):
        assert {lever_set(each) for each in np.flatnonzero(row)} == structure(*key).solutions
    for solutions, limit in ((1, 3), (2, 4), (3, 20)):
        expected = [fits_oracle(key, solutions, limit) for key in keys]
        assert (distance(structures, solutions, limit) == 0).tolist() == expected


@pytest.mark.parametrize("effort", [500, 4000])
def test_no_more_structures_are_looked_at_than_the_effort_says(looked_at, effort, monkeypatch):
    monkeypatch.setattr(sampling, "EFFORT", effort)
    own = sampled(Sampler(12, SIMPLICITY, 1.0), SIGHT, 500, np.random.default_rng(0))
    assert effort / 4 <= sum(looked_at) <= effort
    assert not distance(own.members, SIGHT.solutions, SIGHT.action_limit).any()


def shares(structures, n):
    """How often each arrow is there, and how often each lever is free."""
    arrows = structures.causes[:, :, None] >> np.arange(n) & 1
    return np.concatenate([arrows.mean(axis=0).ravel(), (structures.causes == 0).mean(axis=0)])


def test_what_steps_reach_is_as_probable_as_what_is_drawn():
    """From draws far from the promise, long runs come to what rejection would have kept."""
    n, promise, generator = 5, (2, 3), np.random.default_rng(3)
    sampler = Sampler(n, SIMPLICITY, 1.0, [Event(0, 0, True, False, False)])
    drawn, order = sampler.draw(60_000, generator)
    kept = distance(drawn, *promise) == 0
    away = np.flatnonzero(~kept)[:1500]
    reached = metropolis(sampler, drawn[away], order[away], promise, 300, generator)
    assert len(reached) > 1000
    assert (distance(reached, *promise) == 0).all()
    assert np.abs(shares(reached, n) - shares(drawn[kept], n)).max() < 0.05


def test_a_room_of_twelve_levers_is_played_to_its_end_with_counted_work(looked_at, monkeypatch):
    effort = 1000
    monkeypatch.setattr(sampling, "EFFORT", effort)
    monkeypatch.setattr(beliefs, "PARTICLES", 50)
    condition = find_condition(TWELVE)
    protocol = replace(PROTOCOLS["human"], baseline_trials=1, attempt_limit=4)

    def play():
        table = Session(condition, protocol, 1, seed=3).play(Bayes())
        return [table[name].to_pylist() for name in ("actions", "new_solution")]

    first = play()
    work = sum(looked_at)
    # An attempt has three actions, and each may make the learner think again at most four times.
    assert 0 < work <= (1 + 4 * 3 * 4) * effort
    assert (play(), sum(looked_at)) == (first, 2 * work)


def test_who_cannot_play_a_room_is_said_beforehand(tmp_path):
    (tmp_path / "pairs12.yaml").write_text(TWELVE.to_yaml(), encoding="utf-8")
    said = at_once("schema", "check", "pairs12.yaml", "CC4", cwd=tmp_path).stdout
    assert said.count("ideal cannot play it") == 1
    assert "29,937,600 ways" in said

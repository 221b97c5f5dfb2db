"""The plan that learns and solves at once comes within a few hundredths of the exact optimum."""

from __future__ import annotations

import numpy as np
import pytest

from causal_openlock.belief.hypotheses import strengths
from causal_openlock.belief.likelihoods import DOOR, Event, likelihood
from causal_openlock.belief.placements import mixture
from causal_openlock.belief.planning import Objective, Planner, Situation
from causal_openlock.schemas.finding import find_schema

CERTAIN = strengths(0.0, 1.0, 1.0, 1)


def expected_attempts(hypotheses, prior, limit, objective):
    """Attempts that the plan needs on average until everything is found; exact, no sampling.

    Every hypothesis is followed at once: each action splits those that are still possible by what
    they predict, so that the attempts of all of them are summed up, each with its probability.
    """
    door = hypotheses.causes.shape[1] - 1
    total = 0.0
    todo = [(np.arange(len(prior)), (), 0, False, limit)]
    while todo:
        who, found, pushed, unlocked, left = todo.pop()
        if left == limit:
            if len(found) == hypotheses.solutions.shape[1]:
                continue
            total += prior[who].sum()
        planner = Planner(hypotheses[who], CERTAIN, objective)
        values = planner.values(prior[who], Situation(pushed, unlocked, left, found))
        slot = int(np.flatnonzero(values >= values.max() - 1e-9)[0])
        for took_effect in (False, True):
            for lock_open in (False, True):
                for new in (False, True):
                    where = DOOR if slot == door else slot
                    event = Event(where, pushed, took_effect, lock_open, new, found)
                    if new and not (slot == door and took_effect):
                        continue
                    fits = likelihood(hypotheses, who, CERTAIN, event) > 0
                    if not fits.any():
                        continue
                    then = (*found, pushed) if new else found
                    opened = slot == door and took_effect
                    after = pushed ^ (1 << slot) if took_effect and slot != door else pushed
                    if opened or left == 1:
                        todo.append((who[fits], then, 0, False, limit))
                    else:
                        todo.append((who[fits], then, after, lock_open, left - 1))
    return total


@pytest.mark.parametrize(
    ("schemas", "positions", "optimum", "beta"),
    [
        (("CC3",), None, 8 / 3, 3.0),
        (("CE4",), None, 3.75, 3.0),
        (("CC3", "CE3"), None, 2 + 5 / 6, 2.0),
        (("CC3", "CE3"), None, 2 + 5 / 6, 5.0),
        (("CC4", "CE4"), None, 3.875, 2.0),
        (("CC4", "CE4"), None, 3.875, 5.0),
        (("CC3", "CE3"), 7, 4.810, 3.0),
        (("CC4", "CE4"), 7, 5.643, 3.0),
    ],
)
def test_it_needs_hardly_more_than_the_optimum(schemas, positions, optimum, beta):
    known = [(find_schema(name), 1 / len(schemas)) for name in schemas]
    attempts = expected_attempts(*mixture(known, 3, positions), 3, Objective(1.0, beta))
    assert optimum - 1e-3 < attempts < optimum + 0.05


def test_information_alone_is_not_enough():
    known = [(find_schema(name), 0.5) for name in ("CC3", "CE3")]
    hypotheses, prior = mixture(known, 3, 7)
    greedy = expected_attempts(hypotheses, prior, 3, Objective(1.0, 1e-6))
    assert greedy > 4.810 + 0.2

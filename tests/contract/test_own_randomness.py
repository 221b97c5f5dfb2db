"""Global generators of one's own: what is drawn in turns is what each would draw alone."""

import random

import numpy as np
import pytest
import torch

from causal_openlock.contract.own_randomness import OwnRandomness
from causal_openlock.contract.probes import GlobalRandomness

legacy = np.random


def drawn():
    """From all of them; of NumPy one normal number, so that it has drawn the next one ahead."""
    return [random.random(), legacy.standard_normal(), legacy.random(), float(torch.rand(()))]


def alone(seed, times):
    GlobalRandomness.seed(seed)
    return [drawn() for _ in range(times)]


def test_each_draws_as_if_alone_and_what_fails_changes_nothing_outside():
    before = GlobalRandomness.now()
    expected = {seed: alone(seed, 5) for seed in (1, 2, 3)}
    GlobalRandomness.seed(3)
    generator, own = legacy.get_bit_generator(), {seed: OwnRandomness(seed) for seed in (1, 2)}
    found = {1: [], 2: [], 3: []}
    for turn in range(5):
        for seed in own if turn % 2 else reversed(own):
            with own[seed].in_place():
                found[seed].append(drawn())
        assert legacy.get_bit_generator() is generator
        found[3].append(drawn())
    assert found == expected
    outside = GlobalRandomness.now()

    def fail():
        with own[1].in_place():
            GlobalRandomness.seed(2)
            drawn()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert outside.differs_from(GlobalRandomness.now()) == []
    with own[1].in_place():  # continues where it was
        assert drawn() == expected[2][1]
    before.restore()

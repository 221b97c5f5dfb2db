"""Global generators of one's own: what is drawn in turns is what each would draw alone."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
import pytest
import torch

from causal_openlock.contract.own_randomness import OwnRandomness
from causal_openlock.contract.probes import GlobalRandomness

legacy: Any = np.random


def drawn() -> list[float]:
    """From all of them; of NumPy one normal number, so that it has drawn the next one ahead."""
    return [random.random(), legacy.standard_normal(), legacy.random(), float(torch.rand(()))]


def alone(seed: int, times: int) -> list[list[float]]:
    GlobalRandomness.seed(seed)
    return [drawn() for _ in range(times)]


def test_everyone_draws_as_if_alone() -> None:
    before = GlobalRandomness.now()
    expected = {seed: alone(seed, 5) for seed in (1, 2, 3)}
    GlobalRandomness.seed(3)
    generator, own = legacy.get_bit_generator(), {seed: OwnRandomness(seed) for seed in (1, 2)}
    found: dict[int, list[list[float]]] = {1: [], 2: [], 3: []}
    for turn in range(5):
        for seed in own if turn % 2 else reversed(own):
            with own[seed].in_place():
                found[seed].append(drawn())
        assert legacy.get_bit_generator() is generator
        found[3].append(drawn())
    assert found == expected
    before.restore()


def test_what_fails_or_seeds_inside_changes_nothing_outside() -> None:
    own, before = OwnRandomness(1), GlobalRandomness.now()

    def fail() -> None:
        with own.in_place():
            GlobalRandomness.seed(9)
            drawn()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert before.differs_from(GlobalRandomness.now()) == []
    with own.in_place():  # goes on where it was
        assert drawn() == alone_after(9)
    assert before.differs_from(GlobalRandomness.now()) == []


def alone_after(seed: int) -> list[float]:
    """The second draws with a seed."""
    with OwnRandomness(0).in_place():
        return alone(seed, 2)[1]

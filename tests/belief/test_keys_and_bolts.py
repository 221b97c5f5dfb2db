"""Rooms of keys and bolts: all of them, what they need, and that knowing them pays."""

import pytest

from causal_openlock.belief.keys_and_bolts import families, keys_and_bolts
from causal_openlock.belief.worth import schema_worth
from causal_openlock.schemas.finding import find_schema


def test_every_room_of_a_family_is_there_once():
    """Multigraphs of three edges on four points: six up to renaming (counted by hand)."""
    names = [one.name for one in keys_and_bolts(4, 3, 2)]
    assert names == [
        "keys_01_01_01", "keys_01_01_02", "keys_01_01_23", "keys_01_02_03", "keys_01_02_12",
        "keys_01_02_13",
    ]  # fmt: skip
    assert [len(keys_and_bolts(3, 4, 1)), len(keys_and_bolts(2, 2, 2))] == [4, 1]


def test_a_solution_is_the_keys_of_a_bolt_and_the_bolt():
    shared = keys_and_bolts(4, 2, 2)[1]
    assert {frozenset(one) for one in shared.solutions} == {
        frozenset({"K0", "K1", "B0"}), frozenset({"K0", "K2", "B1"})
    }  # fmt: skip
    assert shared.inert == ("K3",)


def test_the_rooms_that_are_shipped_are_the_best_family_of_six_levers():
    every = {(one.keys, one.bolts, one.needed): one for one in families(5)}
    assert sorted(every) == [(2, 3, 1), (3, 2, 1), (3, 2, 2)]
    assert every[3, 2, 2].worth.worth == pytest.approx(0.3)
    shipped = [find_schema(name) for name in ("same_keys", "shared_key", "own_keys")]
    found = schema_worth(shipped[1], among=shipped)
    assert found.worth == pytest.approx(0.699074, abs=1e-6)
    assert sum(found.here_least) - found.here_known.upper == pytest.approx(1.186111, abs=1e-6)

"""What random actions come to: exactly, by enumeration, by another formula and by simulation."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest

from causal_openlock.analysis.results.chance import chance_of_finding_all, chance_of_opening
from causal_openlock.schemas.finding import find_schema
from causal_openlock.world.room import Layout, Room
from causal_openlock.world.tables import RoomTables


@pytest.mark.parametrize(
    ("name", "ways"), [("CC3", 2), ("CE3", 2), ("CC4", 3), ("CE4", 3), ("two_of_four", 12)]
)
def test_of_all_sequences_of_three_actions_so_many_open_the_door(name: str, ways: int) -> None:
    schema = find_schema(name)
    room = Room.of(schema, Layout((6, 2, 5, 0)[: len(schema.levers)]))
    opening = 0
    for sequence in itertools.product(range(15), repeat=3):
        state = 0
        for action in sequence:
            state = int(room.next_state[state, action])
        opening += bool(room.fsm.opened[state])
    assert opening == ways
    assert chance_of_opening(schema, 3, 7) == pytest.approx(ways / 15**3, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "limit", "positions"), [("CC4", 3, 7), ("CE4", 6, 8), ("noisy_CC3", 5, 7)]
)
def test_chance_agrees_with_a_million_random_attempts(
    name: str, limit: int, positions: int
) -> None:
    schema = find_schema(name)
    tables = RoomTables(positions)
    tables.add([(schema, Layout(tuple(range(len(schema.levers))), positions), limit)])
    rng = np.random.default_rng(1)
    many = 1_000_000
    row = np.full(many, tables.start[0])
    opened = np.zeros(many, bool)
    for _ in range(limit):
        action = rng.integers(tables.actions, size=many)
        luck = rng.random(many) if tables.stochastic else None
        choice = row * tables.columns + action
        if luck is not None:
            fails = (luck >= tables.chance[choice]) & (tables.chance[choice] > 0)
            choice = np.where(fails, row * tables.columns + tables.failed, choice)
        row = np.where(opened, row, tables.effect[choice])
        opened = tables.opened[row]
    exact = chance_of_opening(schema, limit, positions)
    error = math.sqrt(exact * (1 - exact) / many)
    assert abs(opened.mean() - exact) < 4 * error
    assert error < 0.05 * exact  # sharp enough to tell


def test_what_opens_the_door_without_being_a_solution_counts_as_opening_alone() -> None:
    # With six actions a second effect may be pushed beside the first: open, and no solution.
    schema = find_schema("CC4")
    all_three = chance_of_finding_all(schema, 6, 7, 400)
    each = Fraction(chance_of_opening(schema, 6, 7)) / 3
    if_every_opening_were_one = float(_inclusion_exclusion(each, 3, 400))
    assert 0 < all_three < if_every_opening_were_one


@pytest.mark.parametrize("attempts", [1, 2, 3, 30, 300, 700])
@pytest.mark.parametrize("name", ["CC3", "CC4", "two_of_four"])
def test_finding_all_is_the_coupon_collectors_probability(name: str, attempts: int) -> None:
    schema = find_schema(name)
    number = len(schema.solutions)
    each = chance_of_opening(schema, 3, 7) / number  # solutions of a kind are equally likely
    exact = Fraction(round(each * 15**3), 15**3)  # rounded, the sum would cancel to noise
    expected = float(_inclusion_exclusion(exact, number, attempts))
    found = chance_of_finding_all(schema, 3, 7, attempts)
    assert found == pytest.approx(expected, rel=1e-9, abs=0)
    assert (found > 0) == (attempts >= number)


def _inclusion_exclusion(each: Fraction, number: int, attempts: int) -> Fraction:
    terms = (
        (-1) ** missed * math.comb(number, missed) * (1 - missed * each) ** attempts
        for missed in range(number + 1)
    )
    return sum(terms, Fraction(0))

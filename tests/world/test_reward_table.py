"""The table of rewards, against plain Python and against the reward function itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from causal_openlock.schemas.schema import DOOR, Schema
from causal_openlock.testing import schemas
from causal_openlock.world.reward_table import RewardTable
from causal_openlock.world.rewards import PRESETS, TERMS, Events, find_reward
from causal_openlock.world.room import Layout
from causal_openlock.world.tables import RoomTables
from support.plain_paper_rewards import plain_paper_rewards
from support.reward_play import SCHEMAS, pay


@given(
    schema=schemas(max_levers=5),
    terms=st.lists(st.sampled_from(sorted(TERMS)), min_size=1, unique=True),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=60, deadline=None)
def test_terms_pay_what_plain_python_pays_in_any_schema_after_any_history(
    schema: Schema, terms: list[str], seed: int
) -> None:
    generator = np.random.default_rng(seed)
    tables = RoomTables(7)
    limit = schema.least_action_limit + 1
    layout = Layout.random(schema, generator)
    tables.add([(schema, layout, limit)])
    table = RewardTable(find_reward(terms), tables)
    word_of = [
        *(f"{sign}{place}" for sign in ("", "-") for place in range(7)),
        DOOR,
    ]
    for lever, place in zip(schema.levers, layout.places, strict=True):
        word_of[place], word_of[7 + place] = lever, f"-{lever}"
    # Active levers, pushes and the door more often than chance would have them.
    useful = [*layout.places, *layout.places, 14, *(7 + place for place in layout.places)]
    for _ in range(10):
        found = generator.random(len(schema.solutions)) < 0.4
        row, previous = tables.start[:1], -1
        actions, paid = [], []
        for _ in range(limit):
            action = int(generator.choice(useful if generator.random() < 0.8 else 15))
            if generator.random() < 0.1 and actions:
                action = actions[-1]
            row, reward = pay(table, row, [action], [previous], found[None])
            previous = action
            actions.append(action)
            paid.append(float(reward[0]))
            if tables.over[row[0]]:
                break
        expected = plain_paper_rewards(
            schema,
            terms,
            [word_of[action] for action in actions],
            frozenset(
                frozenset(solution)
                for solution, known in zip(schema.solutions, found, strict=True)
                if known
            ),
        )
        assert paid == pytest.approx(expected)


@pytest.mark.parametrize("reward", PRESETS)
@given(data=st.data(), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=6, deadline=None)
def test_the_table_pays_what_the_reward_function_pays(
    reward: str, data: st.DataObject, seed: int
) -> None:
    """In rooms that obey and rooms that do not, with repeats and with every history."""
    generator = np.random.default_rng(seed)
    chosen = [
        SCHEMAS["CC4"],
        SCHEMAS[data.draw(st.sampled_from(sorted(SCHEMAS)))],
        data.draw(schemas(max_levers=5, stochastic=data.draw(st.booleans()))),
    ]
    tables = RoomTables(7)
    table = RewardTable(find_reward(reward), tables)
    many = 300
    # Rooms are added one by one, so the table must take them in while it is in use.
    for schema in chosen:
        limit = schema.least_action_limit + int(generator.integers(2))
        tables.add([(schema, Layout.random(schema, generator), limit)])
        room = generator.integers(len(tables.rooms), size=many)
        found = generator.random((many, int(tables.solutions.max()))) < 0.3
        found &= np.arange(found.shape[1]) < tables.solutions[room][:, None]
        row, previous = tables.start[room], np.full(many, -1)
        for _ in range(12):
            action = generator.integers(15, size=many)
            repeat = (generator.random(many) < 0.2) & (previous >= 0)
            action = np.where(repeat, previous, action)
            after, paid = pay(table, row, action, previous, found, generator.random(many))
            events = Events.of(tables, row, action, after)
            events = events.with_history(tables, after, action == previous, found)
            expected = np.where(tables.over[row], 0.0, table.reward.pay(events))
            np.testing.assert_array_equal(paid, expected)
            previous = np.where(tables.over[after] | tables.over[row], -1, action)
            row = after


def test_putting_a_room_back_pays_nothing() -> None:
    for reward in PRESETS:
        tables = RoomTables(7)
        tables.add([(SCHEMAS["CC3"], Layout.of(SCHEMAS["CC3"], "trial1"), 3)])
        over = np.repeat(np.flatnonzero(tables.over), 15)
        table = RewardTable(find_reward(reward), tables)
        action = np.tile(np.arange(15), len(over) // 15)
        found = np.ones((len(over), 2), dtype=bool)
        after, paid = pay(table, over, action, action, found)
        assert (after == tables.start[0]).all()
        assert not paid.any()

"""Many rooms as one table: stacked together, they behave as each does alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.schemas.fsm import IntArray
from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.testing import schemas
from causal_openlock.world.reward_table import RewardTable
from causal_openlock.world.rewards import find_reward
from causal_openlock.world.room import Layout, Room
from causal_openlock.world.tables import ACTIONS_LEFT, OPENED, UNLOCKED, RoomTables
from support.table_steps import step

BUNDLED = bundled_schemas()
Stacked = tuple[Schema, Layout, int]
PER_ROW = (
    "observation",
    "over",
    "used",
    "status",
    "state",
    "unlocked",
    "opened",
    "solution",
    "on_path",
)


def rooms_of(drawn: list[Schema], positions: int, seed: int) -> list[Stacked]:
    """The schemas in random layouts with an action more or less than they need."""
    generator = np.random.default_rng(seed)
    return [
        (
            schema,
            Layout.random(schema, generator, positions),
            max(1, schema.least_action_limit + int(generator.integers(-1, 2))),
        )
        for schema in drawn
    ]


def stacked(rooms: list[Stacked], positions: int = 7) -> tuple[RoomTables, IntArray]:
    tables = RoomTables(positions)
    return tables, tables.add(rooms)


ROOMS = st.tuples(
    st.lists(schemas(max_levers=5, stochastic=True), min_size=2, max_size=4), st.integers(0, 1000)
).map(lambda drawn: rooms_of(drawn[0], 7, drawn[1]))


# -- stacking -------------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(rooms=ROOMS)
def test_rooms_stacked_in_one_go_or_one_by_one_are_the_same_table(rooms: list[Stacked]) -> None:
    at_once, index = stacked(rooms)
    one_by_one = RoomTables(7)
    assert [int(one_by_one.add([room])[0]) for room in rooms] == index.tolist()
    names = (*PER_ROW, "effect", "chance", "room", "start", "solutions", "action_limit", "twin")
    for name in names:
        assert np.array_equal(getattr(at_once, name), getattr(one_by_one, name)), name
        assert getattr(at_once, name).dtype == getattr(one_by_one, name).dtype
    assert at_once.stochastic == one_by_one.stochastic
    assert at_once.rows == one_by_one.rows
    everywhere = np.arange(at_once.rows)
    assert np.array_equal(at_once.begins(everywhere), one_by_one.begins(everywhere))
    assert at_once.nbytes == one_by_one.nbytes


@settings(max_examples=40, deadline=None)
@given(rooms=ROOMS)
def test_a_room_behaves_among_others_as_it_does_alone(rooms: list[Stacked]) -> None:
    tables, index = stacked(rooms)
    for which, (schema, layout, limit) in zip(index, rooms, strict=True):
        alone, _ = stacked([(schema, layout, limit)])
        first, count = tables.start[which], alone.rows
        mine = slice(first, first + count)
        for name in PER_ROW:
            assert np.array_equal(getattr(tables, name)[mine], getattr(alone, name)), name
        row, action = np.divmod(np.arange(count * 17), 17)
        choices = tables.choice(first + row, action)
        assert np.array_equal(tables.after(first + row, action), alone.effect + first)
        if alone.stochastic:
            assert np.array_equal(tables.chance[choices], alone.chance)
        elif tables.stochastic:
            assert set(tables.chance[choices]) <= {0.0, 1.0}
        solutions = len(schema.solutions)
        begins = tables.begins(np.arange(mine.start, mine.stop))
        assert np.array_equal(begins[:, :solutions], alone.begins(np.arange(count)))
        assert not begins[:, solutions:].any()
        assert (tables.room[mine] == which).all()
        assert tables.solutions[which] == solutions
        assert tables.action_limit[which] == limit
        assert tables.rooms[which].schema == schema


def test_the_same_room_is_stacked_once_and_another_limit_makes_another_room() -> None:
    cc3, ce3 = BUNDLED["CC3"], BUNDLED["CE3"]
    trial1, trial2 = Layout.of(cc3, "trial1"), Layout.of(cc3, "trial2")
    spelled = Layout.of(cc3, trial1.as_mapping(cc3))
    tables, index = stacked(
        [(cc3, trial1, 3), (cc3, trial2, 3), (cc3, spelled, 3), (ce3, trial1, 3)]
    )
    assert index.tolist() == [0, 1, 0, 2]
    rows = tables.rows
    assert tables.add([(ce3, trial1, 3), (cc3, trial1, 3)]).tolist() == [2, 0]
    assert tables.rows == rows
    assert tables.add([(cc3, trial1, 4)]).tolist() == [3]
    assert tables.rows > rows


def test_rooms_that_differ_by_the_layout_alone_are_twins() -> None:
    cc3, ce3 = BUNDLED["CC3"], BUNDLED["CE3"]
    layouts = [Layout(places) for places in ((0, 1, 2), (6, 3, 1), (2, 1, 0))]
    rooms = [(cc3, layouts[0], 3), (ce3, layouts[0], 3), (cc3, layouts[1], 3), (cc3, layouts[0], 4)]
    tables, _ = stacked(rooms)
    tables.add([(ce3, layouts[2], 3), (cc3, layouts[2], 3)])
    assert tables.twin.tolist() == [0, 1, 0, 3, 1, 0]
    for room, twin in enumerate(tables.twin):
        mine, its = tables.rows_of(room), tables.rows_of(twin)
        for name in ("state", "used", "over", "status"):
            held = getattr(tables, name)
            assert np.array_equal(held[mine], held[its]), (room, name)


# -- memory ---------------------------------------------------------------------------------------

LEVERS = [f"L{index}" for index in range(12)]


@pytest.mark.parametrize(
    ("gate", "megabytes"),
    [(Gate("all"), 20), (Gate("at_least", 6), 26)],
    ids=["1 solution", "924 solutions"],
)
@pytest.mark.parametrize("reward", ["paper", "authors_2018_unique_solutions"])
def test_a_room_of_twelve_levers_takes_a_few_megabytes(
    gate: Gate, megabytes: int, reward: str
) -> None:
    """Of arrays that last, the table of rewards included."""
    schema = Schema("large", LEVERS, {lever: [DOOR] for lever in LEVERS}, gates={DOOR: gate})
    generator = np.random.default_rng(0)
    tables = RoomTables(12)
    rewards = RewardTable(find_reward(reward), tables)
    took = []
    for _ in range(3):
        tables.add([(schema, Layout.random(schema, generator, 12), 13)])
        rewards.fill()
        took.append(tables.nbytes + rewards.nbytes)
    assert tables.rows > 3 * 8192
    assert np.diff(took).max() < megabytes * 1e6
    # Which solutions the actions so far begin is kept once, whatever the layouts.
    once = len(schema.solutions) * tables.rows / 3
    assert took[0] < megabytes * 1e6 + once


def test_rooms_that_obey_keep_no_chances() -> None:
    tables, _ = stacked([(BUNDLED["CC4"], Layout((0, 1, 2, 3)), 3)])
    assert len(tables.chance) == 0
    tables.add([(NOISY, Layout((0, 1, 2)), 3)])
    assert len(tables.chance) == 17 * tables.rows


@pytest.mark.parametrize(
    ("room", "said"),
    [
        ((BUNDLED["CC3"], Layout((0, 1, 2), 8), 3), "not of a room of 7 positions"),
        ((BUNDLED["CC3"], Layout((0, 1)), 3), "does not place the levers"),
        ((BUNDLED["CC3"], Layout((0, 1, 2)), 64), "1 to 63 actions, not 64"),
        ((BUNDLED["CC3"], Layout((0, 1, 2)), 0), "1 to 63 actions, not 0"),
    ],
    ids=["positions", "levers", "too long", "too short"],
)
def test_what_cannot_be_stacked_leaves_the_tables_as_they_are(room: Stacked, said: str) -> None:
    fine = (BUNDLED["CC4"], Layout((0, 1, 2, 3)), 3)
    tables, _ = stacked([fine])
    rows = tables.rows
    with pytest.raises(ValueError, match=said):
        tables.add([(BUNDLED["CE4"], Layout((0, 1, 2, 3)), 3), room])
    assert tables.rows == rows == tables.start[0] + rows
    assert tables.add([fine]).tolist() == [0]
    assert len(tables.rooms) == 1


# -- stepping -------------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(rooms=ROOMS, seed=st.integers(0, 1000))
def test_stepping_many_rooms_at_once_is_stepping_the_machine_of_each(
    rooms: list[Stacked], seed: int
) -> None:
    tables, index = stacked(rooms)
    generator = np.random.default_rng(seed)
    subjects = 3 * len(rooms)
    which = index[np.arange(subjects) % len(rooms)]
    row = tables.start[which]
    state, used = [0] * subjects, [0] * subjects
    for _ in range(25):
        action = generator.integers(0, 15, subjects)
        # The same luck for all: what differs is the room.
        luck = generator.random(subjects)
        over = tables.over[row]
        row = step(tables, row, action, luck)
        for subject in range(subjects):
            schema, layout, limit = rooms[subject % len(rooms)]
            room = Room.of(schema, layout)
            if over[subject]:
                state[subject] = used[subject] = 0
                assert row[subject] == tables.start[which[subject]]
            else:
                if luck[subject] < room.chance[state[subject], action[subject]]:
                    state[subject] = int(room.next_state[state[subject], action[subject]])
                used[subject] += 1
            now = row[subject]
            assert tables.state[now] == state[subject]
            assert tables.used[now] == used[subject]
            assert np.array_equal(tables.observation[now], room.observation[state[subject]])
            assert tables.unlocked[now] == room.fsm.unlocked[state[subject]]
            assert tables.opened[now] == room.fsm.opened[state[subject]]
            assert tables.solution[now] == room.fsm.solution[state[subject]]
            assert tables.over[now] == (tables.opened[now] or used[subject] == limit)
            assert tables.room[now] == which[subject]


def test_a_batch_and_a_single_subject_take_the_same_steps() -> None:
    rooms = rooms_of([BUNDLED["noisy_CC3"], BUNDLED["CC4"], BUNDLED["seven"]], 7, 0)
    tables, index = stacked(rooms)
    generator = np.random.default_rng(1)
    row = tables.start[index]
    single = [row[subject : subject + 1].copy() for subject in range(3)]
    for _ in range(60):
        action, luck = generator.integers(0, 15, 3), generator.random(3)
        row = step(tables, row, action, luck)
        for subject in range(3):
            me = slice(subject, subject + 1)
            single[subject] = step(tables, single[subject], action[me], luck[me])
        assert np.array_equal(row, np.concatenate(single))


@settings(max_examples=40, deadline=None)
@given(rooms=ROOMS)
def test_the_status_byte_says_what_the_other_tables_say(rooms: list[Stacked]) -> None:
    tables, _ = stacked(rooms)
    left = tables.action_limit[tables.room] - tables.used
    assert np.array_equal(tables.status & ACTIONS_LEFT, np.where(tables.over, 0, left))
    assert np.array_equal((tables.status & UNLOCKED) > 0, tables.unlocked)
    assert np.array_equal((tables.status & OPENED) > 0, tables.opened)
    assert np.array_equal(tables.over, (tables.status & ACTIONS_LEFT) == 0)
    assert np.array_equal(tables.observation[:, -2] == 0, tables.unlocked)
    assert np.array_equal(tables.observation[:, -1] == 1, tables.opened)
    for room, seen in zip(tables.room, tables.observation, strict=True):
        assert np.array_equal(seen[7:14] == 1, tables.rooms[room].active)
    # One comparison tells a step what it has to know, since an attempt ends with an open door.
    assert not (tables.opened & ~tables.unlocked).any()
    assert np.array_equal(tables.status >= UNLOCKED, tables.unlocked)
    assert np.array_equal(tables.status >= OPENED, tables.opened)


def test_the_longest_attempt_fits_into_the_status_byte() -> None:
    tables, _ = stacked([(BUNDLED["CC3"], Layout((0, 1, 2)), 63)])
    assert tables.status[0] == 63
    assert ((tables.status & ACTIONS_LEFT) + tables.used)[~tables.over].tolist() == [63] * int(
        (~tables.over).sum()
    )


# -- luck -----------------------------------------------------------------------------------------

NOISY = Schema(
    "noisy",
    ["A", "B", "C"],
    {"A": {"C": 0.6}, "B": {"C": 0.3}, "C": {DOOR: 0.25}},
    gates={"C": Gate("any")},
)


@pytest.mark.parametrize(
    ("before", "action", "chance"),
    [
        ([], 0, 1.0),  # a free lever obeys
        ([], 2, 0.0),  # a lever that nothing enables does not
        ([0], 2, 0.6),
        ([1], 2, 0.3),
        ([0, 1], 2, 1 - 0.4 * 0.7),  # either cause may transmit
        ([0], 7, 1.0),
        ([0], 6, 0.0),  # an inactive lever
        ([0], 14, 0.0),  # a locked door
    ],
)
def test_luck_decides_with_the_stated_probability(
    before: list[int], action: int, chance: float
) -> None:
    tables, _ = stacked([(NOISY, Layout((0, 1, 2)), 6)])
    row = np.zeros(1, dtype=np.int64)
    for done in before:
        row = step(tables, row, np.array([done]), np.zeros(1))
    choice = row * tables.columns + action
    assert tables.chance[choice] == pytest.approx(chance)
    trials = 4000
    luck = np.random.default_rng(7).random(trials)
    after = step(tables, row.repeat(trials), np.full(trials, action), luck)
    moved = tables.state[after] != tables.state[row]
    assert (tables.used[after] == len(before) + 1).all()
    if chance in (0.0, 1.0):
        assert (moved == (chance == 1.0)).all()
    else:
        assert stats.binomtest(int(moved.sum()), trials, chance).pvalue > 0.001
        assert np.array_equal(moved, luck < tables.chance[choice])
        # A push that fails only costs the action.
        assert (after[~moved] == tables.effect[row * tables.columns + tables.failed]).all()


def test_an_unlocked_door_gives_way_by_chance_and_unlocks_for_sure() -> None:
    tables, _ = stacked([(NOISY, Layout((0, 1, 2)), 6)])
    row = np.zeros(1, dtype=np.int64)
    for done in (0, 2):
        row = step(tables, row, np.array([done]), np.zeros(1))
    assert tables.unlocked[row].all()
    assert tables.chance[row * tables.columns + 14] == pytest.approx(0.25)
    after = step(tables, row.repeat(2), np.full(2, 14), np.array([0.24, 0.26]))
    assert tables.opened[after].tolist() == [True, False]
    assert tables.over[after].tolist() == [True, False]


def test_rooms_that_leave_something_to_chance_ask_for_luck_and_others_do_not() -> None:
    certain, _ = stacked([(BUNDLED["CC3"], Layout((0, 1, 2)), 3)])
    row = np.zeros(2, dtype=np.int64)
    assert not certain.stochastic
    first = step(certain, row, np.array([0, 1]))
    assert certain.state[first].tolist() == [1, 0]
    certain.add([(NOISY, Layout((0, 1, 2)), 3)])
    assert certain.stochastic
    with pytest.raises(ValueError, match="pass luck"):
        step(certain, row, np.array([0, 1]))
    # Luck is nothing to the rooms that leave nothing to it.
    worst = step(certain, row, np.array([0, 1]), np.full(2, 1 - 1e-12))
    assert certain.state[worst].tolist() == [1, 0]

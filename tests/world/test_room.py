"""Rooms: levers in their places, and the paper's rooms against two independent readings."""

from __future__ import annotations

import csv
import gzip
from collections.abc import Iterable
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from causal_openlock.errors import LayoutError
from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.schemas.schema import DOOR, Schema
from causal_openlock.testing import layouts, schemas
from causal_openlock.world.room import (
    PAPER_POSITIONS,
    Layout,
    Room,
    action_names,
    position_coordinates,
    position_names,
    positions_for,
    published_layouts,
)
from causal_openlock.world.tables import RoomTables
from support.places import DATA
from support.table_steps import step

BUNDLED = bundled_schemas()
BEHAVIOUR = DATA / "behaviour.csv.gz"

# Which role stands where in the authors' trials, lever by lever, as their environment has it.
SHORT = {"UR": 0, "UP": 1, "UL": 2, "L": 3, "LL": 4, "LO": 5, "LR": 6}
TRIALS = {
    "trial1": "UR LL UL", "trial2": "L LO UP", "trial3": "LR UL LL", "trial4": "UR UL UP",
    "trial5": "L LL UL", "trial6": "LR LO LL", "trial7": "LL UR LR UL", "trial8": "UR UP UL L",
    "trial9": "UL UP L LL", "trial10": "LL UL L LO", "trial11": "LR L LL LO",
}  # fmt: skip
ROOMS = [
    (name, trial)
    for name in ("CC3", "CE3", "CC4", "CE4")
    for trial, roles in TRIALS.items()
    if len(roles.split()) == int(name[2])
]


# -- the paper's rooms ----------------------------------------------------------------------------


def walk(room: Room, sequences: NDArray[np.int64], limit: int = 3) -> NDArray[np.int8]:
    """``[N, T+1, 2P+2]`` what is seen before and after each action of N sequences of T."""
    tables = RoomTables(room.positions)
    index = tables.add([(room.schema, room.layout, limit)])
    row = tables.start[index].repeat(len(sequences))
    seen = [tables.observation[row]]
    for action in sequences.T:
        row = step(tables, row, action)
        seen.append(tables.observation[row])
    return np.stack(seen, axis=1)


ALL_SEQUENCES = np.array(list(product(range(15), repeat=3)))


def observed_by_hand(kind: str, places: list[int], actions: Iterable[int]) -> list[list[int]]:
    """The rules of the paper's room, one lever after another, in the words of its authors' code.

    Common cause: l0 moves freely; the others move, out or back, only while l0 is out; the door is
    unlocked while any of the others is out. Common effect: the others move freely; l0 moves, out
    or back, only while any of them is out; the door is unlocked while l0 is out. White levers
    never move. The door opens if it is unlocked when it is pushed, and then stays open.
    """
    out = [False] * len(places)
    opened = False

    def unlocked() -> bool:
        return any(out[1:]) if kind == "CC" else out[0]

    def movable(role: int) -> bool:
        if kind == "CC":
            return role == 0 or out[0]
        return role != 0 or any(out[1:])

    def look() -> list[int]:
        levers, colours = [0] * 7, [0] * 7
        for role, place in enumerate(places):
            levers[place], colours[place] = int(out[role]), 1
        return [*levers, *colours, int(not unlocked()), int(opened)]

    seen = [look()]
    for action in actions:
        if action == 14:
            opened = opened or unlocked()
        elif action % 7 in places:
            role = places.index(action % 7)
            if movable(role):
                out[role] = action < 7
        seen.append(look())
    return seen


@pytest.mark.parametrize(("name", "trial"), ROOMS, ids=["-".join(room) for room in ROOMS])
def test_every_sequence_of_three_actions_follows_the_authors_rules(name: str, trial: str) -> None:
    places = [SHORT[short] for short in TRIALS[trial].split()]
    seen = walk(Room.of(BUNDLED[name], trial), ALL_SEQUENCES)
    by_hand = [observed_by_hand(name[:2], places, sequence) for sequence in ALL_SEQUENCES.tolist()]
    assert np.array_equal(seen, by_hand)


@pytest.mark.parametrize(("name", "trial"), ROOMS, ids=["-".join(room) for room in ROOMS])
def test_exactly_the_solutions_open_the_door(name: str, trial: str) -> None:
    places = [SHORT[short] for short in TRIALS[trial].split()]
    seen = walk(Room.of(BUNDLED[name], trial), ALL_SEQUENCES)
    opening = {tuple(sequence) for sequence in ALL_SEQUENCES[seen[:, 3, 15] == 1].tolist()}
    causes_first = (
        [(places[0], other, 14) for other in places[1:]]
        if name[:2] == "CC"
        else [(other, places[0], 14) for other in places[1:]]
    )
    assert opening == set(causes_first)
    assert len(opening) == {"3": 2, "4": 3}[name[2]]
    room = Room.of(BUNDLED[name], trial)
    assert opening == {tuple(room.action_of(solution)) for solution in room.schema.solutions}


def test_there_are_22_such_rooms() -> None:
    assert len(ROOMS) == 22


def test_the_recorded_behaviour_of_the_authors_environment_is_reproduced() -> None:
    with gzip.open(BEHAVIOUR, "rt", encoding="ascii", newline="") as file:
        records = list(csv.DictReader(file))
    assert len(records) == 6750
    index = {name: number for number, name in enumerate(action_names(7))}
    for schema, layout in {(record["schema"], record["layout"]) for record in records}:
        mine = [r for r in records if (r["schema"], r["layout"]) == (schema, layout)]
        sequences = np.array([[index[r[f"action{step}"]] for step in (1, 2, 3)] for r in mine])
        assert len(np.unique(sequences, axis=0)) == 3375
        recorded = [[[*map(int, r[f"observation{step}"])] for step in range(4)] for r in mine]
        assert np.array_equal(walk(Room.of(BUNDLED[schema], layout), sequences), recorded)


def test_a_longer_attempt_follows_the_same_rules() -> None:
    generator = np.random.default_rng(0)
    for name, trial in ROOMS:
        places = [SHORT[short] for short in TRIALS[trial].split()]
        # Grey levers and the door only, so that much happens in six actions.
        grey = [*places, *(7 + place for place in places), 14]
        sequences = generator.choice(grey, (60, 6))
        seen = walk(Room.of(BUNDLED[name], trial), sequences, limit=6)
        for sequence, observed in zip(sequences.tolist(), seen, strict=True):
            by_hand = observed_by_hand(name[:2], places, sequence)
            # The attempt ends when the door opens, which the rules alone do not.
            ends = [look[15] for look in by_hand].index(1) if by_hand[-1][15] else 6
            assert np.array_equal(observed[: ends + 1], by_hand[: ends + 1])


# -- names and bits -------------------------------------------------------------------------------


def test_the_published_layouts_are_the_authors() -> None:
    for name in ("CC3", "CE3", "CC4", "CE4"):
        fitting = published_layouts(BUNDLED[name])
        assert fitting == [trial for schema, trial in ROOMS if schema == name]
        for trial in fitting:
            layout = Layout.of(BUNDLED[name], trial)
            assert layout.name == trial
            assert layout.places == tuple(SHORT[short] for short in TRIALS[trial].split())
    assert published_layouts(BUNDLED["seven"]) == []


def test_actions_are_named_by_position_in_the_papers_order() -> None:
    assert action_names(7) == (
        "push_UPPERRIGHT", "push_UPPER", "push_UPPERLEFT", "push_LEFT", "push_LOWERLEFT",
        "push_LOWER", "push_LOWERRIGHT", "pull_UPPERRIGHT", "pull_UPPER", "pull_UPPERLEFT",
        "pull_LEFT", "pull_LOWERLEFT", "pull_LOWER", "pull_LOWERRIGHT", "push_door",
    )  # fmt: skip
    assert action_names(9)[8:10] == ("push_P8", "pull_P0")
    assert len(action_names(12)) == 25


def test_observation_bits_are_levers_colours_lock_door() -> None:
    room = Room.of(BUNDLED["CC3"], {"L0": "LEFT", "L1": "UPPERRIGHT", "L2": "LOWER"})

    def seen(*pushed: str, opened: bool = False) -> str:
        bits = room.observation[room.fsm.state(pushed, opened)]
        return "".join(map(str, bits))

    assert seen() == "0000000100101010"
    assert seen("L0") == "0001000100101010"
    assert seen("L0", "L1") == "1001000100101000"
    assert seen("L2", opened=True) == "0000010100101001"
    assert seen("L0", opened=True) == "0001000100101011"
    assert room.active.tolist() == [True, False, False, True, False, True, False]


def test_an_inactive_lever_never_moves_and_never_has_a_chance() -> None:
    room = Room.of(
        BUNDLED["seven"], dict(zip(BUNDLED["seven"].levers, position_names(9), strict=False)), 9
    )
    assert room.active.tolist() == [True] * 7 + [False] * 2
    for place in (7, 8):
        for action in (place, 9 + place):
            assert (room.next_state[:, action] == np.arange(room.fsm.states)).all()
            assert not room.chance[:, action].any()
    assert room.chance[:, 0].any()


@settings(max_examples=60, deadline=None)
@given(data=st.data(), schema=schemas(max_levers=9, stochastic=True), more=st.integers(0, 3))
def test_a_room_is_its_machine_with_the_actions_in_other_places(
    data: st.DataObject, schema: Schema, more: int
) -> None:
    positions = min(12, positions_for(schema) + more)
    room = Room.of(schema, data.draw(layouts(schema, positions)))
    fsm, levers = room.fsm, len(schema.levers)
    for lever, place in room.layout.as_mapping(schema).items():
        role, place_index = schema.levers.index(lever), position_names(positions).index(place)
        for mine, its in ((place_index, role), (positions + place_index, levers + role)):
            assert np.array_equal(room.next_state[:, mine], fsm.next_state[:, its])
            assert np.array_equal(room.chance[:, mine], fsm.chance[:, its])
        assert np.array_equal(room.observation[:, place_index], np.arange(fsm.states) >> role & 1)
    assert np.array_equal(room.next_state[:, -1], fsm.next_state[:, -1])
    assert np.array_equal(room.observation[:, -2], ~fsm.unlocked)
    assert room.observation.shape == (fsm.states, 2 * positions + 2)
    assert room.active.sum() == levers


def test_a_room_of_twelve_positions_works_like_any_other() -> None:
    levers = [f"L{index}" for index in range(12)]
    chain = dict(zip(levers, [[lever] for lever in [*levers[1:], DOOR]], strict=True))
    long = Schema("long", levers, chain)
    backwards = {lever: f"P{11 - index}" for index, lever in enumerate(levers)}
    room = Room.of(long, backwards)
    assert room.positions == 12
    assert room.action_of(long.solutions[0]) == [*range(11, -1, -1), 24]
    seen = walk(room, np.array([room.action_of(long.solutions[0])]), limit=13)[0]
    assert seen[:, -1].tolist() == [0] * 13 + [1]
    assert seen[:, -2].tolist() == [1] * 12 + [0] * 2
    assert seen[12].tolist() == [1] * 24 + [0, 0]
    assert [look[:12].sum() for look in seen[:13]] == list(range(13))


def test_levers_stand_apart_in_rooms_of_every_size() -> None:
    for positions in range(7, 13):
        places = position_coordinates(positions)
        assert places.shape == (positions, 2)
        gaps = np.linalg.norm(places[:, None] - places[None], axis=2)
        assert gaps[~np.eye(positions, dtype=bool)].min() > 1.5
        assert not ((places[:, 0] > 0) & (abs(places[:, 1]) < 1)).any()  # there is the door


# -- layouts --------------------------------------------------------------------------------------

FULL = {"L0": "LEFT", "L1": "UPPER", "L2": "LOWER"}
BAD_LAYOUTS: list[tuple[str, Any, str]] = [
    ("two levers at one position", {**FULL, "L2": "UPPER"}, "two levers are at UPPER; give each"),
    ("unknown position", {**FULL, "L1": "UPER"}, "L1 cannot be at 'UPER'; did you mean UPPER?"),
    ("position by number", {**FULL, "L1": 3}, "L1 cannot be at 3"),
    ("unknown lever", {**FULL, "L3": "LOWERLEFT"}, "places 'L3', which CC3 does not have; did you"),
    ("missing lever", {"L0": "LEFT", "L2": "LOWER"}, "gives no position to L1; add one"),
    ("nothing", {}, "gives no position to L0; add one"),
    ("wrong count", "trial7", "places 4 levers and CC3 has 3; layouts that fit: trial1, trial2"),
    ("unknown name", "trail3", "there is no layout 'trail3'; did you mean trial3? known"),
    ("no name", "", "there is no layout ''; known: trial1, trial2"),
    ("layout of another count", Layout((0, 1)), "places 2 levers and CC3 has 3"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("layout", "said"), [row[1:] for row in BAD_LAYOUTS], ids=[row[0] for row in BAD_LAYOUTS]
)
def test_a_layout_that_no_room_can_have_is_refused(layout: Any, said: str) -> None:
    with pytest.raises(LayoutError) as caught:
        Layout.of(BUNDLED["CC3"], layout)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_places_outside_the_room_and_rooms_of_no_size_are_refused() -> None:
    with pytest.raises(LayoutError, match="no position 7 in a room of 7"):
        Layout((0, 7))
    with pytest.raises(LayoutError, match="no position -1"):
        Layout((-1,))
    for positions in (-1, 0, 6, 13):
        with pytest.raises(LayoutError, match=f"7 to 12 positions, not {positions}"):
            position_names(positions)
    with pytest.raises(LayoutError, match="layouts that fit: random"):
        Layout.of(BUNDLED["seven"], "trial7")


def test_a_layout_fits_any_schema_with_as_many_levers_and_any_larger_room() -> None:
    layout = Layout.of(BUNDLED["two_of_four"], "trial7")
    assert layout == Layout.of(BUNDLED["CE4"], "trial7")
    assert layout.as_mapping(BUNDLED["CE4"]) == {
        "L0": "LOWERLEFT", "L1": "UPPERRIGHT", "L2": "LOWERRIGHT", "L3": "UPPERLEFT",
    }  # fmt: skip
    assert Layout.of(BUNDLED["CE4"], layout.as_mapping(BUNDLED["CE4"])).places == layout.places
    large = Layout.of(BUNDLED["CE4"], "trial7", 9)
    assert (large.places, large.positions, large.name) == (layout.places, 9, "trial7")
    assert Layout.of(BUNDLED["CE4"], layout, 9) == large
    assert Layout.of(BUNDLED["CE4"], large) == large
    with pytest.raises(LayoutError, match="cannot be at 'UPPER'"):
        Layout.of(BUNDLED["CE4"], {"L0": "UPPER", "L1": "P1", "L2": "P2", "L3": "P3"}, 9)
    assert Layout((3, 1)).name == "LEFT UPPER"
    assert PAPER_POSITIONS[3] == "LEFT"


def test_random_layouts_are_uniform() -> None:
    generator = np.random.default_rng(2018)
    schema = BUNDLED["CC3"]
    drawn = [Layout.random(schema, generator).places for _ in range(8400)]
    assert all(len(set(places)) == 3 for places in drawn)
    codes = np.array([49 * a + 7 * b + c for a, b, c in drawn])
    _, counts = np.unique(codes, return_counts=True)
    assert len(counts) == 7 * 6 * 5
    assert stats.chisquare(counts).pvalue > 0.001
    larger = [Layout.random(schema, generator, 12).places for _ in range(500)]
    assert max(map(max, larger)) == 11


def test_random_layouts_follow_the_generator() -> None:
    def draw(seed: int) -> list[Layout]:
        generator = np.random.default_rng(seed)
        return [Layout.random(BUNDLED["CC4"], generator) for _ in range(5)]

    assert draw(1) == draw(1) != draw(2)

"""Rooms: levers in their places, the oracle's rules, and what the authors' environment did."""

import csv
import gzip
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.schemas.schema import DOOR
from causal_openlock.testing import layouts, schemas
from causal_openlock.world.rewards import find_reward
from causal_openlock.world.room import (
    Layout,
    Room,
    action_index,
    action_names,
    first_layout,
    positions_for,
    published_layouts,
)
from causal_openlock.world.rooms import Rooms, RoomTables
from oracle import Room as Trial
from oracle import Rules
from support.places import DATA

BUNDLED = bundled_schemas()
ALL_SEQUENCES = np.array(list(product(range(15), repeat=3)))
# Which role stands where in the authors' trials, lever by lever, as their environment has it.
SHORT = {"UR": 0, "UP": 1, "UL": 2, "L": 3, "LL": 4, "LO": 5, "LR": 6}
TRIALS = {
    "trial1": "UR LL UL", "trial2": "L LO UP", "trial3": "LR UL LL", "trial4": "UR UL UP",
    "trial5": "L LL UL", "trial6": "LR LO LL", "trial7": "LL UR LR UL", "trial8": "UR UP UL L",
    "trial9": "UL UP L LL", "trial10": "LL UL L LO", "trial11": "LR L LL LO",
}  # fmt: skip


def trials_of(name):
    return {
        trial: tuple(SHORT[short] for short in roles.split())
        for trial, roles in TRIALS.items()
        if len(roles.split()) == int(name[2])
    }


def rules_at(schema, places):
    return Rules.of(schema).at(dict(zip(schema.levers, places, strict=True)))


def walk(room, sequences, limit=3):
    """``[N, T+1, 2P+2]`` what is seen before and after each action of N sequences of T."""
    many, tables = len(sequences), RoomTables.of([(room.schema, limit)], room.positions)
    rooms = Rooms(tables, [find_reward("basic")], many, attempt_limit=1, put_back=False)
    lever = np.tile(room.layout.lever_at(), (many, 1))
    rooms.begin_trials(slice(None), np.zeros(many, int), lever)
    seen = [rooms.observation]
    seen += [rooms.step(action, seen=True).seen for action in sequences.T]
    return np.stack(seen, axis=1)


@pytest.mark.parametrize("name", ["CC3", "CE3", "CC4", "CE4"])
def test_rooms_of_the_paper_in_every_sequence_of_three_actions(name):
    schema, published = BUNDLED[name], trials_of(name)
    assert [*published_layouts(schema)] == [*published]
    assert first_layout(schema) == Layout.of(schema, next(iter(published)))
    for trial, places in published.items():
        room = Room.of(schema, trial)
        assert (room.layout.name, room.layout.places) == (trial, places)
        seen = walk(room, ALL_SEQUENCES)
        # Common cause: the first lever frees the others, any of which unlocks; common effect: any
        # of the others frees the first, which unlocks.
        other = [(places[0], p, 14) if name[:2] == "CC" else (p, places[0], 14) for p in places[1:]]
        opening = {tuple(actions) for actions in ALL_SEQUENCES[seen[:, 3, 15] == 1].tolist()}
        assert opening == set(other)
        assert opening == {tuple(room.action_of(solution)) for solution in schema.solutions}


def test_the_recorded_behaviour_of_the_authors_environment_is_reproduced():
    with gzip.open(DATA / "behaviour.csv.gz", "rt", encoding="ascii", newline="") as file:
        records = list(csv.DictReader(file))
    assert len(records) == 6750
    index = {name: number for number, name in enumerate(action_names(7))}
    for schema, layout in {(record["schema"], record["layout"]) for record in records}:
        mine = [r for r in records if (r["schema"], r["layout"]) == (schema, layout)]
        sequences = np.array([[index[r[f"action{step}"]] for step in (1, 2, 3)] for r in mine])
        assert len(np.unique(sequences, axis=0)) == 3375
        recorded = [[[*map(int, r[f"observation{step}"])] for step in range(4)] for r in mine]
        assert np.array_equal(walk(Room.of(BUNDLED[schema], layout), sequences), recorded)


@settings(max_examples=60, deadline=None)
@given(data=st.data(), schema=schemas(max_levers=9, stochastic=True), more=st.integers(0, 3))
def test_tables_of_a_room_by_position(data, schema, more):
    positions = min(12, positions_for(schema) + more)
    layout = data.draw(layouts(schema, positions))
    room, plain = Room.of(schema, layout), Trial(rules_at(schema, layout.places), positions)
    fsm = room.fsm
    assert room.active.tolist() == plain.observation()[positions : 2 * positions]
    for state in data.draw(st.lists(st.integers(0, fsm.states - 1), min_size=4, max_size=4)):
        roles = [lever for bit, lever in enumerate(schema.levers) if state >> bit & 1]
        plain.begin()
        plain.pushed = frozenset(layout.places[schema.levers.index(lever)] for lever in roles)
        is_open = plain.opened = bool(state >> len(schema.levers))
        assert room.observation[state].tolist() == plain.observation()
        for action in range(2 * positions + 1):
            _, node = plain.named(action)
            plain.opened = is_open and node == DOOR
            chance = plain.can_do(action)
            bit = [*layout.places, node].index(node)  # the door's is above the levers
            assert room.next_state[state, action] == (state ^ 1 << bit if chance else state)


def test_actions_are_named_by_position_in_the_papers_order():
    assert action_names(9)[8:10] == ("push_P8", "pull_P0")
    for positions in (7, 9):
        for index, name in enumerate(action_names(positions)):
            forms = (name, name.replace("_", " "), name.upper(), name.removeprefix("push_"))
            asked = {action_index(form, positions) for form in (*forms, index, np.int64(index))}
            assert asked == {index}


def test_a_layout_fits_any_schema_with_as_many_levers_and_any_larger_room():
    layout, ce4 = Layout.of(BUNDLED["two_of_four"], "trial7"), BUNDLED["CE4"]
    assert (layout, layout.name) == (Layout.of(ce4, "trial7"), "trial7")
    named = Layout.of(ce4, layout.as_mapping(ce4))
    assert (named.places, named.name) == (
        layout.places, "LOWERLEFT UPPERRIGHT LOWERRIGHT UPPERLEFT"
    )  # fmt: skip
    assert named == Layout.of(ce4, named.name) == Layout(layout.places)
    large = Layout(layout.places, 9, "trial7")
    assert Layout.of(ce4, layout, 9) == Layout.of(ce4, [*layout.places], 9) == large
    assert Layout.of(BUNDLED["CC3"], Layout((3, 1, 0)), 8).name == "P3 P1 P0"
    assert first_layout(BUNDLED["seven"]).places == (0, 1, 2, 3, 4, 5, 6)


def test_random_layouts_are_uniform_and_follow_the_generator():
    generator, schema = np.random.default_rng(2018), BUNDLED["CC3"]
    drawn = [Layout.random(schema, generator).places for _ in range(8400)]
    assert all(len(set(places)) == 3 for places in drawn)
    _, counts = np.unique(drawn, axis=0, return_counts=True)
    assert len(counts) == 7 * 6 * 5
    assert stats.chisquare(counts).pvalue > 0.001
    assert max(max(Layout.random(schema, generator, 12).places) for _ in range(500)) == 11
    again = [Layout.random(schema, np.random.default_rng(2018)).places for _ in range(2)]
    assert again == [drawn[0]] * 2

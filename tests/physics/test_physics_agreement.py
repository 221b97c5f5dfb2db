"""The physical room ends in what the tables say, and does it the same way every time."""

import hashlib
import subprocess
import sys
from itertools import product

import numpy as np
import pytest

from causal_openlock.physics.room import PhysicalRoom
from causal_openlock.world.room import Layout, Room
from support.physical_play import Guard, effects, room_of
from support.places import ROOT

pytestmark = pytest.mark.slow

each_room_of_the_paper = pytest.mark.parametrize(
    ("name", "layout"),
    [("CC3", "trial1"), ("CE3", "trial5"), ("CC4", "trial7"), ("CE4", "trial8")],
)


def play_and_compare(room, sequences):
    """Play each sequence and compare what is seen after every action with the tables."""
    physical = PhysicalRoom(room.fsm, room.layout)
    guard = Guard(physical)
    for sequence in sequences:
        physical.reset()
        state = 0
        for action in sequence:
            movement = physical.act(action)
            state = int(room.next_state[state, action])
            assert physical.state == state, sequence
            assert physical.pose().locked == room.observation[state][-2], sequence
            assert movement.finished, sequence
    assert guard.steps > 0


def states_of(room, sequence):
    """The states that a sequence leads through."""
    states = [0]
    for action in sequence:
        states.append(int(room.next_state[states[-1], action]))
    return tuple(states)


@each_room_of_the_paper
def test_every_sequence_of_effects_is_seen_as_in_the_tables(name, layout):
    room = room_of(name, layout)
    sequences = effects(room)
    # Nothing that three actions can do is left out.
    possible = {states_of(room, sequence) for sequence in product(range(15), repeat=3)}
    assert {states_of(room, sequence) for sequence in sequences} == possible
    assert len(possible) > 20
    play_and_compare(room, sequences)


def test_levers_move_back_and_lock_each_other_again():
    # Pulling L1 back relocks the door in a common cause; once L0 is back, L1 is stuck.
    room = room_of("CC3", "trial1")
    l0, l1, door = room.action_of(["L0", "L1"])
    play_and_compare(room, [[l0, l1, 7 + l1, door, l1, 7 + l0, 7 + l1, door]])


@each_room_of_the_paper
def test_other_sequences_in_random_layouts_are_seen_as_in_the_tables(name, layout):
    room = room_of(name, layout)
    others = sorted({*product(range(15), repeat=3)} - {*effects(room)})
    generator = np.random.default_rng([2, 0])
    for index in np.random.default_rng(1).permutation(len(others))[:30].tolist():
        elsewhere = Room(room.schema, Layout.random(room.schema, generator))
        play_and_compare(elsewhere, [others[index]])


@pytest.mark.parametrize("positions", range(8, 13))
def test_larger_rooms_are_seen_as_in_the_tables(positions):
    room = room_of("seven", positions=positions)
    solutions = [room.action_of(levers) for levers in room.schema.solutions]
    every = list(range(2 * positions + 1))
    play_and_compare(room, [*solutions, every[:positions], every[positions:]])


def fingerprint():
    """All that happened in some attempts, to the last bit."""
    room = room_of("CE3", "trial2")
    physical = PhysicalRoom(room.fsm, room.layout)
    happened = hashlib.sha256()
    physical.watch = lambda pose: happened.update(repr(pose).encode())
    solution = room.action_of(room.schema.solutions[0])
    for sequence in [solution, *np.random.default_rng(3).integers(15, size=(4, 3)).tolist()]:
        physical.reset()
        for action in sequence:
            physical.act(action)
    return happened.hexdigest()


def test_repeated_runs_are_identical_to_the_last_bit():
    here = fingerprint()
    assert fingerprint() == here
    code = (
        "from physics.test_physics_agreement import *; "
        "kept = [PhysicalRoom for _ in range(10_000)]; print(fingerprint())"
    )
    run = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT / "tests",
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.strip() == here


def test_an_attempt_does_not_depend_on_those_before():
    room = room_of("CC4", "trial7")
    used, fresh = (PhysicalRoom(room.fsm, room.layout) for _ in range(2))
    for action in (4, 0, 14):
        used.act(action)
    used.reset()
    assert used.pose() == fresh.pose()
    for action in (4, 11, 6):
        assert used.act(action) == fresh.act(action)
        assert used.pose() == fresh.pose()

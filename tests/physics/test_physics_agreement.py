"""The physical room ends in what the tables say, and does it the same way every time."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from collections.abc import Iterable
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from causal_openlock.physics.room import PhysicalRoom
from causal_openlock.schemas.finding import find_schema
from causal_openlock.schemas.fsm import compile_schema
from causal_openlock.world.room import Layout, Room
from support.physical_play import Guard, effects, room_of
from support.places import ROOT

pytestmark = pytest.mark.slow

PAPER = [("CC3", "trial1"), ("CE3", "trial5"), ("CC4", "trial7"), ("CE4", "trial8")]
# Of sequences with the same effects, how many; with EACH = 3375 these are all sequences, and
# benchmarks/physics.py plays them all.
EACH, OTHERS = 1, 30


def play(room: Room, sequences: Iterable[Iterable[int]]) -> PhysicalRoom:
    """Play each sequence and compare after every action."""
    physical = PhysicalRoom(room.fsm, room.layout)
    guard = Guard(physical)
    for sequence in sequences:
        physical.reset()
        state = 0
        for action in sequence:
            movement = physical.act(action)
            state = int(room.next_state[state, action])
            assert physical.observation().tolist() == room.observation[state].tolist(), sequence
            assert movement.finished, sequence
    assert guard.steps > 0
    return physical


def told_apart(room: Room, sequence: Iterable[int]) -> tuple[int, ...]:
    """The states that a sequence leads through."""
    states = [0]
    for action in sequence:
        states.append(int(room.next_state[states[-1], action]))
    return tuple(states)


@pytest.mark.parametrize(("name", "layout"), PAPER)
def test_every_sequence_of_effects_is_seen_as_in_the_tables(name: str, layout: str) -> None:
    room = room_of(name, layout)
    sequences = effects(room, EACH)
    # Nothing that three actions can do is left out.
    possible = {told_apart(room, sequence) for sequence in product(range(15), repeat=3)}
    assert {told_apart(room, sequence) for sequence in sequences} == possible
    assert len(possible) > 20
    play(room, sequences)


@pytest.mark.parametrize(("name", "layout"), PAPER)
def test_other_sequences_in_random_layouts_are_seen_as_in_the_tables(
    name: str, layout: str
) -> None:
    played = set(effects(room_of(name, layout), EACH))
    others = sorted(set(product(range(15), repeat=3)) - played)
    chosen = np.random.default_rng(1).permutation(len(others))[:OTHERS]
    schema, generator = find_schema(name), np.random.default_rng([2, 0])
    fsm = compile_schema(schema)
    for index in chosen.tolist():
        play(Room(fsm, Layout.random(schema, generator)), [others[index]])


@pytest.mark.parametrize("positions", range(8, 13))
def test_larger_rooms_are_played_too(positions: int) -> None:
    room = room_of("seven", positions=positions)
    solutions = [room.action_of(levers) for levers in room.schema.solutions]
    every = list(range(2 * positions + 1))
    play(room, [*solutions, every[:positions], every[positions:]])


def test_levers_move_back_and_lock_each_other_again() -> None:
    # Pulling L1 back relocks the door in a common cause; once L0 is back, L1 is stuck.
    room = room_of("CC3", "trial1")
    l0, l1 = room.action_of(["L0", "L1"])[:2]
    pull = 7
    play(room, [[l0, l1, pull + l1, 14, l1, pull + l0, pull + l1, 14]])


def fingerprint() -> str:
    """All that happened in some attempts, to the last bit."""
    room = room_of("CE3", "trial2")
    physical = PhysicalRoom(room.fsm, room.layout)
    happened = hashlib.sha256()
    physical.watch = lambda pose: happened.update(repr(pose).encode())
    generator = np.random.default_rng(3)
    solution = room.action_of(room.schema.solutions[0])
    for sequence in [solution, *generator.integers(15, size=(4, 3)).tolist()]:
        physical.reset()
        for action in sequence:
            physical.act(action)
    return happened.hexdigest()


def test_repeated_runs_are_identical_to_the_last_bit() -> None:
    here = fingerprint()
    assert fingerprint() == here
    folders = [str(Path(__file__).parent), str(ROOT / "tests")]
    code = "import sys; sys.path[:0] = sys.argv[1:]; from test_physics_agreement import *; "
    code += "kept = [PhysicalRoom for _ in range(10_000)]; print(fingerprint())"
    run = subprocess.run(
        [sys.executable, "-c", code, *folders], capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == here


def test_an_attempt_does_not_depend_on_those_before() -> None:
    room = room_of("CC4", "trial7")
    used, fresh = (PhysicalRoom(room.fsm, room.layout) for _ in range(2))
    for action in (4, 0, 14):
        used.act(action)
    used.reset()
    assert used.pose() == fresh.pose()
    for action in (4, 11, 6):
        assert used.act(action) == fresh.act(action)
        assert used.pose() == fresh.pose()

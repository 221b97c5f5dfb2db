"""Playing physical rooms, with an eye on every step of the simulation."""

import math
from itertools import pairwise, product

import numpy as np

from causal_openlock.physics.geometry import DOOR_SWING
from causal_openlock.schemas.finding import find_schema
from causal_openlock.world.room import Layout, Room

FASTEST, FASTEST_TURN = 25.0, 15.0
"""Links, and radians, per unit of time; without an accident nothing comes near them."""


def room_of(name, layout="", positions=None):
    """A bundled schema in a published layout, or in the first positions."""
    schema = find_schema(name)
    if layout:
        return Room.of(schema, layout, positions)
    places = tuple(range(len(schema.levers)))
    return Room.of(schema, Layout(places, positions or 7), positions)


class Guard:
    """Looks at a physical room after every step: nothing leaves it, nothing explodes."""

    def __init__(self, physical):
        self.physical = physical
        self.steps = 0
        physical.watch = self
        self.size = _size(physical.geometry)

    def __call__(self, pose):
        geometry, world = self.physical.geometry, self.physical.world
        self.steps += 1
        assert all(math.hypot(*joint) < self.size for joint in pose.joints)
        assert math.dist(pose.joints[0], (0.0, 0.0)) < 0.02
        for start, end in pairwise(pose.joints):
            assert abs(math.dist(start, end) - geometry.link) < 0.04
        assert all(-0.1 < displacement < 1.1 for displacement in pose.levers)
        assert -0.05 < pose.door < math.radians(65)
        for body in world.space.bodies:
            assert body.velocity.length < FASTEST * geometry.stretch
            assert abs(body.angular_velocity) < FASTEST_TURN


def _size(geometry):
    """No part of anything in the room is ever farther than this from the arm's base."""
    doors = (math.hypot(*geometry.door_end(angle)) for angle in (0.0, DOOR_SWING, math.pi / 2))
    levers = (math.hypot(*corner) for track in geometry.tracks for corner in track.bar(1.0))
    return max(5 * geometry.link, *doors, *levers) + geometry.half_width


def effects(room):
    """A sequence of three actions for every sequence of effects that three actions can have.

    Two sequences have the same effects if the same levers move at the same moments; they differ in
    where the arm goes to no effect. Of these one is drawn by a fixed seed.
    """
    generator = np.random.default_rng(0)
    chosen = {}
    sequences = list(product(range(2 * room.positions + 1), repeat=3))
    for index in generator.permutation(len(sequences)).tolist():
        state, told = 0, []
        for action in sequences[index]:
            after = int(room.next_state[state, action])
            told.append(action if after != state else -1)
            state = after
        chosen.setdefault(tuple(told), sequences[index])
    return sorted(chosen.values())

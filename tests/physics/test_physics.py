"""The arm, the levers and the door: where they are, what they reach, what stops them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from causal_openlock.physics.controller import Controller, straight, swing
from causal_openlock.physics.geometry import DOOR_SWING, RoomGeometry, wrap
from causal_openlock.physics.kinematics import joint_points, reaching
from causal_openlock.physics.room import PhysicalRoom
from causal_openlock.physics.world import ARM, DOOR, LEVER, World
from causal_openlock.render.scene import lever
from causal_openlock.world.facts import room_facts
from support.physical_play import Guard, room_of

SIZES = range(7, 13)


# -- geometry -------------------------------------------------------------------------------------


@pytest.mark.parametrize("positions", SIZES)
def test_levers_stand_where_they_are_drawn(positions: int) -> None:
    for place, track in enumerate(RoomGeometry.of(positions).tracks):
        for displacement in (0.0, 1.0):
            bar = lever(positions, place, displacement, grey=True)[-1]
            drawn = bar.x, bar.y
            assert track.centre(displacement) == pytest.approx(drawn)
            assert track.displacement(drawn) == pytest.approx(displacement)


def test_the_arm_begins_as_in_the_figure() -> None:
    geometry = RoomGeometry.of(7)
    expected = np.array(room_facts()["arm"]["joints"], dtype=float)
    np.testing.assert_allclose(joint_points(geometry.rest), expected, atol=1e-9)
    world = World(geometry, ())
    np.testing.assert_allclose(world.pose().joints, expected, atol=1e-9)
    np.testing.assert_allclose(world.arm.angles, geometry.rest, atol=1e-9)


# -- inverse kinematics ---------------------------------------------------------------------------


@given(
    distance=st.floats(1.0, 5.0),
    direction=st.floats(-math.pi, math.pi),
    link=st.sampled_from([1.0, 12 / 7]),
)
def test_the_arm_comes_to_every_point_in_its_reach(
    distance: float, direction: float, link: float
) -> None:
    point = distance * link * math.cos(direction), distance * link * math.sin(direction)
    angles = reaching(point, link)
    joints = joint_points(angles, link)
    assert joints[-1] == pytest.approx(point, abs=1e-6)
    # The last link points straight outward.
    assert abs(wrap(sum(angles) - math.atan2(point[1], point[0]))) < 1e-6


@pytest.mark.parametrize("point", [(5.1, 0.0), (0.0, -0.9), (0.0, 0.0)])
def test_a_point_out_of_reach_is_refused(point: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match=r"reaches points between 1 and 5 away from its base"):
        reaching(point)


def targets(geometry: RoomGeometry) -> list[tuple[float, float]]:
    """Every point that the arm's end has to come to."""
    points = [
        geometry.at_lever(place, displacement)
        for place in range(len(geometry.tracks))
        for displacement in np.linspace(0, 1, 5).tolist()
    ]
    return points + [geometry.at_door(a) for a in np.linspace(0, DOOR_SWING, 9).tolist()]


@pytest.mark.parametrize("positions", SIZES)
def test_every_lever_and_the_door_is_within_reach(positions: int) -> None:
    geometry = RoomGeometry.of(positions)
    for point in targets(geometry):
        end = joint_points(reaching(point, geometry.link), geometry.link)[-1]
        assert end == pytest.approx(point, abs=1e-6)


@pytest.mark.parametrize("positions", SIZES)
def test_from_any_posture_on_the_way_the_arm_swings_round_inside_the_ring(positions: int) -> None:
    geometry = RoomGeometry.of(positions)
    link, ready = geometry.link, geometry.ready
    ring = min(track.radius for track in geometry.tracks) - 0.1 - geometry.half_width

    def facing(point: tuple[float, float]) -> Any:
        part = ready / math.hypot(*point)
        return reaching((point[0] * part, point[1] * part), link)

    faced = [facing(track.start) for track in geometry.tracks] + [facing(geometry.at_door(0.0))]
    first = [posture for end in faced for posture in swing(geometry.rest, end)[::4]]
    later = [posture for start in faced for end in faced for posture in swing(start, end)[::8]]
    for start in [geometry.rest, *first, *later][:: 1 + positions // 8 * 6]:
        for end in faced:
            path = swing(start, end)
            assert path[-1][1:] == pytest.approx(end[1:])
            assert abs(wrap(path[-1][0] - end[0])) < 1e-9
            for posture in path[::4]:
                assert max(math.hypot(*p) for p in joint_points(posture, link)) < ring - 0.15


# -- what the bodies do ---------------------------------------------------------------------------


def test_only_the_end_of_the_arm_touches_anything_and_only_what_it_is_meant_to() -> None:
    room = room_of("CC4", "trial7")
    physical = PhysicalRoom(room.fsm, room.layout)
    touched: list[tuple[Any, Any]] = []

    def note(arbiter: Any, *_: Any) -> None:
        link, other = arbiter.shapes
        touched.append((link.body, other))

    generator = np.random.default_rng(5)
    pairs = 0
    sequences = generator.integers(15, size=(30, 3)).tolist()
    for sequence in [room.action_of(["L0", "L1"]), *sequences]:
        physical.reset()
        world = physical.world
        for what in (LEVER, DOOR):
            world.space.on_collision(ARM, what, begin=note)
        for action in sequence:
            touched.clear()
            physical.act(action)
            for link, other in touched:
                assert link is world.arm.links[-1]
                if action == 14:
                    assert other.body is world.door.body
                else:
                    place = action % 7
                    centre = other.bb.center()
                    assert math.dist(centre, world.geometry.tracks[place].start) < 0.5
            pairs += len(touched)
    assert pairs > 5


@pytest.mark.parametrize("place", range(7))
def test_the_arm_does_not_pass_through_a_lever_that_does_not_give_way(place: int) -> None:
    geometry = RoomGeometry.of(7)
    world = World(geometry, [0, 1, 2])  # the others are part of the walls
    controller = Controller(world)
    track = geometry.tracks[place]
    controller._last_step = 10**6
    controller._face(track.start)
    beyond = track.centre(2.5)
    deepest = -1.0
    path = straight(world.arm.tip, beyond, 1.0)
    for number, _ in enumerate(controller._follow(path)):
        x, y = world.arm.tip
        outward, across = track.outward, abs(x * track.outward[1] - y * track.outward[0])
        if across > 0.9 or number > 200:
            break  # it has slid off the bar's end
        deep = x * outward[0] + y * outward[1] + geometry.half_width - (track.radius - 0.1)
        deepest = max(deepest, deep)
    assert -0.05 < deepest < 0.05  # at the bar's inner face, and not in it
    assert abs(world.levers[place].displacement) < 0.1


def test_the_arm_does_not_pass_through_a_locked_door() -> None:
    room = room_of("CC3", "trial1")
    physical = PhysicalRoom(room.fsm, room.layout)
    tips = []
    physical.watch = lambda pose: tips.append(pose.joints[-1][0])
    assert physical.act(14).finished
    assert 3.3 < max(tips) < 3.5
    assert abs(physical.pose().door) < 0.01
    assert physical.pose().locked


def test_an_open_door_stays_open_while_the_arm_draws_back() -> None:
    room = room_of("CC3", "trial1")
    physical = PhysicalRoom(room.fsm, room.layout)
    for action in room.action_of(["L0", "L2"]):
        assert physical.act(action).finished
    pose = physical.pose()
    assert pose.door == pytest.approx(DOOR_SWING, abs=0.05)
    assert not pose.locked
    assert math.hypot(*pose.joints[-1]) < 2.7


def test_a_lever_ends_at_the_end_of_its_track() -> None:
    room = room_of("CC3", "trial1")
    physical = PhysicalRoom(room.fsm, room.layout)
    l0, l1, _ = room.action_of(["L0", "L1"])
    for action in (l0, l1, 7 + l1):
        physical.act(action)
    levers = physical.pose().levers
    assert levers[l0] == pytest.approx(1.0, abs=0.01)
    assert all(abs(levers[place]) < 0.01 for place in range(7) if place != l0)


def test_the_door_unlocks_as_soon_as_the_lever_passes_the_middle() -> None:
    room = room_of("CE3", "trial1")
    physical = PhysicalRoom(room.fsm, room.layout)
    l1, l0, _ = room.action_of(["L1", "L0"])
    physical.act(l1)
    seen = []
    physical.watch = lambda pose: seen.append((pose.levers[l0], pose.locked))
    physical.act(l0)
    for displacement, locked in seen:
        if abs(displacement - 0.5) > 0.1:
            assert locked == (displacement < 0.5)
    assert seen[-1] == (pytest.approx(1.0, abs=0.02), False)


def test_what_luck_holds_back_does_not_move_and_is_no_unfinished_movement() -> None:
    room = room_of("CC3", "trial1")
    physical = PhysicalRoom(room.fsm, room.layout)
    l0, l2, door = room.action_of(["L0", "L2"])
    for action in (l0, l2, door):
        before = physical.observation().tolist()
        assert physical.act(action, yields=False).finished
        assert physical.observation().tolist() == before  # nor does the lock's indicator change
        assert physical.act(action).finished
        assert physical.observation().tolist() != before


# -- movements that are broken off ----------------------------------------------------------------


def test_a_movement_without_time_says_so_and_ends_at_once() -> None:
    room = room_of("CC3", "trial1")
    physical = PhysicalRoom(room.fsm, room.layout)
    physical.budget = 40
    movement = physical.act(3)
    assert (movement.finished, movement.steps) == (False, 40)


@pytest.mark.parametrize("steps", range(10, 230, 40))
def test_after_being_broken_off_anywhere_the_arm_still_reaches_everything(steps: int) -> None:
    room = room_of("CC4", "trial7")
    physical = PhysicalRoom(room.fsm, room.layout)
    full = physical.budget
    solution = room.action_of(["L0", "L1"])
    for broken_off, before in ((solution[0], 0), (solution[2], 2), (3, 0)):
        for target in (*range(7), 11, 14):
            physical.reset()
            Guard(physical)
            for action in solution[:before]:
                physical.act(action)
            physical.budget = steps
            physical.act(broken_off)
            physical.budget = full
            assert physical.act(target).finished
            if target == solution[0]:  # L0 is always free
                assert physical.pose().levers[target] == pytest.approx(1.0, abs=0.02)

"""The arm, the levers and the door: where they are, what they reach, what stops them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from causal_openlock.physics.controller import swing
from causal_openlock.physics.geometry import DOOR_SWING, RoomGeometry, wrap
from causal_openlock.physics.kinematics import joint_points, reaching
from causal_openlock.physics.room import PhysicalRoom
from causal_openlock.physics.world import ARM, DOOR, LEVER
from support.physical_play import Guard, room_of

each_size = pytest.mark.parametrize("positions", range(7, 13))


def physical_room(name, layout):
    """A bundled schema's room with bodies, and the actions of its first solution."""
    room = room_of(name, layout)
    return PhysicalRoom(room.fsm, room.layout), room.action_of(room.schema.solutions[0])


@given(st.floats(1.0, 5.0), st.floats(-math.pi, math.pi), st.sampled_from([1.0, 12 / 7]))
def test_the_arm_comes_to_every_point_in_its_reach(distance, direction, link):
    point = distance * link * math.cos(direction), distance * link * math.sin(direction)
    angles = reaching(point, link)
    assert joint_points(angles, link)[-1] == pytest.approx(point, abs=1e-6)
    outward = math.atan2(point[1], point[0])  # the last link points straight outward
    assert abs(wrap(sum(angles) - outward)) < 1e-6


@pytest.mark.parametrize("point", [(5.1, 0.0), (0.0, -0.9), (0.0, 0.0)])
def test_a_point_out_of_reach_is_refused(point):
    with pytest.raises(ValueError, match="between 1 and 5"):
        reaching(point)


@each_size
def test_the_arm_swings_round_inside_the_ring_of_levers_from_any_posture(positions):
    geometry = RoomGeometry.of(positions)
    link, ready = geometry.link, geometry.ready
    ring = min(math.hypot(*track.start) for track in geometry.tracks) - 0.1 - geometry.half_width

    def facing(point):
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


def test_only_the_end_of_the_arm_touches_what_it_is_meant_to():
    physical, solution = physical_room("CC4", "trial7")
    touched = []

    def note(arbiter, *_):
        link, other = arbiter.shapes
        touched.append((link.body, other))

    pairs = 0
    for sequence in [solution, *np.random.default_rng(5).integers(15, size=(30, 3)).tolist()]:
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
                    start = world.geometry.tracks[action % 7].start
                    assert math.dist(other.bb.center(), start) < 0.5
            pairs += len(touched)
    assert pairs > 5


def test_the_arm_does_not_pass_through_what_is_locked():
    physical, solution = physical_room("CC3", "trial1")
    tips = []
    physical.watch = lambda pose: tips.append(pose.joints[-1])
    for place in {*range(7)} - {solution[0]}:  # only L0 is free
        tips.clear()
        assert physical.act(place).finished
        track = physical.geometry.tracks[place]
        reached = max(np.dot(tip, track.outward) for tip in tips) - math.hypot(*track.start)
        assert -0.3 < reached < 0.05  # as far as the bar it holds
        assert abs(physical.pose().levers[place]) < 0.01
    tips.clear()
    assert physical.act(14).finished
    assert 3.3 < max(x for x, _ in tips) < 3.5
    assert abs(physical.pose().door) < 0.01
    assert physical.pose().locked


def test_levers_and_the_door_end_where_they_stop():
    physical, solution = physical_room("CC3", "trial1")
    l0, second, door = solution
    for action in (l0, second, 7 + second):
        physical.act(action)
    levers = physical.pose().levers
    assert levers[l0] == pytest.approx(1.0, abs=0.01)
    assert all(abs(levers[place]) < 0.01 for place in range(7) if place != l0)
    for action in (second, door):
        assert physical.act(action).finished
    pose = physical.pose()
    assert pose.door == pytest.approx(DOOR_SWING, abs=0.05)
    assert not pose.locked
    assert math.hypot(*pose.joints[-1]) < 2.7  # the arm has drawn back, and the door stays open


def test_a_track_stops_its_lever_and_the_arm_that_presses_on():
    physical, (l0, *_) = physical_room("CC3", "trial1")
    slid = []
    physical.watch = lambda pose: slid.append(pose.levers[l0])
    for action in (l0, l0, 7 + l0, 7 + l0):
        assert physical.act(action).finished
    assert -0.03 < min(slid) < max(slid) < 1.03


def test_the_door_unlocks_as_soon_as_the_lever_passes_the_middle():
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


def test_what_luck_holds_back_does_not_move_and_its_movement_is_finished():
    physical, solution = physical_room("CC3", "trial1")
    for action in solution:
        before = physical.state, physical.pose().locked
        assert physical.act(action, yields=False).finished
        assert (physical.state, physical.pose().locked) == before
        assert physical.act(action).finished
        assert physical.state != before[0]


def test_a_movement_without_time_says_so_and_ends_at_once():
    physical, _ = physical_room("CC3", "trial1")
    physical.budget = 40
    movement = physical.act(3)
    assert (movement.finished, movement.steps) == (False, 40)


@pytest.mark.parametrize("steps", range(10, 230, 40))
def test_after_being_broken_off_anywhere_the_arm_still_reaches_everything(steps):
    physical, solution = physical_room("CC4", "trial7")
    full = physical.budget
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

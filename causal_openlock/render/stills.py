"""A room after some actions, or in the midst of the last one, as it is drawn in papers."""

from __future__ import annotations

from collections.abc import Sequence

from causal_openlock.physics.room import PhysicalRoom
from causal_openlock.physics.world import Pose
from causal_openlock.render.scene import Look
from causal_openlock.world.room import Room


def look_after(room: Room, actions: Sequence[int] = (), part: float = 1.0) -> Look:
    """What a room looks like after actions that the arm carries out from the start of an attempt.

    Args:
        room: The room; nothing is left to chance in it.
        actions: The actions.
        part: How much of the last movement is done, 0 to 1.
    """
    grey = room.active.tolist()
    physical = PhysicalRoom(room.fsm, room.layout)
    pose, pressed = physical.pose(), False
    for action in actions:
        poses: list[Pose] = [physical.pose()]
        physical.watch = poses.append
        physical.act(action)
        pose = poses[round((len(poses) - 1) * part)]
        pressed = part < 1.0 and action == 2 * room.positions
    return Look.of_pose(pose, grey, pressed)

"""The room as a body: an arm of five links, levers on tracks and a door, simulated by pymunk.

The symbolic room says what an action leads to; here an action is a whole movement. The arm swings
round, reaches out, takes hold of a lever, pushes or pulls it along its track, lets go and draws
back. What is observed is read from where the bodies then are. The schema's machine decides nothing
but which locks are on.

From plain numbers to the whole: :mod:`~causal_openlock.physics.geometry` (where everything is),
:mod:`~causal_openlock.physics.kinematics` (which joint angles bring the arm's end to a point),
:mod:`~causal_openlock.physics.arm`, :mod:`~causal_openlock.physics.levers` and
:mod:`~causal_openlock.physics.door` (the bodies), :mod:`~causal_openlock.physics.world` (all of
them in one space, and a :class:`Pose` of them to draw), :mod:`~causal_openlock.physics.controller`
(a movement), :mod:`~causal_openlock.physics.room` (a schema's room that is played by movements).

``OpenLockEnv(physics=True)`` is that room as an environment.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from causal_openlock.physics.controller import Movement
    from causal_openlock.physics.geometry import RoomGeometry
    from causal_openlock.physics.room import PhysicalRoom
    from causal_openlock.physics.world import Pose, World

__all__ = ["Movement", "PhysicalRoom", "Pose", "RoomGeometry", "World"]

# pymunk is loaded with the first of these that needs it: where things are is told without.
_HOMES = {
    "Movement": "controller",
    "PhysicalRoom": "room",
    "Pose": "world",
    "RoomGeometry": "geometry",
    "World": "world",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

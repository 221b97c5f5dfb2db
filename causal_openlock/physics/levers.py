"""Levers: bars that slide on their tracks, and a latch that holds each where it stands.

An active lever is a body on a groove. Its latch pulls it into the end of the track that it is
nearer to: weakly while it is unlocked, so that it stays where the arm leaves it, and with all force
while it is locked. An inactive lever never moves, so it is part of the walls.
"""

from __future__ import annotations

import math

import pymunk

from causal_openlock.physics.arm import ARM, LEVER, STIFF
from causal_openlock.physics.geometry import PUSHED, Track

LEVER_MASS = 0.5
LATCH = 4.0
"""The force of the latch of an unlocked lever."""
LATCH_SPEED = 2.0
"""How fast the latch of an unlocked lever draws it into the end of its track."""


class Lever:
    """One lever, pulled and locked.

    Args:
        space: Where it lives.
        track: Its track.
        active: Whether it can move at all.
    """

    def __init__(self, space: pymunk.Space, track: Track, active: bool) -> None:
        self.track = track
        self._latch: pymunk.PivotJoint | None = None
        self._latched_out = False
        self._locked = True
        walls = space.static_body
        if active:
            x, y = track.start
            self.body = pymunk.Body(LEVER_MASS, math.inf)  # it slides and never turns
            self.body.position = x, y
            corners = [(cx - x, cy - y) for cx, cy in track.bar(0.0)]
        else:
            self.body = walls
            corners = list(track.bar(0.0))
        shape = pymunk.Poly(self.body, corners)
        shape.filter = pymunk.ShapeFilter(categories=LEVER, mask=ARM)
        shape.collision_type = LEVER
        if active:
            groove = pymunk.GrooveJoint(walls, self.body, track.start, track.end, (0.0, 0.0))
            groove.error_bias = STIFF
            self._latch = pymunk.PivotJoint(walls, self.body, track.start, (0.0, 0.0))
            space.add(self.body, shape, groove, self._latch)
        else:
            space.add(shape)

    @property
    def displacement(self) -> float:
        """How far it has slid: 0 pulled, 1 pushed."""
        if self._latch is None:
            return 0.0
        x, y = self.body.position
        return self.track.displacement((x, y))

    @property
    def pushed(self) -> bool:
        """Whether it is beyond the middle of its track."""
        return self.displacement > PUSHED

    @property
    def locked(self) -> bool:
        """Whether it is held where it stands."""
        return self._locked

    def lock(self, locked: bool) -> None:
        """Lock it where it stands, or unlock it."""
        if self._latch is None or locked == self._locked:
            return
        self._locked = locked
        self._latch.max_force = math.inf if locked else LATCH
        self._latch.max_bias = math.inf if locked else LATCH_SPEED

    def latch(self) -> None:
        """Hold it at the end of the track that it is nearer to from now on."""
        if self._latch is not None and self.pushed != self._latched_out:
            self._latched_out = not self._latched_out
            self._latch.anchor_a = self.track.end if self._latched_out else self.track.start

"""Inverse and forward kinematics of the arm: joint angles for a point, and points for angles.

An arm of five links can reach a point in many ways. This one always does so in the way that is
safe in a ring of levers: its last link points straight away from the base, so that it meets a
lever's bar squarely, and the four links before bend equally, in an arc between the base and the
wrist. Then the end is the farthest point of the arm as long as it is within the ring, and turning
the base alone carries the whole arm past all levers.

With equal bends the search has one unknown. Four links of length 1 that each bend by 2b against
the one before span 4 cos(b) cos(2b), which grows steadily from 0 to 4 as the bend goes to zero, so
Newton's method finds cos(b) in a few steps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from causal_openlock.physics.geometry import Point

LINKS = 5
Angles = tuple[float, ...]
"""Five joint angles: of the first link against the x axis, of each other against the one before."""

NEWTON_STEPS = 8
ROUNDING = 1e-9


def joint_points(angles: Sequence[float], link: float = 1.0) -> tuple[Point, ...]:
    """The base, the four joints and the free end of an arm (forward kinematics)."""
    x = y = heading = 0.0
    points = [(x, y)]
    for angle in angles:
        heading += angle
        x += link * math.cos(heading)
        y += link * math.sin(heading)
        points.append((x, y))
    return tuple(points)


def reaching(point: Point, link: float = 1.0) -> Angles:
    """The joint angles that bring the arm's free end to a point.

    >>> x, y = joint_points(reaching((2.0, 3.0)))[-1]
    >>> round(x, 9), round(y, 9)
    (2.0, 3.0)

    Args:
        point: Between one and five links away from the base.
        link: Length of a link.

    Raises:
        ValueError: If it is out of reach.
    """
    distance = math.hypot(*point) / link
    if not 1.0 - ROUNDING <= distance <= LINKS + ROUNDING:
        raise ValueError(
            f"the arm reaches points between {link:g} and {LINKS * link:g} away from its base, and "
            f"({point[0]:g}, {point[1]:g}) is {distance * link:g} away"
        )
    # The ends of the four links that bend equally are this far apart:
    # span = 4 c (2 c^2 - 1) with c = cos(bend / 2). It is convex there, so from c = 1 Newton's
    # steps come down to the root and never pass it.
    span, c = min(max(distance - 1.0, 0.0), LINKS - 1.0), 1.0
    for _ in range(NEWTON_STEPS):
        c -= (8 * c**3 - 4 * c - span) / (24 * c * c - 4)
    bend = 2 * math.acos(min(c, 1.0))
    direction = math.atan2(point[1], point[0])
    return direction - 1.5 * bend, bend, bend, bend, -1.5 * bend

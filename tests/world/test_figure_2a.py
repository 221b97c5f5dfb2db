"""Our room against the paper's Figure 2a, as it was measured: in arm links, the base at (0, 0)."""

import math

import numpy as np
import pytest

from causal_openlock.render.scene import look_after
from causal_openlock.world.room import position_names
from support.physical_play import room_of

LEVERS = {
    "UPPERRIGHT": (2.2, 2.2), "UPPER": (0, 3), "UPPERLEFT": (-2.2, 2.2), "LEFT": (-3, 0),
    "LOWERLEFT": (-2.2, -2.2), "LOWER": (0, -3), "LOWERRIGHT": (2.2, -2.2),
}  # fmt: skip
ACTIVE = ("UPPER", "LEFT", "LOWER")  # as in trial2
BAR_LENGTH, WIDTH, TRACK_OUTSIDE = 2.0, 0.2, 0.4
JOINTS = [(0, 0), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)]
HINGE, LOCK = (3.6, 1.0), (3.6, -1.0)
BUTTON, BUTTON_SIDE = (4.2, 1.6), 0.61
GREY, LIGHT, GREEN, RED = (153,) * 3, (229,) * 3, (80, 235, 111), (255, 0, 0)
CLOSE = 0.01  # arm links: the diagonal levers were measured to two digits


@pytest.fixture(scope="module")
def look():
    return look_after(room_of("CC3", "trial2"))


def near(shape, point):
    return math.dist((shape.x, shape.y), point) < CLOSE


def test_levers_stand_where_they_were_measured(look):
    shapes = look.shapes()
    for name in position_names(7):
        inner, outer, bar = shapes[f"lever_{name}"]
        x, y = LEVERS[name]
        assert near(bar, (x, y))
        assert (2 * bar.length, 2 * bar.width) == pytest.approx((BAR_LENGTH, WIDTH))
        # Across the radius; and the track along it, to 0.4 outside the bar.
        assert math.cos(bar.angle - math.atan2(y, x)) == pytest.approx(0, abs=CLOSE)
        edge = math.hypot(x, y) + WIDTH / 2
        end = math.hypot(outer.x, outer.y) + outer.length
        assert end - edge == pytest.approx(TRACK_OUTSIDE, abs=CLOSE)
        assert 2 * inner.width == 2 * outer.width == pytest.approx(WIDTH)
        assert {bar.fill, inner.fill, outer.fill} == {GREY if name in ACTIVE else LIGHT}


def test_arm_door_lock_and_button_are_where_they_were_measured(look):
    np.testing.assert_allclose(look.joints, JOINTS, atol=CLOSE)
    shapes = look.shapes()
    assert all(2 * link.width == pytest.approx(WIDTH) for link in shapes["arm"][:5])
    assert [disc.fill for disc in shapes["arm"][5:]] == [RED] * 5 + [GREY]
    door, hinge, lock = shapes["door"]
    assert near(hinge, HINGE)
    assert near(lock, LOCK)
    assert near(door, (HINGE[0], (HINGE[1] + LOCK[1]) / 2))
    assert 2 * door.length == pytest.approx(HINGE[1] - LOCK[1], abs=CLOSE)
    (button,) = shapes["button"]
    assert near(button, BUTTON)
    assert (2 * button.length, button.fill) == (pytest.approx(BUTTON_SIDE), GREEN)

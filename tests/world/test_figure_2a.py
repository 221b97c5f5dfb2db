"""Our room laid over the paper's Figure 2a, as it was measured."""

from __future__ import annotations

import importlib.util
import math
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from causal_openlock.render.room import look_after
from causal_openlock.render.scene import Look, Shape, colour
from causal_openlock.world.room import position_names
from support.physical_play import room_of
from support.places import ROOT

SCRIPT = ROOT / "docs" / "figures" / "figure_2a.py"
CLOSE = 0.01  # arm links: the diagonal levers were measured to two digits


@pytest.fixture(scope="module")
def measured() -> ModuleType:
    spec = importlib.util.spec_from_file_location("figure_2a", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def ours(measured: ModuleType) -> Look:
    return look_after(room_of("CC3", measured.LAYOUT))


def near(shape: Shape, point: Any) -> bool:
    return math.dist((shape.x, shape.y), point) < CLOSE


def test_every_lever_stands_where_it_was_measured(measured: ModuleType, ours: Look) -> None:
    shapes = ours.shapes()
    for place, name in enumerate(position_names(7)):
        inner, outer, bar = shapes[f"lever {place}"]
        at = measured.LEVERS[name]
        assert near(bar, at)
        assert 2 * bar.length == pytest.approx(measured.BAR_LENGTH)
        assert 2 * bar.width == pytest.approx(measured.WIDTH)
        # Across the radius; and the track along it, to 0.4 outside the bar.
        radial = math.atan2(at[1], at[0])
        assert math.cos(bar.angle - radial) == pytest.approx(0, abs=CLOSE)
        end = math.hypot(outer.x, outer.y) + outer.length
        edge = math.hypot(*at) + measured.WIDTH / 2
        assert end - edge == pytest.approx(measured.TRACK_OUTSIDE, abs=CLOSE)
        assert 2 * inner.width == 2 * outer.width == pytest.approx(measured.WIDTH)
        fill = measured.GREY if name in measured.ACTIVE else measured.LIGHT
        assert {bar.fill, inner.fill, outer.fill} == {rgb(fill)}


def test_arm_door_lock_and_button_are_where_they_were_measured(
    measured: ModuleType, ours: Look
) -> None:
    np.testing.assert_allclose(ours.joints, measured.JOINTS, atol=CLOSE)
    shapes = ours.shapes()
    links = shapes["arm"][:5]
    assert all(2 * link.width == pytest.approx(measured.WIDTH) for link in links)
    assert [disc.fill for disc in shapes["arm"][5:]] == [rgb(measured.RED)] * 5 + [
        rgb(measured.GREY)
    ]
    door, hinge, lock = shapes["door"]
    assert near(hinge, measured.HINGE)
    assert near(lock, measured.LOCK)
    middle = measured.HINGE[0], (measured.HINGE[1] + measured.LOCK[1]) / 2
    assert near(door, middle)
    assert 2 * door.length == pytest.approx(measured.HINGE[1] - measured.LOCK[1], abs=CLOSE)
    (button,) = shapes["button"]
    assert near(button, measured.BUTTON)
    assert 2 * button.length == pytest.approx(measured.BUTTON_SIDE)
    assert button.fill == rgb(measured.GREEN)


def test_one_picture_laid_over_the_other_shows_no_difference_but_at_borders(
    measured: ModuleType,
) -> None:
    size = 600
    picture, view = measured.our_frame(size)
    figure = Figure(figsize=(picture.shape[1] / 100, size / 100), dpi=100)
    canvas = FigureCanvasAgg(figure)
    measured.redraw(figure.add_axes((0, 0, 1, 1)), view)
    canvas.draw()
    redrawn = np.asarray(canvas.buffer_rgba())[..., :3].astype(int)
    assert redrawn.shape == picture.shape
    differs = np.abs(redrawn - picture).max(axis=2) > 90
    # Borders are smoothed in two ways, which differs in single pixels along them.
    assert differs.mean() < 0.004
    block = differs[: size // 4 * 4, : differs.shape[1] // 4 * 4]
    solid = block.reshape(size // 4, 4, -1, 4).all(axis=(1, 3))
    assert not solid.any()
    drawn = (np.abs(picture.astype(int) - 255).max(axis=2) > 20).mean()
    assert drawn > 0.05  # there is something to lay over


def test_the_colours_are_those_that_were_measured(measured: ModuleType) -> None:
    assert colour("active_lever_arm_door") == rgb(measured.GREY)
    assert colour("inactive_lever") == rgb(measured.LIGHT)
    assert colour("button") == rgb(measured.GREEN)


def rgb(text: str) -> tuple[int, int, int]:
    return int(text[1:3], 16), int(text[3:5], 16), int(text[5:7], 16)

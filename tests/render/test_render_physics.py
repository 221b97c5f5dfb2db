"""Pictures of rooms in which something moves: as pixels, as SVG, and the console beside them."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageDraw

from causal_openlock.physics.geometry import RoomGeometry, along
from causal_openlock.physics.room import PhysicalRoom
from causal_openlock.physics.world import Pose
from causal_openlock.render.panel import (
    HEIGHT,
    WIDTH,
    Panel,
    ShownAction,
    draw,
    font,
    panel_picture,
)
from causal_openlock.render.raster import paint
from causal_openlock.render.room import look_after
from causal_openlock.render.scene import Frame, Look, Shape, frame
from causal_openlock.render.svg import room_svg
from causal_openlock.world.facts import room_facts
from support.cc4_in_trial7 import DOOR, L0, L1
from support.physical_play import room_of

RGB = room_facts()["rgb"]
GREY, LIGHT, RED = RGB["active_lever_arm_door"], RGB["inactive_lever"], RGB["joint_and_hinge"]
WHITE, BLACK = [255, 255, 255], [0, 0, 0]
SIZE = 480
SVG = "{http://www.w3.org/2000/svg}"


def watched(name: str, layout: str, actions: tuple[int, ...]) -> tuple[list[Look], PhysicalRoom]:
    """Every fifth step of a physical room that carries out actions."""
    room = room_of(name, layout)
    physical = PhysicalRoom(room.fsm, room.layout)
    poses: list[Pose] = []
    physical.watch = poses.append
    for action in actions:
        physical.act(action)
    return [Look.of_pose(pose, room.active.tolist()) for pose in poses[::5]], physical


def pixel(picture: np.ndarray, point: Any, positions: int = 7) -> list[int]:
    column, row = frame(positions, len(picture)).pixel(point)
    return picture[int(row), int(column)].tolist()


# -- the room as pixels ---------------------------------------------------------------------------


def test_arm_levers_and_door_are_drawn_where_they_are_at_every_moment() -> None:
    looks, physical = watched("CC4", "trial7", (L0, L1, DOOR))
    geometry = physical.geometry
    moved = set()
    for look in looks:
        picture = draw(look, SIZE)
        for joint in look.joints[:-1]:
            assert pixel(picture, joint) == RED
        for start, end in pairwise(look.joints):
            middle = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
            # A link above it may be seen instead: its joint, or its outline.
            assert pixel(picture, middle) != WHITE
        assert pixel(picture, look.joints[-1]) == GREY
        for place, slid in enumerate(look.levers):
            track, colour = geometry.tracks[place], GREY if look.grey[place] else LIGHT
            across = -track.outward[1], track.outward[0]
            for side in (-0.8, 0.8):
                assert pixel(picture, along(track.centre(slid), across, side)) == colour
            if 0.2 < slid < 0.8:
                moved.add(place)
        down = math.sin(look.door), -math.cos(look.door)
        for below in (0.4, 1.7):
            assert pixel(picture, along(geometry.hinge, down, below)) == GREY
        assert pixel(picture, geometry.hinge) == RED
        assert (pixel(picture, along(geometry.lock, (1.0, 0.0), 0.12)) == BLACK) == look.locked
    assert moved == {L0, L1}
    assert looks[0].locked
    assert not looks[-1].locked
    assert looks[-1].door > 1.0


def test_what_is_kept_is_what_would_be_painted_anew() -> None:
    looks, _ = watched("CC3", "trial1", (0, 4, DOOR))
    for look in looks[::4]:
        shown = frame(7, 200)
        anew = np.full((shown.height, shown.width, 3), 255, np.uint8)
        for shapes in look.shapes().values():
            paint(anew, shapes, shown)
        kept = draw(look, 200).astype(int)
        assert np.abs(kept - anew).max() < 40  # places are kept in steps of 1/256
        assert np.abs(kept - anew).mean() < 0.05


def test_a_physical_room_at_rest_is_drawn_as_the_symbolic_one() -> None:
    room = room_of("CC4", "trial7")
    physical = PhysicalRoom(room.fsm, room.layout)
    posed = draw(Look.of_pose(physical.pose(), room.active.tolist()), SIZE)
    symbolic = draw(Look.of_observation(room.observation[0], 7), SIZE)
    assert np.abs(posed.astype(int) - symbolic).max() <= 2


@pytest.mark.parametrize("positions", [7, 9, 12])
def test_the_arm_of_a_larger_room_is_drawn_as_large_as_it_is(positions: int) -> None:
    geometry = RoomGeometry.of(positions)
    look = Look.of_observation([0] * (2 * positions + 2), positions)
    assert math.dist(*look.joints[1:3]) == pytest.approx(geometry.link)
    picture = draw(look, SIZE)
    for joint in look.joints[:-1]:
        assert pixel(picture, joint, positions) == RED


def test_the_button_is_darker_while_it_is_pressed() -> None:
    rest = Look.of_observation([0] * 16, 7)
    at = room_facts()["button"]["centre"]
    assert pixel(draw(rest, SIZE), at) == RGB["button"]
    pressed = Look(rest.joints, rest.levers, rest.grey, pressed=True)
    assert pixel(draw(pressed, SIZE), at) == RGB["button_pressed"]


@pytest.mark.parametrize("angle", [0.0, 0.3, math.pi / 4, 2.0, -1.1])
@pytest.mark.parametrize("corner", [0.0, 0.1])
def test_borders_are_as_smooth_as_those_of_a_drawing_that_is_shrunk(
    angle: float, corner: float
) -> None:
    """Coverage against the share of 16 x 16 points in each pixel that lie inside."""
    shape = Shape(1.03, 0.98, 0.7, 0.1, angle, corner, (0, 0, 0), line=0.0)
    shown, fine = Frame(0.0, 2.0, 20.0, 40, 40), 16
    ours = np.full((40, 40, 3), 255, np.uint8)
    paint(ours, [shape], shown)
    at = (np.arange(40 * fine) + 0.5) / fine / 20.0
    x, y = at[None, :] - shape.x, 2.0 - at[:, None] - shape.y
    u = np.abs(x * math.cos(angle) + y * math.sin(angle)) - (shape.length - corner)
    v = np.abs(y * math.cos(angle) - x * math.sin(angle)) - (shape.width - corner)
    inside = (u <= corner) & (v <= corner) & (
        (u <= 0) | (v <= 0) | (np.hypot(u, v) <= corner)
    )  # fmt: skip
    share = inside.reshape(40, fine, 40, fine).mean(axis=(1, 3))
    # A border aslant is taken for straight across the pixel: that is the error that is left.
    assert np.abs(ours[..., 0] - 255 * (1 - share)).max() < 70  # and corners for straight
    assert np.abs(ours[..., 0] - 255 * (1 - share)).mean() < 1.0
    assert set(np.unique(ours[share == 1])) <= {0}
    assert set(np.unique(ours[share == 0])) <= set(range(230, 256))


@pytest.mark.parametrize("size", [240, 480])
def test_a_picture_is_the_same_at_any_size(size: int) -> None:
    looks, _ = watched("CC4", "trial7", (L0,))
    look = looks[len(looks) // 2]
    small = Image.fromarray(draw(look, size))
    large = Image.fromarray(draw(look, 4 * size)).resize(small.size, Image.Resampling.BOX)
    assert np.abs(np.asarray(small, int) - np.asarray(large, int)).mean() < 3.0
    # Sharp: even a small picture has pixels that are grey, light and black and nothing between.
    counts = [int((np.asarray(small) == colour).all(axis=2).sum()) for colour in (GREY, LIGHT)]
    assert min(counts) > size / 4


# -- the room as SVG ------------------------------------------------------------------------------


def drawn(look: Look, panel: Panel | None = None) -> tuple[Any, dict[str, Any]]:
    root = ElementTree.fromstring(room_svg(look, panel))
    return root, {group.get("id"): group for group in root.findall(f"{SVG}g")}


def test_the_svg_has_every_part_in_its_place() -> None:
    room = room_of("CC4", "trial7")
    look = look_after(room, [L0, L1], part=0.5)
    root, groups = drawn(look)
    names = ["UPPERRIGHT", "UPPER", "UPPERLEFT", "LEFT", "LOWERLEFT", "LOWER", "LOWERRIGHT"]
    assert list(groups) == ["button", *(f"lever_{name}" for name in names), "door", "arm"]
    *_, wide, high = map(float, root.get("viewBox").split())
    shown = frame(7, 1000)
    assert wide / high == pytest.approx(shown.width / shown.height, rel=1e-3)

    def centre(rect: Any) -> tuple[float, float]:
        x, y, w, h = (float(rect.get(key)) for key in ("x", "y", "width", "height"))
        return (x + w / 2) / 100 + shown.left, shown.top - (y + h / 2) / 100

    for place, name in enumerate(names):
        *_, bar = groups[f"lever_{name}"]
        expected = RoomGeometry.of(7).tracks[place].centre(look.levers[place])
        assert centre(bar) == pytest.approx(expected, abs=0.01)
        turned = re.fullmatch(
            r"rotate\((\S+) (\S+) (\S+)\)", bar.get("transform") or "rotate(0 0 0)"
        )
        assert turned
        # Down is positive in an SVG, and so is the way from right to down.
        lies = -math.radians(float(turned[1]))
        outward = RoomGeometry.of(7).tracks[place].outward
        assert outward[0] * math.cos(lies) + outward[1] * math.sin(lies) == pytest.approx(
            0, abs=1e-3
        )
        assert bar.get("fill") == ("#999999" if look.grey[place] else "#e5e5e5")
    joints = [(float(c.get("cx")) / 100 + shown.left, shown.top - float(c.get("cy")) / 100)
              for c in groups["arm"].findall(f"{SVG}circle")]  # fmt: skip
    np.testing.assert_allclose(joints, look.joints, atol=0.01)
    assert len(groups["arm"].findall(f"{SVG}rect")) == 5


@pytest.mark.parametrize("locked", [True, False])
def test_the_lock_is_in_the_svg_while_the_door_is_locked(locked: bool) -> None:
    look = Look.of_observation([0] * 14 + [int(locked), 0], 7)
    _, groups = drawn(look)
    fills = [circle.get("fill") for circle in groups["door"].findall(f"{SVG}circle")]
    assert fills == ["#ff0000", "#000000"][: 1 + locked]


def test_the_same_room_gives_the_same_svg_and_says_what_it_is() -> None:
    look = Look.of_observation([0] * 16, 7)
    assert room_svg(look) == room_svg(look)
    assert "-0 " not in room_svg(look)
    assert "<title>a &lt; b</title>" in room_svg(look, title="a < b")


def test_the_console_is_in_the_svg_too() -> None:
    panel = Panel(
        ("LEFT, UPPER", ""), 29, 2, "bayes", ("CC3",), (ShownAction("push UPPER", "it & so"),)
    )
    root, groups = drawn(Look.of_observation([0] * 16, 7), panel)
    texts = [text.text for text in groups["console"].iter(f"{SVG}text")]
    assert texts == ["bayes", "CC3", "Solutions found: 1 of 2", "LEFT, UPPER", "Attempts left: 29",
                     "Actions left: 2", "This attempt", "1", "push UPPER", "it & so"]  # fmt: skip
    *_, wide, high = map(float, root.get("viewBox").split())
    assert wide / high > 1.8


# -- the console ----------------------------------------------------------------------------------


FULL = Panel(
    solutions=("UPPERLEFT, LOWERRIGHT, UPPERRIGHT, LOWERLEFT, UPPER", None, *[""] * 9),
    attempts_left=300,
    actions_left=12,
    heading="a_learner_with_a_very_long_name_indeed_and_more",
    lines=("two_of_four-two_of_four, protocol human, subject 12345", "Trial", "Attempt"),
    actions=tuple(
        ShownAction(f"push UPPERRIGHT{i}", "the door opens: a new solution") for i in range(12)
    ),
    remark="All solutions found in 300 attempts, and something else",
)
PANELS = [
    FULL,
    Panel(("", ""), 30, 3),
    Panel(("a",), 1, 0, "b", ("c",) * 3, (ShownAction("push UPPER"),) * 3, "d"),
]


@pytest.mark.parametrize("panel", PANELS)
def test_nothing_on_the_console_overlaps_or_is_cut_off(panel: Panel) -> None:
    shapes, labels = panel.layout()
    boxes = []
    for label in labels:
        wide = font(100, label.bold).getlength(label.text) / 100 * label.height
        box = (label.x, label.y - 0.2 * label.height, label.x + wide, label.y + 0.75 * label.height)
        assert box[0] > 0.1
        assert box[1] > 0.1
        assert box[2] < WIDTH - 0.1
        assert box[3] < HEIGHT - 0.1
        boxes.append(box)
    boxes += [(s.x - s.length, s.y - s.width, s.x + s.length, s.y + s.width)
              for s in shapes if s.fill == (255, 255, 255)]  # fmt: skip
    for index, (left, bottom, right, top) in enumerate(boxes):
        for other in boxes[:index]:
            apart = left > other[2] or other[0] > right or bottom > other[3] or other[1] > top
            assert apart, (labels[index : index + 1], other)


def test_the_latest_actions_are_shown_where_there_is_no_room_for_all() -> None:
    _, labels = FULL.layout()
    names = [label.text for label in labels if label.text.startswith("push")]
    assert len(names) >= 2
    assert names == [f"push UPPERRIGHT{i}" for i in range(12 - len(names), 12)]
    assert [label.text for label in labels if label.text.isdigit()] == [
        str(i + 1) for i in range(12 - len(names), 12)
    ]


def test_three_actions_are_always_shown() -> None:
    panel = Panel(("a, b",) * 3, 30, 0, "b", ("c",) * 3, (ShownAction("push UPPER", "x"),) * 3, "d")
    assert sum(label.text == "push UPPER" for label in panel.layout()[1]) == 3


@pytest.mark.parametrize("size", [60, 480, 1000])
def test_the_console_is_as_high_as_the_room(size: int) -> None:
    picture = panel_picture(FULL, size)
    assert picture.shape == (size, round(size * WIDTH / HEIGHT), 3)
    assert (picture[0] == picture[0, 0]).all()
    both = draw(Look.of_observation([0] * 16, 7), size, FULL)
    assert both.shape == (size, frame(7, size).width + picture.shape[1], 3)


def test_text_is_written_where_the_layout_has_it() -> None:
    panel = Panel(("",), 30, 3)
    label = next(one for one in panel.layout()[1] if one.text.startswith("Attempts"))
    picture = panel_picture(panel, 760)
    drawn_here = picture[
        round((HEIGHT - label.y - label.height) * 100) : round((HEIGHT - label.y) * 100),
        round(label.x * 100) :,
    ]
    blank = Image.new("RGB", (500, 40), (246, 246, 246))
    ImageDraw.Draw(blank).text((0, 30), label.text, (30, 30, 30), font(24, True), anchor="ls")
    expected = (np.asarray(blank)[..., 0] < 128).sum()
    assert expected / 2 < (drawn_here[..., 0] < 128).sum() < expected * 4


# -- stills ---------------------------------------------------------------------------------------


def test_a_still_shows_the_room_after_or_amid_actions() -> None:
    room = room_of("CC4", "trial7")
    assert not any(look_after(room).levers)
    half = look_after(room, [L0], 0.5)
    whole = look_after(room, [L0])
    assert whole.levers[L0] == pytest.approx(1.0, abs=0.05)
    assert math.dist(half.joints[-1], whole.joints[-1]) > 0.2
    assert look_after(room, [L0, L0], 0.0).levers[L0] == pytest.approx(1.0, abs=0.05)
    door = look_after(room, [L0, L1, DOOR], 0.6)
    assert door.pressed
    assert not door.locked
    assert not look_after(room, [L0, L1, DOOR]).pressed

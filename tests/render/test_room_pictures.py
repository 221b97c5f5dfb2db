"""Pictures of rooms as pixels, as SVG and as text, at rest and in motion, and the console."""

import math
import re
import xml.etree.ElementTree as ElementTree
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from causal_openlock.physics.geometry import RoomGeometry, along
from causal_openlock.physics.room import PhysicalRoom
from causal_openlock.render.paint import Panel, ShownAction, draw, room_svg, room_text
from causal_openlock.render.scene import Look, frame, look_after
from causal_openlock.world.facts import room_facts
from causal_openlock.world.room import position_names
from support.env_play import DOOR, L0, L1
from support.physical_play import room_of

RGB = room_facts()["rgb"]
GREY, LIGHT, RED = RGB["active_lever_arm_door"], RGB["inactive_lever"], RGB["joint_and_hinge"]
WHITE, BLACK = [255, 255, 255], [0, 0, 0]
SVG = "{http://www.w3.org/2000/svg}"
each_size = pytest.mark.parametrize("positions", range(7, 13))


def draw_room(bits, positions, size):
    return draw(Look.of_observation(bits, positions), size)


def observed(positions, pushed=(), grey=(), locked=True, opened=False):
    """An observation of a room in which these levers are pushed, and these grey."""
    bits = np.zeros(2 * positions + 2, dtype=np.int8)
    bits[list(pushed)] = 1
    bits[[positions + place for place in grey]] = 1
    bits[-2:] = locked, opened
    return bits


def pixel(picture, point, positions=7):
    """The colour of a picture where a point of the room is."""
    column, row = frame(positions, len(picture)).pixel(point)
    return picture[int(row), int(column)].tolist()


def check_picture(picture, look):
    """Every part of a room is where the look says, in its colour."""
    positions, geometry = look.positions, RoomGeometry.of(look.positions)

    def at(point):
        return pixel(picture, point, positions)

    assert [at(joint) for joint in look.joints[:-1]] == [RED] * 5
    assert at(look.joints[-1]) == GREY
    for start, end in pairwise(look.joints):  # another link's joint may lie above the middle
        assert at(((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)) != WHITE
    for place, slid in enumerate(look.levers):
        track, colour = geometry.tracks[place], GREY if look.grey[place] else LIGHT
        across = -track.outward[1], track.outward[0]
        for side in (-0.8, 0.8):  # beside the track, where only the bar can be
            assert at(along(track.centre(slid), across, side)) == colour
            if slid in (0.0, 1.0):
                assert at(along(track.centre(1 - slid), across, side)) == WHITE
    down = math.sin(look.door), -math.cos(look.door)
    for below in (0.4, 1.7):
        assert at(along(geometry.hinge, down, below)) == GREY
    assert at(geometry.hinge) == RED
    assert (at(along(geometry.lock, (1.0, 0.0), 0.12)) == BLACK) == look.locked
    assert at(geometry.button) == RGB["button_pressed" if look.pressed else "button"]


@each_size
def test_every_part_of_a_room_is_where_its_state_puts_it(positions):
    for bits in np.random.default_rng(positions).integers(0, 2, (8, 2 * positions + 2)):
        picture = draw_room(bits, positions, 500)
        assert picture.dtype == np.uint8
        assert picture.shape == (500, frame(positions, 500).width, 3)
        look = Look.of_observation(bits, positions)
        assert [*(slid == 1 for slid in look.levers), *look.grey] == bits[:-2].tolist()
        assert (look.locked, look.door > 1) == tuple(bits[-2:])
        assert math.dist(*look.joints[1:3]) == pytest.approx(RoomGeometry.of(positions).link)
        check_picture(picture, look)
        middle = along(RoomGeometry.of(positions).hinge, (0.0, -1.0), 1.0)
        assert pixel(picture, middle, positions) == (WHITE if bits[-1] else GREY)
        border = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
        assert (border == 255).all()


def test_every_part_is_where_the_bodies_are_at_every_moment():
    room = room_of("CC4", "trial7")
    physical, poses, moved = PhysicalRoom(room.fsm, room.layout), [], set()
    physical.watch = poses.append
    rest = draw(Look.of_pose(physical.pose(), room.active.tolist()), 480)
    symbolic = draw(Look.of_observation(room.observation[0], 7), 480)
    assert np.abs(rest.astype(int) - symbolic).max() <= 2
    for action in (L0, L1, DOOR):
        physical.act(action)
    for pose in poses[::5]:
        look = Look.of_pose(pose, room.active.tolist())
        check_picture(draw(look, 480), look)
        moved |= {place for place, slid in enumerate(look.levers) if 0.2 < slid < 0.8}
    assert moved == {L0, L1}
    assert not look.locked
    assert look.door > 1.0


def test_a_still_shows_the_room_after_or_amid_actions():
    room = room_of("CC4", "trial7")
    assert not any(look_after(room).levers)
    half, whole = look_after(room, [L0], 0.5), look_after(room, [L0])
    assert whole.levers[L0] == pytest.approx(1.0, abs=0.05)
    assert math.dist(half.joints[-1], whole.joints[-1]) > 0.2
    assert look_after(room, [L0, L0], 0.0).levers[L0] == pytest.approx(1.0, abs=0.05)
    amid, after = (look_after(room, [L0, L1, DOOR], part) for part in (0.6, 1.0))
    assert (amid.pressed, amid.locked, after.pressed) == (True, False, False)
    for look in (half, amid):
        check_picture(draw(look, 480), look)


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_other_observations_give_other_pictures_and_texts(data):
    positions = data.draw(st.sampled_from([7, 7, 9, 12]))
    bits = st.lists(st.integers(0, 1), min_size=2 * positions + 2, max_size=2 * positions + 2)
    one, other = data.draw(bits), data.draw(bits)
    if data.draw(st.booleans()):
        other = list(one)
        other[data.draw(st.integers(0, len(one) - 1))] ^= 1
    same = one == other
    picture = draw_room(one, positions, 96)
    assert (picture == draw_room(other, positions, 96)).all() == same
    assert (room_text(one, positions) == room_text(other, positions)) == same
    picture[:] = 0  # what was handed out can be drawn upon
    assert draw_room(one, positions, 96).any()


def test_an_observation_of_another_room_is_refused():
    for draw_it in (Look.of_observation, room_text):
        with pytest.raises(ValueError, match="16 bits"):
            draw_it(observed(8), 7)


@each_size
def test_the_text_shows_every_lever_once(positions):
    for bits in np.random.default_rng(positions).integers(0, 2, (10, 2 * positions + 2)):
        text = room_text(bits, positions)
        shown = re.findall(r"(\d+)([\[(])([# ])[\])]", text)
        assert len(shown) == positions
        for place, bracket, mark in shown:
            assert (bracket == "[") == bits[positions + int(place)]
            assert (mark == "#") == bits[int(place)]
        assert ("unlocked" not in text) == bits[-2]
        assert ("open" in text) == bits[-1]
        assert ("closed" in text) != bits[-1]
        assert max(map(len, text.splitlines())) < 80


def test_the_text_of_a_room():
    assert room_text(observed(7, pushed=[3], grey=[1, 3])) == (
        "          1[ ]\n"
        "   2( )          0( )\n"
        "                        o\n"
        " 3[#]                   |\n"
        "                        |  door closed, locked\n"
        "   4( )          6( )\n"
        "          5( )\n"
        "[ ] grey  ( ) inactive  # pushed\n"
    )


def parts_of(look, panel=None):
    """The SVG's root, and its groups by name."""
    root = ElementTree.fromstring(room_svg(look, panel))
    return root, {group.get("id"): group for group in root.findall(f"{SVG}g")}


def test_the_svg_has_every_part_in_its_place():
    look = look_after(room_of("CC4", "trial7"), [L0, L1], part=0.5)
    root, groups = parts_of(look)
    names = [f"lever_{name}" for name in position_names(7)]
    assert list(groups) == ["button", *names, "door", "arm"]
    *_, wide, high = map(float, root.get("viewBox").split())
    shown = frame(7, 1000)
    assert wide / high == pytest.approx(shown.width / shown.height, rel=1e-3)
    for place, name in enumerate(names):
        *_, bar = groups[name]
        track = RoomGeometry.of(7).tracks[place]
        x, y, w, h = (float(bar.get(key)) for key in ("x", "y", "width", "height"))
        centre = (x + w / 2) / 100 + shown.left, shown.top - (y + h / 2) / 100
        assert centre == pytest.approx(track.centre(look.levers[place]), abs=0.01)
        turned = re.match(r"rotate\((\S+)", bar.get("transform") or "rotate(0")
        lies = -math.radians(float(turned[1]))  # down is positive in an SVG
        across = track.outward[0] * math.cos(lies) + track.outward[1] * math.sin(lies)
        assert across == pytest.approx(0, abs=1e-3)
        assert bar.get("fill") == ("#999999" if look.grey[place] else "#e5e5e5")
    joints = [
        (float(c.get("cx")) / 100 + shown.left, shown.top - float(c.get("cy")) / 100)
        for c in groups["arm"].findall(f"{SVG}circle")
    ]
    np.testing.assert_allclose(joints, look.joints, atol=0.01)
    assert len(groups["arm"].findall(f"{SVG}rect")) == 5
    for locked in (True, False):
        circles = parts_of(Look.of_observation(observed(7, locked=locked), 7))[1]["door"]
        fills = [circle.get("fill") for circle in circles.findall(f"{SVG}circle")]
        assert fills == ["#ff0000", "#000000"][: 1 + locked]
    assert room_svg(look) == room_svg(look)
    assert "<title>a &lt; b</title>" in room_svg(look, title="a < b")


PANEL = Panel(
    ("LEFT, UPPER", ""), 29, 2, "bayes", ("CC3",), (ShownAction("push UPPER", "it & so"),)
)
FULL = Panel(
    ("UPPERLEFT, LOWERRIGHT, UPPERRIGHT, LOWERLEFT, UPPER", *[""] * 9),
    *(300, 12, "a_learner_with_a_very_long_name_indeed_and_more", ("protocol human, subject 1",)),
    actions=tuple(ShownAction(f"push LEFT{i}", "the door opens") for i in range(12)),
    remark="All solutions found",
)


def written(panel):
    """All texts on a console."""
    _, groups = parts_of(Look.of_observation(observed(7), 7), panel)
    return [text.text for text in groups["console"].iter(f"{SVG}text")]


def test_the_console_says_what_was_found_done_and_is_left():
    assert written(PANEL) == [
        *("bayes", "CC3", "Solutions found: 1 of 2", "☑ LEFT, UPPER", "☐"),
        *("Attempts left: 29, actions left: 2", "This attempt", "1  push UPPER", "    it & so"),
    ]
    assert "Attempts left: –, actions left: 0" in written(Panel(("",), None, 0))  # solved and over
    texts = written(FULL)
    assert texts[-1] == "All solutions found"
    shown = [text for text in texts if "push" in text]
    assert len(shown) >= 2
    assert shown == [f"{i + 1}  push LEFT{i}" for i in range(12 - len(shown), 12)]  # the latest
    assert "☑ UPPERLEFT, LOWERRIGHT," in " ".join(texts)


@pytest.mark.parametrize("panel", [PANEL, FULL])
def test_the_console_stands_beside_the_room_and_nothing_is_cut_off(panel):
    look, size = Look.of_observation(observed(7), 7), 480
    alone, both = draw(look, size), draw(look, size, panel)
    width = alone.shape[1]
    assert both.shape[0] == size
    assert (both[:, :width] == alone).all()
    console = both[:, width:]
    assert console.shape[1] > size / 2
    border = np.concatenate([console[0], console[-1], console[:, 0], console[:, -1]])
    assert (border == border[0]).all()
    assert (console.min(axis=2) < 128).sum() > size  # something is written

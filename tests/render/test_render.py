"""Pictures of schemas and rooms: what is in them, where, and that nothing overlaps."""

from __future__ import annotations

import io
import math
import re
from itertools import combinations

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from PIL import Image

from causal_openlock.errors import OpenLockError
from causal_openlock.physics.geometry import RoomGeometry
from causal_openlock.render.arrange import CLEARANCE, LABEL, RADIUS, arrange, distance_to_node
from causal_openlock.render.graph import draw_schema, save_schema_figure, schema_text
from causal_openlock.render.raster import paint
from causal_openlock.render.room import draw_room, room_text
from causal_openlock.render.scene import Look, frame
from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.schemas.schema import DOOR, MAX_LEVERS, Gate, Schema
from causal_openlock.testing import schemas
from causal_openlock.world.facts import room_facts
from causal_openlock.world.room import Room, position_coordinates

BUNDLED = bundled_schemas()
GREY = room_facts()["rgb"]["active_lever_arm_door"]
LIGHT = room_facts()["rgb"]["inactive_lever"]
WHITE = [255, 255, 255]
SIZES = range(7, MAX_LEVERS + 1)

LEVERS = [f"L{index}" for index in range(MAX_LEVERS)]
COMPLETE = Schema(
    "complete",
    LEVERS,
    {cause: [*LEVERS[index + 1 :], DOOR] for index, cause in enumerate(LEVERS)},
)
FAN = Schema("fan", LEVERS, {**{lever: ["L11"] for lever in LEVERS[:-1]}, "L11": [DOOR]})
WIDE = Schema("wide", LEVERS, {lever: [DOOR] for lever in LEVERS}, gates={DOOR: Gate("all")})
NAMED = Schema(
    "named",
    ["pressure_plate", "a_lever_with_a_name_of_forty_characters_", "key", "L3"],
    {
        "pressure_plate": {"key": 0.5, "a_lever_with_a_name_of_forty_characters_": 0.25, "L3": 0.1},
        "a_lever_with_a_name_of_forty_characters_": {DOOR: 0.75},
        "key": [DOOR],
    },
    inert=["L3"],
    gates={DOOR: Gate("at_least", 2)},
)
# Edges to the door that would run through a neighbour, were the rows not moved apart.
SPARSE = Schema(
    "sparse",
    LEVERS,
    {**{lever: [DOOR] for lever in LEVERS}, "L3": ["L9"], "L4": ["L7"], "L6": ["L8"]},
)
HARD = [SPARSE, COMPLETE, FAN, WIDE, NAMED]


def ids(schema: Schema) -> str:
    return schema.name


# -- the figure of a schema -----------------------------------------------------------------------


def check_arrangement(schema: Schema) -> None:
    drawing = arrange(schema)
    nodes = [*schema.levers, DOOR]
    assert set(drawing.half_width) == set(nodes)
    assert set(drawing.edges) == set(schema.graph.edges)
    left, right, bottom, top = drawing.limits
    assert -15 < left < right < 15
    for one, other in combinations(nodes, 2):
        apart = np.abs(drawing.centre[one] - drawing.centre[other])
        reach = drawing.half_width[one] + drawing.half_width[other]
        assert apart[0] > reach + 0.1 or apart[1] > 2 * RADIUS + 0.1, (one, other)
    for (cause, effect), line in drawing.edges.items():
        assert drawing.centre[cause][1] > drawing.centre[effect][1]
        assert abs(distance_to_node(drawing, cause, line[:1])) < 0.02
        assert 0 < distance_to_node(drawing, effect, line[-1:]) < 0.06
        for node in nodes:
            if node not in (cause, effect):
                assert distance_to_node(drawing, node, line) > CLEARANCE, (cause, effect, node)
        assert (line > [left, bottom]).all()
        assert (line < [right, top]).all()
    lowest = min(nodes, key=lambda node: drawing.centre[node][1])
    assert lowest == DOOR
    uncertain = {(c, e) for c, e, strength in schema.graph.edges(data="strength") if strength < 1}
    assert set(drawing.labels) == uncertain
    for at in drawing.labels.values():
        assert left < at[0] - LABEL[0]
        assert at[0] + LABEL[0] < right


@pytest.mark.parametrize("schema", [*BUNDLED.values(), *HARD], ids=ids)
def test_nothing_overlaps(schema: Schema) -> None:
    check_arrangement(schema)


@settings(max_examples=40, deadline=None)
@given(schema=schemas(max_levers=12, stochastic=True))
def test_nothing_overlaps_in_any_schema(schema: Schema) -> None:
    check_arrangement(schema)


@pytest.mark.parametrize("schema", [*BUNDLED.values(), *HARD], ids=ids)
def test_the_svg_names_every_node_gate_and_strength(tmp_path, schema: Schema) -> None:
    save_schema_figure(schema, tmp_path / "a.svg")
    svg = (tmp_path / "a.svg").read_text(encoding="utf-8")
    written = re.findall(r"<text[^>]*>([^<]*)</text>", svg)
    nodes = [*schema.levers, DOOR]
    marks = [f"≥{schema.gate(n).k}" if schema.gate(n).kind == "at_least" else "all"
             for n in nodes if schema.gate(n) != Gate()]  # fmt: skip
    strengths = [f"{s:.2g}" for *_, s in schema.graph.edges(data="strength") if s < 1]
    assert sorted(written) == sorted([*nodes, *marks, *strengths])


def test_causes_stand_above_effects_as_in_the_paper() -> None:
    drawing = arrange(BUNDLED["CC4"])
    x, y = (np.array([drawing.centre[node][axis] for node in ["L0", "L1", "L2", "L3", DOOR]])
            for axis in (0, 1))  # fmt: skip
    np.testing.assert_allclose(x - x[0], [0, -(x[0] - x[1]), 0, x[0] - x[1], 0], atol=1e-6)
    assert x[1] < x[2] < x[3]
    assert y[0] > y[1] == y[2] == y[3] > y[4]


def test_a_long_edge_bends_around_what_stands_in_its_way() -> None:
    schema = Schema("a", ["L0", "L1", "L2"], {"L0": ["L1", DOOR], "L1": ["L2"], "L2": [DOOR]})
    line = arrange(schema).edges["L0", DOOR]
    straight = np.linspace(line[0], line[-1], len(line))
    assert np.abs(line - straight).max() > 0.1


@pytest.mark.parametrize("schema", [BUNDLED["seven"], NAMED, WIDE], ids=ids)
def test_names_fit_into_their_nodes(schema: Schema) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    axes = draw_schema(schema)
    renderer = FigureCanvasAgg(axes.figure).get_renderer()
    drawing = arrange(schema)
    found = 0
    for text in axes.texts:
        if text.get_text() not in drawing.half_width:
            continue
        found += 1
        box = axes.transData.inverted().transform(text.get_window_extent(renderer))
        centre, half = drawing.centre[text.get_text()], drawing.half_width[text.get_text()]
        assert np.abs(box[:, 0] - centre[0]).max() < half
        assert np.abs(box[:, 1] - centre[1]).max() < RADIUS
    assert found == len(drawing.half_width)


def test_inert_levers_are_dashed_and_others_are_not() -> None:
    axes = draw_schema(BUNDLED["two_keys"])
    styles = [patch.get_linestyle() for patch in axes.patches]
    assert styles.count("-") == 2 + 3
    assert len(styles) == 6


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_figures_are_saved_by_suffix_and_alike_each_time(tmp_path, suffix: str) -> None:
    path = tmp_path / f"figure.{suffix}"
    save_schema_figure(BUNDLED["two_of_four"], path)
    first = path.read_bytes()
    assert first[:5] in (b"\x89PNG\r", b"<?xml", b"%PDF-")
    save_schema_figure(BUNDLED["two_of_four"], path)
    assert path.read_bytes() == first
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_a_picture_does_not_follow_settings_of_the_machine(tmp_path) -> None:
    save_schema_figure(BUNDLED["CC3"], tmp_path / "plain.svg")
    with mpl.rc_context({"text.usetex": True, "font.size": 30, "figure.dpi": 33}):
        save_schema_figure(BUNDLED["CC3"], tmp_path / "same.svg")
    assert (tmp_path / "plain.svg").read_bytes() == (tmp_path / "same.svg").read_bytes()


def test_the_figure_is_all_inside_the_picture(tmp_path) -> None:
    for schema in (BUNDLED["seven"], BUNDLED["two_keys"], NAMED):
        save_schema_figure(schema, tmp_path / "a.png")
        pixels = np.asarray(Image.open(tmp_path / "a.png").convert("L"))
        border = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
        assert border.min() == 255
        assert pixels.min() < 50


def test_an_unknown_suffix_names_the_nearest(tmp_path) -> None:
    with pytest.raises(OpenLockError, match=r"'\.svgz'.*did you mean \.svg"):
        save_schema_figure(BUNDLED["CC3"], tmp_path / "a.svgz")


def test_a_schema_is_drawn_into_axes_that_are_given() -> None:
    figure = Figure(figsize=(6, 3))
    axes = figure.subplots(1, 2)
    assert draw_schema(BUNDLED["CC3"], axes[0]) is axes[0]
    draw_schema(BUNDLED["two_keys"], axes[1])
    figure.savefig(io.BytesIO(), format="png")
    assert [text.get_text() for text in axes[0].texts] == ["L0", "L1", "L2", DOOR]
    assert axes[1].texts[0].get_fontsize() < 40


def test_a_schema_as_text() -> None:
    text = schema_text(BUNDLED["seven"])
    assert re.search(r"L0 +──► L2, L3 +moves freely\n", text)
    assert re.search(r"L2 +──► door +moves while all of L0, L1 are pushed\n", text)
    assert re.search(r"door +unlocks while any of L2, L5, L6 is pushed\n", text)
    assert "3 solutions:\n  L0 L1 L2 door\n" in text
    assert "L2             moves freely (inert)" in schema_text(BUNDLED["two_keys"])
    assert "while L0 (0.8) is pushed" in schema_text(BUNDLED["noisy_CC3"])
    assert "at least 2 of L0, L1, L2, L3 are pushed" in schema_text(BUNDLED["two_of_four"])
    assert "and 4 more" in schema_text(BUNDLED["two_of_four"], solutions=2)


@settings(max_examples=30, deadline=None)
@given(schema=schemas(max_levers=8, stochastic=True))
def test_text_says_causes_before_effects(schema: Schema) -> None:
    lines = schema_text(schema).splitlines()[2:]
    order = [line.split()[0] for line in lines[: len(schema.levers) + 1]]
    assert sorted(order) == sorted([*schema.levers, DOOR])
    assert order[-1] == DOOR
    for cause, effect in schema.graph.edges:
        assert order.index(cause) < order.index(effect)


# -- the picture of a room ------------------------------------------------------------------------


def observe(positions: int, pushed=(), grey=(), locked: bool = True, opened: bool = False):
    bits = np.zeros(2 * positions + 2, dtype=np.int8)
    bits[list(pushed)] = 1
    bits[[positions + place for place in grey]] = 1
    bits[-2:] = locked, opened
    return bits


def pixel(picture, positions: int, point) -> list[int]:
    column, row = frame(positions, len(picture)).pixel(point)
    return picture[int(row), int(column)].tolist()


@pytest.mark.parametrize("positions", SIZES)
def test_every_lever_is_where_its_state_puts_it(positions: int) -> None:
    generator = np.random.default_rng(positions)
    for _ in range(8):
        bits = generator.integers(0, 2, 2 * positions + 2)
        picture = draw_room(bits, positions, 500)
        for place, (x, y) in enumerate(position_coordinates(positions)):
            track = RoomGeometry.of(positions).tracks[place]
            pushed, colour = bool(bits[place]), GREY if bits[positions + place] else LIGHT
            across = np.array([-y, x]) / math.hypot(x, y)
            for side in (-0.8, 0.8):  # beside the track, where only the bar can be
                there = track.centre(float(pushed)) + side * across
                other = track.centre(float(not pushed)) + side * across
                assert pixel(picture, positions, there) == colour
                assert pixel(picture, positions, other) == WHITE


@pytest.mark.parametrize("positions", [7, 12])
def test_the_door_and_its_lock(positions: int) -> None:
    facts = room_facts()["door"]
    stretch = positions / 7
    lock = np.array(facts["lock_indicator"]) * [stretch, 1]
    hinge = np.array(facts["hinge"]) * [stretch, 1]
    middle = (lock + hinge) / 2
    swung = hinge + np.array([math.sin(math.radians(60)), -math.cos(math.radians(60))])
    for locked in (False, True):
        for opened in (False, True):
            picture = draw_room(observe(positions, locked=locked, opened=opened), positions, 500)
            black = pixel(picture, positions, lock + np.array([0.12, 0.0])) == [0, 0, 0]
            assert black == locked
            assert pixel(picture, positions, middle) == (WHITE if opened else GREY)
            assert pixel(picture, positions, swung) == (GREY if opened else WHITE)
            assert pixel(picture, positions, hinge) == room_facts()["rgb"]["joint_and_hinge"]


def test_what_never_changes() -> None:
    picture = draw_room(observe(7), 7, 600)
    assert picture.dtype == np.uint8
    assert picture.shape == (600, frame(7, 600).width, 3)
    assert pixel(picture, 7, room_facts()["button"]["centre"]) == room_facts()["rgb"]["button"]
    for joint in room_facts()["arm"]["joints"][:-1]:
        assert pixel(picture, 7, joint) == room_facts()["rgb"]["joint_and_hinge"]
    border = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
    assert (border == 255).all()


@pytest.mark.parametrize("positions", SIZES)
def test_pieces_do_not_touch(positions: int) -> None:
    shown = frame(positions, 300)
    for pushed in np.random.default_rng(0).integers(0, 2, (20, positions)).tolist():
        bits = observe(positions, np.flatnonzero(pushed), locked=True, opened=bool(pushed[0]))
        taken = np.zeros((shown.height, shown.width), dtype=int)
        for shapes in Look.of_observation(bits, positions).shapes().values():
            alone = np.full((*taken.shape, 3), 255, np.uint8)
            paint(alone, shapes, shown)
            taken += (alone != 255).any(axis=2)
        assert taken.max() == 1


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_other_observations_give_other_pictures_and_texts(data: st.DataObject) -> None:
    positions = data.draw(st.sampled_from([7, 7, 9, 12]))
    bits = st.lists(st.integers(0, 1), min_size=2 * positions + 2, max_size=2 * positions + 2)
    one, other = data.draw(bits), data.draw(bits)
    if data.draw(st.booleans()):
        other = list(one)
        other[data.draw(st.integers(0, len(one) - 1))] ^= 1
    same = one == other
    assert (draw_room(one, positions, 96) == draw_room(other, positions, 96)).all() == same
    assert (room_text(one, positions) == room_text(other, positions)) == same


def test_pictures_can_be_drawn_upon() -> None:
    bits = observe(7, pushed=[2])
    first = draw_room(bits, 7, 120)
    kept = first.copy()
    first[:] = 0
    assert (draw_room(bits, 7, 120) == kept).all()


@pytest.mark.parametrize("positions", SIZES)
def test_the_text_shows_every_lever_once(positions: int) -> None:
    generator = np.random.default_rng(positions)
    for bits in generator.integers(0, 2, (10, 2 * positions + 2)):
        text = room_text(bits, positions)
        found = re.findall(r"(\d+)([\[(])([# ])[\])]", text)
        assert len(found) == positions
        for place, bracket, mark in found:
            assert (bracket == "[") == bits[positions + int(place)]
            assert (mark == "#") == bits[int(place)]
        assert ("unlocked" not in text) == bits[-2]
        assert ("open" in text) == bits[-1]
        assert ("closed" in text) != bits[-1]
        assert max(map(len, text.splitlines())) < 80


def test_the_text_of_a_room() -> None:
    assert room_text(observe(7, pushed=[3], grey=[1, 3])) == (
        "          1[ ]\n"
        "   2( )          0( )\n"
        "                        o\n"
        " 3[#]                   |\n"
        "                        |  door closed, locked\n"
        "   4( )          6( )\n"
        "          5( )\n"
        "[ ] grey  ( ) inactive  # pushed\n"
    )


def test_an_observation_of_another_room_is_refused() -> None:
    for draw in (draw_room, room_text):
        with pytest.raises(ValueError, match="16 bits"):
            draw(observe(8), 7)


def test_every_state_of_a_real_room_is_drawn() -> None:
    room = Room.of(BUNDLED["CC4"], "trial7")
    pictures = {draw_room(seen, 7, 64).tobytes() for seen in room.observation}
    assert len(pictures) == len(np.unique(room.observation, axis=0))

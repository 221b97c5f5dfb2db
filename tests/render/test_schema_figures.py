"""Schemas as figures and as text: what is in them, and where."""

import io
import re

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given, settings
from matplotlib.figure import Figure
from PIL import Image

from causal_openlock.render.graph import draw_schema, save_schema_figure, schema_text
from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.schemas.one_line import parse_line
from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.testing import schemas

BUNDLED = bundled_schemas()
LEVERS = [f"L{index}" for index in range(12)]
LONG = "a_lever_with_a_name_of_forty_characters_"
HARD = [
    Schema("one_edge", ["L0"], {"L0": {DOOR: 0.5}}),
    Schema("complete", LEVERS, {cause: [*LEVERS[i + 1 :], DOOR] for i, cause in enumerate(LEVERS)}),
    Schema("wide", LEVERS, {lever: [DOOR] for lever in LEVERS}, gates={DOOR: Gate("all")}),
    Schema(
        "named",
        ["plate", LONG, "key", "L3"],
        {"plate": {"key": 0.5, LONG: 0.25, "L3": 0.1}, LONG: {DOOR: 0.75}, "key": [DOOR]},
        inert=["L3"],
        gates={DOOR: Gate("at_least", 2)},
    ),
]
each_schema = pytest.mark.parametrize(
    "schema", [*BUNDLED.values(), *HARD], ids=lambda schema: schema.name
)


@each_schema
def test_a_figure_names_every_node_gate_and_strength(tmp_path, schema):
    save_schema_figure(schema, tmp_path / "a.svg")
    written = re.findall(r"<text[^>]*>([^<]*)</text>", (tmp_path / "a.svg").read_text("utf-8"))
    nodes = [*schema.levers, DOOR]
    gates = [schema.gate(node) for node in nodes]
    marks = [f"≥{gate.k}" if gate.kind == "at_least" else "all" for gate in gates if gate != Gate()]
    strengths = [f"{s:.2g}" for *_, s in schema.graph.edges(data="strength") if s < 1]
    assert sorted(written) == sorted([*nodes, *marks, *strengths])


@each_schema
def test_causes_stand_above_effects_and_no_two_nodes_in_one_place(schema):
    place = {text.get_text(): text.get_position() for text in draw_schema(schema).texts}
    nodes = [*schema.levers, DOOR]
    assert len({place[node] for node in nodes}) == len(nodes)
    for cause, effect in schema.graph.edges:
        assert place[cause][1] > place[effect][1]
    assert min(nodes, key=lambda node: place[node][1]) == DOOR


def test_inert_levers_are_dashed_and_others_are_not():
    styles = [patch.get_linestyle() for patch in draw_schema(BUNDLED["two_keys"]).patches]
    assert styles.count("-") == 2 + 3
    assert len(styles) == 6


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_figures_are_saved_by_suffix_and_alike_whatever_the_settings(tmp_path, suffix):
    path = tmp_path / f"figure.{suffix}"
    save_schema_figure(BUNDLED["two_of_four"], path)
    first = path.read_bytes()
    assert first[:5] in (b"\x89PNG\r", b"<?xml", b"%PDF-")
    with mpl.rc_context({"text.usetex": True, "font.size": 30, "figure.dpi": 33}):
        save_schema_figure(BUNDLED["two_of_four"], path)
    assert path.read_bytes() == first
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("schema", [BUNDLED["seven"], BUNDLED["two_keys"], *HARD])
def test_the_figure_is_all_inside_the_picture(tmp_path, schema):
    save_schema_figure(schema, tmp_path / "a.png")
    pixels = np.asarray(Image.open(tmp_path / "a.png").convert("L"))
    border = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
    assert border.min() == 255
    assert pixels.min() < 50


def test_a_schema_is_drawn_into_axes_that_are_given():
    figure = Figure(figsize=(6, 3))
    axes = figure.subplots(1, 2)
    assert draw_schema(BUNDLED["CC3"], axes[0]) is axes[0]
    draw_schema(BUNDLED["two_keys"], axes[1])
    figure.savefig(io.BytesIO(), format="png")
    assert [text.get_text() for text in axes[0].texts] == ["L0", "L1", "L2", DOOR]


def test_a_schema_as_text():
    text = schema_text(BUNDLED["seven"])
    assert re.search(r"L0 +──► L2, L3 +moves freely\n", text)
    assert re.search(r"L2 +──► door +moves while all of L0, L1 are pushed\n", text)
    assert re.search(r"door +unlocks while any of L2, L5, L6 is pushed\n", text)
    assert "3 solutions:\n  L0 L1 L2 door\n" in text
    assert "L2             moves freely (inert)" in schema_text(BUNDLED["two_keys"])
    assert "while L0 (0.8) is pushed" in schema_text(BUNDLED["noisy_CC3"])
    assert "at least 2 of L0, L1, L2, L3 are pushed" in schema_text(BUNDLED["two_of_four"])
    assert schema_text(parse_line("2 of (A, B, C, D, E, F) -> door")).endswith("\n  and 3 more\n")


@settings(max_examples=30, deadline=None)
@given(schema=schemas(max_levers=8, stochastic=True))
def test_text_says_causes_before_effects(schema):
    lines = schema_text(schema).splitlines()[2:]
    order = [line.split()[0] for line in lines[: len(schema.levers) + 1]]
    assert sorted(order) == sorted([*schema.levers, DOOR])
    assert order[-1] == DOOR
    for cause, effect in schema.graph.edges:
        assert order.index(cause) < order.index(effect)

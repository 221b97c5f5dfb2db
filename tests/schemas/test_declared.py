"""Schemas as people write them: files, lines of text, graphs of networkx, edges.

That any schema survives in every format is tested with the formats.
"""

from pathlib import Path

import gymnasium
import networkx as nx
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import causal_openlock as ol
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.condition import find_condition
from causal_openlock.files.yaml_file import Document, dump_yaml
from causal_openlock.schemas.finding import bundled_schemas, find_schema, schema
from causal_openlock.schemas.graphs import import_schema, write_schema
from causal_openlock.schemas.one_line import parse_line
from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.testing import schemas

# What declares a schema, and the schema file that declares the same.
HALF = "levers: [A, B]\nedges: {A: {B: 0.5}, B: [door]}"
SAME = [
    ("A -> B, C; B | C -> door", "levers: [A, B, C]\nedges: {A: [B, C], B: [door], C: [door]}"),
    ("A -> B, C -> door", "levers: [A, B, C]\nedges: {A: [B, C], B: [door], C: [door]}"),
    ("A -> door\n\nB -> door  # either\n", "levers: [A, B]\nedges: {A: [door], B: [door]}"),
    ("A & B -> door", "levers: [A, B]\nedges: {A: [door], B: [door]}\ngates: {door: all}"),
    (
        "2 of (A, B (.5), C) -> D -> door",
        "levers: [A, B, C, D]\nedges: {A: [D], B: {D: {strength: 0.5}}, C: [D], D: [door]}\n"
        "gates: {D: {at_least: 2}}",
    ),
    (
        "all of (A) -> B (8e-1), C; any of (B, C) -> door",
        "levers: [A, B, C]\nedges: {A: {B: {strength: 0.8}, C: {}}, B: [door], C: [door]}\n"
        "gates: {B: all, C: all}",
    ),
    (
        "B, A, inert; A -> B -> door; inert inert",
        "levers: [B, A, inert]\nedges: {A: [B], B: [door]}\ninert: [inert]",
    ),
    ([("A", "B", 0.5), ("B", "door")], HALF),
    ({"A": {"B": 0.5}, "B": "door"}, HALF),
    (nx.DiGraph({"A": {"B": {"strength": 0.5}}, "B": {"door": {}}}), HALF),
    (
        {
            "name": "schema",
            "levers": np.array(["B", "A"]),
            "edges": {"A": {"door": {"strength": np.float32(0.5)}}, "B": np.array(["A"])},
        },
        "levers: [B, A]\nedges: {A: {door: 0.5}, B: [A]}",
    ),
]


@pytest.mark.parametrize(("declared", "file"), SAME)
def test_whatever_declares_a_schema_is_what_the_file_is(declared, file):
    assert schema(declared) == import_schema(f"name: schema\n{file}", "yaml")


PIECES = ["A", "B", "door", "->", ",", "|", "&", ";", "\n", "(", ")", "2", ".5", "9" * 5000, "of",
          "all", "inert", ":", '"x"', "#", "-", "1e999", "ü"]  # fmt: skip


@settings(max_examples=300, deadline=None)
@given(st.lists(st.sampled_from(PIECES), max_size=14))
def test_any_line_is_a_schema_or_refused(pieces):
    try:
        found = parse_line(" ".join(pieces))
    except OpenLockError:
        return
    assert parse_line(found.to_text()) == found


@settings(max_examples=60, deadline=None)
@given(drawn=schemas(max_levers=8, stochastic=True))
def test_any_schema_comes_back_from_a_graph_and_from_edges(drawn):
    assert schema(nx.DiGraph(drawn.graph), inert=drawn.inert) == drawn
    gates = {node: drawn.gate(node) for node in [*drawn.levers, DOOR] if drawn.causes(node)}
    plain = nx.DiGraph()
    plain.add_nodes_from(drawn.levers)
    plain.add_edges_from(drawn.graph.edges(data=True))
    assert schema(plain, gates=gates, inert=drawn.inert, name=drawn.name) == drawn


# Spaces, signs that YAML heeds and line breaks that only Unicode knows, in texts of many lines.
HARD = st.text(
    st.sampled_from("ab  :#'\"\\-\t\xa0\x85\u2028\u2029\u3000,[]{}%@&*!|>?\n\r"), max_size=400
)


@settings(max_examples=50, deadline=None)
@given(title=HARD | st.lists(st.text("abc", min_size=1)).map("  ".join))
@example(title="  ".join(["five"] * 18))  # longer than a line, with two spaces where it may break
@example(title="a\x85b")
def test_any_text_comes_back_whatever_its_length_and_spaces(title):
    inside = {"conditions": [{"name": title, "train": [title] * 3}]}
    for text in (dump_yaml(inside), dump_yaml(inside, innermost_in_a_line=True)):
        assert Document(text).data == inside


def test_a_schema_is_written_as_one_writes_it_by_hand():
    edges = {"A": {"B": 0.5, DOOR: 1.0}, "B": [DOOR]}
    gates = {DOOR: Gate("at_least", 2)}
    schema = Schema("S", ["A", "B", "C"], edges, gates=gates, inert=["C"], title="Two")
    assert schema.to_yaml() == (
        "name: S\ntitle: Two\nlevers: [A, B, C]\nedges:\n  A:\n    B: {strength: 0.5}\n"
        "    door: {}\n  B: [door]\ngates:\n  door: {at_least: 2}\ninert: [C]\n"
    )


@pytest.mark.parametrize(
    ("short", "long"),
    [
        ("{L0: {L1: 1}, L1: {door: {}}}", "{L0: [L1], L1: [door]}"),
        ("{L0: {L1: 0.5}, L1: [door]}", "{L0: {L1: {strength: 0.5}}, L1: {door: {}}}"),
        (
            "{L0: [L1], L1: [door]}  # !\r\ngates: {L1: ANY, door: All}\n...",
            "{L0: [L1], L1: [door]}\ngates: {door: all}",
        ),
    ],
)
def test_what_may_be_written_in_two_ways(short, long):
    one, other = (f"name: X\nlevers: [L0, L1]\nedges: {edges}" for edges in (short, long))
    assert import_schema(f"\ufeff---\n{one}", "yaml") == import_schema(other, "yaml")


def test_a_schema_is_found_beside_the_file_that_names_it_before_the_bundled_ones(
    tmp_path, monkeypatch
):
    own = schema("own: A -> door", name="CC3")
    assert find_schema("CC3", beside=[tmp_path]) == bundled_schemas()["CC3"]
    write_schema(own, tmp_path / "schemas" / "CC3.yaml")
    write_schema(own, path := tmp_path / "other.GV")
    for name in ("CC3", "schemas/CC3.yaml", Path("other.GV"), own, own.to_text(), own.as_dict()):
        assert find_schema(name, beside=[tmp_path]) == own
    assert find_schema("CC3") == bundled_schemas()["CC3"]
    room = gymnasium.make("causal_openlock/OpenLock-v0", schema=str(path)).unwrapped
    assert room.settings.schema == find_condition(["CE3", path]).schemas[-1] == own
    monkeypatch.chdir(tmp_path)
    assert ol.schema("CC3") == ol.schema("other.GV") == own

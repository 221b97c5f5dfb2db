"""Schemas declared in a line of text, as a graph of networkx or as edges, equal those of files.

That any schema survives as a line of text is tested with the other formats.
"""

from pathlib import Path

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import causal_openlock as ol
from causal_openlock.errors import SchemaError
from causal_openlock.schemas.declared import schema
from causal_openlock.schemas.one_line import parse_line
from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.schemas.schema_file import parse_schema, schema_from_dict
from causal_openlock.testing import schemas

# Lines of text, and the schema files that declare the same.
SAME = {
    "A -> B, C; B | C -> door": "levers: [A, B, C]\nedges: {A: [B, C], B: [door], C: [door]}",
    "A -> B, C -> door": "levers: [A, B, C]\nedges: {A: [B, C], B: [door], C: [door]}",
    "A -> door\n\nB -> door  # either\n": "levers: [A, B]\nedges: {A: [door], B: [door]}",
    "A & B -> door": "levers: [A, B]\nedges: {A: [door], B: [door]}\ngates: {door: all}",
    "2 of (A, B (.5), C) -> D -> door": (
        "levers: [A, B, C, D]\nedges: {A: [D], B: {D: {strength: 0.5}}, C: [D], D: [door]}\n"
        "gates: {D: {at_least: 2}}"
    ),
    "all of (A) -> B (8e-1), C; any of (B, C) -> door": (
        "levers: [A, B, C]\nedges: {A: {B: {strength: 0.8}, C: {}}, B: [door], C: [door]}\n"
        "gates: {B: all, C: all}"
    ),
    "B, A, inert; A -> B -> door; inert inert": (
        "levers: [B, A, inert]\nedges: {A: [B], B: [door]}\ninert: [inert]"
    ),
}


@pytest.mark.parametrize(("text", "file"), SAME.items())
def test_a_line_of_text_is_what_the_file_is(text, file):
    assert schema(text) == parse_schema(f"name: schema\n{file}")


def test_a_line_can_have_a_name_and_a_title():
    found = schema('safe "A \\"safe\\": two\\nlines": A -> door')
    assert (found.name, found.title) == ("safe", 'A "safe": two\nlines')
    assert schema("safe: A -> door", name="vault").name == "vault"
    assert schema("A -> door").name == "schema"


@pytest.mark.parametrize(
    "text",
    [
        "A -0.8-> door",  # a strength stands in brackets
        "A -> B; B & -> door",
        "A -> B C -> door",
        "C -> door; A & B -> door",  # all causes stand in one statement
        "A -> B (0.8) -> door",
        "A (0.5) -> door (0.5)",
        "A -> B & C; B -> door",
        "A -> door; A -> door",
        "2 of (A, B -> door",
        "2.5 of (A, B) -> door",
        "5 of (A, B) -> door",
        "A -> door; B",  # levers that are listed are all of them
        "A, B; A, B; A -> door",
        "A -> door; inert B (0.5)",
        "A -> door -> B",
        'x "\\q": A -> door',
        "A ->",
    ],
)
def test_a_doubtful_line_is_refused(text):
    with pytest.raises(SchemaError, match=r"^column \d+ of this schema: [^\n]+$"):
        schema(text)


PIECES = ["A", "B", "door", "->", ",", "|", "&", ";", "\n", "(", ")", "2", ".5", "9" * 5000, "of",
          "all", "inert", ":", '"x"', "#", "-", "1e999", "ü"]  # fmt: skip


@settings(max_examples=300, deadline=None)
@given(st.lists(st.sampled_from(PIECES), max_size=14))
def test_any_line_is_a_schema_or_refused(pieces):
    try:
        found = parse_line(" ".join(pieces))
    except SchemaError:
        return
    assert parse_line(found.to_text()) == found


@settings(max_examples=60, deadline=None)
@given(drawn=schemas(max_levers=8, stochastic=True))
def test_any_schema_comes_back_from_a_graph_and_from_edges(drawn):
    gates = {node: drawn.gate(node) for node in [*drawn.levers, DOOR] if drawn.causes(node)}
    assert schema(nx.DiGraph(drawn.graph), inert=drawn.inert) == drawn
    strengths = {(a, b): p for a, b, p in drawn.graph.edges(data="strength")}
    ordered = nx.DiGraph()
    ordered.add_nodes_from(drawn.levers)
    ordered.add_edges_from(strengths)
    again = schema(ordered, gates=gates, strengths=strengths, inert=drawn.inert, name=drawn.name)
    assert again == drawn


def test_edges_are_pairs_or_mappings():
    expected = Schema("schema", ["A", "B"], {"A": {"B": 0.5}, "B": ["door"]})
    for edges in (
        [("A", "B", 0.5), ("B", "door")],
        {"A": {"B": 0.5}, "B": "door"},
        nx.DiGraph({"A": {"B": {"strength": 0.5}}, "B": {"door": {}}}),
    ):
        assert schema(edges) == expected
    both = schema([("A", "door"), ("B", "door")], gates={"door": "at_least 2"})
    assert both.gate(DOOR) == Gate("at_least", 2)


def test_what_a_schema_file_holds_is_a_schema_in_python_too():
    data = {"name": "one", "levers": ["B", "A"], "edges": {"A": ["door"], "B": ["A"]}}
    assert schema(data) == schema_from_dict(data)
    assert schema(data).levers == ("B", "A")
    edges = {"A": {"door": {"strength": np.float32(0.5)}}, "B": np.array(["A"])}
    found = schema({"name": "one", "levers": np.array(["B", "A"]), "edges": edges})
    assert found == Schema("one", "BA", {"A": {"door": 0.5}, "B": ["A"]})


def test_files_are_found_by_name_or_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    own = schema("own: A -> door")
    Path("own.yaml").write_text(own.to_yaml())
    Path("other.txt").write_text(own.to_text())
    assert ol.schema("own") == ol.schema("own.yaml") == ol.schema(Path("other.txt")) == own
    assert ol.schema(own) is own

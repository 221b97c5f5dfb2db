"""Schemas declared in a line of text, as a graph of networkx or as edges, equal those of files.

That any schema survives as a line of text is tested with the other formats.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import networkx as nx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import causal_openlock as ol
from causal_openlock.errors import OpenLockError, SchemaError
from causal_openlock.schemas.declared import schema
from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.schemas.one_line import parse_line
from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.schemas.schema_file import parse_schema
from causal_openlock.testing import schemas

BUNDLED = bundled_schemas()

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
# What is wrong, the column, and what is said of it.
FAULTS = {
    "A -> B, C; B | C -> dor": (21, "for dor, did you mean door?"),
    "left -> door; rihgt -> door; right, left": (15, "'rihgt' is unknown here; did you mean right"),
    "A -0.8-> door": (3, "a strength stands in brackets, as in A (0.8) -> B"),
    "A -> B; B & -> door": (13, "'->' cannot come here; possible: a lever, the door, or '2 of ('"),
    "A -> B C -> door": (8, "'C' cannot come here; possible: '->', ',', '|', '&', a strength"),
    "A & B -> door; C -> door": (21, "name all its causes in one"),
    "C -> door; A & B -> door": (21, "name all its causes in one"),
    "A | B & C -> door": (7, "'&' follows '|'"),
    "A -> B (0.8) -> door": (6, "write two statements"),
    "A (0.5) -> door (0.5)": (12, "the strength of A -> door is given twice"),
    "A -> B & C; B -> door": (6, "effects are separated by ','"),
    "A -> door; A -> door": (17, "the edge A -> door is given twice"),
    "A -> B (1.8); B -> door": (6, "must be above 0 and at most 1"),
    "A -> B; B -> A, door": (6, "A -> B -> A is a cycle"),
    "2 of (A, B -> door": (12, "possible: ',' or ')'"),
    "2.5 of (A, B) -> door": (1, "write any, all or a whole number"),
    "5 of (A, B) -> door": (7, "can never hold"),
    "A -> door; B": (1, "'A' is unknown here; known: B"),
    "A -> door; inert B, C, B": (None, "lever B is listed twice"),
    "A -> door; inert B (0.5)": (18, "without strengths"),
    "A -> door; inert B | C": (20, "'|' cannot come here"),
    "A (x) -> door": (4, "possible: a strength such as 0.8"),
    "A -> door -> B": (14, "the door is an effect"),
    'x "\\q": A -> door': (3, "the title is not a JSON string"),
    "x 'y': A -> door": (3, "cannot come here"),
    "A, B; A, B; A -> door": (7, "all levers are listed already"),
    "A ->": (5, "the end cannot come here"),
    "A -> door; B | C; 2 ->": (17, "possible: '->' and what these enable"),
}


@pytest.mark.parametrize(("text", "file"), SAME.items())
def test_a_line_of_text_is_what_the_file_is(text: str, file: str) -> None:
    assert schema(text) == parse_schema(f"name: schema\n{file}")


def test_a_line_can_have_a_name_and_a_title() -> None:
    found = schema('safe "A \\"safe\\": two\\nlines": A -> door')
    assert (found.name, found.title) == ("safe", 'A "safe": two\nlines')
    assert schema("safe: A -> door", name="vault").name == "vault"
    assert schema("A -> door").name == "schema"


@pytest.mark.parametrize("text", FAULTS)
def test_a_fault_is_one_sentence_with_its_column(text: str) -> None:
    column, words = FAULTS[text]
    with pytest.raises(SchemaError) as caught:
        schema(text)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    if column:
        assert str(caught.value).startswith(f"column {column} of this schema: ")


def test_of_several_lines_the_line_is_named_too() -> None:
    with pytest.raises(SchemaError, match=r"^line 2, column 6 of this schema: a new line cannot"):
        schema("A -> door\nB -> \nC -> door")


PIECES = ["A", "B", "door", "->", ",", "|", "&", ";", "\n", "(", ")", "2", ".5", "9" * 5000, "of",
          "all", "inert", ":", '"x"', "#", "-", "1e999", "ü"]  # fmt: skip


@settings(max_examples=400, deadline=None)
@given(st.lists(st.sampled_from(PIECES), max_size=14))
def test_any_text_is_a_schema_or_has_a_fault_with_a_place(pieces: list[str]) -> None:
    found, said = None, ""
    try:
        found = parse_line(" ".join(pieces))
    except SchemaError as error:
        said = str(error)
    if found is None:
        assert re.match(r"(line \d+, )?column \d+ of this schema: [^\n]+$", said), said
    else:
        assert parse_line(found.to_text()) == found


@settings(max_examples=60, deadline=None)
@given(drawn=schemas(max_levers=8, stochastic=True))
def test_any_schema_comes_back_from_text_yaml_graph_and_edges(drawn: Schema) -> None:
    assert schema(drawn.to_text()) == drawn
    assert parse_schema(drawn.to_yaml()) == drawn
    gates = {node: drawn.gate(node) for node in [*drawn.levers, DOOR] if drawn.causes(node)}
    graph = nx.DiGraph(drawn.graph)
    assert schema(graph, inert=drawn.inert) == drawn
    strengths = {(a, b): p for a, b, p in drawn.graph.edges(data="strength")}
    ordered = nx.DiGraph()
    ordered.add_nodes_from(drawn.levers)
    ordered.add_edges_from(strengths)
    again = schema(ordered, gates=gates, strengths=strengths, inert=drawn.inert, name=drawn.name)
    assert again == drawn
    pairs = [(*edge, p) for edge, p in strengths.items()]
    if not drawn.inert:
        assert {*schema(pairs, gates=gates).graph.edges} == {*drawn.graph.edges}


@pytest.mark.parametrize("name", BUNDLED)
def test_a_bundled_schema_is_its_line(name: str) -> None:
    assert schema(BUNDLED[name].to_text()) == schema(name) == BUNDLED[name]


def test_edges_are_pairs_or_mappings() -> None:
    expected = Schema("schema", ["A", "B"], {"A": {"B": 0.5}, "B": ["door"]})
    for edges in (
        [("A", "B", 0.5), ("B", "door")],
        {"A": {"B": 0.5}, "B": "door"},
        nx.DiGraph({"A": {"B": {"strength": 0.5}}, "B": {"door": {}}}),
    ):
        assert schema(edges) == expected
    both = schema([("A", "door"), ("B", "door")], gates={"door": "at_least 2"})
    assert both.gate(DOOR) == Gate("at_least", 2)


def test_files_are_found_by_name_or_path(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    own = schema("own: A -> door")
    Path("own.yaml").write_text(own.to_yaml())
    Path("other.txt").write_text(own.to_text())
    assert ol.schema("own") == ol.schema("own.yaml") == ol.schema(Path("other.txt")) == own
    assert ol.schema(own) is own


@pytest.mark.parametrize(
    ("source", "options", "words"),
    [
        (5, {}, "5 is not an edge"),
        ([("A", "B", "C", "D")], {}, "is not an edge"),
        ([("A", "door"), ("A", "door")], {}, "listed twice"),
        ({"A": 5}, {}, "is not an edge"),
        ({"A": ["B"]}, {}, "this declared graph has no node named door"),
        ({}, {}, "a schema has at least one edge; declare the schema with a text"),
        ({"A": []}, {}, "a schema has at least one edge"),
        (nx.Graph([("A", "door")]), {}, "declare it directed"),
        (nx.DiGraph([(1, "door")]), {}, "write it in quotes"),
        ("CC5", {}, "did you mean CC4?"),
        ("CC4", {"gates": {"door": "all"}}, "go with a graph or edges"),
        ("A -> door", {"inert": ["B"]}, "a text has them in it"),
        ([("A", "door")], {"gates": {"dor": "all"}}, "did you mean door?"),
        ([("A", "door")], {"gates": {"door": "al"}}, "a gate is any, all or"),
        ([("A", "door")], {"strengths": {("A", "dor"): 0.5}}, "did you mean A -> door?"),
        ([("A", "door")], {"strengths": {("A", "door"): 2}}, "less than or equal to 1"),
        ([("A", "door")], {"inert": ["A"]}, "cannot be inert"),
        ([("A", "door")], {"name": "1"}, "a letter, then letters"),
    ],
)
def test_what_is_no_schema_is_refused(source: Any, options: dict[str, Any], words: str) -> None:
    with pytest.raises(OpenLockError) as caught:
        schema(source, **options)
    assert words in str(caught.value)

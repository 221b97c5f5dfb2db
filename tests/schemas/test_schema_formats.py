"""Schemas in other programs' formats, and the Bayesian network of one push per lever."""

import json
import sys
from itertools import product

import networkx as nx
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from causal_openlock.errors import OpenLockError
from causal_openlock.schemas.bayes_net import to_bayesian_network
from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.schemas.graphs import (
    FORMATS,
    export_schema,
    import_schema,
    read_schema,
    write_schema,
)
from causal_openlock.schemas.schema import DOOR, Gate, Schema, schema_from_dict
from causal_openlock.testing import schemas
from oracle import Rules

BUNDLED = bundled_schemas()
READABLE = [name for name, format in FORMATS.items() if format.read]
TITLES = st.text(st.characters(exclude_categories=["C", "Zl", "Zp"]), max_size=20)

# A schema in which everything is said that a schema can say, in words that formats have as well.
FULL = Schema(
    "on",
    ["edge", "null", "e1", "node", "subgraph", "NaN", "true"],
    {
        "null": {"edge": 0.5, "node": 1.0, "e1": 1.0, "NaN": 1.0, "true": 1.0},
        "edge": {"subgraph": 1 / 3},
        "subgraph": {DOOR: 1.0},
        "e1": {"edge": 1e-7, DOOR: 0.25},
    },
    gates={"edge": Gate("all"), DOOR: Gate("at_least", 2)},
    inert=["NaN", "node", "true"],
    title='A "quoted" & \\odd\\ title; 100% [x] {y} -> #1 // ü 因果 \\',
)


def without_title(schema):
    return schema_from_dict({**schema.as_dict(), "title": ""})


@pytest.mark.parametrize("format", READABLE)
@settings(max_examples=40, deadline=None)
@given(
    schema=schemas(max_levers=8, stochastic=True, titles=TITLES)
    | st.sampled_from([*BUNDLED.values()])
)
@example(schema=FULL)
@example(schema=Schema("a", ["L0"], {"L0": [DOOR]}, title="()"))
@example(schema=Schema("a", ["L0"], {"L0": [DOOR]}, title='two\nlines & "1" &amp;'))
def test_any_schema_survives_every_readable_format(schema, format):
    schema = without_title(schema) if format == "line" else schema
    back = import_schema(export_schema(schema, format), format)
    assert back == schema
    assert back.as_dict() == schema.as_dict()
    assert schema_from_dict(schema.as_dict()) == schema


@pytest.mark.parametrize("format", FORMATS)
def test_files_are_known_by_their_suffix(tmp_path, format):
    schema = without_title(BUNDLED["two_keys"])
    for suffix in FORMATS[format].suffixes:
        path = tmp_path / f"lock{suffix}"
        path.write_bytes(b"\0what was there")
        write_schema(schema, path)
        assert path.read_text(encoding="utf-8") == export_schema(schema, format)
        if FORMATS[format].read:
            assert read_schema(path) == schema
            other = path.rename(path.with_suffix(".other"))
            assert read_schema(other, format) == schema


def test_a_graph_from_elsewhere_gets_the_defaults(tmp_path):
    graph = nx.DiGraph([("A", "B"), ("B", DOOR)])
    expected = Schema("my_lock", ["A", "B"], {"A": ["B"], "B": [DOOR]})
    texts = {
        "node-link": json.dumps(nx.node_link_data(graph, edges="links")),
        "gml": "\n".join(nx.generate_gml(graph)),
        "graphml": "\n".join(nx.generate_graphml(graph)),
        "dot": "digraph { A -> B -> door }",
        "dagitty": "dag{A->B door<-B}",
    }
    for format, text in texts.items():
        path = tmp_path / f"my-lock{FORMATS[format].suffixes[0]}"
        path.write_text(text)
        assert read_schema(path) == expected, format
    named = (  # as igraph writes it
        'graph [ directed 1 node [ id 0 name "A" ] node [ id 1 name "B" ] node [ id 2 name "door" ]'
        " edge [ source 0 target 1 ] edge [ source 1 target 2 strength 1.0e0 ] ]"
    )
    assert import_schema(named, "gml", "my_lock") == expected


def test_edges_that_are_drawn_backwards_are_turned():
    expected = {("bolt", "wheel"), ("wheel", "door"), ("bolt", "door")}
    gml = """graph [ directed 1
      node [ id 5 label "wheel" ] node [ id 6 label "bolt" ] node [ id 7 label "door" ]
      edge [ source 5 target 6 graphics [ type "line" arrow "first" ] ]
      edge [ source 5 target 7 graphics [ arrow "last" ] ]
      edge [ source 6 target 7 ] ]"""
    dot = """strict digraph "safe" { # comment
      wheel -> bolt [dir=back, style=dashed]; edge [color=red]; wheel -> door:n;
      node [shape=box]; bolt:e -> door [URL="http://x/#y"] }"""
    assert {*import_schema(gml, "gml").graph.edges} == expected
    assert {*import_schema(dot, "dot").graph.edges} == expected


def test_without_pydot_dot_is_written_and_not_read(monkeypatch):
    monkeypatch.setitem(sys.modules, "pydot", None)
    with pytest.raises(OpenLockError, match=r"causal-openlock\[dot\]"):
        import_schema(export_schema(FULL, "dot"), "dot")


def test_defaults_of_a_graph_hold_for_what_follows():
    dot = """digraph { A; node [gate=all]; edge [strength=.5]; A -> B; A -> door [strength=.25]
      graph [title="T &amp; \\"t\\""]; edge [strength=1]; B -> door; B [color=red] }"""
    found = import_schema(dot, "dot")
    assert found.graph.edges["A", "B"]["strength"] == 0.5
    assert found.graph.edges["A", "door"]["strength"] == 0.25
    assert found.graph.edges["B", "door"]["strength"] == 1.0
    graphml = """<graphml xmlns="http://graphml.graphdrawing.org/xmlns">
      <key id="s" for="edge" attr.name="strength" attr.type="double"><default>0.5</default></key>
      <graph edgedefault="directed"><node id="A"/><node id="B"/><node id="door"/>
      <edge source="A" target="B"/><edge source="B" target="door"><data key="s">1</data></edge>
      </graph></graphml>"""
    assert import_schema(graphml, "graphml").strengths("B") == (0.5,)
    assert import_schema(graphml, "graphml").strengths("door") == (1.0,)
    assert (found.title, found.gate("door")) == ('T & "t"', Gate("all"))


def test_dagitty_as_its_web_page_writes_it():
    schema = import_schema(
        """dag {
        bb="-2.4,-2,2.2,2"
        Open [outcome,pos="1.4,1.621"]
        Key [exposure,pos="-2.200,1.597"]
        Lever [pos="-0.300,-0.082"]
        Key -> Lever [pos="-0.791,-1.045",beta="0.3"]
        Open <- Lever
        }""",
        "dagitty",
    )
    assert schema == Schema("imported", ["Key", "Lever"], {"Key": {"Lever": 0.3}, "Lever": [DOOR]})
    text = export_schema(BUNDLED["noisy_CC3"], "dagitty")
    for word in ('"L0" [exposure]', '"door" [outcome', '"L0" -> "L1" [beta="0.8"]'):
        assert word in text


def chance_of_the_door(rules, do):
    """P(door opens), summed over what each lever does, causes before effects."""
    order, total = [], 0.0
    while len(order) < len(rules.levers):
        order += [x for x in rules.levers if x not in order and set(rules.causes[x]) <= set(order)]
    for moves in product((0, 1), repeat=len(order)):
        moved = {lever for lever, yes in zip(order, moves, strict=True) if yes}
        weight = rules.chance(DOOR, moved)
        for lever, yes in zip(order, moves, strict=True):
            chance = do[lever] if lever in do else rules.chance(lever, moved)
            weight *= chance if yes else 1 - chance
        total += weight
    return total


def chance_by_network(schema, do):
    from pgmpy.inference import VariableElimination

    network = to_bayesian_network(schema)
    assert network.check_model()
    cut = network.do(list(do)) if do else network
    answer = VariableElimination(cut).query([DOOR], evidence=do, show_progress=False)
    return float(answer.get_value(**{DOOR: 1}))


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_interventions_on_any_schema(data):
    drawn = schemas(max_levers=4, stochastic=True) | st.sampled_from([*BUNDLED.values(), FULL])
    schema = data.draw(drawn)
    do = data.draw(st.dictionaries(st.sampled_from(schema.levers), st.integers(0, 1)))
    expected = chance_of_the_door(Rules.of(schema), do)
    assert chance_by_network(schema, do) == pytest.approx(expected, abs=1e-9)

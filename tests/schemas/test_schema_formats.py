"""Schemas in other programs' formats, and the Bayesian network of one push per lever."""

from __future__ import annotations

import contextlib
import json
from itertools import product
from pathlib import Path
from typing import Any

import gymnasium
import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from causal_openlock.errors import OpenLockError, SchemaError
from causal_openlock.experiment.building import make_experiment
from causal_openlock.experiment.protocol import Condition
from causal_openlock.schemas.declared import schema
from causal_openlock.schemas.finding import bundled_schemas, find_schema
from causal_openlock.schemas.graphs import (
    FORMATS,
    export_schema,
    import_schema,
    read_schema,
    to_bayesian_network,
    write_schema,
)
from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.schemas.schema_file import schema_from_dict
from causal_openlock.testing import schemas

BUNDLED = bundled_schemas()
READABLE = [name for name, format in FORMATS.items() if format.read]
GRAPHS = [name for name in READABLE if name != "yaml"]
TITLES = st.text(st.characters(exclude_categories=["C", "Zl", "Zp"]), max_size=20)

# A schema in which everything is said that a schema can say.
FULL = Schema(
    "full",
    ["edge", "L2", "L10", "node", "subgraph", "L3"],
    {
        "L2": {"edge": 0.5, "node": 1.0, "L10": 1.0, "L3": 1.0},
        "edge": {"subgraph": 1 / 3},
        "subgraph": {DOOR: 1.0},
        "L10": {"edge": 1e-7, DOOR: 0.25},
    },
    gates={"edge": Gate("all"), DOOR: Gate("at_least", 2)},
    inert=["L3", "node"],
    title='A "quoted" & \\odd\\ title; 100% [x] {y} -> #1 // ü 因果 \\',
)


def ids(schema: Schema) -> str:
    return schema.name


# -- there and back -------------------------------------------------------------------------------


@pytest.mark.parametrize("format", READABLE)
@pytest.mark.parametrize("schema", [*BUNDLED.values(), FULL], ids=ids)
def test_a_schema_survives_every_readable_format(schema: Schema, format: str) -> None:
    back = import_schema(export_schema(schema, format), format)
    assert back == schema
    assert back.as_dict() == schema.as_dict()


@pytest.mark.parametrize("format", READABLE)
@settings(max_examples=40, deadline=None)
@given(schema=schemas(max_levers=8, stochastic=True, titles=TITLES))
def test_any_schema_survives(schema: Schema, format: str) -> None:
    assert import_schema(export_schema(schema, format), format) == schema


@pytest.mark.parametrize("title", ["()", "[]", "two\nlines", "1", "true", " ", "\\", '"', "&amp;"])
@pytest.mark.parametrize("format", GRAPHS)
def test_a_title_that_means_something_to_a_format_survives(title: str, format: str) -> None:
    schema = Schema("a", ["L0"], {"L0": [DOOR]}, title=title)
    assert import_schema(export_schema(schema, format), format).title == title


def test_networkx_itself_reads_what_is_written() -> None:
    schema = BUNDLED["seven"]
    data = json.loads(export_schema(schema, "node-link"))
    for graph in (
        nx.node_link_graph(data, edges="edges"),
        nx.parse_gml(export_schema(schema, "gml")),
    ):
        assert set(graph.edges) == set(schema.graph.edges)
        assert graph.nodes["L2"]["gate"] == "all"
        assert graph.edges["L0", "L2"]["strength"] == 1.0


@pytest.mark.parametrize("format", FORMATS)
def test_files_are_known_by_their_suffix(tmp_path, format: str) -> None:
    schema = BUNDLED["two_keys"]
    for suffix in FORMATS[format].suffixes:
        path = tmp_path / f"lock{suffix}"
        write_schema(schema, path)
        assert path.read_text(encoding="utf-8") == export_schema(schema, format)
        if FORMATS[format].read:
            assert read_schema(path) == schema
            other = path.rename(path.with_suffix(".txt"))
            assert read_schema(other, format) == schema


# -- files from elsewhere -------------------------------------------------------------------------


def test_a_graph_from_elsewhere_gets_the_defaults(tmp_path) -> None:
    graph = nx.DiGraph([("A", "B"), ("B", DOOR)])
    expected = Schema("my_lock", ["A", "B"], {"A": ["B"], "B": [DOOR]})
    texts = {
        ".json": json.dumps(nx.node_link_data(graph)),
        ".gml": "\n".join(nx.generate_gml(graph)),
        ".dot": "digraph { A -> B -> door }",
        ".dagitty": "dag{A->B door<-B}",
    }
    for suffix, text in texts.items():
        path = tmp_path / f"my-lock{suffix}"
        path.write_text(text)
        assert read_schema(path) == expected, suffix
    links = nx.node_link_data(graph, edges="links")
    assert import_schema(json.dumps(links), "node-link", "my_lock") == expected


def test_dot_as_people_write_it() -> None:
    schema = import_schema(
        """# a comment
        strict digraph lock { // another
            rankdir=LR; graph [title="Two &amp; \\"two\\""] /* and
            another */ edge [strength=0.5]
            node [color=red]; L1; L0 [shape=box, color="blue"; width=.5]
            subgraph cluster_a { node [gate=all]; L2; }
            {L0 L1} -> L2:n -> door [strength=.25]
            L0 -> door
        }""",
        "dot",
    )
    assert schema == Schema(
        "lock",
        ["L1", "L0", "L2"],
        {"L0": {"L2": 0.25, DOOR: 0.5}, "L1": {"L2": 0.25}, "L2": {DOOR: 0.25}},
        gates={"L2": Gate("all")},
        title='Two & "two"',
    )


def test_dagitty_as_its_web_page_writes_it() -> None:
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


def test_dagitty_says_what_its_own_grammar_has_a_word_for() -> None:
    text = export_schema(BUNDLED["noisy_CC3"], "dagitty")
    assert '"L0" [exposure]' in text
    assert '"door" [outcome' in text
    assert '"L0" -> "L1" [beta="0.8"]' in text


# -- what cannot be read --------------------------------------------------------------------------

EMPTY = {"directed": True, "multigraph": False, "graph": {}, "nodes": [], "edges": []}


def link(nodes, edges, **more) -> str:
    data = {"nodes": [{"id": node} for node in nodes]}
    data["edges"] = [{"source": cause, "target": effect} for cause, effect in edges]
    return json.dumps(EMPTY | data | more)


@pytest.mark.parametrize(
    ("format", "text", "says"),
    [
        ("node-link", "garbage", "node-link .*json.dumps"),
        ("node-link", "[1, 2]", "node-link .*json.dumps"),
        ("node-link", "3", "node-link .*json.dumps"),
        ("node-link", "[" * 100_000, "node-link .*json.dumps"),
        ("node-link", "{}", "key 'nodes' is missing"),
        ("node-link", '{"nodes": [{}], "edges": [{"source": 1}]}', "node-link"),
        ("node-link", json.dumps(EMPTY), "no node named door"),
        ("node-link", link(["A", "Door"], [("A", "Door")]), "did you mean Door"),
        ("node-link", link(["A", DOOR], [("A", DOOR)], directed=False), "directed"),
        ("node-link", link(["A", DOOR], [("A", DOOR)], multigraph=True), "each edge once"),
        ("node-link", link(["A", DOOR], []), "nothing unlocks the door"),
        ("node-link", link([1, DOOR], [(1, DOOR)]), "node-link .*string"),
        ("node-link", link(["A", "B", DOOR], [("A", DOOR)]), "on no path to the door"),
        ("node-link", link(["A", "B", DOOR], [("A", "B"), ("B", "A"), ("A", DOOR)]), "cycle"),
        ("node-link", link(["A", DOOR], [("A", DOOR)], graph={"levers": ["B"]}), "lacks the node"),
        ("node-link", link(["A", DOOR], [("A", DOOR)], graph={"levers": 3}), "node-link"),
        ("node-link", link(["A", DOOR], [("A", DOOR)], graph={"name": "a b"}), "name"),
        ("gml", "garbage", "gml .*write_gml"),
        ("gml", "graph [ directed 1 node [ id 0 ] ]", "gml .*label"),
        ("gml", 'graph [ node [ id 0 label "door" ] ]', "gml .*directed"),
        ("gml", 'graph [ directed 1 node [ id 0 label "A" ] ]', "gml .*no node named door"),
        ("dot", "garbage", "line 1 of this dot text.*digraph"),
        ("dot", "", "line 1 of this dot text.*digraph"),
        ("dot", "graph { A -- door }", "digraph"),
        ("dot", "digraph {\n A -- door }", "line 2 of this dot text.*cause -> effect"),
        ("dot", "digraph {\n A -> door", "end of the text"),
        ("dot", "digraph { A -> }", "name is needed"),
        ("dot", "digraph { A -> door } B", "comes after the graph"),
        ("dot", "digraph { A -> door [strength] }", "dot .*strength"),
        ("dot", "digraph { A -> door [strength=lots] }", "dot .*strength"),
        ("dot", "digraph { A -> door [strength=2] }", "dot .*strength"),
        ("dot", "digraph { A -> door [strength=NaN] }", "dot .*strength"),
        ("dot", "digraph { A -> door A -> door }", "listed twice"),
        ("dot", "digraph { A -> B -> A -> door }", "cycle"),
        ("dot", "digraph { A -> door; door [gate=some] }", "dot .*gate"),
        ("dot", 'digraph { A -> door; door [gate="at_least 2"] }', "dot .*gate of door"),
        ("dot", "digraph { A [label=<b>] -> door }", "cannot make sense"),
        ("dot", "digraph " + "{" * 2000, "nested deeper"),
        ("dagitty", "mag { A -> door }", "dagitty .*dag {"),
        ("dagitty", "dag { A <-> door }", "dagitty .*cause -> effect"),
        ("dagitty", "dag { A -> B }", "dagitty .*no node named door"),
        ("dagitty", "dag { A -> door [beta=-0.4] }", "dagitty .*strength"),
        ("dagitty", "dag { A -> B B -> A A -> door }", "cycle"),
        ("yaml", "garbage", "must hold keys"),
        ("yaml", "name: a", "missing"),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(format: str, text: str, says: str) -> None:
    with pytest.raises(OpenLockError, match=rf"(?s){says}") as raised:
        import_schema(text, format)
    if format != "yaml":
        assert isinstance(raised.value, SchemaError)
        assert all(format in line for line in str(raised.value).splitlines())
        assert raised.value.__cause__ is None
        assert len(str(raised.value)) < 400


@pytest.mark.parametrize("format", GRAPHS)
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_damaged_text_never_gives_a_traceback(format: str, data: st.DataObject) -> None:
    text = export_schema(FULL, format)
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(len(text), start + 30)))
    damaged = (
        text[:start] + data.draw(st.text(max_size=5) | st.sampled_from("{}[]\"'=0")) + text[end:]
    )
    with contextlib.suppress(OpenLockError):
        import_schema(damaged, format)


def test_unknown_formats_name_the_nearest(tmp_path) -> None:
    schema = BUNDLED["CC3"]
    with pytest.raises(OpenLockError, match="did you mean dagitty"):
        export_schema(schema, "dagity")
    with pytest.raises(OpenLockError, match="did you mean node-link"):
        import_schema("", "nodelink")
    with pytest.raises(OpenLockError, match=r"suffix '\.gmll'.*did you mean \.gml"):
        write_schema(schema, tmp_path / "a.gmll")
    with pytest.raises(OpenLockError, match=r"bif can only be written.*node-link"):
        import_schema(export_schema(schema, "bif"), "bif")
    assert not list(tmp_path.iterdir())


def test_a_file_that_cannot_be_read_is_named(tmp_path) -> None:
    with pytest.raises(OpenLockError, match=r"none\.gml: cannot be read"):
        read_schema(tmp_path / "none.gml")
    (tmp_path / "bad.dot").write_text("digraph {")
    with pytest.raises(SchemaError, match=r"bad\.dot: line 1"):
        read_schema(tmp_path / "bad.dot")
    (tmp_path / "bytes.dot").write_bytes(b"\xff\xfe")
    with pytest.raises(OpenLockError, match="UTF-8"):
        read_schema(tmp_path / "bytes.dot")
    with pytest.raises(SchemaError, match="more than the"):
        import_schema(" " * 300_000, "dot")


# -- the Bayesian network -------------------------------------------------------------------------


def chance_by_hand(schema: Schema, do: dict[str, int], push: float) -> float:
    """P(door opens), summed over every outcome of every push and of every edge on its own."""
    order = [node for node in nx.topological_sort(schema.graph) if node not in do]
    edges = [edge for edge in schema.graph.edges if edge[1] in order]
    free = [edge for edge in edges if schema.graph.edges[edge]["strength"] < 1.0]
    pushes = [node for node in order if node != DOOR] if push < 1.0 else []
    total = 0.0
    for luck in product((0, 1), repeat=len(free) + len(pushes)):
        happens = dict(zip([*free, *pushes], luck, strict=True))
        weight = 1.0
        for what, yes in happens.items():
            p = push if isinstance(what, str) else schema.graph.edges[what]["strength"]
            weight *= p if yes else 1 - p
        moved = dict(do)
        for node in order:
            causes = list(schema.graph.predecessors(node))
            through = [cause for cause in causes if moved[cause] and happens.get((cause, node), 1)]
            kind = schema.graph.nodes[node]["gate"].kind
            if not causes:
                enabled = True
            elif kind == "any":
                enabled = bool(through)
            elif kind == "all":
                enabled = through == causes
            else:
                enabled = len(through) >= schema.graph.nodes[node]["gate"].k
            moved[node] = int(enabled and happens.get(node, 1))
        total += weight * moved[DOOR]
    return total


def chance_by_network(schema: Schema, do: dict[str, int], push: float) -> float:
    from pgmpy.inference import VariableElimination

    network = to_bayesian_network(schema, push)
    assert network.check_model()
    cut = network.do(list(do)) if do else network
    answer = VariableElimination(cut).query([DOOR], evidence=do, show_progress=False)
    return float(answer.get_value(**{DOOR: 1}))


@pytest.mark.parametrize("push", [1.0, 0.5])
@pytest.mark.parametrize("schema", BUNDLED.values(), ids=ids)
def test_interventions_on_bundled_schemas(schema: Schema, push: float) -> None:
    levers = schema.levers
    single = [{lever: state} for lever in levers for state in (0, 1)]
    joint = [{levers[0]: 1, levers[1]: 0}, {levers[0]: 1, levers[-1]: 1}]
    for do in [{}, *single, *joint]:
        by_hand = chance_by_hand(schema, do, push)
        assert chance_by_network(schema, do, push) == pytest.approx(by_hand, abs=1e-12), do


@settings(max_examples=40, deadline=None)
@given(data=st.data(), push=st.sampled_from([1.0, 0.7]))
def test_interventions_on_any_schema(data: st.DataObject, push: float) -> None:
    schema = data.draw(schemas(max_levers=4, stochastic=True))
    do = data.draw(st.dictionaries(st.sampled_from(schema.levers), st.integers(0, 1)))
    by_hand = chance_by_hand(schema, do, push)
    assert chance_by_network(schema, do, push) == pytest.approx(by_hand, abs=1e-9)


def test_a_known_noisy_or() -> None:
    # noisy_CC3: L1 and L2 move with 0.8 each; the door opens through each with 0.8.
    assert chance_by_network(BUNDLED["noisy_CC3"], {}, 1.0) == pytest.approx(1 - (1 - 0.64) ** 2)
    assert chance_by_network(BUNDLED["noisy_CC3"], {"L0": 0}, 1.0) == 0.0


@pytest.mark.parametrize("schema", [FULL, BUNDLED["two_of_four"], BUNDLED["noisy_CC3"]], ids=ids)
def test_bif_gives_the_same_tables(schema: Schema) -> None:
    from pgmpy.readwrite import BIFReader

    network = to_bayesian_network(schema)
    back = BIFReader(string=export_schema(schema, "bif")).get_model()
    assert set(back.nodes) == {*schema.levers, DOOR}
    assert set(back.edges) == set(schema.graph.edges)
    for node in network.nodes:
        ours, theirs = network.get_cpds(node), back.get_cpds(node)
        assert ours.variables == theirs.variables
        assert ours.state_names[node] == [0, 1]
        assert theirs.state_names[node] == ["0", "1"]
        np.testing.assert_allclose(theirs.values, ours.values, rtol=0, atol=1e-12)


def test_a_push_probability_is_a_probability() -> None:
    with pytest.raises(OpenLockError, match="from 0 to 1"):
        to_bayesian_network(BUNDLED["CC3"], 1.5)


@pytest.mark.parametrize(
    ("text", "edges"),
    [
        ("digraph { door -> A [dir=back] }", {("A", "door")}),
        ("digraph { edge [dir=back]; door -> A; }", {("A", "door")}),
        (
            "digraph { subgraph s { edge [dir=back]; door -> A; } B -> door }",
            {("A", "door"), ("B", "door")},
        ),
        ("digraph { A -> door [dir=forward, arrowhead=vee] }", {("A", "door")}),
        ("\ufeffdigraph { A -> door }", {("A", "door")}),
    ],
)
def test_dot_says_in_which_direction_an_edge_goes(
    tmp_path: Path, text: str, edges: set[tuple[str, str]]
) -> None:
    path = tmp_path / "one.dot"
    path.write_text(text, encoding="utf-8")
    assert {*read_schema(path).graph.edges} == edges


@pytest.mark.parametrize(
    ("look", "said"),
    [
        ("dir=both", "dir=both"),
        ("dir=none", "dir=none"),
        ("arrowhead=none", "arrowhead=none"),
        ("dir=back, arrowtail=none", "arrowtail=none"),
    ],
)
def test_dot_that_says_no_direction_is_refused(look: str, said: str) -> None:
    with pytest.raises(SchemaError, match=f"line 2 .*an edge with {said} does not say which"):
        import_schema(f"digraph {{\nA -> door [{look}] }}", "dot")


def test_what_a_subgraph_says_of_itself_is_not_of_the_graph() -> None:
    text = 'digraph { A -> door; B -> door; subgraph s { graph [levers="B A"]; A } }'
    assert import_schema(text, "dot").levers == ("A", "B")


NODE_LINK: dict[str, Any] = {
    "nodes": [{"id": "A"}, {"id": "door"}],
    "links": [{"source": "A", "target": "door"}],
}
"""As D3 has it, and as one writes it by hand."""


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"nodes": [{"id": "A"}, {"id": "A"}, {"id": "door"}]}, "node 'A' is there twice"),
        ({"links": [{"source": 0, "target": 1}]}, "name nodes by their place"),
        ({"links": [{"source": "A", "target": "dor"}]}, "'dor' is of no node"),
        ({"graph": [1]}, "attributes of the graph"),
        ({"nodes": [{"name": "A"}]}, "a node has no id"),
        ({"nodes": 3}, "nodes is a list of objects"),
    ],
)
def test_node_link_that_would_be_misread_is_refused(changes: dict[str, Any], said: str) -> None:
    assert import_schema(json.dumps(NODE_LINK), "node-link").levers == ("A",)
    with pytest.raises(SchemaError, match=said):
        import_schema(json.dumps({**NODE_LINK, **changes}), "node-link")


def test_a_key_that_is_there_twice_is_refused() -> None:
    with pytest.raises(SchemaError, match="the key 'links' is there twice"):
        import_schema('{"nodes": [], "links": [], "links": []}', "node-link")


def test_a_number_that_networkx_misreads_is_refused() -> None:
    text = (
        'graph [ directed 1 node [ id 0 label "A" ] node [ id 1 label "door" ]\n'
        "edge [ source 0 target 1 strength {} ] ]"
    )
    with pytest.raises(SchemaError, match=r"line 2 .*1e-1 would be misread; .* such as 0.1"):
        import_schema(text.format("1e-1"), "gml")
    assert import_schema(text.format("1.0e-1"), "gml").strengths("door") == (0.1,)
    named = text.replace("label", "name").format("0.5")  # as igraph writes it
    assert import_schema(named, "gml").levers == ("A",)


def test_synonyms_of_dagitty_and_several_outcomes() -> None:
    assert import_schema("dag { a [source] y [target] a -> y }", "dagitty").levers == ("a",)
    with pytest.raises(SchemaError, match=r"2 outcomes \(y, z\), and a room has one door"):
        import_schema("dag { a y [outcome] z [target] a -> y a -> z }", "dagitty")


def test_what_a_schema_file_holds_is_a_schema_in_python_too(tmp_path: Path) -> None:
    data = {"name": "one", "levers": ["B", "A"], "edges": {"A": ["door"], "B": ["A"]}}
    assert schema(data) == schema_from_dict(data)
    assert schema(data).levers == ("B", "A")
    with pytest.raises(OpenLockError, match="go into the declaration"):
        schema(data, inert=["A"])
    assert schema({**data, "levers": ("B", "A"), "edges": {"A": ("door",), "B": ["A"]}}).levers == (
        "B",
        "A",
    )
    strengths = {"A": {"door": {"strength": np.float32(0.5)}}, "B": np.array(["A"])}
    assert schema({**data, "levers": np.array(["B", "A"]), "edges": strengths}).strengths(
        "door"
    ) == (0.5,)


@pytest.mark.parametrize("digits", ["0x" + "f" * 5000, "1" * 5000, "-" + "9" * 5000])
def test_a_number_of_thousands_of_digits_is_a_sentence(tmp_path: Path, digits: str) -> None:
    path = tmp_path / "one.yaml"
    path.write_text(f"name: one\nlevers: [A]\nedges: {{A: {{door: {{strength: {digits}}}}}}}\n")
    with pytest.raises(OpenLockError, match=r"one\.yaml:3:\d+: this number has 5,00\d digits"):
        read_schema(path)


@pytest.mark.parametrize("suffix", [".dot", ".GV", ".gml", ".dagitty", ".json", ".yml"])
def test_every_format_is_read_wherever_a_schema_is_named(tmp_path: Path, suffix: str) -> None:
    own, path = schema("A -> B; B -> door; C -> door", name="mine"), tmp_path / f"mine{suffix}"
    write_schema(own, path)
    edges = {*own.graph.edges}
    assert {*read_schema(path).graph.edges} == edges
    assert {*find_schema(path.name, [tmp_path]).graph.edges} == edges
    assert {*schema(path).graph.edges} == edges
    room = gymnasium.make("causal_openlock/OpenLock-v0", schema=str(path)).unwrapped
    assert {*room.settings.schema.graph.edges} == edges
    for name in (f"{path}", f"CC3-{path}"):
        found = Condition.named(name, find_schema)
        assert {*found.schemas[-1].graph.edges} == edges
    made = make_experiment([str(path)], ["oracle"], subjects=2)
    assert {*made.conditions[0].schemas[0].graph.edges} == edges


@pytest.mark.parametrize("name", [3, None, ["CC3"]])
def test_what_names_no_schema_is_refused_in_a_sentence(name: Any) -> None:
    with pytest.raises(OpenLockError, match="a schema is given by its name, the path of a file"):
        find_schema(name)
    with pytest.raises(OpenLockError, match="a schema is given by its name"):
        gymnasium.make("causal_openlock/OpenLock-v0", schema=name)

"""Schema files: there and back without loss, what they may say, and where they are looked for."""

import shutil

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from causal_openlock.errors import FileError
from causal_openlock.files.yaml_file import dump_yaml, parse_document, styled
from causal_openlock.schemas.finding import bundled, bundled_schemas, find_schema
from causal_openlock.schemas.graphs import read_schema, write_schema
from causal_openlock.schemas.schema import DOOR, NO_TEXT, Gate, Schema
from causal_openlock.schemas.schema_file import parse_schema, schema_from_dict
from causal_openlock.testing import schemas
from support.places import ROOT

BUNDLED = bundled_schemas()
# Spaces, signs that YAML heeds and line breaks that only Unicode knows, in texts of many lines.
HARD = st.text(
    st.sampled_from("ab  :#'\"\\-\t\xa0\x85\u2028\u2029\u3000,[]{}%@&*!|>?\n\r"), max_size=400
)
TITLES = HARD.filter(lambda title: not NO_TEXT.search(title))
COMMENTED = """\
# A head.
name: X     # the name
title: "Quoted"   # as people say
levers: [L0, L1, L2]   # three

# The edges.
edges:
  L0: [L1, L2]   # frees both
  # Then L1.
  L1: [door]
  L2: [door]
gates: {door: any}
# The end.
"""


@settings(max_examples=60, deadline=None)
@given(schema=schemas(max_levers=12, stochastic=True, titles=TITLES))
def test_any_schema_comes_back_from_its_text_and_its_data(schema):
    back = parse_schema(schema.to_yaml())
    assert back == schema
    assert back.as_dict() == schema.as_dict()
    assert schema_from_dict(schema.as_dict()) == schema


@settings(max_examples=50, deadline=None)
@given(title=HARD | st.lists(st.text("abc", min_size=1)).map("  ".join))
@example(title="  ".join(["five"] * 18))  # longer than a line, with two spaces where it may break
@example(title="a\x85b")
def test_any_text_comes_back_whatever_its_length_and_spaces(title):
    inside = {"conditions": [{"name": title, "train": [title] * 3}]}
    for text in (dump_yaml(inside), dump_yaml(styled(inside))):
        assert parse_document(text).data == inside


@pytest.mark.parametrize("name", ["null", "true", "False", "on", "no", "y", "Inf", "e1", "NaN"])
def test_a_lever_may_be_called_like_a_value_of_yaml(name, tmp_path):
    schema = Schema(name, [name, "L1"], {name: {"L1": 0.5}, "L1": [DOOR]}, title=name)
    write_schema(BUNDLED["CC3"], tmp_path / "x.yaml")
    write_schema(schema, tmp_path / "x.yaml")
    assert read_schema(tmp_path / "x.yaml") == parse_schema(schema.to_yaml()) == schema


def test_a_schema_is_written_as_one_writes_it_by_hand():
    edges = {"A": {"B": 0.5, DOOR: 1.0}, "B": [DOOR]}
    gates = {DOOR: Gate("at_least", 2)}
    schema = Schema("S", ["A", "B", "C"], edges, gates=gates, inert=["C"], title="Two")
    assert schema.to_yaml() == (
        "name: S\ntitle: Two\nlevers: [A, B, C]\nedges:\n  A: {B: {strength: 0.5}, door: {}}\n"
        "  B: [door]\ngates:\n  door: {at_least: 2}\ninert: [C]\n"
    )


@pytest.mark.parametrize(
    ("short", "long"),
    [
        ("edges: {L0: {L1: 1}, L1: {door: {}}}", "edges: {L0: [L1], L1: [door]}"),
        (
            "edges: {L0: {L1: 0.5}, L1: [door]}",
            "edges: {L0: {L1: {strength: 0.5}}, L1: {door: {}}}",
        ),
        (
            "edges: {L0: [L1], L1: [door]}\ngates: {L1: ANY, door: All}\n...",
            "edges: {L0: [L1], L1: [door]}\ngates: {door: all}",
        ),
        ("edges: {L0: [L1], L1: [door]}  # !\r\n", "edges: {L0: [L1], L1: [door]}"),
    ],
)
def test_what_may_be_written_in_two_ways(short, long):
    one, other = (f"name: X\nlevers: [L0, L1]\n{edges}" for edges in (short, long))
    assert parse_schema(f"\ufeff---\n{one}") == parse_schema(other)


# -- written over a file that is there -------------------------------------------------------------


@pytest.mark.parametrize("name", BUNDLED)
def test_writing_what_a_file_says_already_leaves_it_byte_for_byte(name, tmp_path):
    path = tmp_path / f"{name}.yaml"
    shutil.copy(bundled("schemas") / path.name, path)
    before = path.read_bytes()
    write_schema(BUNDLED[name], path)
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("changes", "old", "new"),
    [
        ({"title": "New: é"}, '"Quoted"', "'New: é'"),
        ({"edges": {"L0": ["L1", "L2"], "L1": ["L2", DOOR], "L2": [DOOR]}}, "[door]", "[L2, door]"),
        ({"gates": {DOOR: {"at_least": 2}}}, "any", "{at_least: 2}"),
    ],
)
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_only_what_changed_is_rewritten(changes, old, new, ends, tmp_path):
    path, text = tmp_path / "x.yaml", COMMENTED.replace("\n", ends)
    path.write_bytes(text.encode())
    changed = schema_from_dict({**parse_schema(COMMENTED).as_dict(), **changes})
    write_schema(changed, path)
    assert path.read_bytes().decode() == text.replace(old, new, 1)
    assert read_schema(path) == changed


@settings(max_examples=40, deadline=None)
@given(old=schemas(stochastic=True, titles=TITLES), new=schemas(stochastic=True, titles=TITLES))
@example(  # a space to Python and a letter to YAML
    old=Schema("x", ["A"], {"A": ["door"]}, title="\xa0"),
    new=Schema("x", ["A"], {"A": ["door"]}, title="0"),
)
def test_any_schema_can_be_written_over_any_other(old, new, tmp_path_factory):
    path = tmp_path_factory.mktemp("over") / "x.yaml"
    path.write_text("# Head.\n" + old.to_yaml() + "# Tail.\n", encoding="utf-8")
    write_schema(new, path)
    assert read_schema(path) == new


def test_a_file_with_faults_is_not_overwritten(tmp_path):
    path = tmp_path / "x.yaml"
    path.write_text("name: [my work", encoding="utf-8")
    with pytest.raises(FileError):
        write_schema(BUNDLED["CC3"], path)
    assert path.read_text(encoding="utf-8") == "name: [my work"


# -- where schemas are looked for ------------------------------------------------------------------


def test_a_schema_is_found_beside_the_file_that_names_it_before_the_bundled_ones(
    tmp_path, monkeypatch
):
    own = Schema("CC3", ["A"], {"A": [DOOR]})
    assert find_schema("CC3", beside=[tmp_path]) == BUNDLED["CC3"]
    write_schema(own, tmp_path / "schemas" / "CC3.yaml")
    assert find_schema("CC3", beside=[tmp_path]) == own
    assert find_schema("schemas/CC3.yaml", beside=[tmp_path]) == own
    assert find_schema(own) is own
    assert find_schema("CC3") == BUNDLED["CC3"]
    monkeypatch.chdir(tmp_path)
    assert find_schema("CC3") == own


def test_a_bundled_schema_is_read_once_in_a_checkout_too(monkeypatch):
    """There the folder in which schemas are looked for first is the bundled one."""
    monkeypatch.chdir(ROOT)
    assert find_schema("CC4") is find_schema("CC4")

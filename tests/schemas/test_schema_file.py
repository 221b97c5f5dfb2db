"""Schema files: there and back without loss, and every fault in them told with its place."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from causal_openlock.errors import FileError, OpenLockError
from causal_openlock.experiment import file_format as experiment_file
from causal_openlock.files.yaml_file import dump_yaml, parse_document, styled
from causal_openlock.schemas.finding import bundled, bundled_schemas, find_schema
from causal_openlock.schemas.graphs import read_schema, write_schema
from causal_openlock.schemas.schema import DOOR, NO_TEXT, Gate, Schema
from causal_openlock.schemas.schema_file import json_schema, parse_schema, schema_from_dict
from causal_openlock.testing import schemas
from support.places import ROOT

BUNDLED = bundled_schemas()
TITLES = st.text(st.characters(exclude_categories=["C"]), max_size=150)
# Spaces, signs that YAML heeds and line breaks that only Unicode knows, in texts of many lines.
HARD = st.text(
    st.sampled_from("ab  :#'\"\\-\t\xa0\x85\u2028\u2029\u3000,[]{}%@&*!|>?\n\r"), max_size=400
)

COMMENTED = """\
# yaml-language-server: $schema=./schema.json
# A head.
name: X     # the name
# About the title.
title: "Quoted"   # as people say
levers: [L0, L1, L2]   # three

# The edges.
edges:           # cause: [effects]
  # L0 comes first.
  L0: [L1, L2]   # frees both
  # Then L1.
  L1: [door]
  L2:            # on lines of its own
    - door       # the door
# The gates.
gates:
  door: any      # said, though it goes without saying
# The end.
"""


# -- there and back -------------------------------------------------------------------------------


@pytest.mark.parametrize("schema", BUNDLED.values(), ids=list(BUNDLED))
def test_a_bundled_schema_survives_being_dumped(schema: Schema) -> None:
    assert parse_schema(schema.to_yaml()) == schema
    assert schema_from_dict(schema.as_dict()) == schema


@settings(max_examples=40, deadline=None)
@given(schema=schemas(max_levers=12, stochastic=True, titles=TITLES))
def test_any_schema_survives_being_dumped(schema: Schema) -> None:
    back = parse_schema(schema.to_yaml())
    assert back == schema
    assert back.as_dict() == schema.as_dict()
    assert schema_from_dict(schema.as_dict()) == schema


@settings(max_examples=50, deadline=None)
@given(title=HARD | st.lists(st.text("abc", min_size=1)).map("  ".join))
@example(title="  ".join(["five"] * 18))  # longer than a line, with two spaces where it may break
@example(title="a\x85b")
def test_any_title_comes_back_whatever_its_length_and_spaces(title: str) -> None:
    if not NO_TEXT.search(title):
        schema = Schema("X", ["A"], {"A": [DOOR]}, title=title)
        assert parse_schema(schema.to_yaml()) == schema
    inside = {"conditions": [{"name": title, "train": [title] * 3}]}
    for text in (dump_yaml(inside), dump_yaml(styled(inside))):
        assert parse_document(text).data == inside


@pytest.mark.parametrize("name", ["null", "true", "False", "on", "no", "y", "Inf", "e1", "NaN"])
def test_a_lever_may_be_called_like_a_value_of_yaml(name: str, tmp_path: Path) -> None:
    schema = Schema(name, [name, "L1"], {name: {"L1": 0.5}, "L1": [DOOR]}, title=name)
    assert parse_schema(schema.to_yaml()) == schema
    path = tmp_path / "x.yaml"
    write_schema(BUNDLED["CC3"], path)
    write_schema(schema, path)
    assert read_schema(path) == schema


def test_a_dumped_schema_reads_like_one_written_by_hand() -> None:
    schema = Schema(
        "S", ["A", "B"], {"A": {"B": 0.5, DOOR: 1.0}, "B": [DOOR]},
        gates={DOOR: Gate("at_least", 2)}, title="Two",
    )  # fmt: skip
    assert schema.to_yaml() == (
        "name: S\ntitle: Two\nlevers: [A, B]\nedges:\n  A: {B: {strength: 0.5}, door: {}}\n"
        "  B: [door]\ngates:\n  door: {at_least: 2}\n"
    )


@pytest.mark.parametrize("name", BUNDLED)
def test_writing_what_a_file_says_already_leaves_it_byte_for_byte(
    name: str, tmp_path: Path
) -> None:
    path = tmp_path / f"{name}.yaml"
    shutil.copy(bundled("schemas") / path.name, path)
    before = path.read_bytes()
    write_schema(BUNDLED[name], path)
    assert path.read_bytes() == before


def changed(**changes: Any) -> Schema:
    """The commented schema with some keys of its data changed; ``None`` takes a key out."""
    data = {**parse_schema(COMMENTED).as_dict(), **changes}
    return schema_from_dict({key: value for key, value in data.items() if value is not None})


@pytest.mark.parametrize(
    ("schema", "lines"),
    [
        (changed(), {}),
        (changed(title="New: é"), {'title: "Quoted"': "title: 'New: é'"}),
        (changed(title=None), {'title: "Quoted"   # as people say\n': ""}),
        (
            changed(edges={"L0": ["L1", "L2"], "L1": ["L2", DOOR], "L2": [DOOR]}),
            {"L1: [door]": "L1: [L2, door]"},
        ),
        (
            changed(edges={"L0": ["L1", "L2", DOOR], "L1": [DOOR], "L2": ["L1"]}),
            {
                "L0: [L1, L2]": "L0: [L1, L2, door]",
                "    - door       # the door\n": "    - L1\n",
            },
        ),
        (
            changed(edges={"L0": ["L1", "L2"], "L1": [DOOR], "L2": ["L1", DOOR]}),
            {"# the door\n": "# the door\n    - L1\n"},
        ),
        (
            changed(edges={"L0": ["L2"], "L2": [DOOR]}, inert=["L1"]),
            {
                "L0: [L1, L2]": "L0: [L2]",
                "  L1: [door]\n": "",
                "# the door\n": "# the door\ninert: [L1]\n",
                # Causes and gates that are there stay in their places.
            },
        ),
        (
            changed(edges={"L0": {"L1": {"strength": 0.25}}, "L1": [DOOR], "L2": [DOOR]}),
            {"[L1, L2]": "{L1: {strength: 0.25}}"},
        ),
        (changed(gates={DOOR: "all"}), {"door: any": "door: all"}),
        (changed(gates={DOOR: {"at_least": 2}}), {"door: any": "door: {at_least: 2}"}),
    ],
    ids=[
        *("nothing", "title", "no title", "effect added", "effects exchanged", "item added"),
        *("lever idle", "strength", "gate", "quorum"),
    ],
)
def test_only_what_changed_is_rewritten(
    schema: Schema, lines: dict[str, str], tmp_path: Path
) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(COMMENTED, encoding="utf-8")
    write_schema(schema, path)
    expected = COMMENTED
    for old, new in lines.items():
        assert expected.count(old) == 1, old
        expected = expected.replace(old, new)
    assert path.read_text(encoding="utf-8") == expected
    assert read_schema(path) == schema


@settings(max_examples=40, deadline=None)
@given(old=schemas(stochastic=True, titles=TITLES), new=schemas(stochastic=True, titles=TITLES))
@example(old=parse_schema(COMMENTED), new=parse_schema(BUNDLED["seven"].to_yaml()))
@example(  # a space to Python and a letter to YAML
    old=Schema("x", ["A"], {"A": ["door"]}, title="\xa0"),
    new=Schema("x", ["A"], {"A": ["door"]}, title="0"),
)
def test_any_schema_can_be_written_over_any_other(
    old: Schema, new: Schema, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("over") / "x.yaml"
    path.write_text("# Head.\n" + old.to_yaml() + "# Tail.\n", encoding="utf-8")
    write_schema(new, path)
    assert read_schema(path) == new
    text = path.read_text(encoding="utf-8")
    assert text.startswith("# Head.\n")
    assert "# Tail.\n" in text


def test_a_default_that_contradicts_the_change_costs_the_comments_and_not_the_meaning(
    tmp_path: Path,
) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(
        "# Head.\nname: X\nlevers: [A, B]\nedges: {A: [B], B: [door]}\ngates: {B: any}\n",
        encoding="utf-8",
    )
    apart = Schema("X", ["A", "B"], {"A": [DOOR], "B": [DOOR]})
    write_schema(apart, path)
    assert read_schema(path) == apart


def test_line_ends_of_windows_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_bytes(COMMENTED.replace("\n", "\r\n").encode())
    write_schema(changed(inert=["L3"], levers=["L0", "L1", "L2", "L3"]), path)
    assert read_schema(path).inert == ("L3",)
    text = path.read_bytes()
    assert text.count(b"\n") == text.count(b"\r\n") == COMMENTED.count("\n") + 1


def test_a_file_with_faults_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_text("name: [my work", encoding="utf-8")
    with pytest.raises(FileError):
        write_schema(BUNDLED["CC3"], path)
    assert path.read_text(encoding="utf-8") == "name: [my work"


def test_a_bundled_schema_is_read_once_in_a_checkout_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """There the folder in which schemas are looked for first is the bundled one."""
    monkeypatch.chdir(ROOT)
    assert find_schema("CC4") is find_schema("CC4")


def test_a_schema_is_found_beside_the_file_that_names_it_before_the_bundled_ones(
    tmp_path: Path,
) -> None:
    own = Schema("CC3", ["A"], {"A": [DOOR]})
    assert find_schema("CC3", beside=[tmp_path]) == BUNDLED["CC3"]
    write_schema(own, tmp_path / "schemas" / "CC3.yaml")
    assert find_schema("CC3", beside=[tmp_path]) == own
    assert find_schema("schemas/CC3.yaml", beside=[tmp_path]) == own
    assert find_schema(own) is own
    with pytest.raises(OpenLockError, match="did you mean CC4"):
        find_schema("CC44")
    with pytest.raises(OpenLockError, match="there is no schema"):
        find_schema("x" * 300)


# -- JSON Schema ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("folder", "made"),
    [("schemas", json_schema()), ("experiments", experiment_file.json_schema())],
    ids=["schemas", "experiments"],
)
def test_the_json_schema_files_are_up_to_date(folder: str, made: dict[str, Any]) -> None:
    path = ROOT / folder / "schema.json"
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    assert text == json.dumps(made, indent=2) + "\n", (
        f"{folder}/schema.json is out of date; `make json-schemas` regenerates it"
    )


def plain(text: str) -> Any:
    return YAML(typ="safe", pure=True).load(text)


VALIDATOR = jsonschema.Draft202012Validator(json_schema())


@pytest.mark.parametrize("path", sorted(bundled("schemas").glob("*.yaml")), ids=lambda p: p.stem)
def test_the_bundled_schema_files_are_valid_for_editors(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.startswith("# yaml-language-server: $schema=./schema.json\n")
    VALIDATOR.validate(plain(text))
    assert read_schema(path).name == path.stem


def test_the_bundled_experiments_are_valid_for_editors() -> None:
    validator = jsonschema.Draft202012Validator(experiment_file.json_schema())
    for path in bundled("experiments").glob("*.yaml"):
        validator.validate(plain(path.read_text(encoding="utf-8")))


@settings(max_examples=50, deadline=None)
@given(schema=schemas(max_levers=12, stochastic=True))
def test_any_schema_is_valid_for_editors(schema: Schema) -> None:
    VALIDATOR.validate(schema.as_dict())

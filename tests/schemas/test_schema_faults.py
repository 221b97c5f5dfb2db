"""Faults in schema files: each is told in one line with its place, and nothing else is raised."""

from __future__ import annotations

import json
import pickle
from contextlib import suppress
from functools import cache
from pathlib import Path

import jsonschema
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from causal_openlock.errors import FileError, OpenLockError, SchemaError
from causal_openlock.files.yaml_file import MAX_BYTES
from causal_openlock.schemas.finding import bundled, bundled_schemas
from causal_openlock.schemas.schema import Schema
from causal_openlock.schemas.schema_file import (
    json_schema,
    parse_schema,
    read_schema_file,
    schema_from_dict,
)
from support.counted_work import calls

VALIDATOR = jsonschema.Draft202012Validator(json_schema())

GOOD = {"name": "X", "levers": "[L0, L1]", "edges": "{L0: [L1], L1: [door]}"}


def good(**changes: str) -> str:
    """A schema file of one line for each key, with some values changed or added."""
    return "".join(f"{key}: {value}\n" for key, value in {**GOOD, **changes}.items())


def edge(strength: str) -> str:
    return good(edges=f"{{L0: {{L1: {{strength: {strength}}}}}, L1: [door]}}")


BOMB = 'a: &a ["lol", "lol"]\n' + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 9)}]\n"
    for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)
Place = tuple[int, int, str]

# What the form of the file cannot be: an editor that knows the JSON Schema sees it as well.
FORM: dict[str, tuple[str, list[Place]]] = {
    "strength 0": (edge("0"), [(3, 19, "greater than 0, and this is 0")]),
    "strength 1.5": (edge("1.5"), [(3, 19, "less than or equal to 1, and this is 1.5")]),
    "strength -1": (edge("-1"), [(3, 19, "greater than 0, and this is -1")]),
    "strength high": (edge("high"), [(3, 19, "a valid number, and this is the text 'high'")]),
    "strength quoted": (edge("'0.5'"), [(3, 19, "a valid number, and this is the text '0.5'")]),
    "strength true": (edge("true"), [(3, 19, "a valid number, and this is true")]),
    "strength empty": (edge(""), [(3, 19, "a valid number, and this is nothing")]),
    "strength list": (edge("[1]"), [(3, 19, "a valid number, and this is a list")]),
    "strength infinite": (edge(".inf"), [(3, 19, "less than or equal to 1, and this is inf")]),
    "strength too large": (edge("1e400"), [(3, 19, "less than or equal to 1, and this is inf")]),
    "strength bare": (
        good(edges="{L0: {L1: 1.5}, L1: [door]}"),
        [(3, 14, "less than or equal to 1, and this is 1.5")],
    ),
    "strength a text": (
        good(edges="{L0: {L1: half}, L1: [door]}"),
        [(3, 14, "written {key: value}, and this is the text 'half'")],
    ),
    "strength a truth": (
        good(edges="{L0: {L1: yes}, L1: {door: true}}"),
        [(3, 14, "this is the text 'yes'"), (3, 29, "written {key: value}, and this is true")],
    ),
    "unknown key of an edge": (
        good(edges="{L0: {L1: {strenth: 0.5}}, L1: [door]}"),
        [(3, 19, "'strenth' is not a key here; did you mean strength?")],
    ),
    "name missing": ("levers: [L0]\nedges: {L0: [door]}\n", [(1, 1, "name: is missing; add it")]),
    "everything missing": (
        "{}\n",
        [(1, 1, f"{key}: is missing; add it") for key in ("name", "levers", "edges")],
    ),
    "unknown keys": (
        good(gate="any", lever="[L0]"),
        [
            (4, 1, "'gate' is not a key here; did you mean gates?"),
            (5, 1, "'lever' is not a key here; did you mean levers?"),
        ],
    ),
    "name a number": (good(name="3"), [(1, 1, "this is 3; write it in quotes")]),
    "name a truth": (good(name="true"), [(1, 1, "this is true; write it in quotes")]),
    "name empty": (good(name=""), [(1, 1, "a valid string, and this is nothing")]),
    "name a list": (good(name="[X]"), [(1, 1, "a valid string, and this is a list")]),
    "name with a dash": (good(name="no-dash"), [(1, 1, "letters, digits and underscores")]),
    "name too long": (good(name="X" * 65), [(1, 1, "at most 64")]),
    "title a list": (good(title="[A]"), [(4, 1, "title must be a valid string")]),
    "levers a text": (good(levers="L0"), [(2, 1, "levers must be a list, written [one, anoth")]),
    "levers a mapping": (good(levers="{L0: 1}"), [(2, 1, "levers must be a list")]),
    "levers empty": (good(levers="[]"), [(2, 1, "at least 1; add one")]),
    "levers nested": (good(levers="[L0, [L1]]"), [(2, 14, "levers.1 must be a valid string")]),
    "levers by number": (
        good(levers="[1, 0]", edges="{1: [0], 0: [door]}"),
        [
            (2, 10, "this is 1; write it in quotes"),
            (2, 13, "this is 0; write it in quotes"),
            (3, 9, "a key must be a text, and this is 1; write it in quotes"),
            (3, 13, "this is 0; write it in quotes"),
            (3, 17, "a key must be a text, and this is 0; write it in quotes"),
        ],
    ),
    "edges a list": (good(edges="[L0, L1]"), [(3, 1, "written {key: value}, and this is a list")]),
    "edges nothing": (good(edges=""), [(3, 1, "written {key: value}, and this is nothing")]),
    "effect without brackets": (
        good(edges="{L0: L1, L1: [door]}"),
        [(3, 9, "effects are a list like [L1, door] or a mapping")],
    ),
    "no effects": (good(edges="{L0: , L1: [door]}"), [(3, 9, "effects are a list")]),
    "effect a number": (good(edges="{L0: [L1, 7]}"), [(3, 18, "edges.L0.1 must be a valid stri")]),
    "gates a list": (good(gates="[door]"), [(4, 1, "gates must be keys and values")]),
    "gate unknown": (good(gates="{door: most}"), [(4, 9, "a gate is any, all or {at_least: k}")]),
    "gate nothing": (good(gates="{door: }"), [(4, 9, "a gate is any, all or {at_least: k}")]),
    "gate at most": (
        good(gates="{door: {at_most: 1}}"),
        [(4, 9, "at_least: is missing"), (4, 16, "'at_most' is not a key here; did you mean at_")],
    ),
    "gate of 0": (good(gates="{door: {at_least: 0}}"), [(4, 16, "greater than or equal to 1")]),
    "gate of 13": (good(gates="{door: {at_least: 13}}"), [(4, 16, "less than or equal to 12")]),
    "gate of 1.5": (good(gates="{door: {at_least: 1.5}}"), [(4, 16, "a valid integer")]),
    "inert a text": (good(inert="L1"), [(4, 1, "inert must be a list")]),
    "a text": ("hello\n", [(1, 1, "the file holds the text 'hello'; it must hold keys")]),
    "a number": ("3\n", [(1, 1, "the file holds 3; it must hold keys")]),
    "a list": ("- name: X\n", [(1, 1, "the file holds a list; it must hold keys")]),
    "empty": ("", [(1, 1, "the file is empty; it must hold keys such as name:")]),
    "only comments": ("# name: X\n", [(1, 1, "the file is empty; it must hold keys")]),
}  # fmt: skip

# What only the meaning of the schema shows.
MEANING: dict[str, tuple[str, list[Place]]] = {
    "cycle": (
        good(edges="{L0: [L1], L1: [L0, door]}"),
        [(3, 14, "L0 -> L1 -> L0 is a cycle, and none of these levers could move first; remove")],
    ),
    "cycle of itself": (good(edges="{L0: [L1], L1: [door, L1]}"), [(3, 30, "L1 -> L1 is a cyc")]),
    "unknown effect": (good(edges="{L0: [L2], L1: [door]}"), [(3, 14, "did you mean L1?")]),
    "unknown cause": (good(edges="{L0: [L1], L7: [door]}"), [(3, 19, "known: L0, L1")]),
    "door as a cause": (good(edges="{door: [L0]}"), [(3, 9, "enables nothing")]),
    "duplicate lever": (good(levers="[L0, L1, L0]"), [(2, 18, "lever L0 is listed twice; remov")]),
    "door among the levers": (good(levers="[L0, door]"), [(2, 14, "take it out of the list")]),
    "bad name for a lever": (good(levers="[L0, L-1]"), [(2, 14, "write it like L0")]),
    "too many levers": (
        good(levers=f"[{', '.join(f'L{i}' for i in range(13))}]"),
        [(2, 1, "13 levers are more than the 12 positions of the largest room; leave some out")],
    ),
    "duplicate edge": (
        good(edges="{L0: [L1, door, L1]}"),
        [(2, 14, "L1 is on no path"), (3, 24, "the edge L0 -> L1 is listed twice; remove one")],
    ),
    "several": (
        "name: S\nlevers: [A, B, C, D, E]\nedges:\n  A: [B, door]\n  B: [C]\n  C: [B]\n"
        "gates:\n  X: all\n  E: all\n  door: {at_least: 2}\n",
        [
            (2, 19, "lever D is on no path"),
            (2, 22, "lever E is on no path"),
            (5, 7, "B -> C -> B is a cycle"),
            (8, 3, "'X' is unknown here"),
            (9, 3, "E has a gate and no cause"),
            (10, 3, "requires at least 2 of 1 causes and can never hold"),
        ],
    ),
    "several names": (
        good(name="X", title='"a\\0"', levers="[L0, L-1, door, L0]"),
        [
            (2, 14, "'L-1' is not a valid name"),
            (2, 19, "take it out of the list"),
            (2, 25, "listed twice"),
            (4, 1, "the title holds"),
        ],
    ),
    "several edges, and not what follows from them": (
        good(edges="{L0: [L9], L7: [L1, dor]}", gates="{L1: {at_least: 2}}", inert="[L8]"),
        [(3, 14, "'L9'"), (3, 19, "'L7'"), (3, 28, "did you mean door?"), (5, 9, "'L8'")],
    ),
    "no edges": (good(edges="{}"), [(3, 1, "nothing unlocks the door; add an edge")]),
    "missing door": (good(edges="{L0: [L1]}"), [(3, 1, "nothing unlocks the door; add an edge")]),
    "lever on no path": (good(edges="{L0: [door]}"), [(2, 14, "connect it or list it under iner")]),
    "inert and useful": (good(inert="[L1]"), [(4, 9, "take it out of inert")]),
    "inert and unknown": (good(inert="[L2]"), [(4, 9, "'L2' is unknown here; did you mean L1?")]),
    "impossible gate": (good(gates="{door: {at_least: 2}}"), [(4, 9, "can never hold")]),
    "gate of a free lever": (good(gates="{L0: all}"), [(4, 9, "give it a cause or drop the gate")]),
    "gate of nobody": (good(gates="{dor: all}"), [(4, 9, "did you mean door?")]),
    "unprintable title": (good(title='"a\\0"'), [(4, 1, "the title holds the character U+0000")]),
}  # fmt: skip

# What is not YAML, or no YAML that a person would write into such a file.
YAML_ITSELF: dict[str, tuple[str | bytes, list[Place]]] = {
    "tab": ("name: X\n\tlevers: [L0]\n", [(2, 1, "this is not valid YAML: found character '\\t'")]),
    "unclosed list": ("name: X\nlevers: [L0\nedges: {}\n", [(3, 6, "expected ',' or ']'")]),
    "unclosed quote": ('name: "X\nlevers: [L0]\n', [(3, 1, "unexpected end of stream")]),
    "stray colon": ("name: a: b\n", [(1, 8, "mapping values are not allowed here; correct th")]),
    "not YAML": ("<html>\n<a href='x: y'>: {\n", [(2, 11, "this is not valid YAML")]),
    "duplicate key": (good() + "name: Y\n", [(4, 1, "the key 'name' is written twice; remove")]),
    "duplicate cause": (
        good(edges="{L0: [L1], L1: [door], L0: [door]}"),
        [(3, 31, "the key 'L0' is written twice")],
    ),
    "duplicate effect": (
        good(edges="{L0: {L1: {}, L1: {}}, L1: [door]}"),
        [(3, 22, "the key 'L1' is written twice")],
    ),
    "second document": (good() + "---\n" + good(), [(4, 1, "a second document; keep one")]),
    "text after the end": (good() + "...\nmore\n", [(5, 1, "a second document; keep one")]),
    "anchor": (good(levers="&l [L0, L1]"), [(2, 9, "the anchor &l is not allowed here; take")]),
    "alias": (good(inert="*l"), [(4, 8, "the alias *l is not allowed here; write the value out")]),
    "alias bomb": (BOMB, [(1, 4, "the anchor &a is not allowed here")]),
    "merge key": (
        good(edges="{<<: {L0: [L1]}, L1: [door]}"),
        [(3, 9, "the merge key << is not allowed here; write its values out")],
    ),
    "Python object": (
        good(name="!!python/object:os.system X"),
        [(1, 7, "the tag !!python/object:os.system is not allowed here; take it out")],
    ),
    "Python call": (
        good(name="!!python/object/apply:os.system ['touch hacked']"),
        [(1, 7, "the tag !!python/object/apply:os.system is not allowed here")],
    ),
    "tag on everything": ("!!python/object:os.system\n" + good(), [(1, 1, "the tag")]),
    "tag of a number": (edge("!!float x"), [(3, 29, "the tag !!float is not allowed here")]),
    "tag of a set": (good(levers="!!set {L0}"), [(2, 9, "the tag !!set is not allowed here")]),
    "unknown tag": (good(levers="!levers [L0]"), [(2, 9, "the tag !levers is not allowed")]),
    "key a list": (good(edges="{[L0]: [L1]}"), [(3, 9, "a key must be a name")]),
    "key a mapping": (good(edges="{{L0: 1}: [L1]}"), [(3, 9, "a key must be a name")]),
    "name a date": (good(name="2018-01-31"), [(1, 1, "2018-01-31; write it in quotes")]),
    "names of other kinds": (
        good(edges="{null: [L1], 1.5: [L1], true: [door]}"),
        [
            (3, 9, "a key must be a text, and this is nothing; write a name"),
            (3, 21, "a key must be a text, and this is 1.5; write it in quotes"),
            (3, 32, "a key must be a text, and this is true; write it in quotes"),
        ],
    ),
    "no date": (good(name="2018-02-31"), [(1, 7, "looks like a number or a date and is none")]),
    "no number": (edge("0x_"), [(3, 29, "looks like a number or a date and is none")]),
    "5,000 digits": (edge("9" * 5000), [(3, 29, "this number has 5,000 digits")]),
    "a long word": (edge("a" * 5000), [(3, 19, "this is a text of 5000 characters")]),
    "beyond all characters": (good(title='"\\U00110000"'), [(4, 11, "a number here is larger")]),
    "far beyond": (good(title='"\\UFFFFFFFF"'), [(4, 11, "a number here is larger")]),
    "YAML 1.3": ("%YAML 1.3\n---\n" + good(), [(1, 1, "take the line %YAML out")]),
    "YAML of many digits": (f"%YAML {'9' * 5000}.1\n---\n", [(1, 7, "a number here is larger")]),
    "YAML 1.1": ("%YAML 1.1\n---\n" + good(), [(2, 1, "take the line %YAML out")]),
    "nested lists": (good(title="[" * 20 + "]" * 20), [(4, 23, "nested deeper than 16 levels")]),
    "nested keys": (
        "".join(" " * depth + "a:\n" for depth in range(40)),
        [(17, 17, "nested deeper than 16 levels; is this the right file?")],
    ),
    "10,000 brackets": ("[" * 10_000, [(1, 17, "nested deeper than 16 levels")]),
    "10,000 dashes": ("- " * 10_000, [(1, 33, "nested deeper than 16 levels")]),
    "too many values": ("a: [" + "1," * 20_000, [(1, 9999, "more than 5,000 values")]),
    "one MB of junk": ("x" * 1_000_000, [(1, 1, "more than 131,072 bytes; is this the right")]),
    "as much junk as is read": ("x" * MAX_BYTES, [(1, 1, "holds a text of 131072 characters")]),
    "too many lines": ("x\n" * 20_000, [(5001, 1, "more than 5,000 lines; is this the right")]),
    "many comments": ("#\n" * 5_000, [(1, 1, "the file is empty")]),
    "NUL": (good(name="X\0Y"), [(1, 8, "the character U+0000 is not allowed; take it out")]),
    "only NULs": ("\0" * 500, [(1, 1, "the character U+0000 is not allowed; take it out")]),
    "bell on line 2": (good(levers="[L0, \a]"), [(2, 14, "the character U+0007 is not allowed")]),
    "half a character": (good(title='"\\ud83d"'), [(4, 8, "write the character itself")]),
    "Latin 1": ("name: X\ntitle: ünd so weiter, wie früher: é\n".encode("latin-1"),
                [(2, 8, "not UTF-8 text (invalid start byte); save the file as UTF-8")]),
    "UTF-16": (good().encode("utf-16"), [(1, 1, "not UTF-8 text")]),
    "after a letter of two bytes": ("title: é".encode() + b"\xff", [(1, 9, "not UTF-8 text")]),
    "a picture": (b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 100, [(1, 1, "not UTF-8 text")]),
}  # fmt: skip


def faults_of(content: str | bytes, folder: Path) -> tuple[FileError, int]:
    """What is wrong with a file, and how many calls it takes to find out."""
    path = folder / "x.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    caught: list[FileError] = []

    def read() -> None:
        try:
            read_schema_file(path)
        except FileError as error:
            caught.append(error)

    import_all()
    work = calls(read)
    return caught[0], work


@cache
def import_all() -> None:
    """What is imported on the way is no work of reading."""
    with suppress(FileError):
        parse_schema("name: 1\nlevel: [L0]")


def assert_linear(work: int, size: int) -> None:
    """No file is more work than its length allows, whatever it says."""
    assert work < 20_000 + 500 * size


TABLE = {**FORM, **MEANING, **YAML_ITSELF}


@pytest.mark.parametrize(("content", "expected"), TABLE.values(), ids=list(TABLE))
def test_every_fault_is_one_line_with_its_place_and_a_remedy(
    content: str | bytes, expected: list[Place], tmp_path: Path
) -> None:
    error, work = faults_of(content, tmp_path)
    assert [(fault.line, fault.column) for fault in error.faults] == [row[:2] for row in expected]
    for fault, (_, _, said) in zip(error.faults, expected, strict=True):
        assert said in fault.message
        assert len(fault.message) < 300
    assert str(error).splitlines() == [
        f"{tmp_path / 'x.yaml'}:{fault.line}:{fault.column}: {fault.message}"
        for fault in error.faults
    ]
    assert_linear(work, len(content))
    assert [path.name for path in tmp_path.iterdir()] == ["x.yaml"]
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


@pytest.mark.parametrize("content", [row[0] for row in FORM.values()], ids=list(FORM))
def test_an_editor_sees_the_same_faults_of_form(content: str) -> None:
    document = YAML(typ="safe", pure=True).load(content)
    if isinstance(document, dict):  # JSON knows no keys that are numbers
        document = json.loads(json.dumps(document))
    assert not VALIDATOR.is_valid(document)


def test_a_file_of_faults_is_answered_with_the_first_twenty(tmp_path: Path) -> None:
    text = f"name: X\nlevers: [{', '.join(['1'] * 1500)}]\n"
    error, work = faults_of(text, tmp_path)
    assert len(error.faults) == 1501
    lines = str(error).splitlines()
    assert len(lines) == 21
    assert lines[0].endswith(":1:1: edges: is missing; add it")
    assert lines[20] == f"{tmp_path / 'x.yaml'}: and 1,481 more faults"
    assert_linear(work, len(text))


def test_levers_may_be_called_on_no_and_y_and_a_comment_may_be_anywhere() -> None:
    text = (
        "\ufeff---\nname: off # !\nlevers: [on, no, y]\nedges: {on: [no], no: [y], y: [door]}\n..."
    )
    assert parse_schema(text).solutions == (("on", "no", "y"),)
    assert parse_schema(text.replace("\n", "\r\n")) == parse_schema(text)


def test_a_strength_may_stand_for_its_edge_and_gates_in_any_letters() -> None:
    short = good(edges="{L0: {L1: 0.5}, L1: [door]}", gates="{L1: ANY, door: All}")
    long = good(edges="{L0: {L1: {strength: 0.5}}, L1: [door]}", gates="{L1: any, door: all}")
    assert parse_schema(short) == parse_schema(long)
    assert VALIDATOR.is_valid({**YAML(typ="safe").load(long), "edges": {"L0": {"door": 0.5}}})


def test_a_strength_of_1_may_be_written_as_a_whole_number_or_left_out() -> None:
    assert parse_schema(edge("1")) == parse_schema(edge("1.0")) == parse_schema(good())
    assert parse_schema(good(edges="{L0: {L1: {}}, L1: {door: {}}}")) == parse_schema(good())


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("missing.yaml", "missing.yaml: cannot be read (No such file or directory); check the na"),
        ("", ": cannot be read (Is a directory); check the name"),
        ("x" * 300 + ".yaml", "cannot be read (File name too long); check the name"),
        ("a\0b.yaml", "is not a name that a file can have"),
    ],
    ids=["missing", "directory", "long", "NUL"],
)
def test_a_file_that_cannot_be_read_is_one_sentence(name: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(OpenLockError) as caught:
        read_schema_file(tmp_path / name)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_endless_file_is_not_read_to_its_end() -> None:
    with pytest.raises(FileError, match="more than 131,072 bytes"):
        read_schema_file("/dev/zero")


def test_a_fault_in_plain_data_has_its_path_of_keys() -> None:
    data = bundled_schemas()["CC3"].as_dict()
    data["edges"] = {"L0": {"L1": {"strength": 2.0}}}
    with pytest.raises(SchemaError, match="less than or equal to 1, and this is 2") as caught:
        schema_from_dict(data)
    assert caught.value.at == ("edges", "L0", "L1", "strength")


# -- anything at all ------------------------------------------------------------------------------

SEEDS = [
    good(title="T # no comment", gates="{door: {at_least: 1}}", inert="[]"),
    good(),
    *(path.read_text("utf-8") for path in bundled("schemas").glob("*.yaml")),
]
SNIPPETS = st.sampled_from(
    [
        *" \n\t:,-?&*!|>%@`#[]{}'\"\\~=_0179",
        *("\n  ", ": ", "- ", "? ", "<<: ", "*a", "&a ", "!!set ", "!!int ", "---\n", "...\n"),
        *("null", "true", "on", ".nan", "1e9", "0x", "0b2", "1_", "door", "L0", "edges", "{}"),
        *("[]", "\r\n", "\\u", "\\x00", "'\"", "|\n", ">-\n", "\ufeff", "\x85", "\u2028"),
    ]
)


@st.composite
def mutated(draw: st.DrawFn) -> str:
    """A valid file with a few pieces taken out, doubled, exchanged or put in."""
    text = draw(st.sampled_from(SEEDS))
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(text)))
        end = min(len(text), start + draw(st.integers(0, 12)))
        piece = draw(st.just("") | SNIPPETS | st.text(max_size=3) | st.just(text[start:end] * 2))
        text = text[:start] + piece + text[end:]
    return text


def parsed(text: str) -> Schema | FileError:
    """The schema or the fault of a text; anything else that is raised fails the test."""
    try:
        return parse_schema(text)
    except FileError as error:
        return error


def check(text: str) -> None:
    found = parsed(text)
    if isinstance(found, Schema):
        assert parse_schema(found.to_yaml()) == found
        return
    lines = len(text.splitlines()) + 1
    assert found.faults
    assert all(0 < fault.line <= lines and fault.column > 0 for fault in found.faults)
    assert len(str(found).splitlines()) == min(len(found.faults), 21)


@settings(max_examples=250, deadline=None)
@given(text=mutated())
def test_a_mutated_file_is_a_schema_or_is_refused(text: str) -> None:
    check(text)


@settings(max_examples=200, deadline=None)
@given(text=st.text() | st.lists(SNIPPETS, max_size=30).map("".join))
def test_any_text_is_a_schema_or_is_refused(text: str) -> None:
    check(text)


@settings(max_examples=200, deadline=None)
@given(content=st.binary(max_size=200), at=st.integers(0, 100))
def test_any_bytes_are_a_schema_or_are_refused(
    content: bytes, at: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "bytes.yaml"
    path.write_bytes(good().encode()[:at] + content)
    try:
        found: object = read_schema_file(path)
    except FileError as error:
        found = error.faults
    assert found

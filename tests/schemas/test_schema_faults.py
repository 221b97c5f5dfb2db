"""Faults in schema files: all are told, each with its place, and nothing else is raised.

What faults there are stands in ``tests/refusals/schemas.txt``.
"""

import json
import pickle

import jsonschema
import pytest
from ruamel.yaml import YAML

from causal_openlock.errors import FileError, OpenLockError
from causal_openlock.experiment import declare
from causal_openlock.files.yaml_file import Document
from causal_openlock.schemas import schema
from causal_openlock.schemas.finding import bundled
from causal_openlock.schemas.schema import SchemaData
from refusals import given
from support.places import ROOT


def faults_of(text):
    with pytest.raises(FileError) as caught:
        Document(text, "x.yaml").validate(SchemaData)
    return caught.value


def test_all_faults_of_a_file_are_told_at_once_each_with_its_place():
    error = faults_of(
        "name: S\nlevers: [A, B, C, D, E]\nedges:\n  A: [B, door]\n  B: [C]\n  C: [B]\n"
        "gates:\n  X: all\n  E: all\n  door: {at_least: 2}\n"
    )
    said = [
        (2, 19, "lever D"),
        (2, 22, "lever E"),
        (5, 7, "B -> C -> B"),
        (8, 3, "'X'"),
        (9, 3, "E has a gate"),
        (10, 3, "2 of 1"),
    ]
    for fault, (*place, words) in zip(error.faults, said, strict=True):
        assert [fault.line, fault.column] == place
        assert words in fault.message
    assert str(error).splitlines() == [
        f"x.yaml:{fault.line}:{fault.column}: {fault.message}" for fault in error.faults
    ]
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


def test_what_follows_from_faults_of_edges_is_not_told():
    edges = "{L0: [L9], L7: [L1, dor]}\ngates: {L1: {at_least: 2}}\ninert: [L8]"
    error = faults_of(f"name: X\nlevers: [L0, L1]\nedges: {edges}\n")
    places = [(fault.line, fault.column) for fault in error.faults]
    assert places == [(3, 14), (3, 19), (3, 28), (5, 9)]


def test_of_many_faults_the_first_twenty_are_told():
    error = faults_of(f"name: X\nlevers: [{', '.join(map(str, range(1500)))}]\n")
    assert len(error.faults) == 1501
    lines = str(error).splitlines()
    assert len(lines) == 21
    assert lines[0].startswith("x.yaml:1:1: edges")
    assert "1,481" in lines[20]


TABLES = {"schemas": schema.json_schema(), "experiments": declare.json_schema()}
ROWS = {"schemas": "schemas.txt", "experiments": "experiment.txt"}


def editor(part):
    return jsonschema.Draft202012Validator(TABLES[part])


def plain(path):
    """The content of a YAML file as an editor sees it: JSON knows no keys that are numbers."""
    return json.loads(json.dumps(YAML(typ="safe", pure=True).load(path), default=str))


def rows_of_form():
    """The rows of refusals down to the first comment that follows."""
    for part in TABLES:
        table = ROOT / "tests" / "refusals" / ROWS[part]
        _, rows = table.read_text(encoding="utf-8").split("every row down to the next comment.\n")
        for row in rows.split("\n#")[0].splitlines():
            yield pytest.param(part, row.partition(" ⇒ ")[0], id=row[:60])


@pytest.mark.parametrize(("part", "asked"), [*rows_of_form()])
def test_an_editor_refuses_what_the_reader_refuses_for_its_form(part, asked, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OpenLockError):
        eval(asked, vars(given))
    (path,) = tmp_path.iterdir()
    assert not editor(part).is_valid(plain(path))


@pytest.mark.parametrize("part", TABLES)
def test_bundled_files_are_valid_for_editors(part):
    stored = (ROOT / part / "schema.json").read_text(encoding="utf-8")
    assert stored == json.dumps(TABLES[part], indent=2) + "\n", "make json-schemas writes it anew"
    for path in sorted(bundled(part).glob("*.yaml")):
        text = path.read_text(encoding="utf-8")
        assert text.startswith("# yaml-language-server: $schema=./schema.json\n")
        editor(part).validate(plain(path))

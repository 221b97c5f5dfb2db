"""What a bundle says of itself: Croissant metadata that its validator takes, and a data card."""

from __future__ import annotations

import hashlib
import json
import shutil
import zipfile
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from causal_openlock.export.bundle import write_bundle
from causal_openlock.export.croissant import CONFORMS_TO
from causal_openlock.storage.store import Store
from support.documents import DOCS
from support.play_clients import people, walk_through


@pytest.fixture(scope="module")
def bundled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundle, unpacked, of two people who agreed and were asked."""
    folder = tmp_path_factory.mktemp("bundle")
    home = people(folder / "people", "CC3", practice=False, ask=True, consent="Yes.",
                  recruiting=["PID"])  # fmt: skip
    for number in range(2):
        name = home.join(agreed=home.consent_mark, recruited={"PID": f"pid{number}"})
        walk_through(home, name, 1)
        view = home.view(name)
        home.answer(name, view["turn"], [[view["levers"][0], 7]])
    home.close()
    (folder / "people" / "report.html").write_text("<html></html>")
    write_bundle(Store(folder / "people"), folder / "bundle.zip", "CC-BY-4.0")
    with zipfile.ZipFile(folder / "bundle.zip") as file:
        file.extractall(folder / "unpacked")
    return folder / "unpacked"


@pytest.fixture(scope="module")
def folder(bundled: Path) -> Path:
    return next(bundled.iterdir())


def test_every_file_and_column_is_in_the_metadata(folder: Path) -> None:
    metadata = json.loads((folder / "croissant.json").read_text())
    files = {one["@id"]: one for one in metadata["distribution"] if "sha256" in one}
    there = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert there - files.keys() == {"croissant.json"}
    assert files.keys() <= there
    for name, one in files.items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == one["sha256"], name
    sets = {one["@id"]: one["includes"] for one in metadata["distribution"] if "includes" in one}
    assert sets.keys() == {"cells-files", "reactions-files", "structures-files"}
    for table in metadata["recordSet"]:
        part = table["field"][0]["source"]["fileSet"]["@id"]
        columns = pq.read_table(next(folder.glob(sets[part]))).column_names
        assert [field["name"] for field in table["field"]] == columns
        assert all(field["description"] for field in table["field"])
    assert metadata["conformsTo"] == CONFORMS_TO
    assert metadata["license"] == "CC-BY-4.0"


def test_the_data_card_says_who_played_and_nobody_is_called_by_name(folder: Path) -> None:
    card = (folder / "DATA_CARD.md").read_text()
    assert "| person | CC3 | 2 | " in card
    assert "What they agreed to: results/consent_" in card
    assert "Licence: CC-BY-4.0." in card
    assert "`solutions_found`" in card
    everything = b"".join(path.read_bytes() for path in folder.rglob("*") if path.is_file())
    assert b"pid0" not in everything


def test_the_validator_of_croissant_finds_no_error(folder: Path) -> None:
    """``mlcroissant``; not in the test extra: it brings pandas' stubs, which change type checks."""
    mlcroissant = pytest.importorskip("mlcroissant")
    issues = mlcroissant.Dataset(jsonld=str(folder / "croissant.json")).metadata.ctx.issues
    assert issues.errors == set()
    assert not any("context" in warning for warning in issues.warnings)


def test_the_example_play_can_be_bundled(tmp_path: Path) -> None:
    shutil.copytree(DOCS / "example_play", tmp_path / "play")
    (tmp_path / "play" / "report.html").write_text("<html></html>")
    write_bundle(Store(tmp_path / "play"), tmp_path / "play.zip")
    with zipfile.ZipFile(tmp_path / "play.zip") as file:
        names = {name.partition("/")[2] for name in file.namelist()}
    assert {"croissant.json", "DATA_CARD.md", "README.md"} <= names
    assert not any("log.jsonl" in name for name in names)

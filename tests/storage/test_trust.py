"""Folders from somebody else: what they name is not run, and nothing outside them is reached."""

from __future__ import annotations

import re
import shutil
import sys
import zipfile
from collections.abc import Callable, Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from causal_openlock.cli import app
from causal_openlock.contract.registry import _learner_class, file_that_runs
from causal_openlock.errors import OpenLockError
from causal_openlock.export.bundle import write_bundle
from causal_openlock.files.checksums import json_bytes, read_json
from causal_openlock.storage.store import Store
from openlock_learners.networks.network_file import BUNDLED
from support.command import play_here

LEARNER = """
from pathlib import Path

from causal_openlock.contract.one_subject import OneSubjectLearner

with Path("imported").open("a") as file:
    file.write("once more\\n")


class Foreign(OneSubjectLearner):
    def act(self, observation):
        return 14
"""
EXPERIMENT = """
name: foreign
subjects: 1
conditions: [CC3]
protocol: quick
learners: ["a_foreign_learner:Foreign", random]
protocols:
  quick: {attempt_limit: 4, baseline_trials: 1, layouts: random}
"""


def run(*words: str) -> tuple[int, str]:
    """Exit status and output of a command; an error that the border would print is added."""
    with pytest.MonkeyPatch.context() as patch:
        play_here(patch)
        done = CliRunner().invoke(app, [*words])
    error = done.exception
    if error is not None and not isinstance(error, SystemExit | OpenLockError):
        raise error
    said = str(error) if isinstance(error, OpenLockError) else ""
    return (2 if said else done.exit_code), " ".join(f"{done.output} {said}".split())


def forge(folder: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    """Let ``experiment.json`` say something else, with the checksum that belongs to that."""
    path = folder / "experiment.json"
    held = read_json(path.read_bytes())
    change(held)
    path.write_bytes(json_bytes(held))


def forget() -> None:
    """Let the module of the learner be imported anew."""
    sys.modules.pop("a_foreign_learner", None)
    _learner_class.cache_clear()


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a learner that comes with no package."""
    folder = tmp_path_factory.mktemp("played")
    (folder / "a_foreign_learner.py").write_text(LEARNER)
    (folder / "mine.yaml").write_text(EXPERIMENT)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(sys, "path", [*sys.path])
        assert run("compare", "mine.yaml", "-o", "out")[0] == 0
    forget()
    return folder


@pytest.fixture
def folder(played: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A copy of it, to forge; the working directory is around it."""
    around = shutil.copytree(played, tmp_path / "made")
    (around / "imported").unlink()
    monkeypatch.chdir(around)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield around / "out"
    forget()


READING = (
    ("report", "out"),
    ("report", "other", "--beside", "out"),
    ("report", "other", "out"),
    ("export", "out"),
    ("export", "out", "-f", "minari"),
    ("bundle", "out"),
    ("film", "CC3", "-l", "random", "--from", "out", "-o", "film.svg"),
)


@pytest.mark.parametrize("words", READING, ids=" ".join)
def test_reading_results_runs_no_code_that_they_name(folder: Path, words: tuple[str, ...]) -> None:
    shutil.copytree(folder, folder.with_name("other"))
    forge(folder.with_name("other"), lambda held: held["learners"].reverse())
    status, said = run(*words)
    assert status == 0 or "both of these results" in said, said
    assert not Path("imported").exists()


@pytest.mark.parametrize("words", READING, ids=" ".join)
@pytest.mark.parametrize("name", ["../../secret.parquet", "/secret.parquet", "C:x.parquet", 3])
def test_a_cell_that_is_no_file_of_the_folder_is_not_read(
    folder: Path, words: tuple[str, ...], name: Any
) -> None:
    shutil.copytree(folder, folder.with_name("other"))
    shutil.copy(next((folder / "cells").glob("*.parquet")), folder.parent / "secret.parquet")
    forge(folder, lambda held: held["cells"].insert(0, name))
    status, said = run(*words)
    assert status == 2
    assert "lists" in said
    assert "among the cells, which is not a file in out/cells; do not use this folder" in said


def test_a_name_that_some_system_takes_for_a_path_is_no_cell(folder: Path) -> None:
    for name in ("a\\b.parquet", "..parquet", "a\0.parquet", "a\n.parquet", ".parquet", "passwd"):
        forge(folder, lambda held, name=name: held["cells"].insert(0, name))
        with pytest.raises(OpenLockError, match="among the cells"):
            Store(folder).experiment()
        forge(folder, lambda held: held["cells"].pop(0))
    Store(folder).experiment()


@pytest.mark.parametrize("inside", ["cells", "cells/CELL", "report.html", "summary.csv", ".lock"])
def test_a_link_out_of_the_folder_is_not_followed(folder: Path, inside: str) -> None:
    cell = next((folder / "cells").glob("*.parquet"))
    place = folder / inside.replace("CELL", cell.name)
    elsewhere = folder.parent / "elsewhere"
    if place.exists():
        place.rename(elsewhere)
    else:
        elsewhere.write_text("mine")
    place.symlink_to(elsewhere)
    before = {path: path.stat().st_size for path in [elsewhere, *elsewhere.glob("*")]}
    for words in (*READING, ("compare", "mine.yaml", "-o", "out")):
        if "other" in words:
            continue
        status, said = run(*words)
        assert status == 2, words
        assert f"out/{inside.replace('CELL', cell.name)} is a link that leads out of out" in said
    assert {path: path.stat().st_size for path in before} == before


def test_links_within_the_folder_and_to_it_are_good(folder: Path) -> None:
    (folder / "again.html").symlink_to("report.html")
    (folder.parent / "link").symlink_to("out")
    status, said = run("report", "link")
    assert status == 0, said


def members(path: Path) -> list[str]:
    with zipfile.ZipFile(path) as bundle:
        return bundle.namelist()


@pytest.mark.parametrize("name", ["../../evil", "/evil", "C:\\evil", "..", "", "CON", "a\r\nb"])
def test_whatever_things_are_called_a_bundle_unpacks_into_its_own_folder(
    folder: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    network = folder.parent / "net.npz"
    shutil.copy(BUNDLED, network)
    known = sha256(network.read_bytes()).hexdigest()[:16]

    def change(held: dict[str, Any]) -> None:
        held["name"] = held["conditions"][0]["name"] = held["learners"][0]["name"] = name
        held["learners"][1].update(name=name, material=known, parameters={name: str(network)})

    record = Store(folder).record(["learner", "condition", "subject", "phase"])
    forge(folder, change)
    with pytest.raises(OpenLockError, match="does not list"):
        write_bundle(Store(folder), "out.zip")
    # Without that check, and with cells that were forged, too:
    monkeypatch.setattr(Store, "record", lambda *_: record)
    write_bundle(Store(folder), "out.zip")
    found = members(Path("out.zip"))
    assert any(path.endswith("/net.npz") for path in found)
    (top,) = {path.partition("/")[0] for path in found}
    for path in found:
        parts = path.split("/")
        assert parts[0] == top
        assert all(re.fullmatch(r"(?!CON$)[\w+-][\w.+ -]*", part, re.ASCII) for part in parts)
        assert not {"..", "."} & {*parts}


def test_a_file_that_is_not_what_was_played_with_is_not_bundled(folder: Path) -> None:
    secret = folder.parent / "secret"
    secret.write_text("nobody else's business")

    def change(held: dict[str, Any]) -> None:
        held["learners"][1].update(material="0" * 16, parameters={"checkpoint": str(secret)})

    forge(folder, change)
    with pytest.raises(OpenLockError, match="is not the file that the results were made with"):
        write_bundle(Store(folder), "out.zip")
    assert not Path("out.zip").exists()
    forge(folder, lambda held: held["learners"][1].update(material=""))
    write_bundle(Store(folder), "out.zip")
    assert not [path for path in members(Path("out.zip")) if "secret" in path]


def test_source_that_is_not_what_was_played_with_is_not_bundled(folder: Path) -> None:
    """Neither another file of that name, nor one that its description alone points to."""
    place = folder.parent / "private"
    place.mkdir()
    (place / "notes.py").write_text("secret = 1\n")
    (place / "notes.yaml").write_text("")

    def change(held: dict[str, Any]) -> None:
        held["command"] = f"causal-openlock compare {place}/notes.yaml"
        held["learners"][0].update(learner="notes:N", package="notes.py 0123456789abcdef")
        held["learners"][0]["class"] = "notes:N"

    forge(folder, change)
    with pytest.raises(OpenLockError, match="notes:N is not what the results were made with"):
        write_bundle(Store(folder), "out.zip")


def test_what_a_learner_imports_is_bundled_only_if_it_is_python_of_its_folder(
    folder: Path,
) -> None:
    away = folder.parent.parent / "away"
    away.mkdir()
    (away / "key.txt").write_text("a private key, which is not Python\n")
    (away / "code.py").write_text("secret = 1\n")
    source = "import keys\nimport linked\n"
    Path("a_foreign_learner.py").write_text(source)
    Path("linked.py").symlink_to(away / "code.py")
    digest = sha256(source.encode()).hexdigest()[:16]
    package = f"a_foreign_learner.py {digest}"
    forge(folder, lambda held: held["learners"][0].update(package=package))
    write_bundle(Store(folder), "out.zip")
    assert not [path for path in members(Path("out.zip")) if "linked" in path]
    Path("keys.py").write_text((away / "key.txt").read_text())
    with pytest.raises(OpenLockError, match=r"keys\.py is imported and cannot be read as Python"):
        write_bundle(Store(folder), "second.zip")


def test_what_pip_is_told_to_install_are_packages(folder: Path) -> None:
    for package in ("--index-url=http://x 1", "evil 1\n--pre", "evil 1;x", "./evil 1"):
        forge(folder, lambda held, told=package: held["learners"][1].update(package=told))
        with pytest.raises(OpenLockError, match="which is not a version of a package"):
            write_bundle(Store(folder), "out.zip")


@pytest.mark.parametrize("words", READING[-3:], ids=" ".join)
@pytest.mark.parametrize(
    "change",
    [
        lambda held: held["conditions"][0].update(train=[{"schema": 3}]),
        lambda held: held["learners"][1]["protocol"].update(odd=1),
        lambda held: held["learners"][1].update(reward={"name": "x"}),
        lambda held: held.pop("cell_size"),
    ],
)
def test_a_description_of_another_form_is_a_sentence_or_does_no_harm(
    folder: Path, words: tuple[str, ...], change: Callable[[dict[str, Any]], Any]
) -> None:
    forge(folder, change)
    assert run(*words)[0] in (0, 2)


def test_cells_of_what_the_description_does_not_list_are_refused(folder: Path) -> None:
    def rename(held: dict[str, Any]) -> None:
        held["conditions"][0]["name"] = "elsewhere"

    forge(folder, rename)
    status, output = run("report", str(folder))
    assert status == 2
    assert "does not list" in output


def test_compare_says_once_which_file_runs_before_it_does(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = Path("a_foreign_learner.py")
    told = f"a_foreign_learner.py in {folder.parent} will run as learner Foreign"
    source.write_text(LEARNER + "\nprint('it runs')\n")
    (folder.parent / "away").mkdir()
    monkeypatch.chdir(folder.parent / "away")
    status, said = run("compare", "../mine.yaml", "-o", "again")
    assert status == 0, said
    assert said.count(told) == 1
    assert said.index(told) < said.index("it runs")
    forget()
    monkeypatch.chdir(folder.parent)
    status, said = run("compare", "-l", "a_foreign_learner:Foreign", "-c", "CC3", "--subjects", "1")
    assert status == 0, said
    assert "will run" not in said  # whoever types it knows


def test_code_of_installed_packages_and_of_this_one_runs_without_a_word(tmp_path: Path) -> None:
    for name in (
        "random",
        "openlock_learners.random:RandomLearner",
        "networkx.classes:Graph",
        "nowhere:X",
    ):
        assert file_that_runs(name, tmp_path) is None
    (tmp_path / "parts_of_mine").mkdir()
    (tmp_path / "parts_of_mine" / "__init__.py").write_text("raise SystemExit('it ran')\n")
    (tmp_path / "parts_of_mine" / "inner.py").write_text("raise SystemExit('it ran')\n")
    said = file_that_runs("parts_of_mine.inner:Outer.Inner", tmp_path)
    assert said == f"inner.py in {tmp_path}/parts_of_mine will run as learner Outer.Inner"

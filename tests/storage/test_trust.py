"""Folders from somebody else: what they name is not run, and nothing outside them is reached."""

import re
import shutil
import sys
import zipfile
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import pytest

from causal_openlock.errors import OpenLockError
from causal_openlock.export.bundle import write_bundle
from causal_openlock.storage.store import Store
from support.command import at_once, modules_of
from support.made_up_experiments import edit_stored

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


def run(*words):
    """Exit status of a command, and what it says, in one line."""
    done = at_once(*words)
    return done.status, " ".join(f"{done.stdout} {done.stderr}".split())


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """Results of a learner that comes with no package."""
    folder = tmp_path_factory.mktemp("played")
    (folder / "a_foreign_learner.py").write_text(LEARNER)
    (folder / "mine.yaml").write_text(EXPERIMENT)
    with pytest.MonkeyPatch.context() as patch, modules_of(folder):
        patch.chdir(folder)
        patch.setattr(sys, "path", [*sys.path])
        assert run("compare", "mine.yaml", "-o", "out")[0] == 0
    return folder


@pytest.fixture
def folder(played, tmp_path, monkeypatch):
    """A copy of it, to forge; the working directory is around it."""
    around = shutil.copytree(played, tmp_path / "made")
    (around / "imported").unlink()
    monkeypatch.chdir(around)
    monkeypatch.setattr(sys, "path", [*sys.path])
    with modules_of(tmp_path):
        yield around / "out"


READING = (
    ("report", "out"),
    ("report", "other", "--beside", "out"),
    ("report", "other", "out"),
    ("export", "out"),
    ("bundle", "out"),
    ("film", "CC3", "-l", "random", "--from", "out", "-o", "film.svg"),
)


@pytest.mark.parametrize("words", READING, ids=" ".join)
def test_reading_results_runs_no_code_that_they_name(folder, words):
    shutil.copytree(folder, folder.with_name("other"))
    edit_stored(folder.with_name("other"), lambda held: held["learners"].reverse())
    status, said = run(*words)
    assert status == 0 or "both of these results" in said, said
    assert not Path("imported").exists()


@pytest.mark.parametrize("words", READING, ids=" ".join)
def test_a_cell_that_is_no_file_of_the_folder_is_not_read(folder, words):
    shutil.copytree(folder, folder.with_name("other"))
    shutil.copy(next((folder / "cells").glob("*.parquet")), folder.parent / "secret.parquet")
    edit_stored(folder, lambda held: held["cells"].insert(0, "../../secret.parquet"))
    status, said = run(*words)
    assert status == 2
    assert "'out/cells/../../secret.parquet' leads out of out" in said


@pytest.mark.parametrize(
    "name",
    ["/a.parquet", "../../a.parquet", "x/../../../a\0.parquet"],
)
def test_a_name_that_leads_out_of_the_folder_is_no_cell(folder, name):
    edit_stored(folder, lambda held: held["cells"].insert(0, name))
    with pytest.raises(OpenLockError, match="leads out of"):
        Store(folder).experiment()


@pytest.mark.parametrize("inside", ["cells", "cells/CELL", "report.html", ".lock"])
def test_a_link_out_of_the_folder_is_not_followed(folder, inside):
    cell = next((folder / "cells").glob("*.parquet"))
    inside = inside.replace("CELL", cell.name)
    elsewhere = folder.parent / "elsewhere"
    if (folder / inside).exists():
        (folder / inside).rename(elsewhere)
    else:
        elsewhere.write_text("mine")
    (folder / inside).symlink_to(elsewhere)
    before = {path: path.stat().st_size for path in [elsewhere, *elsewhere.glob("*")]}
    for words in (*READING, ("compare", "mine.yaml", "-o", "out")):
        if "other" not in words:
            status, said = run(*words)
            assert status == 2, words
            assert f"'out/{inside}' leads out of out" in said
    assert {path: path.stat().st_size for path in before} == before


def test_links_within_the_folder_and_to_it_are_good(folder):
    (folder / "again.html").symlink_to("report.html")
    (folder.parent / "link").symlink_to("out")
    assert run("report", "link")[0] == 0


def members(path="out.zip"):
    with zipfile.ZipFile(path) as bundle:
        return bundle.namelist()


@pytest.mark.parametrize("name", ["../../evil", "/evil", "C:\\evil", "..", "CON", "a\r\nb"])
def test_whatever_things_are_called_a_bundle_unpacks_into_its_own_folder(folder, name, monkeypatch):
    def change(held):
        held["name"] = held["conditions"][0]["name"] = held["learners"][0]["name"] = name
        held["learners"][1].update(name=name)

    record = Store(folder).record()
    (code,) = (folder / "code").glob("*/a_foreign_learner.py")
    (code.parent / "CON").mkdir()
    (code.parent / "CON" / "a\nb.py").touch()
    edit_stored(folder, change)
    with pytest.raises(OpenLockError, match="does not list"):
        write_bundle(Store(folder), "out.zip")
    # Without that check, and with cells that were forged, too:
    experiment = replace(record[1], name=name)
    monkeypatch.setattr(Store, "record", lambda *_: (record[0], experiment))
    monkeypatch.setattr("causal_openlock.export.bundle._has_report", lambda _: True)
    write_bundle(Store(folder), "out.zip")
    assert any(path.endswith("/_CON/a_b.py") for path in members())
    assert len({path.partition("/")[0] for path in members()}) == 1
    for path in members():
        for part in path.split("/"):
            assert re.fullmatch(r"(?!CON$)[\w+-][\w.+ -]*", part, re.ASCII), path


def test_nothing_from_outside_the_folder_is_bundled(folder):
    """Neither a file that a parameter names, nor source that an experiment points to."""
    secret = folder.parent / "secret"
    secret.write_text("nobody else's business")
    (folder.parent / "notes.py").write_text("secret = 1\n")
    known = sha256(secret.read_bytes()).hexdigest()[:16]

    def change(held):
        held["command"] = f"causal-openlock compare {folder.parent}/notes.yaml"
        held["learners"][0].update(learner="notes:N", package=f"../../notes.py {known}")
        held["learners"][0]["class"] = "notes:N"
        held["learners"][1].update(material=known, parameters={"checkpoint": str(secret)})

    edit_stored(folder, change)
    (warning,) = write_bundle(Store(folder), "out.zip")
    assert "lacks notes:N" in warning
    assert not [path for path in members() if "secret" in path or "notes" in path]


@pytest.mark.parametrize("package", ["--index-url=http://x 1", "a 1\n--pre", "a 1;x", "./a 1"])
def test_what_pip_is_told_to_install_are_packages(folder, package, monkeypatch):
    monkeypatch.setattr("causal_openlock.export.bundle._has_report", lambda _: True)
    edit_stored(folder, lambda held: held["learners"][1].update(package=package))
    with pytest.raises(OpenLockError, match="which is not a version of a package"):
        write_bundle(Store(folder), "out.zip")


def test_compare_says_once_which_file_runs_before_it_does(folder, monkeypatch, capsys):
    told = f"a_foreign_learner.py in {folder.parent} will run as learner Foreign"
    Path("a_foreign_learner.py").write_text(LEARNER + "\nprint('it runs')\n")
    (folder.parent / "away").mkdir()
    monkeypatch.chdir(folder.parent / "away")
    with modules_of(folder.parent):
        status, said = run("compare", "../mine.yaml", "-o", "again")
    assert status == 0, said
    assert said.count(told) == 1
    monkeypatch.chdir(folder.parent)
    with modules_of(folder.parent):
        status, said = run(
            *("compare", "-l", "a_foreign_learner:Foreign", "-c", "CC3", "--subjects", "1")
        )
    assert status == 0, said
    assert "will run" not in said  # whoever types it knows

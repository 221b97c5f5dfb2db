"""Bundles: what is in them, and that their one command runs the experiment again."""

import re
import shlex
import shutil
import zipfile
from contextlib import chdir
from pathlib import Path

import pytest

import causal_openlock as ol
from causal_openlock.errors import StoreError
from causal_openlock.experiment.making import read_experiment
from causal_openlock.export.bundle import write_bundle
from causal_openlock.storage.store import Store
from openlock_learners.trained_file import BUNDLED
from support.command import at_once, modules_of
from support.made_up_experiments import edit_stored
from support.play_clients import people, walk_through

pytestmark = pytest.mark.slow

LEARNER = """
from dataclasses import dataclass

from causal_openlock.contract.one_subject import OneSubjectLearner


@dataclass(frozen=True)
class Parameters:
    stays: float = 0.5


class Mine(OneSubjectLearner):
    Parameters = Parameters

    def act(self, observation):
        stays = self.generator.random() < self.parameters.stays
        return 14 if stays else int(self.generator.integers(15))
"""
SCHEMA = """
name: two_ways
title: 'Two ways: "either" will do'
levers: [L0, L1, L2]
edges:
  L0: [L1]
  L1: [door]
  L2: {door: {strength: 0.8}}
"""
EXPERIMENT = """
name: own_everything
title: "Own: schema, learner & protocol"
seed: 5
subjects: 3
cell_size: 2
reward: [basic, state_change]
conditions:
  - two_ways
  - CC3-CE4
  - name: spelled.out
    train:
      - {schema: CC3, layouts: random, trials: 2}
      - {schema: two_ways, layouts: [{L0: LEFT, L1: UPPER, L2: LOWER}, trial1], shuffle: false}
    test: [{schema: CE4, layouts: [trial7]}]
  - {name: watched, train: {shown: CC3}, test: [{schema: CE4}]}
learners:
  - oracle
  - {learner: "a_bundled_learner:Mine", name: mine, parameters: {stays: 0.25}, protocol: quick}
  - {learner: random, reward: authors_2018, subjects: 2}
protocols:
  quick: {based_on: rl, attempt_limit: 9, baseline_loops: 1, train_loops: 1, test_loops: 1,
    layouts: random}
"""


def done(*words, **options):
    """What a command prints that ends well."""
    ended = at_once(*words, **options)
    assert ended.status == 0, ended.stdout + ended.stderr
    return " ".join((ended.stdout + ended.stderr).split())


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """A folder with an experiment of everything one's own, its results, and their bundle."""
    folder = tmp_path_factory.mktemp("played")
    (folder / "a_bundled_learner.py").write_text(LEARNER)
    (folder / "two_ways.yaml").write_text(SCHEMA)
    (folder / "mine.yaml").write_text(EXPERIMENT)
    with chdir(folder), modules_of(folder):
        done("compare", "mine.yaml", "-o", "out")
        assert "warning" not in done("bundle", "out", "-o", "own.zip")
    return folder


@pytest.fixture
def made(played, tmp_path, monkeypatch):
    """A copy of it, to be in and to change."""
    folder = shutil.copytree(played, tmp_path / "made")
    monkeypatch.chdir(folder)
    with modules_of(folder):
        yield folder


def names_in(path):
    with zipfile.ZipFile(path) as bundle:
        return {name.partition("/")[2] for name in bundle.namelist()}


def test_the_one_command_of_a_bundle_gives_the_same_summary(made, monkeypatch):
    zipfile.ZipFile("own.zip").extractall("elsewhere")
    for name in ("a_bundled_learner.py", "two_ways.yaml"):
        (made / name).unlink()  # what is not in the bundle is not there
    monkeypatch.chdir(made / "elsewhere" / "own_everything")
    commands = re.findall(r"^    (causal-openlock .+)$", Path("README.md").read_text("utf-8"), re.M)
    (command,) = commands
    done(*shlex.split(command)[1:])
    assert Path("again/summary.csv").read_bytes() == Path("results/summary.csv").read_bytes()
    again, first = (Store(Path(name)).experiment() for name in ("again", "results"))
    assert again.identity == first.identity
    assert again.files == first.files
    said = done("report", "results", "again", "--out", "beside")
    assert "12 are the same, subject by subject" in said
    assert Path("beside/difference_again.html").exists()


def test_a_bundle_holds_everything_and_nothing_else_and_is_the_same_every_time(made):
    names = names_in("own.zip")
    results = {name.removeprefix("results/") for name in names if name.startswith("results/")}
    assert names - {f"results/{name}" for name in results} == {
        *("README.md", "experiment.yaml", "requirements.txt"),
        "a_bundled_learner.py",
        *(f"schemas/{name}.yaml" for name in ("two_ways", "CC3", "CE4")),
    }
    assert {"experiment.json", "report.html", "summary.csv"} <= results
    assert sum(name.startswith("cells/") for name in results) == 20
    assert not any(name.startswith(("figures/", "tables/")) for name in results)
    with zipfile.ZipFile("own.zip") as bundle:
        packages = bundle.read("own_everything/requirements.txt").decode()
        card = bundle.read("own_everything/README.md").decode()
        declared = bundle.read("own_everything/experiment.yaml").decode()
    assert "edges" not in declared  # schemas are named, and stand beside it
    assert re.search(r"^# Python \d", packages, re.M)
    assert re.search(r"^numpy==[\d.]+$", packages, re.M)
    assert "`solutions_found`" in card
    (made / "out" / "notes.txt").write_text("nobody else's business")
    write_bundle(Store(made / "out"), made / "second.zip")
    assert (made / "second.zip").read_bytes() == (made / "own.zip").read_bytes()


def test_the_code_is_that_of_the_run_wherever_it_is_now(made):
    (made / "a_bundled_learner.py").write_text(LEARNER + "\n# changed\n")
    write_bundle(Store(made / "out"), made / "other.zip")
    assert (made / "other.zip").read_bytes() == (made / "own.zip").read_bytes()
    (stored,) = (made / "out" / "code").glob("a_bundled_learner_*/*.py")
    stored.write_text("import os\n")
    with pytest.raises(StoreError, match="is not the source of a_bundled_learner:Mine"):
        write_bundle(Store(made / "out"), made / "third.zip")
    assert not (made / "third.zip").exists()
    shutil.rmtree(stored.parent)
    (warning,) = write_bundle(Store(made / "out"), made / "third.zip")
    assert warning == "mine: the results folder lacks a_bundled_learner:Mine; add its source."


def test_a_report_older_than_the_record_is_written_anew(made):
    store = Store(made / "out")
    page, summary = store.folder / "report.html", store.folder / "summary.csv"
    report, numbers = page.read_bytes(), summary.read_bytes()
    for old in (None, report.replace(store.digest().encode(), b"0" * 16)):
        page.unlink() if old is None else page.write_bytes(old)
        summary.write_text("old")
        write_bundle(store, made / "other.zip")
        assert (page.read_bytes(), summary.read_bytes()) != (old, b"old")
        assert store.digest() in page.read_text("utf-8")
        assert summary.read_bytes() == numbers


def test_modules_that_a_learner_imports_are_bundled_and_run_again(tmp_path, monkeypatch):
    """Beside the experiment file, in a folder with a dot in its name; run from elsewhere."""
    beside, away = tmp_path / "lab-0.5", tmp_path / "away"
    (beside / "parts_of_it").mkdir(parents=True)
    away.mkdir()
    act = "    def act(self, observation):\n"
    lazy = LEARNER.replace(act, f"{act}        from helping import constant\n")
    files = {
        "a_bundled_learner.py": f"{lazy}\nimport networkx, pytest\n",
        "helping.py": "from parts_of_it import deep\nconstant = deep.constant\n",
        "parts_of_it/__init__.py": "",
        "parts_of_it/deep.py": "from . import deeper\nconstant = 1\n",
        "parts_of_it/deeper.py": "import json\n",
    }
    for name, text in files.items():
        (beside / name).write_text(text)
    (beside / "mine.yaml").write_text(
        "name: helped\nsubjects: 2\ncell_size: 1\nconditions: [CC3]\n"
        "learners: ['a_bundled_learner:Mine']\n"
    )
    monkeypatch.chdir(away)
    with modules_of(beside):
        done("compare", beside / "mine.yaml", "-o", "run-0.5")
    done("bundle", "run-0.5")
    names = names_in(away / "run-0.5.zip")
    assert {name for name in names if name.endswith(".py")} == {*files}
    zipfile.ZipFile(away / "run-0.5.zip").extractall(tmp_path / "unpacked")
    shutil.rmtree(beside)
    monkeypatch.chdir(tmp_path / "unpacked" / "helped")
    with modules_of(tmp_path):
        done("compare", "experiment.yaml", "-o", "again")
    assert Path("again/summary.csv").read_bytes() == Path("results/summary.csv").read_bytes()


def test_files_that_parameters_name_are_stored_and_run_again(tmp_path, monkeypatch):
    shutil.copy(BUNDLED, tmp_path / "mine.npz")
    monkeypatch.chdir(tmp_path)
    learner = ol.learner("rl2", checkpoint="mine.npz")
    ol.compare(["CC3"], [learner], subjects=1, out="out", workers=0)
    (tmp_path / "mine.npz").write_bytes(b"another")
    write_bundle(Store("out"), "own.zip")
    zipfile.ZipFile("own.zip").extractall()
    (stored,) = tmp_path.glob("comparison/files/rl2/checkpoint/mine.npz")
    assert stored.read_bytes() == BUNDLED.read_bytes()
    (spec,) = read_experiment(stored.parents[3] / "experiment.yaml").learners
    assert spec.parameters["checkpoint"] == "files/rl2/checkpoint/mine.npz"


def test_what_is_unfinished_is_not_bundled(made):
    next((made / "out" / "cells").glob("*.parquet")).unlink()
    with pytest.raises(StoreError, match="unfinished, 1 cell missing"):
        write_bundle(Store(made / "out"), made / "other.zip")


def test_results_of_another_version_are_bundled_with_a_warning(made):
    edit_stored(made / "out", lambda held: held.update(version="9.0"))
    (warning,) = write_bundle(Store(made / "out"), made / "other.zip")
    assert "9.0" in warning
    with zipfile.ZipFile(made / "other.zip") as bundle:
        assert warning in bundle.read("own_everything/README.md").decode()


def test_a_bundle_of_people_has_their_data_and_nobodys_identity(tmp_path):
    """Recruited and the log never get in."""
    home = people(
        tmp_path / "people", "CC3", practice=False, ask=True, consent="Yes.", recruiting=["PID"]
    )
    for number in range(2):
        name = home.join(agreed=home.consent_mark, recruited={"PID": f"pid{number}"})
        walk_through(home, name, 1)
        view = home.view(name)
        home.take(name, view["turn"], edges=[(view["levers"][0], 7)])
    home.close()
    write_bundle(Store(tmp_path / "people"), tmp_path / "bundle.zip", "CC-BY-4.0")
    zipfile.ZipFile(tmp_path / "bundle.zip").extractall(tmp_path / "unpacked")
    (folder,) = (tmp_path / "unpacked").iterdir()
    there = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert b"pid0" not in b"".join((folder / name).read_bytes() for name in there)
    assert not any("log" in name or "recruited" in name for name in there)
    tables = {name.split("/")[1] for name in there if name.endswith(".parquet")}
    assert tables == {"cells", "reactions", "structures"}
    card = (folder / "README.md").read_text()
    assert "| person | CC3 | 2 | " in card
    assert "results/consent_" in card
    assert "Licence: CC-BY-4.0." in card

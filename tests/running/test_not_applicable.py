"""What a learner cannot play is left out, and is no failure: a dash, and the reason once."""

import json

import pytest

import causal_openlock as ol
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.file import read_experiment
from causal_openlock.files.digest import digest
from causal_openlock.schemas.schema import Schema
from causal_openlock.storage.store import Store
from support.command import at_once, modules_of
from support.html_page import Page

pytestmark = pytest.mark.slow

BRANCHES = {"L0": ["L1", "L2", "L3"], "L1": ["L4", "L5"], "L2": ["L6", "L7"], "L3": ["L8", "L9"]}
LEAVES = [f"L{leaf}" for leaf in range(4, 10)]
TREE = Schema("tree10", [*BRANCHES, *LEAVES], {**BRANCHES, **{leaf: ["door"] for leaf in LEAVES}})
WHY = (
    "ideal cannot play in rooms of tree10: its levers can be placed in 453,600 ways, too many to "
    "list"
)
FILE = """\
name: wide
seed: 1
subjects: 1
protocols: {quick: {based_on: human, baseline_trials: 1, attempt_limit: 2}}
protocol: quick
conditions: [tree10.yaml]
learners: [random, ideal]
"""
LIMITED = """\
from causal_openlock import OneSubjectLearner

class Limited(OneSubjectLearner):
    @classmethod
    def cannot_play(cls, parameters, schema, action_limit):
        return ANSWER

    def act(self, observation):
        return 0
"""


def written(folder, text=FILE):
    (folder / "tree10.yaml").write_text(TREE.to_yaml(), encoding="utf-8")
    path = folder / "wide.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """The results folder, and what was said when it was played first."""
    file = written(tmp_path_factory.mktemp("wide"))
    out = file.parent / "out"
    return out, at_once("compare", file, "--out", out, cwd=file.parent)


def test_a_learner_is_left_out_with_the_reason_once_and_the_folder_is_complete(played):
    out, first = played
    assert first.status == 0, first.stderr
    said = " ".join((first.stdout + first.stderr).split())
    assert said.count("cannot play") == 1
    assert WHY in said
    assert "1 of 1 cells done" in said
    (row,) = [line for line in first.stdout.splitlines() if line.startswith("ideal")]
    assert {*row.split()[1:]} == {"–"}
    stored = json.loads((out / "experiment.json").read_bytes())
    assert stored["not_applicable"] == {"ideal": {"tree10": WHY}}
    assert len(Store(out).experiment().cells()) == 1
    again = at_once("compare", out.parent / "wide.yaml", "--out", out, cwd=out.parent)
    assert "1 of 1 cells were there already" in again.stdout
    assert "over" in at_once("status", out).stdout


def test_tables_have_a_dash_and_the_reason_once(played):
    out, _ = played
    results = ol.open_results(out)
    ideal = results.leaderboard.set_index("learner").loc["ideal"]
    assert (ideal["conditions"], ideal["subjects"]) == (0, 0)
    assert ideal[["solved", "attempts", "found", "median"]].isna().all()
    assert results.by_condition[0].rows["ideal"] == (None,)
    assert results.warnings[0] == f"Not applicable (–): {WHY}."
    page = Page((out / "report.html").read_text("utf-8")).text
    assert "not applicable" in page
    for said in (str(results), page, " ".join(at_once("report", out).stdout.split())):
        assert said.count("cannot play") == 1


def test_others_of_its_conditions_are_played():
    made = ol.make_experiment([TREE, "CC3", ["CC3", TREE]], ["random", "ideal"], subjects=1)
    assert [cell.in_words for cell in made.cells()] == [
        "random in tree10, subject 0",
        "random in CC3, subject 0",
        "random in CC3-tree10, subject 0",
        "ideal in CC3, subject 0",
    ]
    assert made.not_applicable == {"ideal": {"tree10": WHY, "CC3-tree10": WHY}}
    assert made.reasons == (WHY,)


@pytest.mark.parametrize(
    ("answer", "named"),
    [
        ("'it has a table of 7'", "Limited cannot play in rooms of tree10: it has a table of 7"),
        ("1 / 0", "cannot_play of .*Limited fails.*ZeroDivision"),
        ("None", "cannot_play of .*Limited has to return a text"),
    ],
)
def test_a_learner_of_ones_own_says_it_too(answer, named, tmp_path, monkeypatch):
    code = LIMITED.replace("ANSWER", answer)
    module = f"limits_{digest(code)}"
    (tmp_path / f"{module}.py").write_text(code, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    text = FILE.replace("random, ideal", f"{module}:Limited")
    with modules_of(tmp_path), pytest.raises(LearnerError, match=named):
        ol.run(read_experiment(written(tmp_path, text)), tmp_path / "out")

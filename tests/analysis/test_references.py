"""References: registered ones, and results folders, stand beside those who did what they did."""

from dataclasses import replace

import pytest
from scipy.stats import ttest_ind

import causal_openlock as ol
from causal_openlock.analysis.measures import judged
from causal_openlock.analysis.results.references import POINT_COLUMNS
from causal_openlock.experiment.making import find_experiment, read_experiment
from causal_openlock.files.plugins import REFERENCES, registered
from support.command import at_once
from support.imported import imported, rows
from support.packages import register

CONDITIONS = ["CC4", "CC3-CC4", "CE3-CC4"]
EXPERIMENT = read_experiment(find_experiment("deep_quick"))


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    folder = tmp_path_factory.mktemp("played") / "learners"
    ol.compare(CONDITIONS, ["oracle", "random"], subjects=3, workers=0, out=folder)
    return folder


@pytest.mark.parametrize("name", sorted(registered(REFERENCES)))
def test_every_registered_reference_keeps_to_the_contract(name):
    reference = registered(REFERENCES)[name].load()()
    assert reference.points.columns.tolist() == POINT_COLUMNS
    assert (reference.points["subjects"] > 0).all()
    assert (reference.points["se"] >= 0).all()
    cells = reference.within(EXPERIMENT).cells
    assert cells
    assert cells < {
        (spec.name, condition.name, spec.protocol.name)
        for spec in EXPERIMENT.learners
        for condition in EXPERIMENT.conditions
    }
    assert not reference.within(replace(EXPERIMENT, conditions=())).cells


def test_own_people_stand_where_the_papers_do_and_are_tested_from_their_subjects(tmp_path):
    people = imported(tmp_path, *[rows(n, n % 3 > 0, 60.0) for n in range(6)])
    asked = {"subjects": 6, "workers": 0, "out": tmp_path / "x"}
    results = ol.compare(["CE3"], ["random", "win_stay"], beside=people, **asked)
    assert (results.people, results.learners[0]) == (("person",), "person")
    board = results.leaderboard.set_index("learner")
    assert board.index[board["reference"]].tolist() == ["person"]
    assert board["best"].unique().tolist() == ["win_stay"]
    each = judged(results.trials).groupby(["learner", "subject"], observed=True)["attempts"].mean()
    theirs = ttest_ind(each["win_stay"], each["person"], equal_var=False)
    row = board.loc["win_stay"]
    assert row["to_person"] == pytest.approx(each["win_stay"].mean() - each["person"].mean())
    ends = theirs.confidence_interval()
    assert row[["to_person_low", "to_person_high"]].tolist() == pytest.approx([*ends])
    (shown,) = results.by_condition
    looks = [shown.looks.get(row) for row in range(len(shown.frame))]
    assert looks == ["ideal", "published", None, None]
    assert shown.frame["Learner"].tolist()[1] == "person\nn = 6"
    assert (ol.open_results(people) + ol.open_results(tmp_path / "x")).people == ("person",)
    alone = ol.open_results(people)
    assert (alone.people, alone.leaderboard["reference"].tolist()) == ((), [False])


def test_a_package_registers_one(played, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "a_reference.py").write_text(
        "import pandas as pd\n"
        "from causal_openlock.analysis.results.references import POINT_COLUMNS, Reference\n"
        "def novices():\n"
        "    points = pd.DataFrame([('CC4', 'train', 5, 9, 12.5, 0.5)], columns=POINT_COLUMNS)\n"
        "    return Reference('novices', points, lambda spec, condition: True)\n"
    )
    register(tmp_path, "novices", REFERENCES, novices="a_reference:novices")
    ranked = ol.open_results(played).leaderboard.set_index("learner")
    assert ranked.loc["novices", ["conditions", "subjects"]].tolist() == [1, 9]
    frame = ol.open_results(played).by_condition[0].frame.set_index("Learner")
    assert frame.loc["novices\nn = 9", "CC4\ntrial 5"] == "≥ 12.50\n± 0.50"


def test_a_folder_that_is_none_is_refused_before_anything_is_played(tmp_path):
    out = tmp_path / "out"
    asked = ["compare", "-c", "CC3", "-l", "oracle", "--subjects", 1, "--out", out]
    done = at_once(*asked, "--beside", tmp_path / "none")
    assert (done.status, str(tmp_path) in done.stderr) == (2, True)
    assert not out.exists()

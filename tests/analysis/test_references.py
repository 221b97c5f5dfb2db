"""References: registered ones, and results folders, stand beside those who did what they did."""

import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

import causal_openlock as ol
from causal_openlock.analysis.results.references import (
    POINT,
    POINT_COLUMNS,
    Reference,
    find_references,
    references_beside,
)
from causal_openlock.analysis.topics.leaderboard import leaderboard_tables
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.file import find_experiment, read_experiment
from causal_openlock.files.plugins import REFERENCES, registered
from support.command import at_once
from support.packages import register

CONDITIONS = ["CC4", "CC3-CC4", "CE3-CC4"]
EXPERIMENT = read_experiment(find_experiment("deep_quick"))


@pytest.fixture(scope="module")
def mine(tmp_path_factory):
    """A results folder that stands for people of one's own."""
    folder = tmp_path_factory.mktemp("mine") / "visitors"
    ol.compare(CONDITIONS, ["win_stay"], subjects=4, workers=0, seed=3, out=folder)
    return folder


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    folder = tmp_path_factory.mktemp("played") / "learners"
    ol.compare(CONDITIONS, ["oracle", "random"], subjects=3, workers=0, out=folder)
    return folder


@pytest.mark.parametrize("name", sorted(registered(REFERENCES)))
def test_every_registered_reference_keeps_to_the_contract(name):
    reference = registered(REFERENCES)[name].load()()
    assert reference.points.columns.tolist() == POINT_COLUMNS
    assert not reference.points.duplicated(POINT).any()
    assert (reference.points["subjects"] > 0).all()
    assert (reference.points["se"] >= 0).all()
    cells = reference.beside(EXPERIMENT).cells
    assert cells
    assert cells < {
        (spec.name, condition.name, spec.protocol.name)
        for spec in EXPERIMENT.learners
        for condition in EXPERIMENT.conditions
    }
    assert not reference.beside(replace(EXPERIMENT, conditions=())).cells


def test_a_folder_has_the_means_of_its_record(mine):
    (reference,) = find_references(mine)
    assert (reference.name, reference.prefix) == ("visitors", "visitors")
    trials = ol.open_results(mine).trials
    own = trials[(trials["condition"] == "CC4") & (trials["trial"] == 2)]["attempts"].to_numpy()
    row = reference.points.set_index(POINT).loc[("CC4", "train", 2)]
    assert row["subjects"] == len(own) == 4
    assert row["mean"] == pytest.approx(own.mean())
    assert row["se"] == pytest.approx(own.std() / np.sqrt(4))


def test_it_stands_beside_learners_in_tables_and_figures(mine, played, tmp_path):
    results, plain = ol.open_results(played, reference=f"guests={mine}"), ol.open_results(played)
    new = ["guests_attempts", "guests_se", "guests_difference"]
    pd.testing.assert_frame_equal(results.summary.drop(columns=new), plain.summary)
    means = results.given[0].points.set_index(POINT)["mean"]
    for row in results.summary.to_dict("records"):
        expected = means[row["condition"], row["phase"], row["trial"]]
        assert row["guests_attempts"] == pytest.approx(expected)
        assert row["guests_difference"] == pytest.approx(row["attempts"] - expected)
    ranked = results.leaderboard.set_index("learner")
    assert ranked.index[ranked["reference"]].tolist() == ["people", "guests"]
    gap = ranked.loc["random", "attempts"] - ranked.loc["guests", "attempts"]
    assert ranked.loc["random", "to_guests"] == pytest.approx(gap)
    (table,) = results.by_condition
    assert [*table.beside] == ["people", "published model", "guests", "ideal observer"]
    titles = [axes.get_title(loc="left") for axes in results.plot.transfer(ax=Figure())]
    assert titles == ["People", "Published model", "guests", "oracle", "random"]


def test_other_budgets_rooms_and_numbers_are_not_compared(mine):
    (reference,) = find_references(mine)
    experiment = ol.open_results(mine).experiment
    (spec,) = experiment.learners

    def conditions(**changes):
        other = replace(spec, protocol=replace(spec.protocol, **changes))
        cells = reference.beside(replace(experiment, learners=(other,))).cells
        return {condition for _, condition, _ in cells or ()}

    assert conditions() == conditions(name="mine", layouts="random") == {*CONDITIONS}
    assert conditions(attempt_limit=5) == conditions(action_limit=4) == set()
    assert conditions(test_loops=2) == conditions(training_trials=5) == {"CC4"}
    swapped = replace(experiment.conditions[0], train=experiment.conditions[1].train)
    assert not reference.comparable(spec, swapped)


def test_several_stand_side_by_side_and_without_people_each_learner_is_one(mine, played):
    results = ol.open_results(played, reference=[f"adults={mine}", f"old={played}"])
    names = ["adults", "old_oracle", "old_random"]
    assert {f"{name}_attempts" for name in names} <= {*results.summary}
    assert {f"to_{name}" for name in names} <= {*results.leaderboard}
    assert results.leaderboard.set_index("learner").loc["oracle", "to_old_oracle"] == 0
    one, other = (ol.open_results(folder, reference=mine) for folder in (played, mine))
    assert [reference.name for reference in (one + other).given] == ["visitors"]


def test_names_that_would_be_confused_are_refused(mine, played, tmp_path):
    taken = ["human", "People", "ideal", "pilot_p", "difference", "published model", "a_low"]
    for name in (*taken, "oracle"):
        with pytest.raises(OpenLockError, match=f"called {name}"):
            ol.open_results(played, reference=f"{name}={mine}")
    with pytest.raises(OpenLockError, match="two references are called visitors"):
        ol.open_results(played, reference=[mine, mine])
    shutil.copytree(mine, tmp_path / "people")
    assert [one.name for one in find_references(tmp_path / "people")] == ["own people"]


def test_what_a_reference_lacks_is_left_out_or_marked(played, tmp_path):
    empty = Reference("empty", pd.DataFrame(columns=POINT_COLUMNS), lambda *_: True)
    results = ol.open_results(played, reference=empty)
    assert not [name for name in results.summary if name.startswith("empty")]
    ol.compare("CC4", ["random"], subjects=2, workers=0, seed=5, out=tmp_path / "slow")
    results = ol.open_results(played, reference=tmp_path / "slow")
    shown = leaderboard_tables(results.leaderboard)["human"].frame.set_index("Learner")
    # It played one of three conditions, and its mean is of that one.
    assert shown.loc["slow", ["Conditions", "Attempts"]].tolist() == ["1", "> 30"]
    assert "More than slow" not in shown
    (shown,) = results.by_condition
    (cells,) = [cells for one, cells in shown.references.items() if one.name == "slow"]
    assert cells[0] == (30.0, None, 0.0)
    ol.compare("CC4", ["oracle", "random"], subjects=3, workers=0, out=tmp_path / "played")
    alone = ol.open_results(tmp_path / "played", reference=tmp_path / "slow")
    shown = leaderboard_tables(alone.leaderboard)["human"].frame.set_index("Learner")
    assert shown.loc["oracle", "More than slow"] == "−27.00"
    ol.compare(CONDITIONS, ["win_stay"], subjects=1, workers=0, out=tmp_path / "one")
    row = ol.open_results(played, reference=tmp_path / "one").leaderboard.set_index("learner")
    assert np.isfinite(row.loc["random", "to_one"])
    assert np.isnan(row.loc["random", "to_one_low"])  # of one person there is no interval


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
    beside = ol.open_results(played).by_condition[0].beside["novices"]
    assert [one for one in beside if one is not None] == [12.5]


def test_a_folder_that_is_none_is_refused_before_anything_is_played(tmp_path):
    out = tmp_path / "out"
    asked = ["compare", "-c", "CC3", "-l", "oracle", "--subjects", 1, "--out", out]
    for given in (tmp_path / "none", f"?={tmp_path}"):
        done = at_once(*asked, "--reference", given)
        assert (done.status, str(tmp_path) in done.stderr) == (2, True)
        assert not out.exists()


def test_references_beside_no_experiment_go_by_names():
    cell = ["learner", "condition", "protocol"]
    table = pd.DataFrame([("a", "CC4", "human"), ("a", "CC4", "rl")], columns=cell)
    by_name = {one.reference.name: one for one in references_beside(None)}
    assert by_name["people"].stands(table).tolist() == [True, False]

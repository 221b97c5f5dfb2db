"""References: registered ones, and results folders, stand beside those who did what they did."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from typer.testing import CliRunner

import causal_openlock as ol
from causal_openlock.analysis.results.references import (
    POINT,
    POINT_COLUMNS,
    Reference,
    find_references,
    references_beside,
)
from causal_openlock.analysis.topics.leaderboard import leaderboard_tables
from causal_openlock.cli import app
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.file import find_experiment, read_experiment
from causal_openlock.files.plugins import REFERENCES, registered
from support.html_page import Page
from support.packages import register

CONDITIONS = ["CC4", "CC3-CC4", "CE3-CC4"]
EXPERIMENT = read_experiment(find_experiment("deep_quick"))


@pytest.fixture(scope="module")
def mine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A results folder that stands for people of one's own."""
    folder = tmp_path_factory.mktemp("mine") / "visitors"
    ol.compare(CONDITIONS, ["win_stay"], subjects=4, workers=0, seed=3, out=folder)
    return folder


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("played") / "learners"
    ol.compare(CONDITIONS, ["oracle", "random"], subjects=3, workers=0, out=folder)
    return folder


@pytest.mark.parametrize("name", sorted(registered(REFERENCES)))
def test_every_registered_reference_keeps_to_the_contract(name: str) -> None:
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


def test_a_folder_has_the_means_of_its_record(mine: Path) -> None:
    (reference,) = find_references(mine)
    assert (reference.name, reference.prefix) == ("visitors", "visitors")
    trials = ol.open_results(mine).trials
    own = trials[(trials["condition"] == "CC4") & (trials["trial"] == 2)]["attempts"].to_numpy()
    row = reference.points.set_index(POINT).loc[("CC4", "train", 2)]
    assert row["subjects"] == len(own) == 4
    assert row["mean"] == pytest.approx(own.mean())
    assert row["se"] == pytest.approx(own.std() / np.sqrt(4))


def test_it_stands_beside_learners_in_every_table(mine: Path, played: Path, tmp_path: Path) -> None:
    results = ol.open_results(played, reference=f"guests={mine}")
    plain = ol.open_results(played)
    new = ["guests_attempts", "guests_se", "guests_difference"]
    pd.testing.assert_frame_equal(results.summary.drop(columns=new), plain.summary)
    (reference,) = results.given
    means = reference.points.set_index(POINT)["mean"]
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
    report = results.report(tmp_path, figures=True)
    assert "than guests" in report.answers["human"][0]
    page = Page(report.path.read_text("utf-8"))
    assert [row[0].split(" | ")[0] for row in page.tables[0]][:3] == ["Learner", "people", "guests"]
    assert [row[0].split(" | ")[0] for row in page.tables[1]][1:4] == [
        *("People", "Published model", "guests")
    ]
    assert any("Distance from guests" in heading for heading in [page.text])
    assert (tmp_path / "tables" / "distance_from_guests.csv").is_file()
    congruency = pd.read_csv(tmp_path / "tables" / "congruency_all.csv")
    assert congruency["learner"].drop_duplicates().tolist()[:3] == [
        *("people", "published model", "guests")
    ]
    assert {"to_people", "to_guests"} <= {*congruency.columns}


def test_it_stands_beside_learners_in_every_figure(mine: Path, played: Path) -> None:
    results = ol.open_results(played, reference=mine)
    titles = [axes.get_title(loc="left") for axes in results.plot.transfer(ax=Figure())]
    assert titles == ["People", "Published model", "visitors", "oracle", "random"]
    rows = results.plot.congruency(ax=Figure())[0].get_yticklabels()
    assert "visitors" in [label.get_text() for label in rows]
    figure = Figure()
    results.plot.subjects(ax=figure)
    assert "visitors" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_other_budgets_rooms_and_numbers_are_not_compared(mine: Path) -> None:
    (reference,) = find_references(mine)
    experiment = ol.open_results(mine).experiment
    (spec,) = experiment.learners
    everything = {("win_stay", name, "human") for name in CONDITIONS}
    assert reference.beside(experiment).cells == everything
    renamed = replace(spec, protocol=replace(spec.protocol, name="mine", layouts="random"))
    assert len(reference.beside(replace(experiment, learners=(renamed,))).cells or ()) == 3
    for setting, left in (
        ({"attempt_limit": 5}, 0),
        ({"test_loops": 2}, 1),
        ({"action_limit": 4}, 0),
    ):
        other = replace(spec, protocol=replace(spec.protocol, **setting))
        assert len(reference.beside(replace(experiment, learners=(other,))).cells or ()) == left
    swapped = replace(experiment.conditions[0], train=experiment.conditions[1].train)
    assert not reference.comparable(spec, swapped)


def test_several_stand_side_by_side_and_share_no_name(mine: Path, played: Path) -> None:
    results = ol.open_results(played, reference=[f"adults={mine}", f"children={mine}"])
    assert {"adults_attempts", "children_attempts"} <= {*results.summary}
    assert {"to_adults", "to_children"} <= {*results.leaderboard}
    with pytest.raises(OpenLockError, match="two references are called visitors; give one another"):
        ol.open_results(played, reference=[mine, mine])
    with pytest.raises(OpenLockError, match=r"a reference cannot be called '\?'"):
        ol.open_results(played, reference=f"?={mine}")


@pytest.mark.parametrize(
    ("name", "why"),
    [
        *((name, "tables use that name") for name in ("human", "People", "ideal", "pilot_p")),
        *((name, "tables use that name") for name in ("difference", "published model", "a_low")),
        ("oracle", "a learner is called that"),
        ("x" * 61, "60 at most"),
        ("v1.5", "letters, digits"),
    ],
)
def test_names_that_would_be_confused_are_refused(
    name: str, why: str, mine: Path, played: Path
) -> None:
    with pytest.raises(OpenLockError, match=why):
        ol.open_results(played, reference=f"{name}={mine}")


def test_a_folder_of_a_common_name_is_called_otherwise(tmp_path: Path, mine: Path) -> None:
    shutil.copytree(mine, tmp_path / "people")
    assert [one.name for one in find_references(tmp_path / "people")] == ["own people"]


def test_what_is_no_reference_in_python_is_one_sentence() -> None:
    rows = [("CC4", "train", 5, 9, 12.5, 0.5)] * 2
    points = pd.DataFrame(rows, columns=POINT_COLUMNS)
    for changed, said in (
        (points, "has a trial of a condition twice"),
        (points[:1].drop(columns="se"), "lacks the column se"),
        (points[:1].assign(subjects=0), "at least one subject"),
        (points[:1].assign(mean=np.nan), "at least one subject"),
    ):
        with pytest.raises(OpenLockError, match=said):
            Reference("x", changed, lambda *_: True)
    with pytest.raises(OpenLockError, match="a Reference or a results folder, not 5"):
        find_references(5)  # type: ignore[arg-type]


def test_one_without_means_stands_nowhere(played: Path, tmp_path: Path) -> None:
    empty = Reference("empty", pd.DataFrame(columns=POINT_COLUMNS), lambda *_: True)
    results = ol.open_results(played, reference=empty)
    assert not [name for name in results.summary if name.startswith("empty")]
    results.report(tmp_path)


def test_trials_that_a_reference_did_not_solve_are_marked(played: Path, tmp_path: Path) -> None:
    ol.compare("CC4", ["random"], subjects=2, workers=0, seed=5, out=tmp_path / "slow")
    results = ol.open_results(played, reference=tmp_path / "slow")
    (table,) = leaderboard_tables(results.leaderboard)
    # It played one of three conditions: a mean or a difference next to those of all three would
    # mislead.
    assert table.rows["slow"][0] == ("–", "")
    assert "to_slow" not in table.columns
    ol.compare("CC4", ["oracle", "random"], subjects=3, workers=0, out=tmp_path / "played")
    alone = ol.open_results(tmp_path / "played", reference=tmp_path / "slow")
    (table,) = leaderboard_tables(alone.leaderboard)
    at = table.columns.index("to_slow")
    assert table.rows["oracle"][at][0] == "≤ −27.00"
    assert table.rows["random"][at][0].endswith("*")
    (shown,) = results.by_condition
    (cells,) = [cells for one, cells in shown.references.items() if one.name == "slow"]
    assert cells[0] == (30.0, None, 0.0)


def test_more_rooms_of_training_do_not_compare(mine: Path) -> None:
    experiment = ol.open_results(mine).experiment
    (spec,) = experiment.learners
    (reference,) = find_references(mine)
    more = replace(spec, protocol=replace(spec.protocol, training_trials=5))
    names = {
        cell[1] for cell in reference.beside(replace(experiment, learners=(more,))).cells or ()
    }
    assert names == {"CC4"}


def test_one_that_stands_beside_nobody_is_said(played: Path, tmp_path: Path) -> None:
    ol.compare("CE3", ["oracle"], subjects=1, workers=0, out=tmp_path / "else")
    results = ol.open_results(played, reference=f"others={tmp_path / 'else'}")
    assert any("as others, so this reference is not shown" in one for one in results.warnings)


def test_both_results_may_have_read_the_same_reference(
    mine: Path, played: Path, tmp_path: Path
) -> None:
    ol.compare("CC4", ["bayes"], subjects=1, workers=0, out=tmp_path / "more")
    one, other = (ol.open_results(folder, reference=mine) for folder in (played, tmp_path / "more"))
    assert [reference.name for reference in (one + other).given] == ["visitors"]


def test_every_learner_of_a_folder_without_people_is_one(played: Path) -> None:
    names = [reference.name for reference in find_references(f"old={played}")]
    assert names == ["old oracle", "old random"]
    results = ol.open_results(played, reference=f"old={played}")
    assert results.summary["old_oracle_attempts"].notna().all()
    own = results.leaderboard.set_index("learner").loc["oracle"]
    assert own["to_old_oracle"] == 0


def test_a_package_registers_one(
    played: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "a_reference.py").write_text(
        "import pandas as pd\n"
        "from causal_openlock import Reference\n"
        "def novices():\n"
        "    row = ('CC4', 'train', 5, 9, 12.5, 0.5)\n"
        "    columns = ['condition', 'phase', 'trial', 'subjects', 'mean', 'se']\n"
        "    points = pd.DataFrame([row], columns=columns)\n"
        "    return Reference('novices', points, lambda spec, condition: True)\n"
    )
    register(tmp_path, "novices", REFERENCES, novices="a_reference:novices")
    ranked = ol.open_results(played).leaderboard.set_index("learner")
    assert ranked.loc["novices", ["conditions", "subjects"]].tolist() == [1, 9]
    beside = ol.open_results(played).by_condition[0].beside["novices"]
    assert [one for one in beside if one is not None] == [12.5]


def test_what_is_no_reference_is_said_before_anything_is_played(tmp_path: Path) -> None:
    out = tmp_path / "out"
    asked = ["compare", "-c", "CC3", "-l", "oracle", "--subjects", "1", "--out", str(out)]
    for given, said in (
        (str(tmp_path / "none"), "none"),
        (f"?={tmp_path}", ""),
    ):
        done = CliRunner().invoke(app, [*asked, "--reference", given])
        assert done.exit_code != 0
        assert isinstance(done.exception, OpenLockError | SystemExit)
        assert said in str(done.exception) + done.output
        assert not out.exists()


def test_a_single_person_has_no_interval_and_harms_nothing(played: Path, tmp_path: Path) -> None:
    ol.compare(CONDITIONS, ["win_stay"], subjects=1, workers=0, out=tmp_path / "one")
    results = ol.open_results(played, reference=tmp_path / "one")
    row = results.leaderboard.set_index("learner").loc["random"]
    assert row["to_one"] == row["to_one"]
    assert np.isnan(row["to_one_low"])
    results.report(tmp_path / "report")


def test_references_beside_no_experiment_go_by_names() -> None:
    table = pd.DataFrame(
        {"learner": ["a", "a"], "condition": ["CC4", "CC4"], "protocol": ["human", "rl"]}
    )
    by_name = {one.reference.name: one for one in references_beside(None)}
    assert by_name["people"].stands(table).tolist() == [True, False]
    assert isinstance(by_name["people"].reference, Reference)

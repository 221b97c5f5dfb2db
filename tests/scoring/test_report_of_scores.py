"""The section of the report on scores: who predicts best, who follows whom, what fails."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

import causal_openlock as ol
from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.section import Section
from causal_openlock.analysis.topic import all_topics, decisions_of, sections_of
from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.protocol import Condition
from causal_openlock.files.checksums import read_table, table_bytes
from causal_openlock.scoring.score_table import PLAYED, read_scores, write_scores
from causal_openlock.scoring.scores import (
    BY_SUBJECT,
    FOLDER,
    FOLLOWED,
    SUBJECT,
    Scores,
    attributed,
    over,
)
from causal_openlock.scoring.teacher_forcing import ATTEMPT, digests_of
from causal_openlock.scoring.worst_predicted import failures, worst_attempts
from causal_openlock.storage.store import Store
from support.topics import topics_called

OURS = "scores"
SHORT = ol.Protocol("short", 8, stop_when_solved=True, baseline_trials=2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two learners, six subjects each, scored by three."""
    folder = tmp_path_factory.mktemp("scored") / "results"
    thompson = ol.learner("bayes", label="thompson", policy="thompson")
    results = ol.compare(
        "CC3", [thompson, "win_stay"], protocol=SHORT, subjects=6, seed=5, out=folder, workers=0
    )
    results.score([thompson, "win_stay", "random"]).save(folder / FOLDER)
    return folder


@pytest.fixture(scope="module")
def shown(folder: Path) -> Section:
    (found,) = sections_of(ol.open_results(folder), topics_called("scores"))
    return found


def rows(section: Section, name: str) -> pd.DataFrame:
    (table,) = (one for one in section.tables if one.name == name)
    return table.frame


def test_it_is_in_the_report_of_a_folder_that_is_scored_and_in_no_other(
    folder: Path, tmp_path: Path
) -> None:
    names = [topic.name for topic in all_topics()]
    assert names.index("human_likeness") < names.index("scores") < names.index("paper_tests")
    shutil.copytree(folder, tmp_path / "other")
    shutil.rmtree(tmp_path / "other" / FOLDER)
    other = ol.open_results(tmp_path / "other")
    assert sections_of(other, topics_called("scores")) == []
    with pytest.raises(StoreError, match="are not scored; do it with: causal-openlock score"):
        _ = other.scores


def test_who_acted_is_found_to_predict_best(shown: Section) -> None:
    table = rows(shown, "scores").set_index(["of", "predicted by"])
    for name in ("thompson", "win_stay"):
        own = table.loc[name]
        assert own.index[0] == name
        assert own["best of"].tolist() == [6, 0, 0]
        assert (own["p corrected"].iloc[1:] < 0.05).all()
        assert own["followed"].idxmax() == name
        assert own.loc["random", "bits"] == pytest.approx(np.log2(15))
    said = " ".join(shown.text)
    assert "Of thompson, 6 subjects with" in said
    assert "thompson predicts best, with" in said
    assert "a learner that knows nothing needs 3.91" in said
    assert [plot.name for plot in shown.plots] == ["scores_thompson", "scores_win_stay"]


def test_each_subject_is_attributed_to_who_acted(folder: Path, shown: Section) -> None:
    table = rows(shown, "attributed")
    assert table["of"].tolist() == table["follows"].tolist() == ["thompson"] * 6 + ["win_stay"] * 6
    assert (table["probability"] > 0.9).all()
    scores = ol.open_results(folder).scores
    wide = scores.subjects.pivot_table(index=SUBJECT, columns="scored", values="bic", observed=True)
    ordered = np.sort(
        wide.loc[[("win_stay", *one[1:]) for one in wide.index if one[0] == "win_stay"]]
    )
    assert table["ahead"][6:].tolist() == pytest.approx((ordered[:, 1] - ordered[:, 0]) / 2)
    assert pd.read_csv(folder / FOLDER / FOLLOWED)["subject"].tolist() == [*range(6)] * 2
    assert "do not all follow" not in " ".join(shown.text)
    both = scores.subjects.assign(learner="person")
    both["subject"] += 6 * (scores.subjects["learner"] == "win_stay")
    assert attributed(both)["follows"].tolist() == table["follows"].tolist()


def test_ps_are_corrected_for_the_learners_that_are_compared(folder: Path) -> None:
    results = ol.open_results(folder)
    alone, all_of_it = (
        decisions_of(results, order)
        for order in (topics_called("scores"), topics_called("scores", "pairwise"))
    )
    assert all_of_it.total == alone.total + 1 == 5
    keys = [("thompson", "random"), ("win_stay", "random")]
    assert [alone.p(OURS, key) for key in keys] == [all_of_it.p(OURS, key) for key in keys]


def test_subjects_that_are_not_on_record_do_not_count(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "other")
    scores = ol.open_results(folder).scores
    kept = scores.actions[scores.actions["subject"] != 2]
    odd = kept.assign(subject=kept["subject"] + 900)
    Scores(pd.concat([kept, odd])).save(tmp_path / "other" / FOLDER)
    results = ol.open_results(tmp_path / "other")
    assert results.scores.subjects["subject"].max() == 5
    (section,) = sections_of(results, topics_called("scores"))
    assert "10 subjects" in section.text[0]
    assert "2 more of the same learners are on record, and not scored" in section.text[0]


@pytest.mark.parametrize("damage", ["cut", "gap", "twice", "above 1", "empty", "a word"])
def test_damaged_scores_are_one_sentence(folder: Path, tmp_path: Path, damage: str) -> None:
    path = tmp_path / "actions.parquet"
    table = read_table((folder / FOLDER / path.name).read_bytes()).to_pandas()
    if damage == "gap":
        table.loc[3, "log_probability"] = np.nan
    elif damage == "twice":
        table = pd.concat([table, table.head(1)])
    elif damage == "above 1":
        table.loc[3, "log_probability"] = 0.1
    elif damage == "empty":
        table = table.head(0)
    elif damage == "a word":
        table["trial"] = "first"
    content = table_bytes(pa.Table.from_pandas(table))
    path.write_bytes(content[:200] if damage == "cut" else content)
    with pytest.raises(
        StoreError, match=r"actions.parquet cannot be read \(.+\); remove it, and score"
    ):
        Scores.read(tmp_path)


def test_what_stands_next_to_the_actions_is_derived_from_them(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "other")
    for name in (BY_SUBJECT, FOLLOWED):  # as a kill between two files, or an editor, leaves them
        (tmp_path / "other" / FOLDER / name).write_text("scored\nnobody\n")
    here, there = (ol.open_results(one).scores for one in (folder, tmp_path / "other"))
    pd.testing.assert_frame_equal(here.subjects, there.subjects)
    pd.testing.assert_frame_equal(here.attributed, there.attributed)


def test_scores_of_other_actions_are_left_out_and_named(folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    shutil.copytree(folder, other)
    thompson = ol.learner("bayes", label="thompson", policy="thompson", lapse=0.2)
    results = ol.compare(
        "CC3", [thompson, "win_stay"], protocol=SHORT, subjects=6, seed=5, out=other, workers=0
    )
    (section,) = sections_of(results, topics_called("scores"))
    said = " ".join(section.text)
    assert "Scores of 6 subjects of thompson are left out" in said
    assert "thompson predicts with another code, version or settings than it played with" in said
    assert {*rows(section, "scores")["predicted by"]} == {"thompson", "win_stay", "random"}
    assert "Of win_stay" in said
    assert "Of thompson" not in said
    with pytest.warns(UserWarning, match="6 subjects of thompson are left out"):
        scores = results.scores
    assert set(scores.subjects["learner"]) == {"win_stay"}
    record, experiment = Store(folder).record(ATTEMPT)  # and where the rooms alone are others
    declared = replace(experiment, conditions=(Condition.named("CE3", ol.find_schema),))
    moved = digests_of(record.to_pandas(), replace(declared, conditions=(
        replace(declared.conditions[0], name="CC3"),)))  # fmt: skip
    assert not {*moved[PLAYED]} & {*digests_of(record.to_pandas(), experiment)[PLAYED]}


def test_subjects_that_different_learners_scored_are_not_compared(
    folder: Path, tmp_path: Path
) -> None:
    shutil.copytree(folder, tmp_path / "own")
    path = tmp_path / "own" / FOLDER / "actions.parquet"
    actions = read_scores(path)
    first = (actions["learner"] != "win_stay") | (
        (actions["subject"] < 3) == (actions["scored"] == "random")
    )
    write_scores(path, actions[first])
    results = ol.open_results(tmp_path / "own")
    (shown,) = sections_of(results, topics_called("scores"))
    said = " ".join(shown.text)
    assert "Scores of the subjects of win_stay are left out: none of these" in said
    assert "Of thompson, 6 subjects with" in said
    with pytest.raises(OpenLockError, match="score all subjects with the same learners"):
        _ = Scores(actions[first]).of("win_stay").ranking


def test_scores_that_do_not_say_of_what_they_are_are_left_out(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "other")
    path = tmp_path / "other" / FOLDER / "actions.parquet"
    table = read_table(path.read_bytes()).drop_columns([PLAYED, "setting", "price"])
    path.write_bytes(table_bytes(table))
    results = ol.open_results(tmp_path / "other")
    (section,) = sections_of(results, topics_called("scores"))
    assert section.tables == section.plots == ()
    assert "an earlier version made them" in " ".join(section.text)
    with pytest.raises(StoreError, match="an earlier version made them"):
        _ = results.scores


def made_up(bits: list[list[float]]) -> pd.DataFrame:
    """Scores of `theory` on one condition: a row of bits for each subject's actions, expected 1."""
    return pd.DataFrame(
        [
            {"scored": "theory", "learner": "person", "condition": "CC3", "protocol": "human",
             "experiment": "e", "seed": 1, "subject": subject, "trial": 1,
             "attempt": 1 + place // 3, "action": 1 + place % 3,
             "action_index": (0, 8, 14)[place % 3],
             "log_probability": -value * np.log(2), "entropy": np.log(2)}
            for subject, own in enumerate(bits)
            for place, value in enumerate(own)
        ]
    )  # fmt: skip


def test_subjects_count_alike_and_what_is_impossible_has_no_interval() -> None:
    table = made_up([[1, 1, 1, 1, 1, 4], [2, 2, 2]])
    whole = over(table, ["trial"]).iloc[0]
    assert (whole["bits"], whole["subjects"], whole["actions"]) == (1.75, 2, 9)
    assert whole["expected"] == pytest.approx(1.0)
    assert whole["ci_low"] == pytest.approx(1.5)
    assert whole["ci_high"] == pytest.approx(2.0)
    never = over(made_up([[1, 1], [np.inf, 1]]), ["trial"]).iloc[0]
    assert np.isinf(never["bits"])
    assert np.isnan(never["ci_low"])


def test_where_it_fails_is_beyond_what_it_expected() -> None:
    # It has every third action of a second attempt wrong, and one first action.
    table = made_up([[1, 1, 1, 1, 1, 6], [1, 1, 1, 1, 1, 6], [5, 1, 1, 1, 1, 6]])
    found = failures(table, {"CC3": 7})
    assert found["part"].iloc[0] == "later actions"
    assert found["part"].iloc[1] == "pushes of the door"
    by_part = found.set_index("part")["beyond"]
    assert by_part["second attempts"] == pytest.approx(5 / 3)
    assert by_part["pulls of levers"] == pytest.approx(0)
    worst = worst_attempts(table, {"CC3": 7})
    assert len(worst) == 5
    assert worst[["subject", "attempt"]].iloc[0].tolist() == [0, 2]
    assert worst["done"].iloc[0] == "push UPPERRIGHT, pull UPPER, push door"
    assert worst["beyond"].iloc[0] == pytest.approx(5)
    unsaid = failures(table.assign(entropy=np.nan), {"CC3": 7})  # by bits alone
    assert unsaid["part"].iloc[0] == "later actions"


def test_the_figure_has_a_line_for_each_learner_at_the_numbers_of_the_table(folder: Path) -> None:
    scores = ol.open_results(folder).scores
    axes = scores.plot(of="win_stay", ax=Figure())
    table = scores.of("win_stay").over("condition", "trial").set_index(["scored", "trial"])
    lines = {str(line.get_label()): [*line.get_ydata()] for line in axes.lines}
    assert set(lines.pop("knows nothing")) == {np.log2(15)}
    assert list(lines) == scores.of("win_stay").ranking["scored"].tolist()
    thin = [one.get_segments() for one in axes.collections if isinstance(one, LineCollection)]
    assert [len(one) for one in thin] == [6] * len(lines)  # a line a subject, for each of them
    assert max(line[:, 1].max() for own in thin for line in own) <= axes.get_ylim()[1]
    mean = np.mean([line[0, 1] for line in thin[0]])
    assert mean == pytest.approx(next(iter(lines.values()))[0])
    for name, drawn in lines.items():
        assert drawn == table.loc[name, "bits"].tolist()
    only = scores.plot(learners=["random"], ax=Figure())
    assert [line.get_label() for line in only.lines] == ["knows nothing", "random"]
    untold = replace(scores, choices={}).plot(learners=["random"], ax=Figure())
    assert [line.get_label() for line in untold.lines] == ["random"]
    with pytest.raises(OpenLockError, match="did you mean win_stay"):
        scores.plot(of="winstay", ax=Figure())


def test_means_over_subjects_who_follow_several_are_said_to_describe_none() -> None:
    """What is said of five people of whom four follow one learner and one another."""
    said = Prose("causal_openlock.scoring.scores_section").sentence(
        "predicted", of="person", uniform=3.91, actions=100, beaten=[], others=["theory"],
        best={"subjects": 5, "scored": "win_stay", "bits": 2.0, "low": 1.0, "high": 3.0},
        most={"followed": 0.7, "scored": "win_stay", "most frequent": 0.8},
        worst={"part": "pulls", "bits": 3.0, "expected": 1.0},
        sure={"win_stay": 4, "theory": 1}, at_least=0.9,
    )  # fmt: skip
    assert "at least 0.9, 4 follow win_stay and 1 follows theory. Means over all of them" in said

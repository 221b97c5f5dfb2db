"""Scores next to a record: who predicts best, who follows whom, and when they are out of date."""

import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

import causal_openlock as ol
from causal_openlock.analysis.effects import holm
from causal_openlock.analysis.table import p_value
from causal_openlock.analysis.topic import sections_of
from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.condition import find_condition
from causal_openlock.files.checksums import read_table, table_bytes
from causal_openlock.scoring.recorded import record_digest
from causal_openlock.scoring.scores import FOLDER, FOLLOWED, RECORD, SUBJECT, Scores
from causal_openlock.storage.store import Store
from support.topics import topics_called

SHORT = ol.Protocol("short", 8, stop_when_solved=True, baseline_trials=2)


def compared(folder, **changes):
    """Two learners of six subjects each, in a folder."""
    thompson = ol.learner("bayes", label="thompson", policy="thompson", **changes)
    budget = {"protocol": SHORT, "subjects": 6, "seed": 5, "workers": 0}
    return thompson, ol.compare("CC3", [thompson, "win_stay"], out=folder, **budget)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two learners, scored by three."""
    folder = tmp_path_factory.mktemp("scored") / "results"
    thompson, results = compared(folder)
    results.score([thompson, "win_stay", "random"]).save(folder / FOLDER)
    return folder


@pytest.fixture
def other(folder, tmp_path):
    """A copy of the folder, to be changed."""
    return shutil.copytree(folder, tmp_path / "other")


def section_of(folder):
    return next(iter(sections_of(ol.open_results(folder), topics_called("scores"))), None)


@pytest.fixture(scope="module")
def shown(folder):
    return section_of(folder)


def rows(section, name):
    return next(one.frame for one in section.tables if one.name == name)


def test_a_folder_without_scores_has_no_section(other):
    shutil.rmtree(other / FOLDER)
    assert section_of(other) is None
    with pytest.raises(StoreError, match="causal-openlock score"):
        _ = ol.open_results(other).scores


def test_the_learner_that_acted_is_first_in_the_table_of_scores(shown):
    table = rows(shown, "scores").set_index(["of", "predicted by"])
    for name in ("thompson", "win_stay"):
        own = table.loc[name]
        assert own.index[0] == name
        assert own["best of"].tolist() == [6, 0, 0]
        assert (own["low"].iloc[1:] > 0).all()
        assert own["p"].tolist()[0] == "–"
        assert own["followed by"].idxmax() == name
        assert own.loc["random", "bits/action"] == pytest.approx(np.log2(15))
    assert [plot.name for plot in shown.plots] == ["scores_thompson", "scores_win_stay"]


def test_each_subject_is_attributed_to_the_learner_that_acted(folder, shown):
    table = rows(shown, "attributed")
    assert table["of"].tolist() == table["follows"].tolist() == ["thompson"] * 6 + ["win_stay"] * 6
    assert (table["probability"] > 0.9).all()
    scores = ol.open_results(folder).scores
    wide = scores.subjects.pivot_table(index=SUBJECT, columns="scored", values="bic", observed=True)
    ordered = np.sort(wide.xs("win_stay", level="learner"))
    assert table["ahead"][6:].tolist() == pytest.approx((ordered[:, 1] - ordered[:, 0]) / 2)
    assert pd.read_csv(folder / FOLDER / FOLLOWED)["subject"].tolist() == [*range(6)] * 2
    both = scores.actions.assign(learner="person")
    both["subject"] += 6 * (scores.actions["learner"] == "win_stay")
    assert Scores(both).attributed["follows"].tolist() == table["follows"].tolist()


def test_ps_are_corrected_for_the_learners_that_are_compared(folder, shown):
    each = rows(shown, "scores").groupby("of")["p"]
    for name in ("thompson", "win_stay"):
        p = ol.open_results(folder).scores.of(name).ranking["p"].iloc[1:]
        assert each.get_group(name).iloc[1:].tolist() == [*map(p_value, holm(p.to_numpy(float)))]


def test_subjects_that_are_not_scored_are_counted(folder, other):
    scores = ol.open_results(folder).scores
    replace(scores, actions=scores.actions.query("subject != 2")).save(other / FOLDER)
    text = section_of(other).text[0]
    assert "10 subjects" in text
    assert "2 more" in text


@pytest.mark.parametrize(
    "damage", ["cut", "a word", "a column less", "no digest", "a gap", "no rows"]
)
def test_damaged_scores_are_refused_by_their_file_and_not_shown(other, damage):
    path = other / FOLDER / "actions.parquet"
    stored = read_table(path.read_bytes())
    table = stored.to_pandas()
    if damage == "a word":
        table["trial"] = "first"
    elif damage == "a column less":
        del table["entropy"]
    elif damage == "a gap":
        table.loc[3, "log_probability"] = np.nan
    elif damage == "no rows":
        table = table[:0]
    metadata = {} if damage == "no digest" else {RECORD: stored.schema.metadata[RECORD]}
    schema = stored.schema if damage in ("a gap", "no rows") else None
    content = table_bytes(pa.Table.from_pandas(table, schema, preserve_index=False), metadata)
    path.write_bytes(content[:200] if damage == "cut" else content)
    with pytest.raises(StoreError, match=r"actions.parquet"):
        Scores.read(other / FOLDER)
    assert section_of(other).tables == ()
    with pytest.raises(StoreError, match="other/scores are left out"):
        _ = ol.open_results(other).scores


@pytest.mark.parametrize(("first", "twice"), [(1, []), (0, [0]), (1, [1])])
def test_scores_have_each_action_once_or_are_left_out(other, first, twice):
    stored = Scores.read(other / FOLDER)
    actions = pd.concat([stored.actions[first:], stored.actions.iloc[twice]])
    replace(stored, actions=actions).save(other / FOLDER)
    with pytest.raises(StoreError, match=r"some actions are not there, or twice. Score .* again"):
        _ = ol.open_results(other).scores


def test_scores_of_actions_that_were_played_again_are_left_out(other):
    thompson, results = compared(other)
    assert section_of(other).tables  # another comparison of the same subjects changes nothing
    _, results = compared(other, lapse=0.2)
    (section,) = sections_of(results, topics_called("scores"))
    assert section.tables == section.plots == ()
    with pytest.raises(StoreError, match="are of other actions than those on record"):
        _ = results.scores
    results.score([thompson, "random"]).save(other / FOLDER)
    assert section_of(other).tables


def test_a_record_is_known_by_its_rooms_and_by_those_who_were_scored(folder):
    record, experiment = Store(folder).record()
    both, one = ({"thompson", "win_stay"}, {"win_stay"})
    known = record_digest(record, experiment, both)
    elsewhere = replace(find_condition("CE3"), name="CC3")
    assert record_digest(record, replace(experiment, conditions=(elsewhere,)), both) != known
    alone = record.filter(pc.equal(record["learner"].cast("string"), "win_stay"))
    assert record_digest(alone, experiment, one) == record_digest(record, experiment, one) != known
    for name in ("attempt", "opened", "layout"):
        column = record[name].to_pylist()[::-1]
        changed = record.set_column(record.schema.get_field_index(name), name, pa.array(column))
        assert record_digest(changed, experiment, both) != known


def test_subjects_that_different_learners_scored_are_not_compared(folder, other):
    actions = ol.open_results(folder).scores.actions
    first = (actions["learner"] != "win_stay") | (
        (actions["subject"] < 3) == (actions["scored"] == "random")
    )
    stored = Scores.read(other / FOLDER)
    replace(stored, actions=actions[first]).save(other / FOLDER)
    assert [plot.name for plot in section_of(other).plots] == ["scores_thompson"]
    with pytest.raises(OpenLockError, match="same learners"):
        _ = Scores(actions[first]).of("win_stay").ranking


def made_up(bits):
    """Scores of `theory` on one condition: a row of bits for each subject's actions, expected 1."""
    theory = {"scored": "theory", "learner": "person", "condition": "CC3", "protocol": "human"}
    table = [
        {
            **theory,
            **{"experiment": "e", "seed": 1, "subject": subject, "trial": 1},
            **{"attempt": 1 + place // 3, "action": 1 + place % 3},
            **{"action_index": (0, 8, 14)[place % 3], "entropy": np.log(2)},
            "log_probability": -value * np.log(2),
        }
        for subject, own in enumerate(bits)
        for place, value in enumerate(own)
    ]
    return pd.DataFrame(table)


def test_subjects_count_alike_and_an_impossible_action_has_no_interval():
    table = made_up([[1, 1, 1, 1, 1, 4], [2, 2, 2]])
    whole = Scores(table).over("trial").iloc[0]
    assert (whole["bits"], whole["subjects"], whole["actions"]) == (1.75, 2, 9)
    assert whole["expected"] == pytest.approx(1.0)
    never = Scores(made_up([[1, 1], [np.inf, 1]])).over("trial").iloc[0]
    assert np.isinf(never["bits"])
    assert np.isnan(never["ci_low"])


def test_the_figure_has_a_line_for_each_learner_at_the_numbers_of_the_table(folder):
    scores = ol.open_results(folder).scores
    axes = scores.plot(of="win_stay", ax=Figure())
    table = scores.of("win_stay").over("condition", "trial").set_index(["scored", "trial"])
    lines = {str(line.get_label()): [*line.get_ydata()] for line in axes.lines}
    assert set(lines.pop("knows nothing")) == {np.log2(15)}
    assert list(lines) == scores.of("win_stay").ranking["scored"].tolist()
    thin = [one.get_segments() for one in axes.collections if isinstance(one, LineCollection)]
    assert [len(one) for one in thin] == [6] * len(lines)  # a line a subject, for each of them
    assert max(line[:, 1].max() for own in thin for line in own) <= axes.get_ylim()[1]
    for name, drawn in lines.items():
        assert drawn == table.loc[name, "bits"].tolist()
    only = scores.plot(learners=["random"], ax=Figure())
    assert [line.get_label() for line in only.lines] == ["knows nothing", "random"]
    with pytest.raises(OpenLockError, match="did you mean win_stay"):
        scores.plot(of="winstay", ax=Figure())

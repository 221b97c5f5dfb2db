"""The tables, texts and files of results, against the record that they are made of."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import causal_openlock as ol
from causal_openlock.errors import StoreError
from causal_openlock.notebook import experiment_html, report_html, results_html
from support.html_page import Page

PAIR = ol.Schema("pair", ["a", "b"], {"a": ["door"], "b": ["door"]}, gates={"door": ol.Gate("all")})


def played(folder: Path, conditions: list[Any], learners: list[Any], **settings: Any) -> Path:
    """A results folder, played in this process."""
    experiment = ol.make_experiment(conditions, learners, subjects=2, **settings)
    with ThreadPoolExecutor(1) as executor:
        ol.run(experiment, folder, executor=executor)
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return played(tmp_path_factory.mktemp("r") / "r", ["CE4", "CC4", PAIR], ["random", "oracle"])


@pytest.fixture
def results(folder: Path) -> ol.Results:
    return ol.open_results(folder)


def test_tables_are_those_of_the_record(folder: Path, results: ol.Results) -> None:
    record, experiment = ol.Store(folder).record()
    expected = ol.attempts_to_solve(record)
    assert results.trials.drop(columns="learner").equals(expected.drop(columns="learner"))
    assert list(results.trials["learner"].cat.categories) == ["random", "oracle"]
    assert results.summary.equals(ol.summary_table(record, experiment))
    assert results.headline.equals(ol.headline_table(record, experiment))
    assert len(results.attempts) == record.num_rows
    assert results.attempts["reward"].sum() == pytest.approx(sum(record["reward"].to_pylist()))


def test_a_row_for_each_attempt_and_each_action(results: ol.Results) -> None:
    attempts, actions = results.attempts, results.actions
    keys = ["learner", "condition", "subject", "phase", "loop", "trial", "attempt"]
    per_trial = attempts.groupby(keys[:-1], observed=True)["attempt"]
    assert (per_trial.max() == per_trial.size()).all()
    assert per_trial.apply(lambda numbers: numbers.is_monotonic_increasing).all()
    within = actions.groupby(keys, observed=True)["action"]
    assert (within.max() == within.size()).all()
    assert len(within) == len(attempts)
    opened = attempts.set_index(keys)["opened"]
    last = actions.groupby(keys, observed=True)["name"].last().reindex(opened.index)
    assert (last[opened] == "push_door").all()
    names = ol.action_names(7)
    assert [names[index] for index in actions["action_index"]] == list(actions["name"])


def test_training_comes_before_the_test(tmp_path: Path) -> None:
    results = ol.open_results(played(tmp_path / "r", ["CC3-CC4"], ["oracle"]))
    for table in (results.trials, results.attempts, results.actions):
        phases = table.query("subject == 0")["phase"]
        assert list(dict.fromkeys(phases)) == ["train", "test"]


def test_pairs_are_of_every_two_learners(results: ol.Results) -> None:
    (row,) = results.pairs.to_dict("records")
    assert (row["learner"], row["other"], row["protocol"]) == ("random", "oracle", "human")
    judged = results.headline.pivot(index="condition", columns="learner", values="attempts")
    assert row["difference"] == pytest.approx((judged["random"] - judged["oracle"]).mean())
    assert row["probability"] < 0.5


def test_the_verdict_has_people_beside_what_they_played(results: ol.Results) -> None:
    (table,) = results.by_condition
    assert table.columns == (("CE4", "trial 5"), ("CC4", "trial 5"), ("pair", "trial 5"))
    assert list(table.rows) == ["random", "oracle"]
    assert table.beside["people"] == (9.425, 6.45, None)
    assert table.beside["ideal observer"][2] == 1.0
    text, shown = repr(results), results_html(results)
    Page(shown)
    for word in ("people", "oracle", "Fewer than 20 subjects"):
        assert word in text
        assert word in shown
    assert "9.43" in shown
    assert "> 30" in text
    assert "\x1b" not in text


def test_labels_are_text_and_not_markup(tmp_path: Path) -> None:
    label = "a.b_c-1"
    odd = ol.make_experiment(["CC3"], [ol.learner("oracle", label=label)], title="<i>x</i>")
    assert odd.learners[0].name == label
    folder = played(tmp_path / "r", ["CC3"], ["oracle"], title="<script>1</script>")
    assert "<script>" not in results_html(ol.open_results(folder))


def test_saved_results_are_the_same_and_stay(tmp_path: Path, folder: Path) -> None:
    copied = tmp_path / "copy"
    results = ol.open_results(folder)
    before = results.summary
    assert results.save(copied) == copied
    assert results.folders == (copied,)
    assert ol.open_results(copied).summary.equals(before)
    assert len(results.attempts) == len(ol.open_results(folder).attempts)
    with pytest.raises(StoreError, match="is there already"):
        results.save(copied)
    (tmp_path / "notes.txt").write_text("mine")
    for write in (results.save, results.report):
        with pytest.raises(StoreError, match="a folder is given by its path, not by int"):
            write(3)  # type: ignore[operator]
        with pytest.raises(StoreError, match=r"notes\.txt is a file; choose a folder$"):
            write(tmp_path / "notes.txt")  # type: ignore[operator]
        (tmp_path / "loop").symlink_to("loop")
        for place in (tmp_path / "loop" / "x", tmp_path / ("a" * 300), "a\0b"):
            with pytest.raises(StoreError, match="cannot be a folder; choose another"):
                write(place)  # type: ignore[operator]
        (tmp_path / "loop").unlink()
    (tmp_path / "empty").mkdir()
    ol.open_results(folder).save(tmp_path / "empty")
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_the_report_is_written_into_the_folder_and_shown(tmp_path: Path, folder: Path) -> None:
    results = ol.open_results(folder)
    page = results.report(tmp_path / "page")
    assert page.path == tmp_path / "page" / "report.html"
    assert (tmp_path / "page" / "summary.csv").is_file()
    shown = report_html(page)
    assert shown.startswith("<iframe")
    assert "<table" not in shown  # it is quoted inside the frame


def test_together_in_one_table(tmp_path: Path, folder: Path) -> None:
    other = ol.open_results(played(tmp_path / "o", ["CC4"], ["ideal"]))
    both = ol.open_results(folder) + other
    assert both.learners == ("random", "oracle", "ideal")
    assert len(both.attempts) == len(both.folders and ol.open_results(folder).attempts) + len(
        other.attempts
    )
    assert both.warnings[0] == other.warnings[0] or both.warnings
    elsewhere = ol.open_results(played(tmp_path / "e", ["CC3"], ["oracle"]))
    assert (ol.open_results(folder) + elsewhere).learners == ("random", "oracle")
    page = (ol.open_results(folder) + elsewhere).report()
    assert folder not in page.path.parents
    with pytest.raises(StoreError, match="save each by itself"):
        both.save(tmp_path / "both")


def test_what_cannot_be_compared_is_refused(tmp_path: Path, folder: Path) -> None:
    results = ol.open_results(folder)
    with pytest.raises(StoreError, match="have a learner oracle"):
        results + results
    unlike = ol.Schema("pair", ["a", "b"], {"a": ["door"], "b": ["door"]})
    other = ol.open_results(played(tmp_path / "o", [unlike], ["ideal"]))
    with pytest.raises(StoreError, match="condition pair is not the same"):
        results + other
    with pytest.raises(TypeError):
        results + 1  # type: ignore[operator]


def test_a_folder_that_was_used_again_is_noticed(tmp_path: Path) -> None:
    folder = played(tmp_path / "r", ["CC3"], ["oracle"])
    results = ol.open_results(folder)
    played(folder, ["CC3"], ["oracle", "random"])
    with pytest.raises(StoreError, match="open it again"):
        _ = results.attempts
    assert ol.open_results(folder).learners == ("oracle", "random")


def test_a_folder_is_found_from_elsewhere(
    folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(folder.parent)
    results = ol.open_results("r")
    monkeypatch.chdir(tmp_path)
    assert len(results.attempts) == len(ol.open_results(folder).attempts)


def test_the_order_of_adding_does_not_matter(tmp_path: Path) -> None:
    parts = [
        ol.open_results(played(tmp_path / name, [condition], [learner]))
        for name, condition, learner in (
            ("a", "CC3", "oracle"), ("b", "CC4", "random"), ("c", "CC3", "random"),
        )
    ]  # fmt: skip
    together = parts[0] + parts[1] + parts[2]
    assert len(together.trials) == sum(len(part.trials) for part in parts)
    assert (parts[2] + parts[0] + parts[1]).learners == ("random", "oracle")


def test_results_are_not_saved_inside_themselves(tmp_path: Path) -> None:
    folder = played(tmp_path / "r", ["CC3"], ["oracle"])
    with pytest.raises(StoreError, match="inside the results"):
        ol.open_results(folder).save(folder / "copy")


def test_showing_an_experiment_of_a_folder_runs_no_code(tmp_path: Path) -> None:
    folder = played(tmp_path / "r", ["CC3"], [f"{__name__}:Elsewhere"])
    recorded = ol.Store(folder).experiment()
    spec = replace(recorded.learners[0], learner="nowhere_at_all:Evil")
    assert "nowhere_at_all" in experiment_html(replace(recorded, learners=(spec,)))


class Elsewhere(ol.OneSubjectLearner):
    """A learner in a module."""

    def act(self, observation: Any) -> int:
        return 0

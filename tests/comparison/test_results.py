"""The tables and files of results, against the record that they are made of."""

from dataclasses import replace

import pytest

import causal_openlock as ol
from causal_openlock.errors import StoreError
from causal_openlock.notebook import experiment_html, report_html, results_html
from causal_openlock.storage.store import Store
from causal_openlock.world.room import action_names

PAIR = ol.schema("pair: a & b -> door")


class Elsewhere(ol.OneSubjectLearner):
    """A learner in a module."""

    def act(self, observation):
        return 0


def played(folder, conditions, learners, **settings):
    """Results in a folder, played in this process."""
    return ol.compare(conditions, learners, subjects=2, out=folder, workers=0, **settings)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("r") / "r"
    played(path, ["CE4", "CC4", PAIR], ["random", "oracle"])
    return path


@pytest.fixture
def results(folder):
    return ol.open_results(folder)


TRIAL = ["learner", "condition", "subject", "phase", "loop", "trial"]


def test_attempts_and_actions_are_those_of_the_record(folder, results):
    record = Store(folder).record()[0].to_pandas()
    assert [*results.trials["learner"].cat.categories] == ["random", "oracle"]  # as declared
    attempts, actions = results.attempts, results.actions
    assert len(attempts) == len(record)
    assert attempts["reward"].sum() == pytest.approx(record["reward"].sum())
    by_trial = attempts.groupby(TRIAL, observed=True)["attempt"]
    assert by_trial.apply(lambda numbers: [*numbers] == [*range(1, len(numbers) + 1)]).all()
    by_attempt = actions.groupby([*TRIAL, "attempt"], observed=True)
    assert by_attempt["action"].apply(lambda n: [*n] == [*range(1, len(n) + 1)]).all()
    indices = by_attempt["action_index"].apply(list)
    stored = record.set_index([*TRIAL, "attempt"])
    for key, done in indices.items():
        assert done == stored.loc[key, "actions"].tolist()
    assert actions["moved"].sum() == sum(map(sum, record["moved"]))
    names = action_names(7)
    assert [names[index] for index in actions["action_index"]] == [*actions["name"]]


def test_training_comes_before_the_test(tmp_path):
    results = played(tmp_path / "r", ["CC3-CC4"], ["oracle"])
    for table in (results.trials, results.attempts, results.actions):
        phases = table.query("subject == 0")["phase"]
        assert list(dict.fromkeys(phases)) == ["train", "test"]


TABLES = ["trials", "attempts", "actions", "summary", "headline", "leaderboard", "pairs", "regret"]


@pytest.mark.parametrize("name", [*TABLES, "structure_recovery", "transfer"])
def test_looking_at_a_table_changes_nothing(results, name):
    known = getattr(results, name).copy()
    table = getattr(results, name)
    table["learner"] = "nobody"
    del table[table.columns[-1]]
    if len(table):
        table.iloc[:, -1] = table.iloc[0, -1]
    assert getattr(results, name).equals(known)


def test_looking_at_trials_and_bounds_leaves_every_other_number(results, folder):
    results.trials["attempts"] = 1
    del results.all_trials["solved"]
    results.bounds.clear()
    board = ol.open_results(folder).leaderboard
    assert results.leaderboard.equals(board)
    assert board["score"].notna().any()


def test_markup_in_a_title_is_text(tmp_path):
    results = played(tmp_path / "r", ["CC3"], ["oracle"], title="<script>1</script>")
    assert "<script>" not in results_html(results)
    assert "&lt;script&gt;" in results_html(results)


def test_saved_results_are_the_same_and_stay(tmp_path, folder):
    results = ol.open_results(folder)
    assert results.save(tmp_path / "copy") == tmp_path / "copy"
    assert results.folders == (tmp_path / "copy",)
    assert ol.open_results(tmp_path / "copy").summary.equals(ol.open_results(folder).summary)
    (tmp_path / "empty").mkdir()
    ol.open_results(folder).save(tmp_path / "empty")
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(StoreError, match="loop"):
        results.save(tmp_path / "loop" / "x")
    assert not list(tmp_path.glob(".*"))


def test_report_is_written_where_it_is_asked_for_and_shown(tmp_path):
    results = played(tmp_path / "r", ["CC3"], ["oracle"])
    page = results.report(tmp_path / "page")
    assert page.path == tmp_path / "page" / "report.html"
    assert sorted(path.name for path in page.path.parent.iterdir()) == [
        "report.html",
        "summary.csv",
    ]
    shown = report_html(page)
    assert shown.startswith("<iframe")
    assert "<table" not in shown  # it is quoted inside the frame
    both = results + played(tmp_path / "o", ["CC3"], ["win_stay"])
    assert not {*both.folders} & {*both.report().path.parents}


def test_results_are_added_in_any_order(tmp_path, folder):
    parts = [
        played(tmp_path / name, [condition], [learner])
        for name, condition, learner in (
            ("a", "CC3", "oracle"),
            ("b", "CC4", "random"),
            ("c", "CC3", "random"),
        )
    ]
    together = parts[0] + parts[1] + parts[2]
    assert len(together.attempts) == sum(len(part.attempts) for part in parts)
    assert (parts[2] + parts[0] + parts[1]).learners == ("random", "oracle")
    assert (ol.open_results(folder) + parts[0]).learners == ("random", "oracle")
    assert ol.open_results(tmp_path / "a", tmp_path / "b").learners == ("oracle", "random")
    with pytest.raises(TypeError):
        together + 1


def test_attempts_are_those_of_the_folder_when_it_was_opened(tmp_path):
    results = ol.open_results(played(tmp_path / "r", ["CC3"], ["oracle"]).folders[0])
    played(tmp_path / "r", ["CC3"], ["oracle", "random"])
    assert results.attempts["learner"].unique().tolist() == ["oracle"]


def test_relative_folder_is_found_from_elsewhere(folder, monkeypatch, tmp_path):
    monkeypatch.chdir(folder.parent)
    results = ol.open_results("r")
    monkeypatch.chdir(tmp_path)
    assert len(results.attempts) == len(ol.open_results(folder).attempts)


def test_showing_an_experiment_of_a_folder_runs_no_code(tmp_path):
    played(tmp_path / "r", ["CC3"], [Elsewhere])
    recorded = Store(tmp_path / "r").experiment()
    spec = replace(recorded.learners[0], learner="nowhere_at_all:Evil")
    assert "Elsewhere" in experiment_html(replace(recorded, learners=(spec,)))

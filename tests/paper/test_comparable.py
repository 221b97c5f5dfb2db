"""What is published stands beside those who did what people did, and beside nobody else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

from causal_openlock.analysis.report.all_figures import figures_of
from causal_openlock.analysis.report.writing import write_report
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.summary import headline_table, summary_table
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.paper_conditions import paper_conditions
from causal_openlock.experiment.protocol import PAPER_CONDITIONS
from causal_openlock.paper.references import people
from causal_openlock.schemas.schema_file import schema_from_dict
from causal_openlock.storage.stored import StoredExperiment
from support.fabricated_records import table, trial_rows
from support.html_page import Page
from support.made_up_experiments import declared

pytestmark = pytest.mark.slow

ONE_LEVER = "name: CC4\ntitle: Not the paper's\nlevers: [A]\nedges: {A: [door]}\n"
ALL = ", ".join(PAPER_CONDITIONS)


def described(folder: Path, conditions: str = ALL, **settings: Any) -> StoredExperiment:
    """An experiment as a results folder holds it, its protocol perhaps changed."""
    experiment = declared(
        folder,
        f"subjects: 2\nconditions: [{conditions}]\nlearners: [{{learner: random, name: a}}]\n",
    )
    (spec,) = experiment.learners
    spec = replace(spec, protocol=replace(spec.protocol, **settings))
    return replace(experiment, learners=(spec,))


def pairs(experiment: Experiment) -> Any:
    return people().beside(experiment).cells


def played(protocol: str = "human") -> pa.Table:
    """Two subjects of ``a`` in a baseline and a transfer with the names of the paper's."""
    rows = []
    for subject in (0, 1):
        one = {"subject": subject, "protocol": protocol}
        for trial in range(1, 6):
            rows += trial_rows([1, 2, 3], trial=trial, **one)
        rows += trial_rows([1, 2, 3], condition="CC3-CC4", schema="CC3", **one)
        rows += trial_rows([1, 2, 3], condition="CC3-CC4", phase="test", **one)
    return table(rows)


def test_the_papers_own_experiment_is_comparable_in_every_condition(tmp_path: Path) -> None:
    everyone = {("a", condition, "human") for condition in PAPER_CONDITIONS}
    assert pairs(described(tmp_path)) == everyone
    assert pairs(read_experiment(tmp_path / "made_up.yaml")) == everyone


@pytest.mark.parametrize(
    "settings",
    [
        {"attempt_limit": 3},
        {"stop_when_solved": False},
        {"baseline_trials": 4},
        {"test_loops": 2},
        {"layouts": "random"},
        {"test_layout": "trial7"},
        {"name": "quick"},
    ],
)
def test_other_budgets_are_not_comparable(tmp_path: Path, settings: dict[str, Any]) -> None:
    assert pairs(described(tmp_path, **settings)) == set()


@pytest.mark.parametrize(
    ("trials", "alike"),
    [
        ("{schema: CC4}", True),
        ("{schema: CC4, trials: 5, layouts: published}", True),
        ("{schema: CC4, trials: 4}", False),
        ("{schema: CC4, layouts: random}", False),
        ("{schema: CC4, layouts: [trial7]}", False),
        ("{schema: CC4, shuffle: false}", False),
        ("{schema: CE4}", False),
        ("{schema: mine.yaml}", False),
        ("{schema: CC4}, {schema: CC4}", False),
    ],
)
def test_a_condition_is_the_papers_by_its_rooms_and_not_by_its_name(
    tmp_path: Path, trials: str, alike: bool
) -> None:
    (tmp_path / "mine.yaml").write_text(ONE_LEVER)
    held = described(tmp_path, f"{{name: CC4, train: [{trials}]}}")
    assert pairs(held) == ({("a", "CC4", "human")} if alike else set())
    assert pairs(described(tmp_path, f"{{name: own, train: [{trials}]}}")) == set()


def test_the_title_of_a_schema_makes_no_difference(tmp_path: Path) -> None:
    held = described(tmp_path)
    for title, kept in (("retitled", PAPER_CONDITIONS), ("", PAPER_CONDITIONS[1:])):
        conditions = []
        for condition in held.conditions:
            data = condition.train[0].schema.as_dict()
            if title:
                data["title"] = title
            elif not conditions:
                data["gates"] = {"door": "all"}
            trials = replace(condition.train[0], schema=schema_from_dict(data))
            conditions.append(replace(condition, train=(trials,)))
        assert paper_conditions(replace(held, conditions=tuple(conditions))) == set(kept)


def test_names_decide_where_there_is_no_experiment() -> None:
    assert headline_table(played())["human_attempts"].tolist() == [6.45, 5.525]


def test_tables_and_figures_leave_out_what_does_not_compare(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(ONE_LEVER)
    own = described(tmp_path, "{name: CC4, train: [{schema: mine.yaml}]}, CC3-CE4")
    own = replace(own, conditions=(*own.conditions, *described(tmp_path, "CC3-CC4").conditions))
    headline = headline_table(played(), own).set_index("condition")
    summary = summary_table(played(), own)
    for column in ("human_attempts", "human_se", "difference", "model_attempts", "model_se"):
        assert headline[column].isna().to_dict() == {"CC4": True, "CC3-CC4": False}
        assert set(summary.loc[summary[column].notna(), "condition"]) == {"CC3-CC4"}
    figures = figures_of(Material.of(played(), own))
    assert [plot.name for plot in figures] == ["attempts_by_trial_human"]
    # The paper's DDQN has no place beside other rooms either.
    assert [plot.name for plot in figures_of(Material.of(played("rl"), own))] == [
        "transfer_categories",
        "attempts_by_trial_rl",
    ]


def test_the_report_shows_what_is_published_or_says_why_not(tmp_path: Path) -> None:
    held = described(tmp_path, "CC4, CC3-CC4")
    same = Page(write_report(played(), tmp_path, held).read_text("utf-8"))
    assert same.tables[1][1] == ["People | published, n = 40", "6.45 | ± 1.00", "5.53 | ± 0.49"]
    model = "Published model | theory-based, n = 40"
    assert same.tables[1][2] == [model, "6.82 | ± 0.39", "7.06 | ± 0.33"]
    assert "not shown" not in same.text
    short = described(tmp_path, "CC4, CC3-CC4", attempt_limit=3)
    other = Page(write_report(played(), tmp_path, short).read_text("utf-8"))
    cells = [cell for rows in other.tables for row in rows for cell in row]
    assert not [cell for cell in cells if "People" in cell or "model" in cell.lower()]
    written = other.text + (tmp_path / "summary.csv").read_text()
    assert "6.45" not in written
    assert "6.82" not in written
    assert "results are not shown next to them (a, CC4 (human); a, CC3-CC4 (human))" in other.text


def test_a_learner_that_compares_lends_nothing_to_one_that_does_not(tmp_path: Path) -> None:
    held = described(tmp_path, "CC4")
    (spec,) = held.learners
    other = replace(spec, name="b", protocol=replace(spec.protocol, attempt_limit=3))
    held = replace(held, learners=(spec, other))
    rows = [row for name in "ab" for row in trial_rows([1, 2, 3], learner=name)]
    page = Page(write_report(table(rows), tmp_path, held).read_text("utf-8"))
    first, conditions = page.tables[:2]
    names = [row[0].split(" | ")[0] for row in first]
    assert names == ["Learner", "people", "a", "b"]
    beside = next(at for at, head in enumerate(first[0]) if "more than people" in head)
    assert [row[beside][:5] for row in first[2:]] == ["−16.3", "–"]
    assert [row[0] for row in conditions] == ["Learner", "a | n = 1", "b | n = 1"]
    headers = [rows[0] for rows in page.tables if rows[0][0] == "Condition"][:2]
    for column in ("People", "Published model"):
        assert [column in header for header in headers] == [True, False]

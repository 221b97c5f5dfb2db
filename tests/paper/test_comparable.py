"""What is published stands beside those who did what people did, and beside nobody else."""

from dataclasses import replace

import pytest

from causal_openlock.analysis.report.writing import figures_of
from causal_openlock.analysis.results.material import Material
from causal_openlock.experiment.condition import PAPER_CONDITIONS
from causal_openlock.experiment.making import read_experiment
from causal_openlock.paper.references import people
from causal_openlock.schemas.schema import schema_from_dict
from support.fabricated_records import table, trial_rows
from support.made_up_experiments import declared, headline_table, summary_table

pytestmark = pytest.mark.slow

ONE_LEVER = "name: CC4\ntitle: Not the paper's\nlevers: [A]\nedges: {A: [door]}\n"
ALL = ", ".join(PAPER_CONDITIONS)


def described(folder, conditions=ALL, **settings):
    """An experiment as a results folder holds it, its protocol perhaps changed."""
    learners = "learners: [{learner: random, name: a}]\n"
    experiment = declared(folder, f"subjects: 2\nconditions: [{conditions}]\n{learners}")
    (spec,) = experiment.learners
    spec = replace(spec, protocol=replace(spec.protocol, **settings))
    return replace(experiment, learners=(spec,))


def pairs(experiment):
    return people().within(experiment).cells


def played(protocol="human"):
    """Two subjects of ``a`` in a baseline and a transfer with the names of the paper's."""
    rows = []
    for subject in (0, 1):
        one = {"subject": subject, "protocol": protocol}
        for trial in range(1, 6):
            rows += trial_rows([1, 2, 3], trial=trial, **one)
        rows += trial_rows([1, 2, 3], condition="CC3-CC4", schema="CC3", **one)
        rows += trial_rows([1, 2, 3], condition="CC3-CC4", phase="test", **one)
    return table(rows)


def test_the_papers_own_experiment_is_comparable_in_every_condition(tmp_path):
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
def test_other_budgets_are_not_comparable(tmp_path, settings):
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
def test_a_condition_is_the_papers_by_its_rooms_and_its_name(tmp_path, trials, alike):
    (tmp_path / "mine.yaml").write_text(ONE_LEVER)
    held = described(tmp_path, f"{{name: CC4, train: [{trials}]}}")
    assert pairs(held) == ({("a", "CC4", "human")} if alike else set())
    assert pairs(described(tmp_path, f"{{name: own, train: [{trials}]}}")) == set()


@pytest.mark.parametrize("change", [{"title": "retitled"}, {"gates": {"door": "all"}}])
def test_the_title_of_a_schema_makes_no_difference_and_its_gates_do(tmp_path, change):
    held = described(tmp_path)
    first, *rest = held.conditions
    schema = schema_from_dict({**first.train[0].schema.as_dict(), **change})
    own = replace(first, train=(replace(first.train[0], schema=schema),))
    kept = PAPER_CONDITIONS if "title" in change else PAPER_CONDITIONS[1:]
    assert {one.name for one in (own, *rest) if one.is_of_paper} == set(kept)


def test_tables_and_figures_leave_out_people_beside_other_rooms(tmp_path):
    assert headline_table(played())["human_attempts"].tolist() == [6.45, 5.525]  # by names alone
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
    names = [plot.name for plot in figures_of(Material.of(played("rl"), own))]
    assert names == ["transfer_categories", "attempts_by_trial_rl"]

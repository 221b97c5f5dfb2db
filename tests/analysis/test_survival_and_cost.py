"""How long trials go unsolved, and what learning costs: small cases by hand, and statsmodels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from statsmodels.duration.survfunc import SurvfuncRight

from causal_openlock.analysis.measures import attempts_to_solve
from causal_openlock.analysis.results.bounds import Bound
from causal_openlock.analysis.topics.learning_cost import (
    TOPIC,
    cost_of_learning,
    learning_costs,
    median_cost,
    shown,
)
from causal_openlock.analysis.topics.solution_costs import TOPIC as SOLUTION_COSTS
from causal_openlock.analysis.topics.solution_costs import solution_costs
from causal_openlock.analysis.topics.survival import unsolved_after
from causal_openlock.experiment.building import Changes
from causal_openlock.experiment.experiment import Origin
from causal_openlock.experiment.file import find_experiment, read_experiment
from support.fabricated_records import Row, table, trial_rows
from support.made_up_experiments import experiment_of, material_of, spec, stored
from support.topics import section_on


def solved_at(attempt: int, **values: object) -> list[Row]:
    """A trial that is solved at an attempt."""
    return trial_rows([0] * (attempt - 1) + [1], 1, **values)


def unsolved(attempts: int, **values: object) -> list[Row]:
    return trial_rows([0] * attempts, 1, **values)


def test_a_trial_at_its_limit_is_censored_and_not_solved() -> None:
    # Solved at 1, 3 and 3; lost at 2: of the three that are left at 3, two are solved by it.
    rows = [
        *solved_at(1, subject=0),
        *unsolved(2, subject=1),
        *solved_at(3, subject=2),
        *solved_at(3, subject=3),
        *unsolved(4, subject=4),
    ]
    found = unsolved_after(attempts_to_solve(table(rows)))
    assert found["attempts"].tolist() == [0, 1, 2, 3, 4]
    assert found["at_risk"].tolist() == [5, 5, 4, 3, 1]
    assert found["unsolved"].tolist() == pytest.approx([1, 0.8, 0.8, 0.8 / 3, 0.8 / 3])
    assert set(found["subjects"]) == {5}
    assert (found["ci_low"] <= found["unsolved"]).all()
    assert (found["unsolved"] <= found["ci_high"]).all()
    assert found["ci_high"].iloc[1] > found["ci_low"].iloc[1]


def test_each_solution_costs_what_it_took_since_the_one_before() -> None:
    rows = [
        *trial_rows([0, 1, 1, 2, 3], subject=0),
        *trial_rows([1, 1, 1, 2, 2], subject=1),  # the third is not found
        *trial_rows([0, 0, 0, 0, 0], subject=2),
    ]
    record = table(rows)
    found = solution_costs(attempts_to_solve(record))
    assert found[["solution", "subjects", "attempts"]].to_numpy().tolist() == [
        ["first", 2, 1.5],
        ["second", 2, 2.5],
        ["third", 1, 1.0],
    ]
    section = section_on(SOLUTION_COSTS, material_of(record, experiment_of(record)))
    assert section is not None
    assert section.tables[0].rows == [
        ["CC4", "a", "1.50 [1.00, 2.00], n = 2", "2.50 [2.00, 3.00], n = 2", "1.00, n = 1"]
    ]
    nothing = table(trial_rows([0, 0]))
    assert section_on(SOLUTION_COSTS, material_of(nothing, experiment_of(nothing))) is None


def test_shares_are_those_of_statsmodels() -> None:
    rng = np.random.default_rng(3)
    times, ends = rng.integers(1, 25, 60), rng.random(60) < 0.7
    rows = [
        row
        for subject, (time, end) in enumerate(zip(times, ends, strict=True))
        for row in (solved_at if end else unsolved)(int(time), subject=subject)
    ]
    found = unsolved_after(attempts_to_solve(table(rows))).set_index("attempts")["unsolved"]
    theirs = SurvfuncRight(times, ends.astype(int))
    np.testing.assert_allclose(found[theirs.surv_times], theirs.surv_prob)


def test_only_the_trials_that_a_condition_is_judged_by_count() -> None:
    rows = [*solved_at(2, trial=1), *solved_at(1, trial=2)]
    found = unsolved_after(attempts_to_solve(table(rows)))
    assert found["unsolved"].tolist() == [1, 0]
    assert found["ci_low"].isna().all()  # of one subject


BOUNDS = {("CC4", "human", "train"): Bound("CC4", 2.0)}


def cost_of(rows: list[Row], **options: float) -> pd.DataFrame:
    return cost_of_learning(attempts_to_solve(table(rows)), BOUNDS, **options)


def test_all_attempts_count_up_to_the_one_that_solves_a_room_well() -> None:
    rows = [
        *solved_at(4, trial=1, layout="a"),  # too many: 1.5 times 2 are 3
        *unsolved(5, trial=2, layout="b"),
        *solved_at(3, trial=3, layout="c"),
        *solved_at(1, trial=4, layout="d"),
    ]
    (row,) = cost_of(rows).to_dict("records")
    assert (row["cost"], row["asked"]) == (4 + 5 + 3, 13)
    assert cost_of(rows, within=2.0)["cost"].tolist() == [4]
    assert cost_of(rows, within=0.5)["cost"].tolist() == [13]
    assert cost_of(rows, within=0.4)["cost"].tolist() == [np.inf]


def test_a_trial_goes_on_and_what_follows_counts_for_the_next_one() -> None:
    rows = [
        *trial_rows([0, 0, 0, 1, 1, 1], 1, trial=1, layout="a"),
        *trial_rows([0, 1, 1, 1], 1, trial=2, layout="b"),
    ]
    assert cost_of(rows)[["cost", "asked"]].to_numpy().tolist() == [[6 + 2, 10]]


def test_a_room_is_new_once() -> None:
    rows = [
        *solved_at(5, loop=1, layout="a"),
        *solved_at(1, loop=2, layout="a"),
    ]
    (row,) = cost_of(rows).to_dict("records")
    assert (row["cost"], row["asked"]) == (np.inf, 5)
    assert cost_of(rows, repeats=True)["cost"].tolist() == [6]


def test_where_no_bound_is_known_nothing_is_asked() -> None:
    assert cost_of(solved_at(1, condition="CE4")).empty
    both = [*solved_at(2, subject=0), *unsolved(3, subject=1)]
    found = cost_of(both)
    assert found["subject"].tolist() == [0, 1]
    assert found["cost"].tolist() == [2, np.inf]


def test_the_median_is_infinite_where_half_never_came_so_far() -> None:
    assert median_cost(np.array([4.0, np.inf, np.inf])) == (np.inf, 4, np.inf)
    middle, low, high = median_cost(np.array([3.0, 5, 6, 9, 200, np.inf]))
    assert middle == 7.5
    assert 3 <= low <= 6
    assert high == np.inf
    assert median_cost(np.full(3, np.inf)) == (np.inf, np.inf, np.inf)
    assert np.isnan(median_cost(np.array([3.0]))[1:]).all()


def test_training_before_the_experiment_counts() -> None:
    rows = [*solved_at(2, subject=0), *solved_at(3, subject=1), *unsolved(5, subject=2)]
    record = table(rows)
    trained = spec("a", recorded=Origin("made_up:A", "made-up 1.0", prior_attempts=1000))
    held = material_of(record, experiment_of(record, learners=(trained,)), bounds=BOUNDS)
    (row,) = learning_costs(held).to_dict("records")
    assert (row["before"], row["subjects"], row["asked"]) == (1000, 3, 1005)
    assert row["attempts"] == 1003
    assert row["reached"] == pytest.approx(2 / 3)
    assert row["ci_low"] >= 1002
    frame = shown(learning_costs(held))
    assert frame["attempts, median"].tolist() == ["1,003"]
    assert frame["95% interval"].tolist() == ["1,002 to beyond"]
    never = shown(learning_costs(held, within=0.5))
    assert never["attempts, median"].tolist() == ["not within 1,005"]


def test_a_median_between_two_numbers_of_attempts_is_not_rounded() -> None:
    record = table([*solved_at(2, subject=0), *solved_at(3, subject=1)])
    held = material_of(record, experiment_of(record, learners=(spec("a"),)), bounds=BOUNDS)
    assert shown(learning_costs(held))["attempts, median"].tolist() == ["2.5"]
    found = section_on(TOPIC, held)
    assert found is not None
    assert "in 1 of 1 learners" in " ".join(found.text)


def test_what_a_learner_declares_of_its_past_is_stored_and_changes_no_identity() -> None:
    before = read_experiment(find_experiment("default"), Changes(["CC3"], ["rl2", "ideal"]))
    rl2, ideal = before.learners
    assert rl2.origin.prior_attempts == 5_022_720 // 3
    assert (rl2.origin.informed, ideal.origin.informed) == (False, True)
    assert rl2.origin.about.startswith("A recurrent policy")
    plain = Origin(rl2.origin.class_name, rl2.origin.package, rl2.origin.artifact_hash)
    other = replace(before, learners=(replace(rl2, recorded=plain), ideal))
    assert other.identity == before.identity
    assert [cell.identity for cell in other.cells()] == [cell.identity for cell in before.cells()]
    assert [one.origin for one in stored(before).learners] == [rl2.origin, ideal.origin]


def test_an_interval_of_medians_that_all_agree_is_that_median() -> None:
    assert median_cost(np.array([9.0, *[4.0] * 60])) == (4, 4, 4)

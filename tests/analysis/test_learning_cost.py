"""How long trials go unsolved, and what learning costs: small cases by hand, and statsmodels."""

import numpy as np
import pytest
from statsmodels.duration.survfunc import SurvfuncRight

from causal_openlock.analysis.measures import attempts_to_solve
from causal_openlock.analysis.topics.learning_cost import costs_by_learner, shown, subject_costs
from causal_openlock.analysis.topics.solution_costs import TOPIC as SOLUTION_COSTS
from causal_openlock.analysis.topics.solution_costs import solution_costs
from causal_openlock.analysis.topics.survival import unsolved_after
from causal_openlock.experiment.origin import Origin
from support.fabricated_records import table, trial_rows
from support.made_up_experiments import experiment_of, material_of, spec
from support.topics import section_on

BOUNDS = {("CC4", "human", "train"): 2.0}


def solved_at(attempt, **values):
    """A trial that is solved at an attempt."""
    return trial_rows([0] * (attempt - 1) + [1], 1, **values)


def unsolved(attempts, **values):
    return trial_rows([0] * attempts, 1, **values)


def cost_of(rows, **options):
    record = table(rows)
    held = material_of(record, experiment_of(record), bounds=BOUNDS)
    return subject_costs(held, held.trials, **options)


def costs_of(rows, **options):
    """What the table of the report shows, of a learner with 1,000 attempts of training."""
    record = table(rows)
    trained = spec("a", recorded=Origin("made_up:A", "made-up 1.0", prior_attempts=1000))
    held = material_of(record, experiment_of(record, learners=(trained,)), bounds=BOUNDS)
    found = costs_by_learner(subject_costs(held, held.trials, **options))
    return found.iloc[0], shown(found).iloc[0]


def test_a_trial_at_its_limit_is_censored_and_not_solved():
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
    # Only the trials that a condition is judged by count.
    rows = [*solved_at(2, trial=1), *solved_at(1, trial=2)]
    found = unsolved_after(attempts_to_solve(table(rows)))
    assert found["unsolved"].tolist() == [1, 0]
    assert found["ci_low"].isna().all()  # of one subject


def test_shares_are_those_of_statsmodels():
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


def test_each_solution_costs_what_it_took_since_the_one_before():
    record = table(
        trial_rows([0, 1, 1, 2, 3], subject=0)
        + trial_rows([1, 1, 1, 2, 2], subject=1)  # the third is not found
        + trial_rows([0, 0, 0, 0, 0], subject=2)
    )
    found = solution_costs(attempts_to_solve(record))
    assert found[["solution", "subjects", "attempts"]].to_numpy().tolist() == [
        ["first", 2, 1.5],
        ["second", 2, 2.5],
        ["third", 1, 1.0],
    ]
    section = section_on(SOLUTION_COSTS, material_of(record, experiment_of(record)))
    assert section.tables[0].rows == [["CC4", "a", "1.50, n = 2", "2.50, n = 2", "1.00, n = 1"]]
    nothing = table(trial_rows([0, 0]))
    assert section_on(SOLUTION_COSTS, material_of(nothing, experiment_of(nothing))) is None


def test_all_attempts_count_up_to_the_one_that_solves_a_new_room_well():
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
    goes_on = [
        *trial_rows([0, 0, 0, 1, 1, 1], 1, trial=1, layout="a"),
        *trial_rows([0, 1, 1, 1], 1, trial=2, layout="b"),
    ]  # what follows a solution counts for the next trial
    assert cost_of(goes_on)[["cost", "asked"]].to_numpy().tolist() == [[6 + 2, 10]]
    twice = [*solved_at(5, loop=1, layout="a"), *solved_at(1, loop=2, layout="a")]
    (row,) = cost_of(twice).to_dict("records")  # a room is new once
    assert (row["cost"], row["asked"]) == (np.inf, 5)


def test_where_no_bound_is_known_nothing_is_asked():
    assert cost_of(solved_at(1, condition="CE4")).empty
    found = cost_of([*solved_at(2, subject=0), *unsolved(3, subject=1)])
    assert found["subject"].tolist() == [0, 1]
    assert found["cost"].tolist() == [2, np.inf]


def test_training_before_the_experiment_counts():
    rows = [row for subject in range(4) for row in solved_at(2 + subject // 2, subject=subject)]
    rows += [*unsolved(5, subject=4), *unsolved(5, subject=5)]
    row, printed = costs_of(rows)
    assert (row["before"], row["subjects"], row["asked"]) == (1000, 6, 1005)
    assert row["attempts"] == 1003
    assert row["reached"] == pytest.approx(2 / 3)
    assert row["ci_low"] >= 1002
    assert printed["attempts, median"] == "1,003"
    assert printed["95% interval"] == "1,002 to beyond"
    assert costs_of(rows, within=0.5)[1]["attempts, median"] == "not within 1,005"
    between = [*solved_at(2, subject=0), *solved_at(3, subject=1)]
    assert costs_of(between)[1]["attempts, median"] == "1,002.5"

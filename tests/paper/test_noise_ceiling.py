"""What a distance from people is worth, against formulas, simulation and published figures."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from causal_openlock.analysis.measures import TRANSFERS
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import references_beside
from causal_openlock.experiment.file import read_experiment
from causal_openlock.paper.likeness import (
    distance,
    distance_with_spreads,
    likeness,
    mixture,
    points_of,
    points_of_model,
    points_of_people,
    spread_distance,
    training_points_of,
    training_points_of_model,
)
from causal_openlock.paper.likeness_section import TOPIC
from causal_openlock.paper.noise_ceiling import (
    NULL_CURVES,
    PERFECT,
    beside_null_models,
    chosen_settings,
    drawn_means,
    misfit,
    noise_ceiling,
    null_curves,
    rmse_difference,
)
from causal_openlock.paper.published import model_in_training, people_in_training
from causal_openlock.paper.references import people
from causal_openlock.schemas.finding import bundled
from support.fabricated_records import table
from support.made_up_experiments import declared, stored
from support.made_up_people import made_up
from support.topics import section_on


def by_solution(points: pd.DataFrame) -> dict[str, float]:
    return {str(name): distance(own)[0] for name, own in points.groupby("solution")}


# -- training, published elsewhere ----------------------------------------------------------------


def test_the_model_of_cogsci_2019_is_as_far_from_people_as_its_figure_shows():
    expected = {"all": 2.78, "first": 4.21, "second": 1.24}
    assert by_solution(training_points_of_model()) == pytest.approx(expected, abs=0.005)
    assert len(people_in_training()) == len(model_in_training()) == 36


def test_first_and_second_solution_of_the_published_model_add_up_to_all():
    means = model_in_training().query("schema == 'CC3'").pivot(
        index="trial", columns="solution", values="mean"
    )  # fmt: skip
    assert (means["first"] + means["second"] - means["all"]).abs().max() < 0.15


def training(off: int = 0) -> pd.DataFrame:
    """Two subjects of each transfer condition that need 4 + trial attempts, the first 2 of them."""
    rows = [
        ("a", condition, "human", "made up", 1, subject, "train", 1, trial, 4 + trial + off, 2,
         True)
        for condition in TRANSFERS
        for subject in range(2)
        for trial in range(1, 7)
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=list(made_up().columns))


def test_training_is_taken_together_whatever_the_test_and_compared_by_solution():
    points = training_points_of(training()).set_index(["schema", "solution", "trial"])
    assert len(points) == 36
    assert (points["subjects"] == 4).all()
    assert points.loc[("CE3", "all", 3), ["mean", "people_mean"]].tolist() == [7.0, 7.73]
    assert points.loc[("CC3", "first", 2), ["mean", "people_mean"]].tolist() == [2.0, 2.84]
    assert points.loc[("CC3", "second", 5), ["mean", "se"]].tolist() == [7.0, 0.0]


def test_who_did_not_solve_a_room_counts_in_all_but_not_in_first_and_second():
    trials = training()
    lost = (trials["subject"] == 1) & (trials["trial"] == 4)
    trials.loc[lost, ["attempts", "first_solution", "solved"]] = 30, 30, False
    points = training_points_of(trials).set_index(["schema", "solution", "trial"])
    assert points.loc[("CC3", "all", 4), "mean"] == (8 + 30) / 2
    assert points.loc[("CC3", "first", 4), ["subjects", "mean"]].tolist() == [2, 2.0]
    assert points.loc[("CC3", "second", 1), "subjects"] == 2


def test_baselines_and_tests_are_no_training():
    assert training_points_of(made_up()).empty
    assert training_points_of(pd.concat([made_up(), training()]))["subjects"].eq(4).all()


# -- spreads and mixtures -------------------------------------------------------------------------


def test_spreads_are_standard_deviations_over_subjects():
    points = points_of_people()
    assert spread_distance(points) == 0
    wider = points.assign(se=points["se"] + 3 / np.sqrt(40))
    assert spread_distance(wider) == pytest.approx(3)
    fewer = points.assign(se=points["se"] * 2, subjects=10)  # the same standard deviation
    assert spread_distance(fewer) == pytest.approx(0)
    off = wider.assign(mean=points["mean"] + 4)
    assert distance_with_spreads(off) == pytest.approx(np.sqrt((9 + 16) / 2))


def test_in_a_mixture_every_subject_counts_once():
    near, far = made_up("near", subjects=30), made_up("far", subjects=12, off=8.0)
    trials = mixture(pd.concat([near, far, made_up("other")]), {"near": 30, "far": 10}, "both")
    points = points_of(trials)
    assert points["subjects"].eq(40).all()
    assert distance(points)[0] == pytest.approx(2.0, abs=0.3)  # a quarter is eight off
    apart = points_of(near)["se"].mean() * np.sqrt(30)
    assert (points["se"] * np.sqrt(40)).mean() > 3 * apart


# -- sampling error -------------------------------------------------------------------------------


def test_the_noise_ceiling_is_what_simulated_people_come_to():
    found = noise_ceiling(points_of_people())
    assert found.people == pytest.approx(1.206, abs=0.0005)
    # Forty people at each point, drawn with people's means and standard deviations.
    rng, points = np.random.default_rng(1), points_of_people()
    sd = points["people_se"].to_numpy() * 40 / np.sqrt(39)
    people = rng.normal(points["people_mean"], sd, (4000, 40, 14)).mean(axis=1)
    apart = np.sqrt(((people - points["people_mean"].to_numpy()) ** 2).mean(axis=1))
    assert np.sqrt((apart**2).mean()) == pytest.approx(found.people, abs=0.02)
    assert np.quantile(apart, [0.025, 0.975]) == pytest.approx([found.low, found.high], abs=0.05)
    assert found.own == pytest.approx(found.people)  # as many subjects, as different as people
    assert found.both == pytest.approx(np.sqrt(2) * found.people)


@pytest.mark.parametrize(("fitted", "subjects"), [(0, 40), (4, 40), (4, 4000)])
def test_ceiling_and_misfit_are_those_of_simulated_perfect_models(fitted: int, subjects: int):
    """True means in all but some directions, in which numbers were fitted to what was measured."""
    rng = np.random.default_rng(3)
    points = points_of_people().assign(mean=0.0, people_mean=0.0, people_se=1.0)
    points = points.assign(subjects=subjects, se=np.sqrt(40 / subjects))  # differ like people
    errors = [np.sqrt(40 / 39), np.sqrt(40 / (subjects - 1))]
    directions = np.linalg.qr(rng.normal(size=(14, 14)))[0][:, :fitted]
    squares, sums, rejected = [], [], []
    for _ in range(800):
        people, luck = rng.normal(0.0, errors, (14, 2)).T
        own = points.assign(people_mean=people, mean=directions @ (directions.T @ people) + luck)
        found = misfit(own, fitted)
        squares.append(distance(own)[0] ** 2)
        sums.append(found.chi2)
        rejected.append(found.p < 0.05)
    ceiling = noise_ceiling(points, fitted).both
    assert np.sqrt(np.mean(squares)) == pytest.approx(ceiling, rel=0.02)
    assert np.mean(sums) == pytest.approx(found.df, rel=0.03)
    assert 0.03 < np.mean(rejected) < 0.07


def test_a_misfit_in_one_well_known_mean_is_seen_where_the_distance_looks_perfect():
    points = points_of_people().assign(se=0.0)
    best_known = points["people_se"].idxmin()
    off = points["people_mean"] + 4.0 * (points.index == best_known)
    found = misfit(points.assign(mean=off))
    assert distance(points.assign(mean=off))[0] < noise_ceiling(points).people
    assert found.df == 14
    assert found.p < 1e-6
    assert np.isnan(misfit(points[:0]).p)
    assert misfit(points[:0]).in_words == ""


def test_null_curves_come_to_what_is_reported_of_them():
    curves = null_curves()
    assert list(curves) == list(NULL_CURVES)
    plain, schema = curves.values()
    assert distance(plain.points)[0] == pytest.approx(2.06, abs=0.005)
    assert distance(schema.points)[0] == pytest.approx(0.68, abs=0.005)
    assert (len(plain.numbers), len(schema.numbers)) == (3, 4)
    last, gain, rate, cost = schema.numbers
    means = schema.points.set_index(["condition", "trial"])["mean"]
    assert means["CC4", 3] == pytest.approx(last + gain * np.exp(-2 / rate))
    assert means["CC3-CE4", 1] == pytest.approx(last + gain * np.exp(-6 / rate) + 2 * cost)
    # No other numbers are nearer.
    for change in np.vstack([np.eye(4), -np.eye(4)]) * 0.05:
        other = schema.points.copy()
        changed = (
            last
            + change[0]
            + (gain + change[1])
            * np.exp(-np.array([0, 1, 2, 3, 4] * 2 + [6] * 4) / (rate + change[2]))
        )
        harder = np.array([0] * 5 + [1] * 5 + [0, 1, 2, 1])
        other["mean"] = changed + (cost + change[3]) * harder
        assert distance(other)[0] > distance(schema.points)[0]


def compared(first: pd.DataFrame, second: pd.DataFrame, seed: int = 0):
    rng = np.random.default_rng(seed)
    points = points_of(first), points_of(second)
    drawn = drawn_means(points[0], first, rng), drawn_means(points[1], second, rng)
    return rmse_difference(points, drawn, rng)


def test_models_are_ranked_only_where_peoples_sampling_error_allows():
    at = made_up("at", off=0.2, subjects=40)
    assert compared(at, made_up("far", off=6.0, subjects=40)).verdict == "nearer"
    assert compared(made_up("far", off=6.0, subjects=40), at).verdict == "farther"
    close = compared(at, made_up("close", off=-0.6, subjects=40))
    assert close.verdict == "not ranked"
    assert close.low < close.rmse < close.high
    assert close.rmse == pytest.approx(-0.4)


def test_the_interval_covers_the_true_difference_as_often_as_it_says():
    rng, points = np.random.default_rng(5), points_of_people()
    truth, error = points["people_mean"].to_numpy(), points["people_se"].to_numpy()
    off = rng.normal(0, 2, (2, 14))
    covered = 0
    for _ in range(150):  # studies of people, each with means of its own
        study = points.assign(people_mean=rng.normal(truth, error * np.sqrt(40 / 39)), se=0.0)
        models = tuple(study.assign(mean=truth + one) for one in off)
        draws = tuple(drawn_means(one, None, rng) for one in models)
        found = rmse_difference(models, draws, rng)
        scale = sum(distance(one)[0] for one in models)
        expected = ((off[0] ** 2).mean() - (off[1] ** 2).mean()) / scale
        covered += found.low <= expected <= found.high
    assert 0.88 <= covered / 150 <= 0.99


def test_few_subjects_do_not_make_a_model_farther_than_its_means_are():
    rng, points = np.random.default_rng(2), points_of_people()
    models = [points.assign(mean=points["people_mean"] + 3, se=se) for se in (2.0, 0.0)]
    drawn = [drawn_means(one, None, rng) for one in models]
    found = rmse_difference((models[0], models[1]), (drawn[0], drawn[1]), rng)
    assert found.rmse == 0
    assert (found.low + found.high) / 2 == pytest.approx(0, abs=0.15)


def test_subjects_are_resampled_with_all_their_trials():
    trials = made_up(subjects=50)
    trials["attempts"] += trials["subject"] % 2 * 10  # half of them are slow throughout
    points = points_of(trials)
    drawn = drawn_means(points, trials, np.random.default_rng(0))
    assert drawn.mean(axis=0) == pytest.approx(points["mean"].to_numpy(), abs=0.2)
    assert drawn.std(axis=0) == pytest.approx(points["se"].to_numpy(), rel=0.1)
    correlation = np.corrcoef(drawn.T)
    assert correlation[0, 1] > 0.9  # trials of one baseline
    assert abs(correlation[0, 5]) < 0.1  # other subjects


# -- beside every distance ------------------------------------------------------------------------


def test_every_distance_stands_beside_what_it_is_worth():
    trials = pd.concat([made_up("near", off=1.0), made_up("far", off=6.0),
                        training().assign(learner="near")], ignore_index=True)  # fmt: skip
    like = likeness(trials, people().beside(None), ["near", "far"])
    assert like is not None
    found = beside_null_models(like, trials, {"near": 6}, {"near": 4}).set_index("learner")
    assert set(NULL_CURVES) < set(found.index)
    assert found["rmse"].dropna().is_monotonic_increasing
    assert found.loc["near", "settings"] == 6
    assert found["settings"].isna()["far"]
    expected = by_solution(training_points_of(trials))
    assert found.loc["near", ["all", "first", "second"]].to_dict() == pytest.approx(expected)
    assert np.isnan(found.loc["far", "all"])
    assert found.loc["near", "baselines"] == pytest.approx(1.0)
    assert (found.loc["far", "verdict"], found.loc["far", "difference"]) == (
        "farther", pytest.approx(5.0))  # fmt: skip
    assert found.loc[PERFECT, "rmse"] == pytest.approx(1.206, abs=0.0005)
    assert found.loc["near", "misfit"] == misfit(like.points["near"], 4).in_words
    assert found.loc["near", "ceiling"] == noise_ceiling(like.points["near"], 4).both
    assert found.loc["far", "misfit"] == misfit(like.points["far"]).in_words
    assert found.loc["far", "misfit"].startswith("χ²(14) = ")
    assert found.loc["near", "misfit_all"].startswith("χ²(12) = ")
    curve = found.loc["curve of 4 numbers"]
    assert curve["misfit"] == "χ²(10) = 5.7, p = .843"
    assert curve["ceiling"] == pytest.approx(1.206 * np.sqrt(10 / 14), abs=0.001)


def test_settings_are_those_that_differ_from_the_defaults():
    experiment = stored(read_experiment(bundled("experiments") / "bayes_like_people.yaml"))
    whole = made_up("bayes_like_people")
    material = Material(
        table([]), experiment, whole, ("bayes_like_people",), references_beside(None), {}
    )
    settings = chosen_settings(material.experiment.learners)
    assert settings["bayes_like_people"] == 6
    assert settings["bayes"] == 0
    found = section_on(TOPIC, material)
    assert found is not None
    shown = found.tables[0].frame.set_index("learner")["settings"]
    assert shown["bayes_like_people"] == 6


def test_defaults_are_recognised_in_a_results_folder(tmp_path):
    text = "conditions: [CC4]\nsubjects: 1\nlearners: [bayes, ddqn, recurrent, random, rl2]\n"
    material = Material(table([]), declared(tmp_path, text), made_up("bayes"), ("bayes",),
                        (), {})  # fmt: skip
    assert set(chosen_settings(material.experiment.learners).values()) == {0}


def test_the_published_model_and_people_have_the_form_of_learners():
    assert list(points_of_model().columns) == list(points_of(made_up()).columns)

"""What a distance from people is worth, against formulas, simulation and published figures."""

import numpy as np
import pandas as pd
import pytest

from causal_openlock.analysis.measures import TRANSFERS
from causal_openlock.paper.likeness import (
    distance,
    points_of,
    points_of_people,
    training_points_of,
    training_points_of_model,
)
from causal_openlock.paper.noise_ceiling import (
    drawn_means,
    misfit,
    noise_ceiling,
    null_curve,
    rmse_difference,
)
from support.made_up_people import made_up


def test_the_model_of_cogsci_2019_is_as_far_from_people_as_its_figure_shows():
    assert distance(training_points_of_model())[0] == pytest.approx(2.78, abs=0.005)
    assert len(training_points_of_model()) == 12


def training():
    """Two subjects of each transfer condition that need 4 + trial attempts."""
    rows = [
        (condition, subject, trial, 4 + trial)
        for condition in TRANSFERS
        for subject in range(2)
        for trial in range(1, 7)
    ]
    trials = pd.DataFrame(rows, columns=["condition", "subject", "trial", "attempts"]).assign(
        learner="a", protocol="human", experiment="made up", seed=1, phase="train", loop=1
    )
    return trials.assign(first_solution=2, solved=True)


def test_training_is_taken_together_whatever_the_test():
    # Baselines and tests are no training.
    points = training_points_of(pd.concat([made_up(), training()]))
    assert len(points) == 12
    assert (points["subjects"] == 4).all()
    points = points.set_index(["condition", "trial"])
    assert points.loc[("CE3", 3), ["mean", "se", "people_mean"]].tolist() == [7.0, 0.0, 7.73]
    trials = training()
    lost = (trials["subject"] == 1) & (trials["trial"] == 4)
    trials.loc[lost, ["attempts", "solved"]] = 30, False
    points = training_points_of(trials).set_index(["condition", "trial"])
    assert points.loc[("CC3", 4), ["mean", "se"]].tolist() == [(8 + 30) / 2, 11 / np.sqrt(4)]


def test_the_noise_ceiling_is_the_distance_of_simulated_people():
    found = noise_ceiling(points_of_people())
    assert found.people == pytest.approx(1.206, abs=0.0005)
    # Forty people at each point, drawn with people's means and standard deviations.
    rng, points = np.random.default_rng(1), points_of_people()
    sd = points["people_se"].to_numpy() * 40 / np.sqrt(39)
    people = rng.normal(points["people_mean"], sd, (4000, 40, 14)).mean(axis=1)
    apart = np.sqrt(((people - points["people_mean"].to_numpy()) ** 2).mean(axis=1))
    assert np.sqrt((apart**2).mean()) == pytest.approx(found.people, abs=0.02)
    assert np.quantile(apart, [0.025, 0.975]) == pytest.approx([found.low, found.high], abs=0.05)
    assert found.both == pytest.approx(np.sqrt(2) * found.people)  # as many subjects, as different


@pytest.mark.parametrize(("fitted", "subjects"), [(0, 40), (4, 40), (4, 4000)])
def test_ceiling_and_misfit_are_those_of_simulated_perfect_models(fitted, subjects):
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
    points["mean"] = points["people_mean"] + 4.0 * (points.index == best_known)
    found = misfit(points)
    assert distance(points)[0] < noise_ceiling(points).people
    assert found.df == 14
    assert found.p < 1e-6
    assert np.isnan(misfit(points[:0]).p)
    assert misfit(points[:0]).in_words == ""


def test_the_null_curve_is_the_nearest_of_its_form():
    points = null_curve()
    assert distance(points)[0] == pytest.approx(0.68, abs=0.005)
    trials_before = np.array([0, 1, 2, 3, 4] * 2 + [6] * 4)
    harder = np.array([0] * 5 + [1] * 5 + [0, 1, 2, 1])
    # Of its form, with the rate that it has: a sum of three columns, of which it is the nearest.
    gain = np.diff(points["mean"][:5])
    rate = -1 / np.log(gain[1] / gain[0])
    columns = np.stack([np.ones(14), np.exp(-trials_before / rate), harder], axis=1)
    nearest, *_ = np.linalg.lstsq(columns, points["people_mean"], rcond=None)
    assert columns @ nearest == pytest.approx(points["mean"].to_numpy(), abs=1e-4)
    for other in (0.9 * rate, 1.1 * rate):
        columns[:, 1] = np.exp(-trials_before / other)
        _, squares, *_ = np.linalg.lstsq(columns, points["people_mean"], rcond=None)
        assert np.sqrt(squares[0] / 14) > distance(points)[0]


def compared(first, second):
    rng = np.random.default_rng(0)
    points = points_of(first), points_of(second)
    drawn = drawn_means(points[0], first, rng), drawn_means(points[1], second, rng)
    return rmse_difference(points, drawn, rng)


def test_models_are_ranked_only_where_peoples_sampling_error_allows():
    at, far = made_up("at", off=0.2, subjects=40), made_up("far", off=6.0, subjects=40)
    assert compared(at, far).verdict == "nearer"
    assert compared(far, at).verdict == "farther"
    close = compared(at, made_up("close", off=-0.6, subjects=40))
    assert close.verdict == "not ranked"
    assert close.low < close.difference < close.high
    assert close.difference == pytest.approx(-0.4)


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
    # Few subjects do not make a model farther than its means are.
    models = tuple(points.assign(mean=points["people_mean"] + 3, se=se) for se in (2.0, 0.0))
    found = rmse_difference(models, tuple(drawn_means(one, None, rng) for one in models), rng)
    assert found.difference == 0
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

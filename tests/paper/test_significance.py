"""The paper's tests: from published means alone, and against scipy and statsmodels."""

import warnings

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from statsmodels.formula.api import ols
from statsmodels.multivariate.manova import MANOVA
from statsmodels.stats.anova import anova_lm

from causal_openlock.analysis.effects import Group
from causal_openlock.paper.significance import INTERACTION, contrast_test, t_test, trial_test
from causal_openlock.world import facts


@pytest.fixture(autouse=True)
def _no_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def published(condition, trial=None):
    human = facts.results()["cogsci2018"]["human"]
    if trial is None:
        values = human["transfer"][condition]
        return Group.published(values["mean"], values["se"], 40)
    values = human["baseline"][condition]
    return Group.published(values["mean"][trial - 1], values["se"][trial - 1], 40)


def sample(seed, mean=8, size=40):
    return np.random.default_rng(seed).normal(mean, 3, size)


def normal_like(group):
    """Values with exactly the mean and the variance of a group."""
    values = np.random.default_rng(group.size).normal(size=group.size)
    values = (values - values.mean()) / values.std(ddof=1)
    return group.mean + values * np.sqrt(group.variance)


@pytest.mark.parametrize("form", [lambda group: group, normal_like], ids=["summary", "values"])
def test_the_papers_statistics_follow_from_its_means_and_error_bars(form):
    def of(condition, trial=None):
        return form(published(condition, trial))

    for groups, printed in (
        ((of("CE4", 5), of("CC4", 5)), 2.00),
        ((of("CE3-CC4"), of("CC3-CC4")), 2.62),
        ((of("CC3-CE4"), of("CE3-CE4")), 4.27),
    ):
        found = t_test(*groups)
        assert (found.df, found.value) == ((78,), pytest.approx(printed, abs=0.005))
        assert found.p < 0.05
    cells = [of(name) for name in ("CE3-CC4", "CC3-CC4", "CE3-CE4", "CC3-CE4")]
    interaction = contrast_test(cells, INTERACTION)
    assert (interaction.df, interaction.value) == ((1, 156), pytest.approx(24.94, abs=0.015))
    values = [
        np.concatenate([normal_like(published(f"{trained}-{test}")) for trained in ("CC3", "CE3")])
        for test in ("CE4", "CC4")
    ]
    tested = contrast_test(values)
    assert (tested.df, tested.value) == ((1, 158), pytest.approx(17.14, abs=0.01))
    assert tested.p < 0.001


def test_with_error_bars_of_sample_deviations_they_would_not():
    """The ruling that bars are population SD / √n is what makes the numbers come out."""
    groups = [published("CE4", 5), published("CC4", 5)]
    other = [Group(one.size, one.mean, one.variance * 39 / 40) for one in groups]
    assert abs(t_test(*other).value - 2.00) > 0.015


def test_two_groups_are_compared_as_scipy_does_with_effects_by_hand():
    one, other = sample(1, 9), sample(2, 7, 25)
    ours, theirs = t_test(one, other), stats.ttest_ind(one, other)
    assert (ours.value, ours.p) == pytest.approx((theirs.statistic, theirs.pvalue))
    pooled = (39 * one.var(ddof=1) + 24 * other.var(ddof=1)) / 63
    assert ours.effect == pytest.approx((one.mean() - other.mean()) / pooled**0.5)
    assert ours.difference == pytest.approx(one.mean() - other.mean())
    ours, theirs = contrast_test([one, other]), stats.f_oneway(one, other)
    assert (ours.value, ours.p) == pytest.approx((theirs.statistic, theirs.pvalue))
    everyone = np.concatenate([one, other])
    within = sum(((group - group.mean()) ** 2).sum() for group in (one, other))
    total = ((everyone - everyone.mean()) ** 2).sum()
    assert ours.effect == pytest.approx(1 - within / total)
    assert ours.df == (1, 63)


@pytest.mark.parametrize("sizes", [(20, 20, 20, 20), (12, 25, 31, 18)])
def test_the_interaction_is_that_of_statsmodels(sizes):
    values = [sample(k, *of) for k, of in enumerate(zip((5, 8, 8, 13), sizes, strict=True))]
    test, train = (np.repeat(names, sizes) for names in (["C", "C", "E", "E"], [*"CECE"]))
    frame = pd.DataFrame({"y": np.concatenate(values), "test": test, "train": train})
    fitted = ols("y ~ C(test, Sum) * C(train, Sum)", frame).fit()
    row = anova_lm(fitted, typ=3).loc["C(test, Sum):C(train, Sum)"]
    ours = contrast_test(values, INTERACTION)
    assert (ours.value, ours.p) == pytest.approx((row["F"], row["PR(>F)"]))
    assert ours.df == (1, sum(sizes) - 4)
    cells = [one.mean() for one in values]
    assert ours.difference == pytest.approx((cells[0] - cells[1] - cells[2] + cells[3]) / 2)


@pytest.mark.parametrize("sizes", [(40, 40), (40, 40, 40, 40), (17, 26), (12,)])
def test_the_trial_effect_is_the_manova_of_statsmodels(sizes):
    trials = 5 if len(sizes) == 2 else 6
    rng = np.random.default_rng(4)
    course = 8 * 0.6 ** np.arange(trials)
    groups = [rng.normal(course + g, 4, (n, trials)) for g, n in enumerate(sizes)]
    ours = trial_test(groups)
    steps = np.concatenate([np.diff(one, axis=1) for one in groups])
    # Effect coding: the intercept is the mean of the groups, each counting alike.
    coded = np.eye(len(sizes))[np.repeat(np.arange(len(sizes)), sizes)]
    design = np.c_[np.ones(len(coded)), coded[:, :-1] - coded[:, -1:]]
    contrast = [("mean", np.eye(1, design.shape[1]))]
    found = MANOVA(steps, design).mv_test(contrast).results["mean"]["stat"].loc["Wilks' lambda"]
    assert ours.value == pytest.approx(float(found["F Value"]))
    assert ours.df == (found["Num DF"], found["Den DF"])
    if sum(sizes) == 80:  # as in the paper
        assert ours.df == (4, 75)
    assert ours.p == pytest.approx(float(found["Pr > F"]))
    assert ours.effect == pytest.approx(1 - float(found["Value"]))
    first, last = (np.mean([one[:, i].mean() for one in groups]) for i in (0, -1))
    assert ours.difference == pytest.approx(first - last)


def test_subjects_that_do_not_differ_give_no_number():
    three, five = np.full(20, 3.0), np.full(20, 5.0)
    tenth = np.full(20, 0.1)  # its mean is not 0.1 in the last digit
    rng = np.random.default_rng(1)
    trials = rng.poisson(6, (20, 5)).astype(float)
    trials[:, 3] = trials[:, 2] - 1
    dependent = trials.copy()
    dependent[:, 3] = 2 * trials[:, 1] - trials[:, 0] + 1  # follows from others, and yet varies
    for outcome in (
        t_test(three, three),
        t_test(tenth, tenth),
        contrast_test([five, three]),
        contrast_test([three] * 4, INTERACTION),
        trial_test([np.full((20, 5), 3.0)] * 2),
        trial_test([np.full((20, 5), 0.1), np.full((20, 5), 0.3)]),
        trial_test([trials, trials + 1]),
        trial_test([dependent]),
        t_test(np.ones(1), np.ones(1)),
        trial_test([rng.random((2, 5)), rng.random((3, 5))]),
        trial_test([rng.random((9, 1))]),
    ):
        assert np.isnan([outcome.value, outcome.p, outcome.effect]).all()
    assert contrast_test([five, three]).difference == 2
    assert trial_test([rng.random((3, 5)), rng.random((3, 5))]).p > 0
    assert t_test(np.array([9.0]), np.array([1.0, 2.0, 3.0])).df == (2,)

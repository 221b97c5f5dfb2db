"""The paper's tests: from published means alone, and against scipy and statsmodels."""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from causal_openlock.analysis.effects import Group
from causal_openlock.paper.significance import (
    INTERACTION,
    Sample,
    contrast_test,
    t_test,
    trial_test,
)
from causal_openlock.world import facts


@pytest.fixture(autouse=True)
def _no_warnings() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def published(condition: str, trial: int | None = None) -> Group:
    human = facts.results()["cogsci2018"]["human"]
    if trial is None:
        values = human["transfer"][condition]
        return Group.published(values["mean"], values["se"], 40)
    values = human["baseline"][condition]
    return Group.published(values["mean"][trial - 1], values["se"][trial - 1], 40)


def sample(seed: int, mean: float = 8, size: int = 40) -> np.ndarray:
    return np.random.default_rng(seed).normal(mean, 3, size)


def normal_like(group: Group) -> np.ndarray:
    """Values with exactly the mean and the variance of a group."""
    values = np.random.default_rng(group.size).normal(size=group.size)
    values = (values - values.mean()) / values.std(ddof=1)
    return group.mean + values * np.sqrt(group.variance)


# -- published numbers ----------------------------------------------------------------------------


@pytest.mark.parametrize("form", [lambda group: group, normal_like], ids=["summary", "values"])
def test_the_papers_statistics_follow_from_its_means_and_error_bars(form: object) -> None:
    def of(condition: str, trial: int | None = None) -> Sample:
        return form(published(condition, trial))  # type: ignore[operator]

    at_trial_5 = t_test(of("CE4", 5), of("CC4", 5))
    assert (at_trial_5.df, at_trial_5.value) == ((78,), pytest.approx(2.00, abs=0.005))
    assert at_trial_5.p < 0.05
    on_cc4 = t_test(of("CE3-CC4"), of("CC3-CC4"))
    assert (on_cc4.df, on_cc4.value) == ((78,), pytest.approx(2.62, abs=0.005))
    assert on_cc4.p == pytest.approx(0.01, abs=0.002)
    on_ce4 = t_test(of("CC3-CE4"), of("CE3-CE4"))
    assert (on_ce4.df, on_ce4.value) == ((78,), pytest.approx(4.27, abs=0.005))
    cells = [of(name) for name in ("CE3-CC4", "CC3-CC4", "CE3-CE4", "CC3-CE4")]
    interaction = contrast_test(cells, INTERACTION)
    assert (interaction.df, interaction.value) == ((1, 156), pytest.approx(24.94, abs=0.015))
    values = [
        np.concatenate([normal_like(published(f"{trained}-{test}")) for trained in ("CC3", "CE3")])
        for test in ("CE4", "CC4")
    ]
    tested = contrast_test(values)
    assert (tested.df, tested.value) == ((1, 158), pytest.approx(17.14, abs=0.01))
    assert str(tested).startswith("F(1, 158) = 17.14, p < .001")


def test_with_error_bars_of_sample_deviations_they_would_not() -> None:
    """The ruling that bars are population SD / √n is what makes the numbers come out."""
    groups = [published("CE4", 5), published("CC4", 5)]
    other = [Group(one.size, one.mean, one.variance * 39 / 40) for one in groups]
    assert abs(t_test(*other).value - 2.00) > 0.015  # type: ignore[operator]


# -- by other means -------------------------------------------------------------------------------


def test_t_is_scipys_and_d_is_by_hand() -> None:
    one, other = sample(1, 9), sample(2, 7, 25)
    ours, theirs = t_test(one, other), stats.ttest_ind(one, other)
    assert (ours.value, ours.p) == (pytest.approx(theirs.statistic), pytest.approx(theirs.pvalue))
    pooled = (39 * one.var(ddof=1) + 24 * other.var(ddof=1)) / 63
    assert ours.effect == pytest.approx((one.mean() - other.mean()) / pooled**0.5)
    assert ours.difference == pytest.approx(one.mean() - other.mean())


def test_one_way_is_scipys_and_its_effect_a_share_of_squares() -> None:
    groups = [sample(1, 9), sample(2, 7, 25)]
    ours, theirs = contrast_test(groups), stats.f_oneway(*groups)
    assert (ours.value, ours.p) == (pytest.approx(theirs.statistic), pytest.approx(theirs.pvalue))
    everyone = np.concatenate(groups)
    within = sum(((one - one.mean()) ** 2).sum() for one in groups)
    total = ((everyone - everyone.mean()) ** 2).sum()
    assert ours.effect == pytest.approx(1 - within / total)
    assert ours.df == (1, 63)


@pytest.mark.parametrize("sizes", [(20, 20, 20, 20), (12, 25, 31, 18)])
def test_the_interaction_is_that_of_statsmodels(sizes: tuple[int, ...]) -> None:
    from statsmodels.formula.api import ols
    from statsmodels.stats.anova import anova_lm

    means = (5, 8, 8, 13)
    values = [
        sample(seed, mean, n) for seed, (mean, n) in enumerate(zip(means, sizes, strict=True))
    ]
    frame = pd.DataFrame(
        {
            "y": np.concatenate(values),
            "test": np.repeat(["CC", "CC", "CE", "CE"], sizes),
            "train": np.repeat(["CC", "CE", "CC", "CE"], sizes),
        }
    )
    fitted = ols("y ~ C(test, Sum) * C(train, Sum)", frame).fit()
    row = anova_lm(fitted, typ=3).loc["C(test, Sum):C(train, Sum)"]
    ours = contrast_test(values, INTERACTION)
    assert (ours.value, ours.p) == (pytest.approx(row["F"]), pytest.approx(row["PR(>F)"]))
    assert ours.df == (1, sum(sizes) - 4)
    cells = [one.mean() for one in values]
    assert ours.difference == pytest.approx((cells[0] - cells[1] - cells[2] + cells[3]) / 2)


@pytest.mark.parametrize("sizes", [(40, 40), (40, 40, 40, 40), (17, 26)])
def test_the_trial_effect_is_the_manova_of_statsmodels(sizes: tuple[int, ...]) -> None:
    from statsmodels.multivariate.manova import MANOVA

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
    assert ours.p == pytest.approx(float(found["Pr > F"]))
    assert ours.effect == pytest.approx(1 - float(found["Value"]))
    first, last = (np.mean([one[:, i].mean() for one in groups]) for i in (0, -1))
    assert ours.difference == pytest.approx(first - last)


def test_degrees_of_freedom_are_the_papers() -> None:
    rng = np.random.default_rng(0)
    assert trial_test([rng.random((40, 5)) for _ in range(2)]).df == (4, 75)
    assert trial_test([rng.random((40, 6)) for _ in range(4)]).df == (5, 152)


# -- invariances ----------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    shift=st.floats(-50, 50),
    scale=st.floats(0.1, 20),
    sizes=st.lists(st.integers(4, 15), min_size=4, max_size=4),
)
def test_neither_unit_nor_origin_nor_order_changes_a_statistic(
    seed: int, shift: float, scale: float, sizes: list[int]
) -> None:
    rng = np.random.default_rng(seed)
    values = [rng.normal(rng.random(), 1, (n, 3)) for n in sizes]
    moved = [rng.permutation(shift + scale * one, axis=0) for one in values]
    for first, second in (
        (trial_test(values), trial_test(moved)),
        *(
            (
                test([one[:, 0] for one in values]),
                test([one[:, 0] for one in moved]),
            )
            for test in (
                lambda of: t_test(of[0], of[1]),
                lambda of: contrast_test(of, INTERACTION),
                lambda of: contrast_test(of, (1, 1, -3, 1)),
            )
        ),
    ):
        assert second.value == pytest.approx(first.value, rel=1e-6)
        assert second.effect == pytest.approx(first.effect, rel=1e-6)
        assert second.difference == pytest.approx(scale * first.difference, rel=1e-6, abs=1e-6)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_squared_t_is_f_and_exchange_changes_the_sign_alone(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, other = rng.random(9), rng.random(7)
    t, f = t_test(one, other), contrast_test([one, other])
    assert t.value**2 == pytest.approx(f.value)
    assert t.p == pytest.approx(f.p)
    assert t_test(other, one).value == pytest.approx(-t.value)


# -- what is not defined --------------------------------------------------------------------------


def test_subjects_that_do_not_differ_are_said_and_no_number_is_given() -> None:
    three, five = np.full(20, 3.0), np.full(20, 5.0)
    tenth = np.full(20, 0.1)  # its mean is not 0.1 in the last digit
    for outcome, reason in (
        (t_test(three, three), "every subject needed 3 attempts"),
        (t_test(tenth, tenth), "every subject needed 0.1 attempts"),
        (contrast_test([five, three]), "as many attempts as the others (5 and 3)"),
        (contrast_test([three] * 4, INTERACTION), "every subject needed 3 attempts"),
        (trial_test([np.full((20, 5), 3.0)] * 2), "needed 3 attempts in every trial"),
    ):
        assert reason in outcome.undefined
        assert str(outcome) == f"not defined: {outcome.undefined}"
        assert (outcome.value, outcome.p, outcome.effect) == (None, None, None)
    assert contrast_test([five, three]).difference == 2


def test_trials_that_every_subject_does_alike_are_named() -> None:
    rng = np.random.default_rng(1)
    trials = rng.poisson(6, (20, 5)).astype(float)
    trials[:, 3] = trials[:, 2] - 1
    outcome = trial_test([trials, trials + 1])
    assert outcome.undefined.endswith("changed alike from one trial to the next (3 to 4)")
    trials[:, 3] = 2 * trials[:, 1] - trials[:, 0] + 1  # follows from others, and yet varies
    assert "fewer ways" in trial_test([trials]).undefined


def test_too_few_subjects_or_trials_are_said() -> None:
    assert "a single subject" in t_test(np.ones(1), np.ones(1)).undefined
    rng = np.random.default_rng(1)
    few = [rng.random((2, 5)), rng.random((3, 5))]
    assert trial_test(few).undefined == "5 trials need at least 6 subjects"
    assert trial_test([rng.random((3, 5)), rng.random((3, 5))]).value is not None
    assert trial_test([rng.random((9, 1))]).undefined == "there is only one trial"


def test_one_subject_in_one_group_alone_is_enough_for_t() -> None:
    assert t_test(np.array([9.0]), np.array([1.0, 2.0, 3.0])).df == (2,)

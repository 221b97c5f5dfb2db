"""Significance tests of groups of subjects, from their values or from published means alone.

A comparison of means needs only the size, the mean and the variance of each group: a
:class:`~causal_openlock.analysis.effects.Group`. So the same functions test learners, of which
every value is known, and people, of whom the paper publishes means and error bars. Only the test of
learning over trials needs every value, because it depends on how a subject's own trials vary
together.

Where subjects do not differ, a test is not defined: its :class:`SignificanceTest` then says why and
has no numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from causal_openlock.analysis.effects import Group
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.wording import joined

INTERACTION = (0.5, -0.5, -0.5, 0.5)
"""Weights of the interaction of a 2 × 2 design, row by row; every cell counts alike (sums of
squares of type III)."""


Sample = Group | FloatArray
"""A group of subjects: a summary of it, or ``[n]`` their values."""


def hedges_g(d: float, df: int) -> float:
    """Hedges' g: Cohen's d without its bias in small samples, for n + m − 2 degrees of freedom.

    >>> round(hedges_g(0.8, 10), 3)
    0.738

    NaN for fewer than 2 degrees of freedom, with which the bias is not defined.
    """
    from scipy.special import gammaln

    if df < 2:
        return float("nan")
    return float(d * np.exp(gammaln(df / 2) - gammaln((df - 1) / 2)) / np.sqrt(df / 2))


def partial_eta_squared(f: float, df_effect: int, df_error: int) -> float:
    """Partial η² of an F: the share of the variance left by other effects that this one explains.

    Of the multivariate test of trials it is 1 − Wilks' Λ.

    >>> round(partial_eta_squared(24.94, 1, 156), 3)
    0.138
    """
    return float(f * df_effect / (f * df_effect + df_error))


@dataclass(frozen=True)
class SignificanceTest:
    """The result of a significance test.

    Attributes:
        statistic: ``t`` or ``F``.
        df: Its degrees of freedom.
        difference: The difference tested, in the unit of the values; its sign is that of the
            means, the first minus the second.
        value: Of the statistic; None if the test is not defined, as the two that follow.
        p: Probability of so large a statistic, on either side of zero, if there is no difference.
        effect: Size of the effect: Cohen's d for t, partial η² for F.
        undefined: Why the test is not defined; empty if it is.
    """

    statistic: str
    df: tuple[int, ...]
    difference: float
    value: float | None = None
    p: float | None = None
    effect: float | None = None
    undefined: str = ""

    def __str__(self) -> str:
        """The result as a paper prints it: ``F(1, 156) = 24.94, p < .001``."""
        if self.value is None or self.p is None:
            return f"not defined: {self.undefined}"
        p = "p < .001" if self.p < 0.001 else f"p = {self.p:.3f}".replace("0.", ".")
        return f"{self.statistic}({', '.join(map(str, self.df))}) = {self.value:.2f}, {p}"


def t_test(first: Sample, second: Sample) -> SignificanceTest:
    """Student's t of two independent groups, variances pooled, two-sided: the paper's t(78).

    >>> people = Group.published(9.425, 1.24, 40), Group.published(6.45, 0.86, 40)
    >>> print(t_test(*people))
    t(78) = 1.95, p = .055

    Returns:
        t with n + m − 2 degrees of freedom, positive where the first mean is larger, and
        Cohen's d.
    """
    found = contrast_test([first, second])  # of two groups F is t squared
    df = found.df[1:]
    if found.value is None:
        return replace(found, statistic="t", df=df)
    t = float(np.copysign(np.sqrt(found.value), found.difference))
    one, other = _summaries([first, second])
    d = t * float(np.sqrt(1 / one.size + 1 / other.size))
    return replace(found, statistic="t", df=df, value=t, effect=d)


def contrast_test(groups: Sequence[Sample], weights: Sequence[float] = (1, -1)) -> SignificanceTest:
    """F of a weighted sum of the means of independent groups, with one degree of freedom.

    Of two groups it is a one-way analysis of variance, the paper's F(1, 78) and F(1, 158); with
    the weights :data:`INTERACTION` it is the paper's F(1, 156).

    >>> cells = [np.array([7.0, 9]), np.array([4.0, 6]), np.array([3.0, 4]), np.array([6.0, 9])]
    >>> print(contrast_test(cells, INTERACTION))
    F(1, 4) = 10.89, p = .030

    Args:
        groups: G groups, or ``[n]`` values of each.
        weights: One for each of them; they sum to 0.

    Returns:
        F(1, N − G) and partial η²; the difference is the weighted sum.
    """
    parts = _summaries(groups)
    difference = float(sum(w * one.mean for w, one in zip(weights, parts, strict=True)))
    pooled, df, reason = _pooled(parts)
    if reason:
        return SignificanceTest("F", (1, df), difference, undefined=reason)
    spread = pooled * sum(w**2 / one.size for w, one in zip(weights, parts, strict=True))
    return _f(difference**2 / spread, (1, df), difference)


def trial_test(groups: Sequence[FloatArray]) -> SignificanceTest:
    """Whether trials differ: the multivariate test of repeated measures, F(4, 75) in the paper.

    The differences between successive trials of the same subject are tested against zero, all at
    once (Hotelling's T² with covariances pooled within groups; every group counts alike). Unlike
    the univariate analysis it does not suppose that all pairs of trials are equally correlated.

    Args:
        groups: ``[n_g, T]`` values of the subjects of each of G groups in the same T trials.

    Returns:
        F(T − 1, N − G − T + 2) and partial η²; the difference is the first trial's mean minus the
        last one's, groups counting alike.
    """
    steps = [np.diff(np.asarray(one, float), axis=1) for one in groups]
    means = np.array([one.mean(axis=0) for one in steps])
    number, (count, trials) = sum(map(len, steps)), (len(groups), groups[0].shape[1])
    error, tested = number - count, trials - 1
    df = (tested, error - tested + 1)
    mean = means.mean(axis=0)
    difference = -float(mean.sum())
    reason = _not_testable(groups, steps, df)
    if reason:
        return SignificanceTest("F", df, difference, undefined=reason)
    residuals = np.concatenate([one - m for one, m in zip(steps, means, strict=True)])
    weight = sum(1 / len(one) for one in steps) / count**2
    covariance = residuals.T @ residuals / error
    squared = float(mean @ np.linalg.solve(covariance, mean) / weight)  # Hotelling's T²
    return _f(squared * df[1] / (error * tested), df, difference)


def _f(value: float, df: tuple[int, int], difference: float) -> SignificanceTest:
    from scipy.special import fdtrc

    effect = partial_eta_squared(value, *df)
    return SignificanceTest("F", df, difference, float(value), float(fdtrc(*df, value)), effect)


def _summaries(groups: Sequence[Sample]) -> list[Group]:
    return [one if isinstance(one, Group) else Group.of(one) for one in groups]


def _pooled(groups: Sequence[Group]) -> tuple[float, int, str]:
    """The variance within groups, its degrees of freedom, and why it cannot be used."""
    df = sum(one.size for one in groups) - len(groups)
    if df < 1:
        return 0.0, df, "a single subject in each group does not show how subjects differ"
    pooled = sum((one.size - 1) * one.variance for one in groups) / df
    if pooled > 0:
        return pooled, df, ""
    means = list(dict.fromkeys(f"{one.mean:.4g}" for one in groups))
    if len(means) == 1:
        return 0.0, df, f"every subject needed {means[0]} attempts"
    each = joined(means)
    return 0.0, df, f"every subject of a group needed as many attempts as the others ({each})"


def _not_testable(
    groups: Sequence[FloatArray], steps: Sequence[FloatArray], df: tuple[int, int]
) -> str:
    """Reason why trials cannot be compared; empty if they can."""
    tested, rest = df
    if tested < 1:
        return "there is only one trial"
    if rest < 1:
        return f"{tested + 1} trials need at least {tested + len(groups)} subjects"
    values = np.concatenate([np.ravel(one) for one in groups])
    if (values == values[0]).all():
        return f"every subject needed {values[0]:.4g} attempts in every trial"
    # Exact in whole attempts; rounding of means over loops is far below one part in 10⁹.
    spread = np.concatenate([one - one.mean(axis=0) for one in steps])
    scale = np.abs(values).max() * np.sqrt(len(spread))
    alike = np.flatnonzero(np.linalg.norm(spread, axis=0) <= 1e-9 * scale)
    if len(alike):
        named = ", ".join(f"{trial + 1} to {trial + 2}" for trial in alike)
        return f"all subjects of a group changed alike from one trial to the next ({named})"
    if np.linalg.matrix_rank(spread, tol=1e-9 * scale) < tested:
        return "subjects differ in fewer ways than there are differences between trials"
    return ""

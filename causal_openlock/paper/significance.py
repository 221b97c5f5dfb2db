"""Significance tests of groups of subjects, from their values or from published means alone.

A comparison of means needs only the size, the mean and the variance of each group: a
:class:`~causal_openlock.analysis.effects.Group`. So the same functions test learners, of which
every value is known, and people, of whom the paper publishes means and error bars. Only the test of
learning over trials needs every value. Where subjects do not differ, a test is not defined.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from causal_openlock.analysis.effects import Group
from causal_openlock.analysis.table import p_value
from causal_openlock.schemas.fsm import FloatArray

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


def p_in_words(p: float) -> str:
    """A p as a paper prints it.

    >>> p_in_words(0.0312), p_in_words(0.0001)
    ('p = .031', 'p < .001')
    """
    number = p_value(p)
    return f"p {number}" if number.startswith("<") else f"p = {number}"


class SignificanceTest(NamedTuple):
    """The result of a significance test; its numbers are NaN where it is not defined."""

    statistic: str  #: ``t`` or ``F``
    df: tuple[int, ...]
    difference: float  #: that was tested, in the unit of the values
    value: float  #: of the statistic
    effect: float  #: Cohen's d for t, partial η² for F

    @classmethod
    def of_f(cls, value: float, df: tuple[int, int], difference: float) -> SignificanceTest:
        """The result of an F test.

        >>> round(SignificanceTest.of_f(24.94, (1, 156), 4.34).effect, 3)
        0.138
        """
        return cls("F", df, difference, value, df[0] * value / (df[0] * value + df[1]))

    @property
    def p(self) -> float:
        """Probability of so large a statistic, on either side of zero, without a difference."""
        from scipy.special import fdtrc, stdtr

        if self.statistic == "t":
            return float(2 * stdtr(*self.df, -abs(self.value)))
        return float(fdtrc(*self.df, self.value))


def t_test(first: Sample, second: Sample) -> SignificanceTest:
    """Compare two independent groups by Student's t, variances pooled, two-sided.

    >>> people = Group.published(9.425, 1.24, 40), Group.published(6.45, 0.86, 40)
    >>> found = t_test(*people)
    >>> found.df, round(found.value, 2), round(found.p, 3)
    ((78,), 1.95, 0.055)

    Returns:
        t with n + m − 2 degrees of freedom, positive where the first mean is larger, and
        Cohen's d.
    """
    f_test = contrast_test([first, second])  # of two groups F is t squared
    t = float(np.copysign(np.sqrt(f_test.value), f_test.difference))
    sizes = [group.size for group in _summaries([first, second])]
    d = t * float(np.sqrt(1 / sizes[0] + 1 / sizes[1]))
    return SignificanceTest("t", f_test.df[1:], f_test.difference, t, d)


def contrast_test(groups: Sequence[Sample], weights: Sequence[float] = (1, -1)) -> SignificanceTest:
    """F of a weighted sum of the means of independent groups, with one degree of freedom.

    Of two groups it is a one-way analysis of variance, the paper's F(1, 78) and F(1, 158); with
    the weights :data:`INTERACTION` it is the paper's F(1, 156).

    >>> cells = [np.array([7.0, 9]), np.array([4.0, 6]), np.array([3.0, 4]), np.array([6.0, 9])]
    >>> found = contrast_test(cells, INTERACTION)
    >>> found.df, round(found.value, 2), round(found.p, 3)
    ((1, 4), 10.89, 0.03)

    Args:
        groups: G groups, or ``[n]`` values of each.
        weights: One for each of them; they sum to 0.

    Returns:
        F(1, N − G) and partial η²; the difference is the weighted sum.
    """
    size, mean, variance = np.array([group[:3] for group in _summaries(groups)], float).T
    difference = float(np.dot(weights, mean))
    df = int(size.sum()) - len(size)
    within = float((size - 1) @ variance)
    if not within > 0:
        return SignificanceTest.of_f(np.nan, (1, df), difference)
    error = within / df * float((np.square(weights) / size).sum())
    return SignificanceTest.of_f(difference**2 / error, (1, df), difference)


def trial_test(groups: Sequence[FloatArray]) -> SignificanceTest:
    """Test whether trials differ: multivariate, of repeated measures, F(4, 75) in the paper.

    The differences between successive trials of the same subject are tested against zero, all at
    once (Hotelling's T² with covariances pooled within groups; every group counts alike). Unlike
    the univariate analysis it does not suppose that all pairs of trials are equally correlated.

    Args:
        groups: ``[n_g, T]`` values of the subjects of each of G groups in the same T trials.

    Returns:
        F(T − 1, N − G − T + 2) and partial η², which is 1 − Wilks' Λ; the difference is the first
        trial's mean minus the last one's, groups counting alike.
    """
    steps = [np.diff(np.asarray(group, float), axis=1) for group in groups]
    means = [group.mean(axis=0) for group in steps]
    residuals = np.concatenate([group - mean for group, mean in zip(steps, means, strict=True)])
    mean = np.mean(means, axis=0)
    tested, error = len(mean), len(residuals) - len(groups)
    df = tested, error - tested + 1
    difference = -float(mean.sum())
    # Exact in whole attempts; rounding of means over loops is far below one part in 10⁹.
    least = 1e-9 * max(np.abs(group).max() for group in groups) * np.sqrt(len(residuals))
    if tested < 1 or np.linalg.matrix_rank(residuals, tol=least) < tested:
        return SignificanceTest.of_f(np.nan, df, difference)
    weight = sum(1 / len(group) for group in steps) / len(groups) ** 2
    covariance = residuals.T @ residuals / error
    squared = float(mean @ np.linalg.solve(covariance, mean) / weight)  # Hotelling's T²
    return SignificanceTest.of_f(squared * df[1] / (error * tested), df, difference)


def _summaries(groups: Sequence[Sample]) -> list[Group]:
    return [group if isinstance(group, Group) else Group.of(group) for group in groups]

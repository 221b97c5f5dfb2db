"""A group that subjects' parameters are drawn from: its mean and spread, by empirical Bayes.

A parameter between two bounds becomes a number without bounds: the log-odds of where it stands
between them (on a logarithmic scale where that is searched). In these, the group is normal, each
parameter by itself. Mean and spread are those that make the actions of all subjects most probable,
by expectation and maximisation with Laplace's approximation (Huys et al. 2011, PLoS Computational
Biology 7: e1002028):

* for each subject, its most probable parameters under the prior of the group, and the curvature
  there (:func:`peak`; scipy's Newton method in a trust region, derivatives from differences);
* mean and spread of the group from all of these (:func:`group_of`), and so on until they stay.

In between, likelihoods are taken to be normal around the last peaks, so that rounds of the second
step, which cost nothing, are repeated until they have settled before subjects are asked again. This
changes how fast, and not to what, it settles.

What a subject adds to the evidence for the learner is the integral over its parameters, by the same
approximation (:func:`evidence_of`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import minimize
from scipy.stats import norm

from causal_openlock.schemas.fsm import FloatArray

STEP = 0.05  #: step of finite differences, in log-odds
SPREADS = 0.05, 1.6
"""The least spread of a group, and the greatest, with which it begins: about even over a range."""
FARTHEST = 4.6
"""Largest distance of a group's mean from the middle, in log-odds: 1% to 99% of a range."""
GRADIENT = 0.05  #: a peak is where the slope is less than this, in nats per spread of the group
SETTLED = 0.02  #: a round that changes no mean and no spread by more is the last one; in log-odds
EASY_ROUNDS = 10_000  #: the most rounds in which likelihoods are taken to be normal


@dataclass(frozen=True)
class Group:
    """A normal distribution of subjects' parameters, in log-odds."""

    mean: FloatArray  #: ``[D]``
    spread: FloatArray  #: ``[D]`` standard deviations

    @classmethod
    def wide(cls, parameters: int) -> Group:
        """The group that a fit begins with, for a number of parameters."""
        return cls(np.zeros(parameters), np.full(parameters, SPREADS[1]))

    def apart(self, other: Group) -> float:
        """The greatest difference of a mean or a spread."""
        both = np.abs([self.mean - other.mean, self.spread - other.spread])
        return float(both.max(initial=0.0))


@dataclass(frozen=True)
class Peak:
    """The most probable parameters of a subject under the prior of a group; plain data."""

    at: list[float]  #: ``[D]`` where it is, in log-odds
    slope: list[float]  #: ``[D]`` first derivatives of the negative log-likelihood there, in nats
    curvature: list[list[float]]  #: ``[D, D]`` its second derivatives; no direction bends down
    nll: float  #: negative log-likelihood there, in nats, of the actions fitted to
    actions: int = 1  #: number of these actions
    held_out: float = 0.0  #: negative log-likelihood of the actions held out
    held_out_actions: int = 0  #: number of these actions


def peak(loss: Callable[[FloatArray], float], group: Group, start: FloatArray) -> Peak:
    """The most probable parameters of a subject, and how its likelihood bends there.

    Args:
        loss: Negative log-likelihood at ``[D]`` log-odds.
        group: The prior.
        start: ``[D]`` where the search begins.

    Example:
        One measurement, 2, with variance 1, and a prior around 0 with variance 1:

        >>> around = Group(np.zeros(1), np.ones(1))
        >>> found = peak(lambda x: float((x[0] - 2) ** 2) / 2, around, np.zeros(1))
        >>> round(found.at[0], 4), round(found.curvature[0][0], 4)
        (1.0, 1.0)
    """

    @cache
    def bent(*x: float) -> tuple[FloatArray, FloatArray]:
        return derivatives(loss, np.array(x))

    # In units of the prior, where the curvature is at least 1, which gives slopes a scale.
    def there(y: FloatArray) -> FloatArray:
        return group.mean + group.spread * y

    found = minimize(
        lambda y: loss(there(y)) + 0.5 * float(y @ y),
        (start - group.mean) / group.spread,
        jac=lambda y: group.spread * bent(*there(y))[0] + y,
        hess=lambda y: np.outer(group.spread, group.spread) * bent(*there(y))[1] + np.eye(len(y)),
        method="trust-exact",
        options={"gtol": GRADIENT, "maxiter": 50},
    )
    at = there(found.x)
    slope, curvature = bent(*at)
    values, vectors = np.linalg.eigh(curvature)
    upward = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return Peak(at.tolist(), slope.tolist(), upward.tolist(), loss(at))


def derivatives(f: Callable[[FloatArray], float], x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``[D]`` first and ``[D, D]`` second derivatives, from differences by :data:`STEP`."""
    steps = STEP * np.eye(len(x))
    here = f(x)
    up, down = (np.array([f(x + sign * step) for step in steps]) for sign in (1, -1))
    second = np.diag(up - 2 * here + down)
    for i, one in enumerate(steps):
        for j, other in enumerate(steps[:i]):
            # Forwards and backwards in both at once, less what each does by itself.
            both = (f(x + one + other) + f(x - one - other)) / 2 - here
            own = (up[i] + down[i] + up[j] + down[j]) / 2 - 2 * here
            second[i, j] = second[j, i] = both - own
    return (up - down) / (2 * STEP), second / STEP**2


def group_of(peaks: Sequence[Peak], group: Group) -> Group:
    """The group that makes what subjects did most probable, if likelihoods are normal.

    Args:
        peaks: Of the subjects; those without actions do not count.
        group: The prior under which they were found. It stays if no subject counts.

    Example:
        Three measurements with variance 1 and a variance of 5 in all leave 4 for the group.

        >>> far = np.sqrt(7.5)  # the mean square of -far, 0 and far is 5
        >>> flat = Group(np.zeros(1), np.full(1, 1e6))
        >>> three = [Peak([x], [0.0], [[1.0]], 0.0) for x in (-far, 0.0, far)]
        >>> group_of(three, flat).spread.round(3).tolist()
        [1.6]
    """
    known = [one for one in peaks if one.actions]
    if not known:
        return group
    names = ("at", "slope", "curvature")
    at, slopes, bends = (np.array([getattr(one, name) for one in known]) for name in names)
    mean, spread = group.mean, group.spread
    # A normal likelihood with these slopes and curvatures where each peak is.
    pull = (bends @ at[..., None])[..., 0] - slopes
    for _ in range(EASY_ROUNDS):
        covariance = np.linalg.inv(bends + np.diag(1.0 / spread**2))
        each = (covariance @ (pull + mean / spread**2)[..., None])[..., 0]
        before = mean, spread
        mean = each.mean(axis=0).clip(-FARTHEST, FARTHEST)
        variances = (each - mean) ** 2 + covariance.diagonal(axis1=1, axis2=2)
        spread = np.sqrt(variances.mean(axis=0)).clip(*SPREADS)
        if Group(mean, spread).apart(Group(*before)) < SETTLED * 1e-3:
            break
    return Group(mean, spread)


def evidence_of(found: Peak, group: Group) -> tuple[float, FloatArray]:
    """Log evidence of a subject under a prior, and ``[D]`` the spread of its parameters.

    >>> one = Peak([0.5], [-0.5], [[1.0]], nll=0.125 + 0.5 * np.log(2 * np.pi))  # it measures 1
    >>> evidence, spread = evidence_of(one, Group(np.zeros(1), np.ones(1)))
    >>> bool(np.isclose(evidence, norm.logpdf(1, scale=2**0.5))), (spread**2).round(3).tolist()
    (True, [0.5])
    """
    precision = np.array(found.curvature) + np.diag(1.0 / group.spread**2)
    prior = norm.logpdf(found.at, group.mean, group.spread).sum()
    volume = np.linalg.slogdet(precision / (2 * np.pi))[1] / 2
    spread: FloatArray = np.sqrt(np.linalg.inv(precision).diagonal())
    return float(prior - found.nll - volume), spread

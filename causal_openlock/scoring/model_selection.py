"""Random-effects Bayesian model selection: every subject may follow another learner.

A sum over subjects asks which one learner all of them follow. Here each subject follows one of M,
drawn with frequencies that are unknown, with a flat Dirichlet prior (Stephan et al. 2009). What is
inferred from the log evidence of each learner for each subject are

* the expected **frequencies** of the learners among subjects like these;
* the **exceedance** probability of each, that it is the most frequent;
* the **protected** exceedance probability (Rigoux et al. 2014), which allows for the chance that
  all are equally frequent and differences among them luck;
* for each subject, the probability that it followed each.

As log evidence -BIC/2 serves, which takes a price for each parameter that was fitted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import digamma, expit, gammainc, gammaincinv, gammaln, logsumexp, softmax

from causal_openlock.schemas.fsm import FloatArray

ROUNDS, ENOUGH = 10_000, 1e-9
QUANTILES = 20_000


@dataclass(frozen=True)
class Selection:
    """Result of model selection: which learners subjects follow."""

    frequencies: FloatArray  #: ``[M]`` expected share of subjects that follow each learner
    exceedance: FloatArray  #: ``[M]`` probability that no other learner is more frequent
    protected: FloatArray  #: ``[M]`` the same, allowing for equal frequencies
    all_equal: float  #: probability that all are equally frequent (Bayesian omnibus risk)
    followed: FloatArray  #: ``[S, M]`` probability that each subject followed each learner


def select_models(evidence: FloatArray) -> Selection:
    """Random-effects model selection.

    Args:
        evidence: ``[S, M]`` log evidence of each learner for each subject, in nats; finite.

    Example:
        Of ten subjects seven are predicted clearly better by the first learner.

        >>> found = select_models(np.array([[5.0, 0.0]] * 7 + [[0.0, 5.0]] * 3))
        >>> found.frequencies.round(2).tolist(), found.exceedance.round(2).tolist()
        ([0.67, 0.33], [0.89, 0.11])
    """
    subjects, learners = evidence.shape
    prior = np.ones(learners)
    counts, followed = prior + subjects / learners, np.zeros_like(evidence)
    for _ in range(ROUNDS):
        followed = softmax(evidence + _expected(counts), axis=1)
        before, counts = counts, prior + followed.sum(axis=0)
        if np.abs(counts - before).max() < ENOUGH:
            break
    exceedance = exceedance_of(counts)
    equal = float((logsumexp(evidence, axis=1) - np.log(learners)).sum())
    all_equal = float(expit(equal - _differ(evidence, followed, counts)))
    return Selection(
        frequencies=counts / counts.sum(),
        exceedance=exceedance,
        protected=exceedance * (1.0 - all_equal) + all_equal / learners,
        all_equal=all_equal,
        followed=followed,
    )


def _expected(counts: FloatArray) -> FloatArray:
    """Expected logarithms of frequencies with a Dirichlet distribution of these counts."""
    logs: FloatArray = digamma(counts) - digamma(counts.sum())
    return logs


def exceedance_of(counts: FloatArray) -> FloatArray:
    """``[M]`` the probability that each frequency of a Dirichlet distribution is the greatest.

    Frequencies are as gamma variates divided by their sum: that of one is the greatest with the
    probability that all others are below it, which is averaged over its quantiles.

    >>> exceedance_of(np.array([3.0, 3.0, 3.0])).round(6).tolist()
    [0.333333, 0.333333, 0.333333]
    """
    chances = (np.arange(QUANTILES) + 0.5) / QUANTILES
    below = [
        gammainc(np.delete(counts, which)[:, None], gammaincinv(count, chances)).prod(axis=0)
        for which, count in enumerate(counts)
    ]
    greatest = np.array(below).mean(axis=1)
    return greatest / greatest.sum()


def _differ(evidence: FloatArray, followed: FloatArray, counts: FloatArray) -> float:
    """The variational bound on the log evidence that frequencies differ."""
    prior, expected = np.ones_like(counts), _expected(counts)
    joint = (followed * (evidence + expected)).sum()
    entropy = -(followed * np.log(np.maximum(followed, np.finfo(float).tiny))).sum()
    # The Kullback-Leibler divergence of a Dirichlet distribution from another.
    own, other = (gammaln(one.sum()) - gammaln(one).sum() for one in (counts, prior))
    divergence = own - other + ((counts - prior) * expected).sum()
    return float(joint + entropy - divergence)

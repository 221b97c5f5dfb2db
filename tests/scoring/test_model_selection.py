"""Random-effects model selection, against closed forms and direct integration."""

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import beta

from causal_openlock.scoring.model_selection import exceedance_of, select_models


def test_with_clear_evidence_the_posterior_is_a_dirichlet_of_counts():
    evidence = np.full((12, 3), -1000.0)
    evidence[np.arange(12), [0] * 7 + [1] * 4 + [2]] = 0.0
    found = select_models(evidence)
    assert found.frequencies == pytest.approx(np.array([8, 5, 2]) / 15)
    assert found.followed == pytest.approx((evidence == 0).astype(float))
    draws = np.random.default_rng(0).dirichlet([8, 5, 2], 200_000)
    often = np.bincount(draws.argmax(axis=1), minlength=3) / 200_000
    assert found.exceedance == pytest.approx(often, abs=0.005)


@pytest.mark.parametrize("counts", [(2.0, 7.0), (30.5, 31.0), (1.0, 400.0)])
def test_of_two_the_exceedance_probability_is_a_beta_tail(counts):
    assert exceedance_of(np.array(counts))[0] == pytest.approx(beta.sf(0.5, *counts), abs=1e-6)


def test_the_chance_that_all_are_equal_is_near_the_integral():
    """Of two learners the frequency is a single number, over which one can integrate."""
    evidence = np.array([[2.0, 0.0]] * 9 + [[0.0, 1.0]] * 3)
    grid = (np.arange(20_000) + 0.5) / 20_000
    each = np.logaddexp(np.log(grid) + evidence[:, :1], np.log(1 - grid) + evidence[:, 1:])
    differ = logsumexp(each.sum(axis=0)) - np.log(len(grid))
    equal = (np.logaddexp(*evidence.T) - np.log(2)).sum()
    exact = 1 / (1 + np.exp(differ - equal))
    found = select_models(evidence)
    # A variational bound is below the evidence, so it errs towards equality.
    assert exact <= found.all_equal < exact + 0.12
    protected = found.exceedance * (1 - found.all_equal) + found.all_equal / 2
    assert found.protected == pytest.approx(protected)


@pytest.mark.filterwarnings("error")
def test_many_subjects_leave_no_doubt_and_no_evidence_leaves_all_of_it():
    found = select_models(np.array([[10.0, 0.0, 0.0]] * 3000))
    assert found.all_equal == pytest.approx(0.0, abs=1e-300)
    assert found.protected[0] == pytest.approx(1.0)
    found = select_models(np.zeros((20, 4)))
    assert found.frequencies == pytest.approx(np.full(4, 0.25))
    assert found.protected == pytest.approx(np.full(4, 0.25))
    assert found.all_equal > 0.8
    assert select_models(np.zeros((5, 1))).protected.tolist() == [1.0]

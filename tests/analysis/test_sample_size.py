"""Subjects, difference and power of a t test: each from the other two."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from statsmodels.stats.power import TTestIndPower, TTestPower

import causal_openlock as ol
from causal_openlock.errors import OpenLockError


@pytest.mark.parametrize("paired", [False, True])
@pytest.mark.parametrize(("difference", "power", "alpha"), [(1.0, 0.8, 0.05), (3.0, 0.95, 0.01)])
def test_it_is_what_statsmodels_says(difference, power, alpha, paired):
    planned = ol.sample_size(difference, sd=2.5, power=power, alpha=alpha, paired=paired)
    theirs = TTestPower() if paired else TTestIndPower()
    of_group = "nobs" if paired else "nobs1"

    def at(subjects: int) -> float:
        return float(theirs.power(difference / 2.5, **{of_group: subjects}, alpha=alpha))

    assert at(planned.subjects - 1) < power <= at(planned.subjects)
    assert planned.power == pytest.approx(at(planned.subjects), abs=1e-6)


def test_power_is_how_often_the_test_is_significant():
    planned = ol.sample_size(2, sd=5, subjects=40)
    rng = np.random.default_rng(0)
    p = stats.ttest_ind(rng.normal(2, 5, (4000, 40)), rng.normal(0, 5, (4000, 40)), axis=1).pvalue
    assert np.mean(p < 0.05) == pytest.approx(planned.power, abs=0.025)


@pytest.mark.parametrize("subjects", [2, 5, 40, 3000])
@pytest.mark.parametrize("paired", [False, True])
def test_the_smallest_difference_has_just_the_power(subjects, paired):
    found = ol.sample_size(sd=5, subjects=subjects, power=0.9, paired=paired)
    assert found.power == pytest.approx(0.9)
    again = ol.sample_size(found.difference, sd=5, subjects=subjects, paired=paired)
    assert again.power == pytest.approx(0.9)
    assert ol.sample_size(found.difference * 1.0001, sd=5, power=0.9, paired=paired)[0] == subjects


def test_the_sd_can_come_from_a_pilot_study():
    pilot = [3, 4, 9, 12, 5]
    assert ol.sample_size(2, sd=pilot) == ol.sample_size(2, sd=float(np.std(pilot, ddof=1)))


def test_the_sign_of_a_difference_does_not_matter():
    assert ol.sample_size(-2, sd=5).subjects == ol.sample_size(2, sd=5).subjects


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "give the difference that matters, or the number of subjects"),
        ({"difference": 1, "subjects": 9, "power": 0.8}, "give two, and the third is returned"),
        ({"difference": 0}, "difference has to be more than 0, not 0"),
        ({"difference": 1, "sd": 0}, "sd has to be more than 0, not 0.0"),
        ({"difference": 1, "sd": [2, 2, 2]}, "sd has to be more than 0, not 0.0"),
        ({"difference": 1, "sd": float("nan")}, "sd has to be more than 0, not nan"),
        ({"difference": 1, "power": 80}, "power has to be more than 0.05 and less than 1, not 80"),
        ({"difference": 1, "alpha": 5}, "alpha has to be more than 1e-12 and less than 0.8, not 5"),
        ({"difference": "2"}, "difference has to be more than 0, not '2'"),
        ({"difference": 1, "sd": []}, "sd is a number, or the values of a pilot study, not []"),
        ({"difference": 1, "sd": "5 attempts"}, "sd is a number, or the values of a pilot study"),
        ({"subjects": 1}, "subjects"),
        ({"subjects": 40.5}, "subjects"),
        ({"difference": 1e-6}, "a difference of 1e-06 needs more than 1,000,000 subjects"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(given, message):
    with pytest.raises(OpenLockError) as raised:
        ol.sample_size(**{"sd": 5, **given})
    assert message in str(raised.value)

"""The studies in ``evidence``: what the documentation says follows from what is stored."""

import pytest

from causal_openlock.fitting.steps import read_fit_file, seeds_of
from evidence.pages import check
from evidence.study import selection
from support.shipped_studies import DECLARED, EVIDENCE, STUDIES

pytestmark = pytest.mark.slow


def test_the_numbers_of_all_pages_follow_from_what_is_stored():
    assert check(EVIDENCE) == []


FITS = {study.folder / fit for study in STUDIES.values() for fit in study.file.fits}
"""All fits that are stored with a study."""


def is_result(spec, fit):
    """Whether a learner plays with what a fit found, rounded."""

    def best(kept):
        # A search that was cut short has not played its best again.
        again = kept["again"] or {one["number"]: one["rmse"] for one in kept["done"]}
        number = min(again, key=again.__getitem__)
        return kept["plan"]["space"]["learner"], kept["done"][int(number)]["chosen"]

    learner, chosen = read_fit_file(fit, best, "make it again")
    if spec.learner != learner:
        return False
    return {name: spec.parameters[name] for name in chosen} == pytest.approx(chosen, rel=0.02)


def compared_with_means(study):
    """The learners of which a study says how far they are from published means."""
    contrasts = [one for claim in study.file.claims.values() for one in claim.contrasts.values()]
    names = {
        selection(one.of)["learner"][0]
        for one in contrasts
        if str(one.minus).startswith(("people ", "published_model "))
    }
    every = study.file.derived == "distances_from_people"
    return [one for one in study.asked.learners if every or one.name in names]


@pytest.mark.parametrize("name", DECLARED)
def test_a_fitted_learner_is_not_compared_with_people_in_the_rooms_of_its_fit(name):
    study = STUDIES[name]
    for spec in compared_with_means(study):
        for fit in FITS:
            assert not (is_result(spec, fit) and study.asked.seed in seeds_of(fit)), spec.name


def test_stored_fits_found_the_parameters_that_are_played():
    found = {
        (fit.parent.name, spec.name)
        for fit in FITS
        if fit.parent.name in DECLARED
        for spec in STUDIES[fit.parent.name].asked.learners
        if is_result(spec, fit)
    }
    expected = {("rivals", "theory_based"), ("likeness", "fitted_to_baselines")}
    expected |= {("reward_alone", f"{one}_fitted") for one in ("tabular_q", "ddqn")}
    assert found >= {(study, learner) for study, learner in expected if study in DECLARED}

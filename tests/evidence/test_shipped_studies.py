"""The studies in ``evidence``: what the documentation says follows from what is stored."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from causal_openlock.evidence.checking import check
from causal_openlock.evidence.study import Selection, Study
from causal_openlock.experiment.experiment import LearnerSpec
from causal_openlock.fitting.kept import kept_fit, seeds_of
from support.shipped_studies import EVIDENCE, NAMES, shipped

pytestmark = pytest.mark.slow


def test_all_that_is_written_follows_from_what_is_stored() -> None:
    assert check(EVIDENCE) == []


@pytest.mark.parametrize("name", NAMES)
def test_its_claims_are_about_what_it_plays(name: str) -> None:
    assert not shipped(name).faults()


def fits() -> list[Path]:
    """Folders of all fits that are stored with a study."""
    return [EVIDENCE / name / fit for name in NAMES for fit in shipped(name).file.fits]


MEANS = {"people", "published_model"}
"""Published means, which learners were fitted to."""


def found_by(fit: Path) -> tuple[str, dict[str, float]]:
    """The learner of a stored fit, and the values that it found."""

    def best(kept: dict[str, Any]) -> tuple[str, dict[str, float]]:
        # A search that was cut short has not played its best again.
        again = kept["again"] or {one["number"]: one["rmse"] for one in kept["done"]}
        number = min(again, key=again.__getitem__)
        return kept["plan"]["space"]["learner"], kept["done"][int(number)]["chosen"]

    return kept_fit(fit, best)


def is_result(spec: LearnerSpec, fit: Path) -> bool:
    """Whether a learner plays with what a fit found, rounded."""
    learner, chosen = found_by(fit)
    if spec.learner != learner:
        return False
    return {name: spec.parameters[name] for name in chosen} == pytest.approx(chosen, rel=0.02)


def compared_with_means(study: Study) -> list[LearnerSpec]:
    """The learners of which a study says how far they are from published means."""
    contrasts = [one for claim in study.file.claims.values() for one in claim.contrasts.values()]
    names = {
        one.of.learner
        for one in contrasts
        if isinstance(one.minus, Selection) and one.minus.learner in MEANS
    }
    every = study.file.derived == "distances_from_people"
    return [one for one in study.asked.learners if every or one.name in names]


@pytest.mark.parametrize("name", NAMES)
def test_what_was_fitted_is_not_compared_with_people_in_the_rooms_of_its_fit(name: str) -> None:
    study = shipped(name)
    for spec in compared_with_means(study):
        for fit in fits():
            assert not (is_result(spec, fit) and study.asked.seed in seeds_of(fit)), spec.name


def test_stored_fits_found_what_is_played() -> None:
    found = {
        (fit.parent.name, spec.name)
        for fit in fits()
        for spec in shipped(fit.parent.name).asked.learners
        if is_result(spec, fit)
    }
    assert found >= {("rivals", "theory_based"), ("likeness", "fitted_to_baselines")}
    assert found >= {("reward_alone", f"{one}_fitted") for one in ("tabular_q", "ddqn")}


def test_pages_of_results_are_bound_to_studies() -> None:
    text = (EVIDENCE / "pages.yaml").read_text(encoding="utf-8")
    for name in ("reproduction", "deep_learners", "structure_learner", "fit"):
        assert f"../docs/{name}.md" in text

"""The studies in ``evidence``: what the documentation says follows from what is stored."""

from __future__ import annotations

from pathlib import Path

import pytest

from causal_openlock.evidence.checking import check
from causal_openlock.evidence.study import Study, read_studies

ROOT = Path(__file__).parents[2] / "evidence"
STUDIES = read_studies(ROOT)


def test_all_that_is_written_follows_from_what_is_stored() -> None:
    assert check(ROOT) == []


@pytest.mark.parametrize("study", STUDIES, ids=lambda study: study.name)
def test_its_claims_are_about_what_it_plays(study: Study) -> None:
    assert not study.faults()


def test_pages_of_results_are_bound_to_studies() -> None:
    text = (ROOT / "pages.yaml").read_text(encoding="utf-8")
    for name in ("reproduction", "deep_learners", "structure_learner", "fit"):
        assert f"../docs/{name}.md" in text

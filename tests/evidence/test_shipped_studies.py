"""The studies in ``evidence``: what the documentation says follows from what is stored."""

from __future__ import annotations

from pathlib import Path

import pytest

from causal_openlock.evidence.checking import check
from causal_openlock.evidence.study import FILE, read_study

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2] / "evidence"
FOLDERS = sorted(path.parent for path in ROOT.glob(f"*/{FILE}"))


def test_all_that_is_written_follows_from_what_is_stored() -> None:
    assert check(ROOT) == []


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_its_claims_are_about_what_it_plays(folder: Path) -> None:
    assert not read_study(folder).faults()


def test_pages_of_results_are_bound_to_studies() -> None:
    text = (ROOT / "pages.yaml").read_text(encoding="utf-8")
    for name in ("reproduction", "deep_learners", "structure_learner", "fit"):
        assert f"../docs/{name}.md" in text

"""Links that lead out of the pages' folder, as the site has them."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from support.documents import DOCS, ROOT, broken_links

sys.path.append(str(DOCS / "_extensions"))
from links_into_the_code import relinked

PAGE = DOCS / "page.md"
STUDY = DOCS / "evidence" / "bayes" / "README.md"


@pytest.mark.parametrize(
    ("page", "link", "expected"),
    [
        (
            PAGE,
            '[3.75](../evidence/bayes/README.md "attempts bayes CC4")',
            '[3.75](/evidence/bayes/README.md "attempts bayes CC4")',
        ),
        (
            PAGE,
            '[does not hold](../evidence/bayes/README.md\n"claim one_room_is_enough verdict")',
            '[does not hold](/evidence/bayes/README.md\n"claim one_room_is_enough verdict")',
        ),
        (
            PAGE,
            "[rules](../evidence/README.md#verdicts)",
            "[rules](/evidence/README.md#verdicts)",
        ),
        (PAGE, "[here](decisions.md)", "[here](decisions.md)"),
        (PAGE, '[here](decisions.md "why")', '[here](decisions.md "why")'),
        (
            PAGE,
            "[`ddqn.py`](../learners/openlock_learners/ddqn.py)",
            "{py:mod}`ddqn.py <openlock_learners.ddqn>`",
        ),
        (
            PAGE,
            '[`ddqn.py`](../learners/openlock_learners/ddqn.py "its code")',
            "{py:mod}`ddqn.py <openlock_learners.ddqn>`",
        ),
        (STUDY, "[the claims](study.yaml)", "[the claims](/evidence/bayes/study.yaml)"),
        (STUDY, "[rules](../README.md#verdicts)", "[rules](/evidence/README.md#verdicts)"),
        (STUDY, "[why](../../docs/fit.md)", "[why](/fit.md)"),
        (
            STUDY,
            "[played](../../experiments/bayes.yaml)",
            "[played](../../experiments/bayes.yaml)",
        ),
        (STUDY, "[experiments](../../experiments)", "experiments"),
    ],
)
def test_links_out_of_the_folder(page: Path, link: str, expected: str) -> None:
    assert relinked(f"See {link}.", page, DOCS) == f"See {expected}."


def test_a_link_with_a_title_is_followed_too(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text('[1](gone.md "attempts") and [2](page.md\n"attempts")', encoding="utf-8")
    assert broken_links(page) == ["gone.md"]


def test_studies_are_kept_outside_and_shown_inside() -> None:
    assert (DOCS / "evidence").resolve() == ROOT / "evidence"

"""What claims are about, and how many of their verdicts chance would bring about."""

from __future__ import annotations

from pathlib import Path

import pytest

from causal_openlock.evidence.measured import Evidence
from causal_openlock.evidence.multiplicity import multiplicity
from causal_openlock.evidence.study import Study, StudyFile
from causal_openlock.evidence.study_files import RUN
from causal_openlock.evidence.verdicts import EQUIVALENCE, LEVEL, Estimate, Verdict
from support.shipped_studies import NAMES, shipped

X = {"learner": "x", "condition": "CC3"}
LESS = {"measure": "solved", "of": X, "minus": 0.5, "expected": "less"}
SAME = {**LESS, "expected": "same", "smallest": 0.1}
MADE_UP = {
    "title": "Made up",
    "experiment": "experiment.yaml",
    "hours": 1,
    "claims": {
        "every": {"text": "a", "contrasts": dict.fromkeys("ABCD", LESS)},
        "whole": {"text": "a", "about": "whole", "contrasts": dict.fromkeys("AB", LESS)},
        "same": {"text": "b", "contrasts": {"A": SAME, "B": SAME}},
        "late": {"text": "c", "contrasts": {"A": LESS}},
    },
}


@pytest.mark.parametrize("study", NAMES)
def test_only_a_claim_that_says_so_is_about_the_whole(study: str) -> None:
    for name, claim in shipped(study).file.claims.items():
        assert (claim.about == "whole") == ("on the whole" in claim.text.lower()), name


def made_up(tmp_path: Path, complete: bool = True) -> Evidence:
    """A study of four claims: one contrast of the first and one of the second do not hold."""
    said: dict[str, list[Verdict]] = {
        "every": ["holds", "holds", "holds", "does not hold"],
        "whole": ["holds", "does not hold"],
        "same": ["holds", "holds"],
        "late": ["undecided"],
    }
    estimate = Estimate(0.1, {LEVEL: (0.0, 0.2), EQUIVALENCE: (0.0, 0.2)}, (9,))
    found = Evidence(Study(tmp_path, StudyFile.model_validate(MADE_UP)))
    (tmp_path / RUN).touch()
    claims = {name: found.study.margin(name) for name in said if name != "late"}
    found.__dict__["run"] = {"complete": complete, "claims": claims}
    found.__dict__["estimates"] = {
        (name, part): (estimate, verdict)
        for name, verdicts in said.items()
        for part, verdict in zip("ABCD", verdicts, strict=False)
    }
    return found


def test_a_mixed_claim_says_how_many_contrasts_do_not_hold(tmp_path: Path) -> None:
    text = made_up(tmp_path).block("verdicts")
    assert "| **does not hold** (1 of 4 do not hold) |" in text
    assert "| **in part** (1 of 2 do not hold) |" in text
    assert "| **holds** |" in text
    assert "| **undecided**; stated after the run |" in text


def test_what_a_claim_is_about_cannot_change_unmarked(tmp_path: Path) -> None:
    study = made_up(tmp_path).study
    before = {name: study.margin(name) for name in study.file.claims}
    for claim in study.file.claims.values():
        claim.about = "every"
    changed = [name for name in before if study.margin(name) != before[name]]
    assert changed == ["whole"]


def test_verdicts_of_chance_are_counted(tmp_path: Path) -> None:
    table = [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in multiplicity([made_up(tmp_path), made_up(tmp_path, False)]).splitlines()
    ]
    rows = {name: (claims, contrasts) for name, claims, contrasts in table}
    assert rows["stated"] == ("8", "18")
    assert rows["of studies that were run to their end"] == ("4", "9")
    assert rows["of these stated or changed after the run"] == ("1", "1")
    assert rows["holds"] == ("1", "6")
    assert rows["does not hold"] == ("1", "2")
    assert (rows["in part"], rows["undecided"]) == (("1", "0"), ("1", "1"))
    # Seven directed contrasts at 2.5% and two of equivalence at 5%.
    assert rows["would hold by chance if none were true, at most"] == ("0.1", "0.3")
    assert rows["would be refuted by chance if all were true, at most"] == ("0.3", "0.3")

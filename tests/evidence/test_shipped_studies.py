"""The studies in ``evidence``: what the documentation says follows from what is stored."""

from __future__ import annotations

from pathlib import Path

import pytest

from causal_openlock import read_experiment
from causal_openlock.evidence.checking import check
from causal_openlock.evidence.study import Selection, Study, read_studies

ROOT = Path(__file__).parents[2] / "evidence"
STUDIES = read_studies(ROOT)


def test_all_that_is_written_follows_from_what_is_stored() -> None:
    assert check(ROOT) == []


@pytest.mark.parametrize("study", STUDIES, ids=lambda study: study.name)
def test_its_claims_are_about_what_it_plays(study: Study) -> None:
    experiment = read_experiment(study.experiment)
    learners = {one.name for one in experiment.learners}
    if networks := study.file.networks:
        learners = {*networks.files, *networks.parameters}
        assert all(path.is_file() for path in study.training_files.values())
    learners |= {"people", "published_model", "paper_ddqn"}
    conditions = {one.name for one in experiment.conditions}
    chosen = [
        side
        for claim in study.file.claims.values()
        for contrast in claim.contrasts.values()
        for side in (contrast.of, contrast.minus)
        if isinstance(side, Selection)
    ]
    chosen += [
        Selection.parse([*row.split(), *column.split()])
        for table in study.file.tables.values()
        for row in table.rows
        for column in table.columns
    ]
    assert {one.learner for one in chosen} <= learners
    named = [one.condition for one in chosen if one.condition]
    of_each = [[one] if isinstance(one, str) else one for one in named]
    assert {name for names in of_each for name in names} <= conditions

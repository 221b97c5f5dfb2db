"""Units of a study of theories: which of them subjects are taken for, and recovered parameters.

Subjects are simulated from every learner of the experiment, and every theory predicts all of them
(:mod:`causal_openlock.design`). ``units.parquet`` has three kinds of rows:

- a row for each simulated subject: ``nats NAME``, the log-likelihood of what it did under each
  theory; how many ``actions`` it took; ``single``, the share of it that is attributed to the theory
  that made it; and what else :func:`~causal_openlock.design.telling.informed` adds;
- a row for each group of a theory in a condition, with its number of ``subjects``: ``groups``, all
  subjects, and ``halves``, two groups of half the number; shares as of a subject;
- a row for each set and ``parameter`` that was recovered: the ``true`` value and the ``fitted``
  one, logarithms where these were searched. ``r``, their correlation over sets, follows from them.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import CELL
from causal_openlock.comparison.progress_bar import counting, shown_steps
from causal_openlock.design.apart import NATS, told_apart
from causal_openlock.design.parameters import on_search_scale, parameters_recovered, searched
from causal_openlock.design.telling import attributed, bits, by_size, confusion, informed
from causal_openlock.running.workers import available_cores
from causal_openlock.scoring.teacher_forcing import known_learners
from evidence.study import Study

WHOLE = {"phase": "test", "judged": True}
"""A subject is looked at as a whole, so that a phase or a trial says nothing."""


def units_of_theories(
    study: Study, folder: Path, workers: int | None
) -> tuple[pd.DataFrame, float]:
    """Simulate subjects, let all theories predict them, and recover parameters.

    The work is stored in ``folder``, so that it continues after an interruption.

    Returns:
        The units, and hours of the processor in this call.

    Raises:
        LearnerError: If a theory cannot predict others, there are fewer than two, or one whose
            parameters are to be recovered has no search space.
    """
    began, asked, settings = sum(os.times()[:4]), study.asked, study.file.theories
    specs = known_learners(settings.parameters, asked.learners)
    spaces = [searched(spec) for spec in specs]  # before hours of work
    cores = available_cores() if workers is None else max(1, workers)
    with shown_steps(study.name) as begin:
        subjects = told_apart(
            asked, folder / "subjects", draws=settings.draws, outside=settings.outside,
            workers=cores, report=counting(begin, "subjects"),
        )  # fmt: skip
        units = [units_of_subjects(subjects)]
        for spec, space in zip(specs, spaces, strict=True):
            pairs = parameters_recovered(
                spec, space, asked, folder / spec.name, sets=settings.sets,
                candidates=settings.candidates, workers=cores,
                report=counting(begin, f"sets of {spec.name}"),
            )  # fmt: skip
            about = {"learner": spec.name, "condition": "", "protocol": "", "subjects": 1, **WHOLE}
            sets = on_search_scale(pairs, space).drop(columns="at_bound")
            units.append(sets.rename(columns={"set": "unit"}).assign(**about))
    return pd.concat(units, ignore_index=True), (sum(os.times()[:4]) - began) / 3600


def units_of_subjects(subjects: pd.DataFrame) -> pd.DataFrame:
    """The rows of subjects (:func:`~causal_openlock.design.apart.told_apart`) and of groups."""
    units = informed(subjects).rename(columns={"subject": "unit"}).assign(subjects=1)
    nats = [name for name in units if name.startswith(NATS)]
    groups = []
    for names, group in _of_theories(units).groupby(CELL):
        for measure, number in (("groups", 1), ("halves", 2)):
            halves = np.array_split(group[nats].to_numpy(float), min(number, len(group)))
            for unit, half in enumerate(halves):
                shares = attributed(half.sum(axis=0, keepdims=True))[0]
                right = shares[nats.index(NATS + names[0])]
                about = dict(zip(CELL, names, strict=True))
                groups.append({**about, "unit": unit, "subjects": len(half), measure: right})
    return pd.concat([units, pd.DataFrame(groups)], ignore_index=True).assign(**WHOLE)


def sizes_of(study: Study, units: pd.DataFrame) -> pd.DataFrame:
    """How often groups of any size are attributed to each theory, from stored units."""
    return by_size(_of_theories(units), study.asked.seed)


def _of_theories(units: pd.DataFrame) -> pd.DataFrame:
    """The rows of subjects that theories made."""
    nats = [name for name in units if name.startswith(NATS)]
    return units[(NATS + units["learner"]).isin(nats)].dropna(subset=nats)


def confusions(study: Study, units: pd.DataFrame) -> pd.DataFrame:
    """Confusion of theories: which are taken for which.

    Columns: by theory, the share of single subjects that are attributed to it; ``groups``, the
    share of groups that are attributed to the theory that made them; and ``bits`` per action, as
    the theory that made them predicts subjects.
    """
    sizes, ceiling = sizes_of(study, units), bits(_of_theories(units))
    right = {"groups": np.diag(confusion(sizes, of_groups=True)),
             "bits": np.diag(ceiling.loc[ceiling.columns])}  # fmt: skip
    return confusion(sizes).assign(**right)

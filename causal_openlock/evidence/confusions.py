"""Stored rows of a study of theories, and the theories to which subjects are attributed.

A study with ``measured: recovery`` or ``measured: design`` simulates subjects of every learner of
its experiment, and lets every learner predict all of them, with parameters known or unknown
(:mod:`~causal_openlock.design.apart`). Its ``units.parquet`` has three kinds of rows:

- a row for each simulated subject: ``nats NAME``, the log-likelihood of what it did under each
  learner; how many ``actions`` it took; and what
  :func:`~causal_openlock.design.telling.informed` adds;
- a row for each group of a learner in a condition, with its number of ``subjects``: ``groups``, all
  subjects, and ``halves``, two groups of half the number; 1 if it is attributed to the learner that
  made it, 0 if to others, and a share where several predict it equally well;
- a row for each set and ``parameter`` that was recovered: the ``true`` value and the ``fitted``
  one, logarithms where these were searched. ``r``, their correlation over sets, follows from them.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from causal_openlock.design.apart import NATS
from causal_openlock.design.parameters import on_search_scale
from causal_openlock.design.telling import attributed, bits, by_size, informed
from causal_openlock.design.telling import confusion as confusion_of
from causal_openlock.evidence.study import Study
from causal_openlock.evidence.study_files import read_run
from causal_openlock.fitting.space import SearchSpace

GROUPS = {"groups": 1, "halves": 2}
"""Into how many groups the subjects of a learner in a condition are divided."""
WHOLE = {"phase": "test", "judged": True}
"""A subject is looked at as a whole, so that a phase or a trial says nothing."""


def units_of_subjects(subjects: pd.DataFrame) -> pd.DataFrame:
    """The rows of subjects and of groups.

    Args:
        subjects: From :func:`~causal_openlock.design.apart.told_apart`.
    """
    units = informed(subjects).rename(columns={"subject": "unit"}).assign(subjects=1)
    return pd.concat([units, units_of_groups(units)], ignore_index=True).assign(**WHOLE)


def units_of_groups(subjects: pd.DataFrame) -> pd.DataFrame:
    """The rows of groups, from those of subjects: each group as if it were one subject."""
    nats = [str(name) for name in subjects.columns if str(name).startswith(NATS)]
    rows = []
    for names, own in subjects.groupby(["learner", "condition", "protocol"], sort=False):
        if NATS + str(names[0]) not in nats:  # of no theory
            continue
        maker, likelihoods = nats.index(NATS + names[0]), own[nats].to_numpy(float)
        for measure, many in GROUPS.items():
            for unit, group in enumerate(np.array_split(likelihoods, min(many, len(own)))):
                right = attributed(group.sum(axis=0, keepdims=True))[0, maker]
                rows.append([*names, unit, len(group), measure, float(right)])
    columns = ["learner", "condition", "protocol", "unit", "subjects", "measure", "right"]
    table = pd.DataFrame(rows, columns=columns)
    return table.pivot(index=columns[:5], columns="measure", values="right").reset_index()


def units_of_parameters(learner: str, pairs: pd.DataFrame, space: SearchSpace) -> pd.DataFrame:
    """The rows of a learner's parameters.

    Args:
        learner: Its label.
        pairs: From :func:`~causal_openlock.design.parameters.parameters_recovered`.
        space: What was searched.
    """
    kept = on_search_scale(pairs, space)[["set", "parameter", "true", "fitted"]]
    about = {"learner": learner, "condition": "", "protocol": "", "subjects": 1, **WHOLE}
    return kept.rename(columns={"set": "unit"}).assign(**about)


def subjects_of(units: pd.DataFrame) -> pd.DataFrame:
    """The subjects that theories made, from the stored rows."""
    nats = [str(name) for name in units.columns if str(name).startswith(NATS)]
    made = units["learner"].isin([name.removeprefix(NATS) for name in nats])
    return units[made].dropna(subset=nats)


def confusion(study: Study, units: pd.DataFrame) -> pd.DataFrame:
    """Confusion of learners: which are taken for which.

    Columns: by learner, the share of single subjects that are attributed to it; ``groups``, the
    share of groups that are attributed to the learner that made them, and ``taken for``, what else
    they are attributed to; ``bits`` per action, as the learner that made them predicts subjects.
    """
    subjects = subjects_of(units)
    sizes = by_size(subjects, read_run(study)["seed"])
    groups, ceiling = confusion_of(sizes, of_groups=True), bits(subjects)
    taken_for = {
        maker: ", ".join(
            f"{name} {share:.2f}" for name, share in row.items() if name != maker and share > 0.005
        )
        for maker, row in groups.iterrows()
    }
    table = confusion_of(sizes).rename_axis(index="learner").reset_index()
    return table.assign(
        groups=[groups.loc[name, name] for name in groups],
        **{"taken for": [taken_for[name] or "–" for name in groups]},
        bits=[ceiling.loc[name, name] for name in groups],
    )

"""Stored rows of a recovery study, and the learners to which subjects are attributed.

A study with ``measured: recovery`` simulates subjects of every learner of its experiment, and lets
every learner predict all of them (:mod:`~causal_openlock.fitting.recovery`). Its
``units.parquet`` has three kinds of rows:

- a row for each simulated subject: ``nats NAME``, the log-likelihood of what it did under each
  learner; how many ``actions`` it took; and ``single``, 1 if it is attributed to the learner that
  made it, 0 if to others, and a share where several predict it equally well;
- a row for each group of a learner in a condition, with its number of ``subjects``: ``groups``, all
  subjects, and ``halves``, two groups of half the number; 1 or 0, or a share, as for a subject;
- a row for each set and ``parameter`` that was recovered: the ``true`` value and the ``fitted``
  one, logarithms where these were searched. ``r``, their correlation over sets, follows from them.

A study with ``measured: design`` does so with parameters that no theory knows
(:mod:`~causal_openlock.fitting.design`): likelihoods are averaged over draws, and rows of subjects
have what :func:`~causal_openlock.fitting.design.informed` adds.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from causal_openlock.evidence.study import Study
from causal_openlock.evidence.study_files import read_run
from causal_openlock.fitting.design import NATS, informed
from causal_openlock.fitting.recovery import Recovery, attributed, attributed_rows, recovery
from causal_openlock.fitting.space import SearchSpace
from causal_openlock.scoring.scores import LN2, SUBJECT

GROUPS = {"groups": 1, "halves": 2}
"""Into how many groups the subjects of a learner in a condition are divided."""
WHOLE = {"phase": "test", "judged": True}
"""A subject is looked at as a whole, so that a phase or a trial says nothing."""


def units_of_recovery(actions: pd.DataFrame) -> pd.DataFrame:
    """The rows of subjects and of groups.

    Args:
        actions: From :func:`~causal_openlock.fitting.recovering.predicted`.
    """
    sums = actions.groupby([*SUBJECT, "scored"], observed=True)["log_probability"].sum()
    wide = sums.unstack("scored")[list(dict.fromkeys(actions["scored"]))]
    taken = actions[actions["scored"] == wide.columns[0]].groupby(SUBJECT, observed=True).size()
    makers = wide.index.get_level_values("learner")
    own = wide.columns.get_indexer(makers)
    single = attributed_rows(wide.to_numpy(float))[np.arange(len(wide)), own]
    subjects = wide.add_prefix(NATS).assign(actions=taken, single=single).reset_index()
    subjects = subjects.rename(columns={"subject": "unit"}).assign(subjects=1)
    return _with_groups(subjects.drop(columns=["experiment", "seed"]))


def units_of_design(subjects: pd.DataFrame) -> pd.DataFrame:
    """The rows of subjects and of groups, where parameters are unknown.

    Args:
        subjects: From :func:`~causal_openlock.fitting.design.told_apart`.
    """
    return _with_groups(informed(subjects).rename(columns={"subject": "unit"}).assign(subjects=1))


def _with_groups(subjects: pd.DataFrame) -> pd.DataFrame:
    return pd.concat([subjects, units_of_groups(subjects)], ignore_index=True).assign(**WHOLE)


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
                right = attributed(group.sum(axis=0, keepdims=True))[maker]
                rows.append([*names, unit, len(group), measure, float(right)])
    columns = ["learner", "condition", "protocol", "unit", "subjects", "measure", "right"]
    found = pd.DataFrame(rows, columns=columns)
    return found.pivot(index=columns[:5], columns="measure", values="right").reset_index()


def units_of_parameters(learner: str, pairs: pd.DataFrame, space: SearchSpace) -> pd.DataFrame:
    """The rows of a learner's parameters.

    Args:
        learner: Its label.
        pairs: From :func:`~causal_openlock.fitting.recovery.recovered`.
        space: What was searched.
    """
    logs = pairs["parameter"].map({name: one.log for name, one in space.ranges.items()})
    found = {
        name: np.where(logs, np.log(pairs[name].where(logs, 1.0)), pairs[name])
        for name in ("true", "fitted")
    }
    return pd.DataFrame(
        {"learner": learner, "condition": "", "protocol": "", "unit": pairs["set"],
         "subjects": 1, "parameter": pairs["parameter"], **found, **WHOLE}
    )  # fmt: skip


def recovery_of(units: pd.DataFrame, seed: int) -> Recovery:
    """Attribution of subjects to learners, from the rows of subjects."""
    names = [str(name) for name in units.columns if str(name).startswith(NATS)]
    made = units["learner"].isin([name.removeprefix(NATS) for name in names])
    subjects = units[made].dropna(subset=names).rename(columns={"unit": "subject"})
    key = subjects[["learner", "condition", "protocol", "subject"]].assign(experiment="", seed=seed)
    parts = [
        key.assign(trial=1, scored=name.removeprefix(NATS), log_probability=subjects[name])
        for name in names
    ]
    found = recovery(pd.concat(parts, ignore_index=True), seed)
    sums = subjects.groupby("learner", observed=True)[[*names, "actions"]].sum()
    bits = -sums[names].div(sums["actions"], axis=0) / LN2
    return replace(found, bits=bits.rename(columns=lambda name: str(name).removeprefix(NATS)))


def confusion(study: Study, units: pd.DataFrame) -> pd.DataFrame:
    """Confusion of learners: which are taken for which.

    Columns: by learner, the share of single subjects that are attributed to it; ``groups``, the
    share of groups that are attributed to the learner that made them, and ``taken for``, what else
    they are attributed to; ``bits`` per action, as the learner that made them predicts subjects.
    """
    found = recovery_of(units, read_run(study)["seed"])
    table = found.single.rename_axis(index="learner").reset_index()
    names = list(found.single.index)
    taken: dict[str, list[str]] = {name: [] for name in names}
    for maker, other, share in found.confused(found.groups, above=0.005):
        taken[maker].append(f"{other} {share:.2f}")
    return table.assign(
        groups=[found.groups.loc[name, name] for name in names],
        **{"taken for": [", ".join(taken[name]) or "–" for name in names]},
        bits=[found.bits.loc[name, name] for name in names],
    )

"""Recovery: can a study of this size tell these theories apart?

Before any person is asked, subjects are simulated from every learner, and every learner predicts
all of them (Wilson & Collins 2019). A subject, or a group of subjects in one condition, is
attributed to the learner that predicts it best. How often that is the learner that made it is the
diagonal of a confusion matrix; theories that are confused here cannot be distinguished in
people either. How well the learner that made a subject predicts it is the ceiling: no theory can do
better.

Learners predict with the parameters that they were simulated with; nothing is fitted. Parameters
are recovered by themselves: subjects are simulated with parameters drawn from their ranges, and
what is fitted to them is correlated with what made them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from causal_openlock.experiment.declare import LearnerSpec
from causal_openlock.experiment.making import LearnerForm, learner
from causal_openlock.files.atomic import write_text
from causal_openlock.files.escaping import csv_of
from causal_openlock.fitting.search import at_bound
from causal_openlock.fitting.space import SearchSpace, bundled_search
from causal_openlock.fitting.to_actions import Fitted
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.scoring.scores import LN2, SUBJECT
from causal_openlock.world.randomness import generators

GROUPS = 200
"""Groups that are drawn, with replacement, from the subjects of a learner in a condition."""
SIZES = (1, 2, 5, 10, 20, 40, 80, 160)


@dataclass(frozen=True)
class Recovery:
    """Attribution of subjects to learners.

    Attributes:
        single: Confusion of single subjects: rows made them, columns are what they are attributed
            to, as shares.
        groups: The same of groups of as many subjects as there are in a condition.
        by_size: For each learner, condition, number of ``subjects`` in a group and number of
            ``trials`` that count, the share ``right`` that is attributed to their maker.
        bits: Bits per action of subjects (rows) as the learners (columns) predict them; the
            diagonal is the ceiling.
        subjects: How many there are in a condition.
        made: How many there are in all.
    """

    single: pd.DataFrame
    groups: pd.DataFrame
    by_size: pd.DataFrame
    bits: pd.DataFrame
    subjects: int
    made: int

    def shares_right(self) -> tuple[float, float]:
        """Share of groups and of single subjects that are attributed correctly."""
        return float(np.diag(self.groups).mean()), float(np.diag(self.single).mean())

    def confused(self, table: pd.DataFrame, above: float = 0.1) -> list[tuple[str, str, float]]:
        """Learners that made subjects, what these are taken for, and how often, beyond a share."""
        return [
            (str(maker), str(taken), float(table.loc[maker, taken]))
            for maker in table.index
            for taken in table.columns
            if maker != taken and table.loc[maker, taken] > above
        ]

    def save(self, folder: Path) -> list[Path]:
        """Write ``single.csv``, ``groups.csv``, ``by_size.csv`` and ``bits.csv``.

        Raises:
            OSError: If they cannot be written.
        """
        tables = {"single": self.single, "groups": self.groups, "bits": self.bits}
        tables = {name: table.reset_index() for name, table in tables.items()}
        files = []
        for name, table in {**tables, "by_size": self.by_size}.items():
            files.append(folder / f"{name}.csv")
            write_text(files[-1], csv_of(table.round(6)))
        return files


def recovery(actions: pd.DataFrame, seed: int = 0) -> Recovery:
    """Attribute simulated subjects, one by one and in groups, to the learners that predict them.

    Args:
        actions: Scores of every learner on every learner's subjects, from
            :func:`~causal_openlock.scoring.teacher_forcing.score_actions`.
        seed: Of the groups that are drawn.
    """
    names = list(dict.fromkeys(actions["scored"]))
    by_trial = actions.groupby([*SUBJECT, "trial", "scored"], observed=True)["log_probability"]
    sums = by_trial.sum().unstack("scored")[names]
    so_far = sums.groupby(SUBJECT, observed=True).cumsum()
    last = int(sums.index.get_level_values("trial").max())
    single = dict.fromkeys(names, np.zeros(len(names)))
    groups, rows, most = dict(single), [], 0
    for trials in range(1, last + 1):
        ends = so_far[so_far.index.get_level_values("trial") <= trials]
        whole = ends.groupby(SUBJECT, observed=True).last()
        parts = whole.groupby(["learner", "condition"], observed=True, sort=False)
        for (maker, condition), own in parts:
            found = own.to_numpy(float)
            most = max(most, len(found))
            sizes = {size for size in (*SIZES, len(found)) if size <= len(found)}
            (generator,) = generators(seed, f"groups/{maker}/{condition}", [trials])
            for size in sorted(sizes):
                drawn = _drawn(found, size, generator)
                shares = attributed(drawn)
                if maker in names:
                    right = float(shares[names.index(maker)])
                    rows.append([maker, condition, size, trials, right])
                if trials < last:
                    continue
                if size == 1:
                    single[maker] = single[maker] + shares
                if size == len(found):
                    groups[maker] = groups[maker] + shares
    bits = -actions.groupby(["learner", "scored"], observed=True)["log_probability"].mean() / LN2
    return Recovery(
        _matrix(single, names),
        _matrix(groups, names),
        pd.DataFrame(rows, columns=["learner", "condition", "subjects", "trials", "right"]),
        bits.unstack("scored").loc[names, names],
        most,
        len(sums.groupby(SUBJECT, observed=True).size()),
    )


def _drawn(found: FloatArray, size: int, generator: np.random.Generator) -> FloatArray:
    """``[G, M]`` summed log-likelihoods of groups; a group of one is each subject once."""
    if size == 1:
        return found
    who = generator.integers(len(found), size=(GROUPS, size))
    summed: FloatArray = found[who].sum(axis=1)
    return summed


def attributed(likelihoods: FloatArray) -> FloatArray:
    """``[M]`` the share of rows, ``[N, M]``, in which each column is greatest; ties are shared.

    >>> attributed(np.array([[1.0, 2.0], [3.0, 3.0]])).tolist()
    [0.25, 0.75]
    """
    shares: FloatArray = attributed_rows(likelihoods).mean(axis=0)
    return shares


def attributed_rows(likelihoods: FloatArray) -> FloatArray:
    """``[N, M]`` what of each row is attributed to each column: to the greatest; ties are shared.

    >>> attributed_rows(np.array([[1.0, 2.0], [3.0, 3.0]])).tolist()
    [[0.0, 1.0], [0.5, 0.5]]
    """
    best = likelihoods >= likelihoods.max(axis=1, keepdims=True) - 1e-9
    shares: FloatArray = best / best.sum(axis=1, keepdims=True)
    return shares


def _matrix(shares: Mapping[str, FloatArray], names: Sequence[str]) -> pd.DataFrame:
    table = np.array([shares[name] / max(shares[name].sum(), 1e-12) for name in names])
    return pd.DataFrame(table, index=pd.Index(names, name="made_by"), columns=names)


# -- parameters -----------------------------------------------------------------------------------


def space_of(spec: LearnerSpec) -> SearchSpace | None:
    """Search space of a learner as it is set, if the space comes with the toolkit."""
    space = bundled_search(spec.learner)
    if space is None or any(spec.parameters[name] != kept for name, kept in space.fixed.items()):
        return None
    return space


def drawn_sets(space: SearchSpace, many: int, seed: int) -> list[dict[str, int | float]]:
    """Parameters drawn evenly from their ranges, the logarithm where that is searched."""
    drawn = []
    for generator in generators(seed, f"parameters/{space.learner}", range(many)):
        drawn.append({name: one.at(generator.random()) for name, one in space.ranges.items()})
    return drawn


def made_with(
    space: SearchSpace, sets: Sequence[Mapping[str, float]], subjects: int
) -> list[LearnerForm]:
    """A learner for each set of parameters, ``set_000`` and so on."""
    return [
        learner(space.learner, label=f"set_{number:03}", subjects=subjects,
                **space.parameters(chosen))
        for number, chosen in enumerate(sets)
    ]  # fmt: skip


def recovered(
    sets: Sequence[Mapping[str, float]], fits: Sequence[Fitted], space: SearchSpace
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """True parameters of subjects, next to the fitted ones.

    Returns:
        A row for each set and parameter, ``parameter``, ``true``, ``fitted`` and whether that is
        ``at_bound``; and a row for each parameter with the correlation ``r``, on a logarithmic
        scale where that was searched.
    """
    pairs = pd.DataFrame(
        [
            {"set": number, "parameter": name, "true": true[name], "fitted": one.chosen[name],
             "at_bound": name in at_bound(space.ranges, one.chosen)}
            for number, (true, one) in enumerate(zip(sets, fits, strict=True))
            for name in space.ranges
        ]
    )  # fmt: skip
    rows = []
    for name, own in pairs.groupby("parameter", sort=False):
        values = own[["true", "fitted"]].to_numpy(float)
        values = np.log(values) if space.ranges[str(name)].log else values
        spread = values.std(axis=0).min() > 0
        rows.append({"parameter": name, "r": np.corrcoef(values.T)[0, 1] if spread else np.nan,
                     "sets": len(own)})  # fmt: skip
    return pairs, pd.DataFrame(rows)

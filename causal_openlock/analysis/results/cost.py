"""What learning costs: attempts until a subject solves a new room about as well as can be done.

Two learners that do equally well in the end may have needed ten attempts or a million to get there.
So every attempt counts here, those of all trials of training too, up to the first new room that is
solved within some multiple of what the ideal observer needs
(:mod:`~causal_openlock.analysis.results.bounds`).

What a learner was trained with before the experiment, such as the meta-training of ``rl2``, counts
as well: a learner declares it (``Learner.prior_attempts``), and it is kept with the experiment.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import CELL, SUBJECT, VISIT
from causal_openlock.analysis.results.bounds import Bounds
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.statistics import SEED, bootstrap_interval
from causal_openlock.schemas.fsm import FloatArray

WITHIN = 1.5
"""A room is solved well in so many times the attempts of the ideal observer."""


def learning_costs(
    results: Material, within: float = WITHIN, repeats: bool = False
) -> pd.DataFrame:
    """How many attempts each learner needs, all training counted, until it solves a new room well.

    >>> import causal_openlock as ol
    >>> table = ol.learning_costs(results)
    >>> table[["learner", "before", "attempts", "reached"]].values.tolist()
    [['random', 0, inf, 0.0], ['oracle', 0, 2.0, 1.0]]

    Args:
        results: What was played.
        within: As in :func:`cost_of_learning`, as ``repeats``.
        repeats: As there.

    Returns:
        A row for each ``learner`` and ``protocol``, of all conditions in which the attempts of the
        ideal observer are known: ``subjects`` (in all of them); ``before``, the attempts of its
        training before the experiment; the share of subjects that ``reached`` it; ``attempts``,
        the median of subjects, ``before`` included, with its 95% interval ``ci_low`` and
        ``ci_high``, inf where it is beyond what was played; and ``asked``, the most attempts that
        one of its subjects had, ``before`` included.
    """
    return costs_by_learner(subject_costs(results, results.trials, within, repeats))


def costs_by_learner(each: pd.DataFrame) -> pd.DataFrame:
    """:func:`learning_costs` of subjects, as :func:`subject_costs` returns them."""
    rows = []
    for (learner, protocol), own in each.groupby(["learner", "protocol"], observed=True, sort=True):
        cost = own["cost"].to_numpy(float)
        reached = float(np.isfinite(cost).mean())
        size, before = len(own), int(own["before"].iloc[0])
        about = (str(learner), str(protocol), size, before, reached)
        rows.append((*about, *median_cost(cost), int(own["asked"].max())))
    columns = ["learner", "protocol", "subjects", "before", "reached"]
    return pd.DataFrame(rows, columns=[*columns, "attempts", "ci_low", "ci_high", "asked"])


def subject_costs(
    results: Material, trials: pd.DataFrame, within: float = WITHIN, repeats: bool = False
) -> pd.DataFrame:
    """:func:`cost_of_learning` with what learners were trained with ``before``, which it counts."""
    table = cost_of_learning(trials, results.bounds, within, repeats)
    known = {spec.name: spec.origin.prior_attempts for spec in results.experiment.learners}
    before = table["learner"].astype(str).map(known).fillna(0).astype(int)
    added = table[["cost", "asked"]].add(before, axis=0)
    return table.assign(before=before, **added)


def cost_of_learning(
    trials: pd.DataFrame, bounds: Bounds, within: float = WITHIN, repeats: bool = False
) -> pd.DataFrame:
    """How many attempts each subject made until it first solved a new room well.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.
        bounds: What the ideal observer needs.
        within: How well: in at most so many times its attempts.
        repeats: Whether rooms count that the subject has visited before. A room is new if the
            subject has not met its schema with its layout; where a protocol goes through the same
            layouts over and over, only the first visits are new.

    Returns:
        A row for each subject of each ``learner``, ``condition`` and ``protocol`` in which a bound
        is known: :data:`~causal_openlock.analysis.measures.SUBJECT`; ``cost``, all its attempts up
        to the one that solves that room, inf if there is none; and ``asked``, all its attempts up
        to the end of the last room that could have been.
    """
    keys = trials[["condition", "protocol", "phase"]].astype(str).itertuples(index=False, name=None)
    bound = np.array([bounds[key].attempts if key in bounds else np.nan for key in keys], float)
    rows = trials.assign(bound=bound).sort_values([*CELL, *SUBJECT, *VISIT], kind="stable")
    whole = rows.groupby([*CELL, *SUBJECT], observed=True, sort=False)
    made = whole["last_attempt"].cumsum()
    room = [*CELL, *SUBJECT, "schema", "layout"]
    counts = rows["bound"].notna() & (repeats | ~rows.duplicated(room))
    solved = counts & rows["solved"] & (rows["attempts"] <= within * rows["bound"])
    until = made - rows["last_attempt"] + rows["attempts"]
    rows = rows.assign(cost=until.where(solved, np.inf), asked=made.where(counts))
    found = rows.groupby([*CELL, *SUBJECT], observed=True, sort=True)[["cost", "asked"]]
    return found.agg({"cost": "min", "asked": "max"}).dropna().reset_index()


def median_cost(cost: FloatArray) -> tuple[float, float, float]:
    """The median of subjects, inf where half of them never came so far, and its 95% interval.

    >>> median_cost(np.array([4.0, 4.0, 4.0]))
    (4.0, 4.0, 4.0)
    """
    never = 1e18  # infinity has no differences; so far above the others it stays there
    most = np.max(cost, where=np.isfinite(cost), initial=0.0)
    ends = bootstrap_interval(
        lambda values: np.median(values, axis=-1),
        [np.minimum(cost, never)],
        np.random.default_rng(SEED),
    )
    found = (float(np.median(cost)), *map(float, ends))
    low, middle, high = (np.inf if end > most else end for end in (found[1], found[0], found[2]))
    return middle, low, high

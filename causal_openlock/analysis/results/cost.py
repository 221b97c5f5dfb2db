"""What learning costs: attempts until a subject solves a new room about as well as can be done.

Two learners that do equally well in the end may have needed ten attempts or a million to get there.
So every attempt counts here, those of all trials of training too, up to the first new room that is
solved within some multiple of what the ideal observer needs
(:mod:`~causal_openlock.analysis.results.bounds`).

What a learner went through before the experiment, such as the meta-training of ``rl2``, is not on
record and does not count.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import CELL, SUBJECT, VISIT
from causal_openlock.analysis.results.bounds import Bounds
from causal_openlock.analysis.statistics import SEED, bootstrap_interval
from causal_openlock.world.fsm import FloatArray

WITHIN = 1.5
"""A room is solved well in so many times the attempts of the ideal observer."""


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

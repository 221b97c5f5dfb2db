"""Published results in the form of units, so that studies compare and show them as learners.

``people`` and ``published_model`` have attempts in the trials that the papers report,
``paper_ddqn`` the shares of the paper's Figures 6 and 7, and ``paper_ppo`` and the like the curves
of AAAI 2020. These are means without units; those of people and the published model have an error
bar (``se``) of a number of ``subjects``; of the others none is known, and they are taken as they
are.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import pandas as pd

from causal_openlock.paper import published
from causal_openlock.paper.agreement import published_shares

BLOCK = 50
"""Trials in a part of a curve; published points seem to be means of this number of trials."""
RL_2020 = {name: f"paper_{name.lower()}" for name in ("DQN", "A2C", "TRPO", "PPO", "MAML")}
"""Names of the published curves of AAAI 2020."""
PUBLISHED = ("people", "published_model", "paper_ddqn", *RL_2020.values())
"""Names of all published results."""


@cache
def published_units() -> pd.DataFrame:
    """Published results with the columns of :mod:`evidence.units`.

    >>> people = published_units().query("learner == 'people' and condition == 'CC3-CC4'")
    >>> people["attempts"].tolist()
    [5.525]
    """
    curves, ddqn = published.rl_2020(), published_shares().drop(columns="attempts")
    parts = [
        published.people().assign(learner="people"),
        published.model().assign(learner="published_model"),
        ddqn.reset_index().assign(learner="paper_ddqn"),
        curves.assign(
            learner=curves["learner"].map(RL_2020), block=curves.pop("trial") // BLOCK + 1
        ),
    ]
    units = pd.concat(parts, ignore_index=True).dropna(subset="learner")
    units = units.rename(columns={"mean": "attempts", "block": "part"})
    when = units["part"].fillna(units["trial"])
    return units.assign(unit=0, judged=judged(units, when, ["learner", "condition"]))


def judged(units: pd.DataFrame, when: pd.Series[float], by: Sequence[str]) -> pd.Series[bool]:
    """Which rows a condition is judged by: those of its test, or the last ones of a baseline."""
    tests = units["phase"] == "test"
    has_test, last = (one.groupby([units[name] for name in by], observed=True).transform("max")
                      for one in (tests, when))  # fmt: skip
    return tests.where(has_test, when == last)

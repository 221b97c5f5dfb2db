"""Published results in the form of units, so that studies compare and show them as learners.

``people`` and ``published_model`` have attempts in the trials that the papers report,
``paper_ddqn`` the shares of the paper's Figures 6 and 7, and ``paper_ppo`` and the like the curves
of AAAI 2020. These are means without units; those of people and the published model have a standard
error (``error``); of the others none is known, and they are taken as they are.
"""

from __future__ import annotations

from functools import cache

import pandas as pd

from causal_openlock.analysis.statistics import error_of_bar
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
    parts = [
        means.rename(columns={"mean": "attempts"}).assign(
            learner=name,
            judged=means["trial"] == means.groupby("condition")["trial"].transform("max"),
            error=error_of_bar(means["se"], means["subjects"]),
        )
        for name, means in zip(PUBLISHED, (published.people(), published.model()), strict=False)
    ]
    ddqn = published_shares().drop(columns="attempts").reset_index()
    ddqn = ddqn.rename(columns={"block": "part"})
    last = ddqn.groupby("condition")["part"].transform("max")
    parts.append(ddqn.assign(learner="paper_ddqn", judged=ddqn["part"] == last))
    curves = published.rl_2020().rename(columns={"mean": "attempts"})
    curves = curves[curves["learner"].isin([*RL_2020])]
    last = curves.groupby(["condition", "phase"])["trial"].transform("max")
    parts.append(
        curves.assign(
            learner=curves["learner"].map(RL_2020),
            part=curves["trial"] // BLOCK + 1,
            judged=(curves["phase"] == "test") | (curves["trial"] == last),
        ).drop(columns="trial")
    )
    units = pd.concat(parts, ignore_index=True).assign(unit=0)
    return units.assign(trials=units["subjects"].fillna(1).astype(int))

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
from causal_openlock.evidence.study import BLOCK, PUBLISHED, RL_2020
from causal_openlock.experiment.declare import PROTOCOLS
from causal_openlock.paper.published import (
    model,
    paper_ddqn,
    people,
    rl_2020,
)


@cache
def published_units() -> pd.DataFrame:
    """Published results with the columns of :mod:`~causal_openlock.evidence.units`.

    >>> found = published_units().query("learner == 'people' and condition == 'CC3-CC4'")
    >>> found["attempts"].tolist()
    [5.525]
    """
    parts = []
    for name, means in zip(PUBLISHED, (people(), model()), strict=False):
        last = means.groupby("condition")["trial"].transform("max")
        parts.append(
            means.rename(columns={"mean": "attempts"}).assign(
                learner=name,
                protocol="human",
                judged=means["trial"] == last,
                error=error_of_bar(means["se"], means["subjects"]),
            )
        )
    counts = paper_ddqn().pivot_table(
        index=["condition", "phase", "block"], columns="category", values="count"
    )
    total = counts.sum(axis=1)
    opened = counts[["open1", "open2", "open3"]].sum(axis=1)
    # Third solutions are new in their visit, so each of them stands for a visit.
    visits = total / PROTOCOLS["rl"].attempt_limit
    shares = pd.DataFrame(
        {
            "opens": opened / total,
            "unlocks": counts["unlock"] / total,
            "else": counts["else"] / total,
            "finds_all": counts["open3"] / visits,
        }
    ).reset_index()
    last = shares.groupby("condition")["block"].transform("max")
    parts.append(
        shares.rename(columns={"block": "part"}).assign(
            learner="paper_ddqn", protocol="rl", judged=shares["block"] == last
        )
    )
    curves = rl_2020()
    last = curves.groupby(["condition", "phase"])["trial"].transform("max")
    parts.append(
        curves.rename(columns={"mean": "attempts"}).assign(
            learner=curves["learner"].map({name: ours for ours, name in RL_2020.items()}),
            part=curves["trial"] // BLOCK + 1,
            protocol="rl_2020",
            judged=(curves["phase"] == "test") | (curves["trial"] == last),
            error=0.0,
        ).dropna(subset="learner").drop(columns="trial")
    )  # fmt: skip
    units = pd.concat(parts, ignore_index=True).assign(unit=0).drop(columns="se")
    return units.assign(trials=units.pop("subjects").fillna(1).astype(int))

"""Failures of a learner: the attempts and actions that it predicts worse than it expects to.

A learner that is undecided needs many bits, and says so before: what it expects to need is the
entropy of its own probabilities. The bits that it needs beyond that measure its errors.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from causal_openlock.scoring.scores import LN2, SUBJECT, over
from causal_openlock.world.room import action_names

ATTEMPTS = {
    "first attempts": 1, "second attempts": 2, "third attempts": 3, "attempts 4 to 6": 6,
    "attempts 7 to 12": 12, "later attempts": np.inf,
}  # fmt: skip
"""Ranges of attempts of a trial, with the last attempt of each."""
WORST = 5
"""Attempts of subjects that are named."""


def failures(actions: pd.DataFrame, positions: Mapping[str, int]) -> pd.DataFrame:
    """Prediction of different attempts and actions by one learner, the worst parts first.

    Args:
        actions: Its scores, from
            :func:`~causal_openlock.scoring.teacher_forcing.score_actions`.
        positions: By condition, how many positions its rooms have.

    Returns:
        A row for each ``part`` of what was done, by attempt, by place in the attempt and by kind of
        action: ``actions``, ``bits`` per action with ``ci_low`` and ``ci_high``, what was
        ``expected``, and what it needed ``beyond`` that, as
        :func:`~causal_openlock.scoring.scores.over` has them. Where it expects nothing, as it gives
        no probabilities, parts are in the order of bits.
    """
    bins = [0, *ATTEMPTS.values()]
    places = (
        actions["action"].map({1: "first actions", 2: "second actions"}).fillna("later actions")
    )
    size = actions["condition"].astype(str).map(positions)
    kind = np.select(
        [actions["action_index"] < size, actions["action_index"] < 2 * size],
        ["pushes of levers", "pulls of levers"],
        "pushes of the door",
    )
    attempt = pd.cut(actions["attempt"], bins, labels=list(ATTEMPTS)).astype(str)
    tables = [over(actions.assign(part=one), ["part"]) for one in (attempt, places, kind)]
    return _worst_first(pd.concat(tables, ignore_index=True)).drop(columns="scored")


def worst_attempts(actions: pd.DataFrame, positions: Mapping[str, int]) -> pd.DataFrame:
    """The attempts that one learner predicts worst.

    The arguments are those of :func:`failures`.

    Returns:
        ``condition``, ``subject``, ``trial``, ``attempt``; what was ``done``, by name; ``bits`` of
        the whole attempt, what was ``expected``, and what it needed ``beyond`` that.
    """
    names = {name: [one.replace("_", " ") for one in action_names(size)]
             for name, size in positions.items()}  # fmt: skip
    done = [names[str(condition)][index] for condition, index in
            zip(actions["condition"], actions["action_index"], strict=True)]  # fmt: skip
    table = actions.assign(
        bits=-actions["log_probability"] / LN2, expected=actions["entropy"] / LN2, done=done
    )
    each = table.groupby([*SUBJECT, "trial", "attempt"], observed=True, sort=False)
    found = each.agg(
        done=("done", ", ".join), bits=("bits", "sum"),
        expected=("expected", lambda own: own.sum(skipna=False)),
    )  # fmt: skip
    kept = ["condition", "subject", "trial", "attempt", "done", "bits", "expected", "beyond"]
    return _worst_first(found.reset_index())[kept].head(WORST)


def _worst_first(table: pd.DataFrame) -> pd.DataFrame:
    found = table.assign(beyond=table["bits"] - table["expected"])
    by = "bits" if found["beyond"].isna().any() else "beyond"
    return found.sort_values(by, ascending=False, kind="stable", ignore_index=True)

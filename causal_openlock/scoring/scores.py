"""How well learners predict: in bits per action, by subject and over all of them.

A learner that knows nothing predicts each of A actions with 1/A, which is log2 A bits an action.
What one that predicts better needs less is what it knows. Subjects are the unit: a learner's score
is the mean of subjects, and two learners are compared on the same subjects.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import Group, weighted_difference
from causal_openlock.scoring.teacher_forcing import GROUP

SUBJECT = [*GROUP, "subject"]
LN2 = float(np.log(2.0))


def by_subject(actions: pd.DataFrame, chosen: Mapping[str, int] | None = None) -> pd.DataFrame:
    """The score of each learner on each subject.

    Args:
        actions: From :func:`~causal_openlock.scoring.teacher_forcing.score_actions`, of one learner
            or several.
        chosen: By learner, how many of its parameters were chosen to fit these subjects.

    Returns:
        A row for each ``scored`` learner and subject: how many ``actions``; ``nll``, the negative
        log-likelihood in nats, and its ``standard_error`` (0 where it is exact); ``bits`` per
        action; ``expected``, the bits per action that it would need for its own actions; ``bic``;
        and ``impossible``, how many actions it would never do.
    """
    surprise = actions["log_probability"]
    table = (
        actions.assign(nll=-surprise, variance=actions["standard_error"] ** 2)
        .groupby(["scored", *SUBJECT], observed=True, sort=False)
        .agg(
            actions=("nll", "size"),
            nll=("nll", "sum"),
            standard_error=("variance", lambda of_all: float(np.sqrt(of_all.sum()))),
            expected=("entropy", "mean"),
            impossible=("impossible", "sum"),
        )
        .reset_index()
    )
    parameters = table["scored"].map(chosen or {}).fillna(0).to_numpy(float)
    return table.assign(
        bits=table["nll"] / table["actions"] / LN2,
        expected=table["expected"] / LN2,
        bic=2.0 * table["nll"] + parameters * np.log(table["actions"]),
    )


def ranking(subjects: pd.DataFrame) -> pd.DataFrame:
    """The learners, the one that predicts best first.

    Args:
        subjects: From :func:`by_subject`.

    Returns:
        A row for each ``scored`` learner: ``subjects``, the mean ``bits`` per action with its 95%
        interval ``low`` and ``high``; ``worse``, how much more it needs than the best, on the same
        subjects, with its interval ``worse_low`` and ``worse_high`` (NaN of the best, and where one
        cannot do what was done); and ``best_of``, for how many subjects none is better.
    """
    wide = subjects.pivot_table(index=SUBJECT, columns="scored", values="bits", observed=True)
    wide = wide[list(dict.fromkeys(subjects["scored"]))].dropna()
    means = wide.mean().sort_values(kind="stable")
    best = means.index[0]
    rows = []
    for name in means.index:
        own = _interval(wide[name].to_numpy(float))
        gap = _interval((wide[name] - wide[best]).to_numpy(float))
        rows.append(
            {
                "scored": name,
                "subjects": len(wide),
                **dict(zip(("bits", "low", "high"), own, strict=True)),
                **(
                    dict(zip(("worse", "worse_low", "worse_high"), gap, strict=True))
                    if name != best
                    else {}
                ),
                "best_of": int((wide[name] == wide.min(axis=1)).sum()),
            }
        )
    columns = ["scored", "subjects", "bits", "low", "high", "worse", "worse_low", "worse_high"]
    return pd.DataFrame(rows, columns=[*columns, "best_of"])


def _interval(values: np.ndarray) -> tuple[float, float, float]:
    if not np.isfinite(values).all():
        return float(values.mean()), np.nan, np.nan
    return weighted_difference([Group.of(1, values)])[:3]

"""How much information each action gave a learner that has beliefs.

A record holds actions and not beliefs, so information is measured from traces
(:mod:`causal_openlock.belief.trace`), which play a subject's trial again and read the learner's
beliefs. Only learners that have beliefs have traces.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pandas as pd

from causal_openlock.belief.trace import Trace


def information_per_action(traces: Iterable[Trace]) -> pd.DataFrame:
    """The tables of traces, with ``learner``, ``condition``, ``protocol`` and ``subject``.

    ``gain_obtained`` is NaN where the subject drew its hypotheses again, since entropies of
    different hypotheses cannot be compared.
    """
    tables = [
        trace.table().assign(
            learner=trace.learner,
            condition=trace.condition,
            protocol=trace.protocol.name,
            subject=trace.subject,
        )
        for trace in traces
    ]
    actions = pd.concat(tables, ignore_index=True)
    actions["gain_obtained"] = actions["gain_obtained"].where(actions["renewed"] == "")
    return actions


def mean_information(
    actions: pd.DataFrame, by: Sequence[str] = ("learner", "condition", "trial", "attempt")
) -> pd.DataFrame:
    """Mean bits of an action, every subject counting once.

    Args:
        actions: From :func:`information_per_action`.
        by: What to keep apart.

    Returns:
        One row for each group: ``by``, ``subjects``, ``actions`` (how many), ``predicted`` and
        ``obtained`` (means over subjects of each subject's mean).
    """
    subject = ("learner", "condition", "protocol", "subject")
    of_subject = actions.groupby(list(dict.fromkeys([*by, *subject])), sort=False)
    each = of_subject.agg(
        actions=("number", "size"),
        predicted=("gain_predicted", "mean"),
        obtained=("gain_obtained", "mean"),
    ).reset_index()
    grouped = each.groupby(list(by), sort=False)
    return grouped.agg(
        subjects=("subject", "size"),
        actions=("actions", "sum"),
        predicted=("predicted", "mean"),
        obtained=("obtained", "mean"),
    ).reset_index()

"""What is published to compare with: what people did, and what a model of people did.

Only means and error bars are published, of the same trials: the baseline trials, and the test after
training. People are those of the paper (Figures 3 and 4). The published model is the theory-based
causal model of a later paper, *Theory-based Causal Transfer* (Edmonds et al., AAAI 2020, Figure 5),
whose agents played as people had. They are compared only with learners that played under the same
protocol, ``human``, in the same rooms; see
:mod:`~causal_openlock.analysis.results.people.comparable`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.results.people.comparable import HUMAN_PROTOCOL, Pairs
from causal_openlock.world import reference
from causal_openlock.world.fsm import BoolArray

AGENTS = 40
"""Number of agents behind each published mean of the model."""

PUBLISHED_COLUMNS = ("human_attempts", "human_se", "difference", "model_attempts", "model_se")
"""What :func:`beside_published` adds to a table."""

_PLACE = ["condition", "phase", "trial"]


def people() -> pd.DataFrame:
    """What people did, as published.

    >>> people().query("condition == 'CC4'")["mean"].tolist()
    [19.375, 12.825, 8.525, 7.225, 6.45]

    Returns:
        One row for each ``condition``, ``phase`` and ``trial`` that the paper reports, with
        ``subjects``, ``mean`` (attempts) and ``se`` (the error bar: population SD / √40).
    """
    human = reference.results()["cogsci2018"]["human"]
    return _means(human, int(human["n_per_condition"]))


def model() -> pd.DataFrame:
    """What the theory-based model did, as published.

    Returns:
        A table as :func:`people` has it, of the same trials; ``se`` is the error bar as drawn.
    """
    return _means(reference.results()["aaai2020"]["model"], AGENTS)


def did_what_people_did(table: pd.DataFrame, pairs: Pairs | None = None) -> BoolArray:
    """``[N]`` whether people can be compared with each row: its learner, condition and protocol."""
    human: BoolArray = (table["protocol"] == HUMAN_PROTOCOL).to_numpy(dtype=bool)
    if pairs is None:
        return human
    played = zip(table["learner"], table["condition"], strict=True)
    return human & np.array([pair in pairs for pair in played], dtype=bool)


def beside_published(table: pd.DataFrame, pairs: Pairs | None = None) -> pd.DataFrame:
    """A table of means with what is published beside each of them.

    Args:
        table: One row for each learner, condition, protocol, phase and trial, with ``attempts``.
        pairs: As in :func:`~causal_openlock.analysis.results.summary.summarise`.

    Returns:
        The table with :data:`PUBLISHED_COLUMNS`, which are NaN where nothing compares.
    """
    compares = did_what_people_did(table, pairs)
    keys = pd.MultiIndex.from_arrays([table[column].astype(object) for column in _PLACE])
    found: dict[str, Any] = {}
    for source, means in (("human", people()), ("model", model())):
        beside = means.set_index(_PLACE).reindex(keys)
        for column, value in (("attempts", "mean"), ("se", "se")):
            found[f"{source}_{column}"] = np.where(compares, beside[value].to_numpy(float), np.nan)
    return table.assign(**found, difference=table["attempts"] - found["human_attempts"])


def _means(source: Mapping[str, Any], subjects: int) -> pd.DataFrame:
    rows = [
        (condition, "train", trial, subjects, mean, se)
        for condition, values in source["baseline"].items()
        for trial, (mean, se) in enumerate(zip(values["mean"], values["se"], strict=True), 1)
    ]
    rows += [
        (condition, "test", 1, subjects, values["mean"], values["se"])
        for condition, values in source["transfer"].items()
    ]
    return pd.DataFrame(rows, columns=[*_PLACE, "subjects", "mean", "se"])

"""Published results: means of people and of models, and counts of the paper's DDQN.

Published are means and error bars of people (the paper's Figures 3 and 4), counts of its DDQN by
category (Figures 6 and 7); means of the theory-based model and curves of learners by reinforcement
in *Theory-based Causal Transfer* (Edmonds et al., AAAI 2020, Figures 5 and 4); and how people and a
model trained in three-lever rooms, in *Decomposing Human Causal Learning* (Edmonds et al., CogSci
2019, Figure 4). With whom they are compared stands in :mod:`causal_openlock.paper.references`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from causal_openlock.analysis.results.references import POINT, POINT_COLUMNS
from causal_openlock.world import facts

AGENTS = 40
"""Number of agents behind each published mean of the model."""


def people() -> pd.DataFrame:
    """People's published means.

    >>> people().query("condition == 'CC4'")["mean"].tolist()
    [19.375, 12.825, 8.525, 7.225, 6.45]

    Returns:
        One row for each ``condition``, ``phase`` and ``trial`` that the paper reports, with
        ``subjects``, ``mean`` (attempts) and ``se`` (the error bar: population SD / √40).
    """
    human = facts.results()["cogsci2018"]["human"]
    return _means(human, int(human["n_per_condition"]))


def model() -> pd.DataFrame:
    """The theory-based model's means, in the form of :func:`people`; ``se`` as drawn."""
    return _means(facts.results()["aaai2020"]["model"], AGENTS)


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
    return pd.DataFrame(rows, columns=POINT_COLUMNS)


def people_in_training() -> pd.DataFrame:
    """People's means in the six training trials before the test, by the schema of the rooms.

    >>> people_in_training().query("condition == 'CC3' and solution == 'second'")["mean"].tolist()
    [4.9, 2.68, 2.23, 1.54, 1.31, 1.23]

    Returns:
        One row for each ``solution``, ``condition`` (the schema that is trained: CC3, CE3),
        ``phase`` and ``trial``, with ``subjects``, ``mean`` and ``se``: attempts until ``all``
        solutions are found (30 in a trial that is not solved), until the ``first``, and from there
        to the ``second``, in people who solved every trial (which is inferred: the paper does not
        say who is left out).
    """
    return _training("human")


def model_in_training() -> pd.DataFrame:
    """Means of the model of CogSci 2019, in the form of :func:`people_in_training`."""
    return _training("model")


def _training(who: str) -> pd.DataFrame:
    known = facts.results()["cogsci2019"]
    rows = [
        (solution, schema, "train", trial, known["subjects"][who][solution], mean, se)
        for solution, by_schema in known[who].items()
        for schema, values in by_schema.items()
        for trial, (mean, se) in enumerate(zip(values["mean"], values["se"], strict=True), 1)
    ]
    return pd.DataFrame(rows, columns=["solution", *POINT_COLUMNS])


def paper_ddqn() -> pd.DataFrame:
    """Counts of attempts of the paper's DDQN: five blocks of the baselines, and the tests.

    Returns:
        One row for each ``condition``, ``phase``, ``block`` (from 1) and ``category``, with
        ``count`` and ``until``, the attempts up to the end of the block.
    """
    ddqn = facts.results()["cogsci2018"]["ddqn"]
    courses = [(name, "train", list(own.values())) for name, own in ddqn["baseline_counts"].items()]
    courses += [(name, "test", [own]) for name, own in ddqn["transfer_counts"].items()]
    rows = [
        (condition, phase, number, category, count, number * round(sum(block.values()), -3))
        for condition, phase, blocks in courses
        for number, block in enumerate(blocks, 1)
        for category, count in block.items()
    ]
    return pd.DataFrame(rows, columns=["condition", "phase", "block", "category", "count", "until"])


def rl_2020() -> pd.DataFrame:
    """Attempts in a trial of AAAI 2020's learners by reinforcement (protocol ``rl_2020``).

    >>> rl_2020().query("learner == 'A2C' and condition == 'CC3-CC4'")["mean"].tolist()
    [120, 61, 58, 40, 33, 36, 34]

    Returns:
        One row for each ``learner``, ``condition``, ``phase`` and ``trial`` (from 1: the first of
        the fifty trials that the value seems to be the ``mean`` of). That rooms of the same
        kind of schema came before a transfer is inferred.
    """
    known = facts.results()["aaai2020"]["rl"]
    rows = []
    for learner, by_phase in known["curves"].items():
        for phase, by_schema in by_phase.items():
            tested = phase == "transfer"
            for schema, values in by_schema.items():
                name = f"{schema[:2]}3-{schema}" if tested else schema
                for trial, mean in zip(known["trials"], values["mean"], strict=True):
                    rows.append((learner, name, "test" if tested else "train", trial + 1, mean))
    return pd.DataFrame(rows, columns=["learner", *POINT, "mean"])

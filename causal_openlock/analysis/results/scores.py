"""Scores of subjects in each condition, and what training was worth.

Transfer has two scores. *Congruency*: does training with the structure of the test help more than
training with the other one? *Savings*: how many attempts does training with three levers save in
the first room with four, against subjects without any training?
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import Group, weighted_difference
from causal_openlock.analysis.measures import (
    CELL,
    TRANSFERS,
    by_subject,
    ordered,
)
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.people.published import (
    HUMAN_PROTOCOL,
    did_what_people_did,
    model,
    paper_conditions,
    people,
)
from causal_openlock.analysis.results.summary import judged
from causal_openlock.analysis.statistics import LEVEL, SEED, bootstrap_interval
from causal_openlock.schemas.fsm import FloatArray

SCORE_COLUMNS = (
    *("learner", "protocol", "score", "condition", "subjects"),
    *("attempts", "against", "value", "ci_low", "ci_high", "p"),
)
"""Columns of :func:`transfer_scores`."""

CONGRUENCY, SAVINGS = "congruency", "savings"
PEOPLE, MODEL = "People", "Published model"
_COMPARED = (
    (CONGRUENCY, "CC3-CC4", "CE3-CC4"),
    (CONGRUENCY, "CE3-CE4", "CC3-CE4"),
    *((SAVINGS, name, name.split("-")[1]) for name in TRANSFERS),
)
"""Each score, the condition that it is about, and the one that it is compared with."""


def normalised_score(
    attempts: FloatArray, random: FloatArray | float, ideal: FloatArray | float
) -> FloatArray:
    """Where attempts lie between chance and the best that is possible.

    >>> normalised_score(np.array([30.0, 10.0, 5.0]), 30, 5).tolist()
    [0.0, 0.8, 1.0]

    Args:
        attempts: ``[...]`` attempts to solve.
        random: ``[...]`` or a number: attempts of a learner that acts at random.
        ideal: Attempts of the ideal observer.

    Returns:
        ``[...]`` 0 for as many attempts as at random and 1 for the ideal; below 0 or above 1 for
        more or fewer than these. NaN where random needs no more than ideal.
    """
    span = np.asarray(random, float) - np.asarray(ideal, float)
    width = np.where(span > 0, span, np.nan)
    score: FloatArray = (np.asarray(random, float) - np.asarray(attempts, float)) / width
    return score


def congruency(congruent: FloatArray, incongruent: FloatArray) -> FloatArray:
    """How many attempts more a test takes after training with its own structure than with another.

    >>> float(congruency(np.array([4.0, 6.0]), np.array([7.0, 9.0])))
    -3.0

    Args:
        congruent: ``[..., n]`` attempts of subjects trained with the structure of the test.
        incongruent: ``[..., m]`` attempts of those trained with the other.
    """
    difference: FloatArray = congruent.mean(axis=-1) - incongruent.mean(axis=-1)
    return difference


def savings(baseline: FloatArray, transfer: FloatArray) -> FloatArray:
    """Which share of the attempts in a first trial training saves: 1 − transfer / baseline.

    Args:
        baseline: ``[..., n]`` attempts in the first trial of subjects without training.
        transfer: ``[..., m]`` attempts in the first test trial of those with training.
    """
    share: FloatArray = 1 - transfer.mean(axis=-1) / baseline.mean(axis=-1)
    return share


def scores_by_condition(trials: pd.DataFrame) -> dict[tuple[str, str], dict[str, FloatArray]]:
    """The attempts of every subject in the trials by which its condition is judged.

    Returns:
        By learner and protocol, by condition: ``[n]`` attempts of its subjects, each subject's
        trials averaged.
    """
    return _by_condition(judged(trials))


def transfer_scores(trials: pd.DataFrame) -> pd.DataFrame:
    """What training was worth to each learner in the paper's transfer conditions.

    Congruency compares the mean of a subject's test trials; savings compare the first test trial
    with the first baseline trial.

    Returns:
        A row for each learner, protocol and score for which the conditions were played, with the
        columns :data:`SCORE_COLUMNS`:

        - ``score``: :func:`congruency` (in attempts) or :func:`savings` (a share).
        - ``condition``: the transfer condition whose test it is about; of congruency the one
          trained with the structure of its test.
        - ``subjects``: of that condition; ``attempts``: their mean.
        - ``against``: the mean of those compared with: trained with the other structure, or
          without training.
        - ``value``, ``ci_low``, ``ci_high``: the score and its 95% bootstrap interval, subjects of
          both groups resampled among themselves; NaN for an interval of one subject, and where
          nobody differs from the others of its group though the groups differ.
        - ``p``: of Welch's test that congruency is 0; NaN for savings.
    """
    tests = scores_by_condition(trials[trials["condition"].isin(TRANSFERS)])
    first_visits = trials[(trials["loop"] == 1) & (trials["trial"] == 1)]
    in_phase = first_visits["phase"] == np.where(
        first_visits["condition"].isin(TRANSFERS), "test", "train"
    )
    firsts = _by_condition(first_visits[in_phase])
    rows: list[tuple[object, ...]] = []
    for group in trials.groupby(["learner", "protocol"], observed=True).groups:
        for score, condition, other in _COMPARED:
            held = (tests if score == CONGRUENCY else firsts).get(group, {})
            if condition not in held or other not in held:
                continue
            one, two = held[condition], held[other]
            function, groups = (
                (congruency, (one, two)) if score == CONGRUENCY else (savings, (two, one))
            )
            ends = bootstrap_interval(function, groups, np.random.default_rng(SEED))
            means = (float(one.mean()), float(two.mean()), float(function(*groups)))
            if means[2] and ends[0] == ends[1]:
                ends = np.array(np.nan), np.array(np.nan)
            tested = weighted_difference([Group.of(1, one), Group.of(-1, two)])
            p = tested.p if score == CONGRUENCY else np.nan
            rows.append((*group, score, condition, len(one), *means, *ends, p))
    return pd.DataFrame(rows, columns=SCORE_COLUMNS)


def published_transfer_scores(name: str, means: pd.DataFrame) -> pd.DataFrame:
    """The same of published means.

    Args:
        name: What to call them.
        means: As :func:`~causal_openlock.analysis.results.people.published.people` has them.

    Returns:
        As :func:`transfer_scores`; the intervals follow from the error bars, as if means were
        distributed normally.
    """
    from scipy.stats import norm

    first = means[means["trial"] == 1].set_index("condition")
    z = float(norm.isf((1 - LEVEL) / 2))
    se = first["se"] * np.sqrt(first["subjects"] / (first["subjects"] - 1))
    rows: list[tuple[object, ...]] = []
    for score, condition, other in _COMPARED:
        one, two = first["mean"][condition], first["mean"][other]
        if score == CONGRUENCY:
            value, error = one - two, np.hypot(se[condition], se[other])
        else:  # the error of a ratio, to first order
            value = 1 - one / two
            error = np.hypot(se[condition] / two, one * se[other] / two**2)
        size = int(first["subjects"][condition])
        low, high = value - z * error, value + z * error
        rows.append((name, "human", score, condition, size, one, two, value, low, high, np.nan))
    return pd.DataFrame(rows, columns=SCORE_COLUMNS)


def scores_of(results: Material) -> dict[str, pd.DataFrame]:
    """The scores of conditions that are the paper's, by protocol.

    Published results come first, where they compare (:data:`PEOPLE`, :data:`MODEL`).
    """
    trials = results.trials
    rooms = paper_conditions(results.experiment)
    if rooms is not None:
        trials = trials[trials["condition"].isin(list(rooms))]
    own = transfer_scores(trials)
    found = {
        protocol: own[own["protocol"] == protocol]
        for protocol in ordered(own["protocol"], (HUMAN_PROTOCOL,))
    }
    beside = did_what_people_did(trials, results.like_people) & trials["condition"].isin(TRANSFERS)
    if beside.any() and HUMAN_PROTOCOL in found:
        published = [
            published_transfer_scores(PEOPLE, people()),
            published_transfer_scores(MODEL, model()),
        ]
        found[HUMAN_PROTOCOL] = pd.concat([*published, found[HUMAN_PROTOCOL]], ignore_index=True)
    return found


def _by_condition(trials: pd.DataFrame) -> dict[tuple[str, str], dict[str, FloatArray]]:
    held: dict[tuple[str, str], dict[str, FloatArray]] = {}
    for key, rows in by_subject(trials, []).groupby(CELL, observed=True, sort=True):
        learner, condition, protocol = map(str, key)
        held.setdefault((learner, protocol), {})[condition] = rows["attempts"].to_numpy(float)
    return held

"""Which theories can be told apart, and in which conditions for the least of a person's time?

A simulated subject, or a group of subjects in one condition, is attributed to the theory under
which what it did is likeliest. How often that is the theory that made it is the diagonal of a
confusion matrix; theories that are confused here cannot be distinguished in people either.

How much a subject's actions tell about its theory is their mutual information. Whatever
probabilities q somebody gives to M theories once a subject's actions are seen, the mean of log2 M +
log2 q(the theory that made it) is at most this information (Barber & Agakov 2003; Foster et al.
2019), so what is computed is a lower bound, and few draws of parameters make it lower. A person's
time is their attempts, at the pace of the people of the paper. Conditions are ranked by information
a minute.

Subjects are always a table of :func:`~causal_openlock.design.apart.told_apart`.
"""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from causal_openlock.design.apart import NATS
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.scoring.scores import LN2
from causal_openlock.world import facts
from causal_openlock.world.randomness import generators

DOUBT = 0.02  #: probability that no estimate is right; it is shared among the theories
CERTAIN = 0.95  #: probability of a theory from which on a subject seems to follow it for certain
FEWEST_OWN = 20  #: fewer subjects of a theory do not show how badly it predicts its own
GROUPS = 200
"""Groups that are drawn, with replacement, from the subjects of a theory in a condition."""
SIZES = (1, 2, 5, 10, 20, 40, 80, 160)  #: subjects in a group


def attributed(nats: FloatArray) -> FloatArray:
    """``[N, M]`` what of each row is attributed to each column: to the greatest; ties are shared.

    >>> attributed(np.array([[1.0, 2.0], [3.0, 3.0]])).tolist()
    [[0.0, 1.0], [0.5, 0.5]]
    """
    best = nats >= nats.max(axis=1, keepdims=True) - 1e-9
    shares: FloatArray = best / best.sum(axis=1, keepdims=True)
    return shares


def _nats(subjects: pd.DataFrame) -> pd.DataFrame:
    """Log-likelihoods of subjects under each theory, by its name."""
    nats = subjects.filter(regex=f"^{NATS}")
    return nats.rename(columns=lambda name: name.removeprefix(NATS))


def by_size(subjects: pd.DataFrame, seed: int = 0) -> pd.DataFrame:
    """How often groups of any size are attributed to each theory.

    Groups are drawn; those of one are each subject once.

    Returns:
        A row for each ``learner`` that made subjects, ``condition`` and number of ``subjects`` in a
        group, and a column for each theory: the share of groups that are attributed to it.
    """
    rows, by = [], ["learner", "condition"]
    for (maker, condition), own in subjects.groupby(by, observed=True):
        nats = _nats(own).to_numpy(float)
        (generator,) = generators(seed, f"groups/{maker}/{condition}", [1])
        for size in sorted({min(size, len(nats)) for size in (*SIZES, len(nats))}):
            groups = nats
            if size > 1:
                groups = nats[generator.integers(len(nats), size=(GROUPS, size))].sum(axis=1)
            rows.append([maker, condition, size, *attributed(groups).mean(axis=0)])
    return pd.DataFrame(rows, columns=[*by, "subjects", *_nats(subjects)])


def confusion(sizes: pd.DataFrame, of_groups: bool = False) -> pd.DataFrame:
    """Confusion of theories: rows made subjects, columns are what they are attributed to.

    The shares, to which each condition contributes alike, are of single subjects or of groups as
    large as there are subjects in a condition, from :func:`by_size`.
    """
    names = list(sizes.columns[3:])
    largest = sizes.groupby(["learner", "condition"], observed=True)["subjects"].transform("max")
    table = sizes[sizes["subjects"] == (largest if of_groups else 1)]
    sums = table.groupby("learner", observed=True)[names].sum().reindex(names)
    return sums.div(sums.sum(axis=1), axis=0)


def bits(subjects: pd.DataFrame) -> pd.DataFrame:
    """Bits per action of subjects (rows) as each theory (columns) predicts them.

    The diagonal is the ceiling: no theory predicts subjects better than the one that made them.
    """
    sums = subjects.groupby("learner", observed=True, sort=False).sum(numeric_only=True)
    return -_nats(sums).div(sums["actions"], axis=0) / LN2


def minutes_an_attempt() -> float:
    """Minutes that an attempt took the people of the paper, in the baseline.

    >>> round(minutes_an_attempt(), 2)
    0.28
    """
    people = facts.results()["cogsci2018"]["human"]
    attempts = [sum(points["mean"]) for points in people["baseline"].values()]
    return float(people["minutes"]["baseline"] / np.mean(attempts))


def most_bits(theories: int) -> float:
    """The most that one subject can be found to tell about which of some theories made it.

    >>> 1.9 < most_bits(4) < 2
    True
    """
    return math.log2(theories * (1 - DOUBT) + DOUBT)


def informed(subjects: pd.DataFrame) -> pd.DataFrame:
    """Add to subjects how much their actions tell about the theory that made them.

    Returns:
        The subjects with six columns more: ``information``, in bits, whose mean is at most the
        mutual information; ``single``, 1 if the theory that made a subject is the likeliest, else 0
        (or its share of several that are); ``minutes``, as long as people would take;
        ``per_minute``, information divided by the mean minutes of all subjects of its condition;
        ``certain``, 1 if a theory's probability is at least :data:`CERTAIN`; and ``unlike``, 1 if
        the likeliest theory predicts this subject worse, per action, than 95% of its own. Subjects
        that no theory made have no ``information``, ``per_minute`` and ``single``, and they alone
        have ``unlike``, if that theory made :data:`FEWEST_OWN` subjects.
    """
    names, nats = [*_nats(subjects)], _nats(subjects).to_numpy(float)
    likely = np.exp(nats - nats.max(axis=1, keepdims=True))
    likely = (1 - DOUBT) * likely / likely.sum(axis=1, keepdims=True) + DOUBT / len(names)
    made_by, rows = pd.Index(names).get_indexer(subjects["learner"]), np.arange(len(subjects))
    of_theory = made_by >= 0
    minutes = subjects["attempts"] * minutes_an_attempt()
    information = np.where(of_theory, np.log2(len(names) * likely[rows, made_by]), np.nan)
    mean = minutes.where(of_theory).groupby(subjects["condition"]).transform("mean")
    surprise = -nats / subjects[["actions"]].to_numpy(float)
    own = [surprise[made_by == place, place] for place in range(len(names))]
    # What 95% of a theory's own subjects do not exceed.
    usual = [np.quantile(one, 0.95) if len(one) >= FEWEST_OWN else np.nan for one in own]
    taken_for = likely.argmax(axis=1)
    limit = np.array(usual)[taken_for]
    return subjects.assign(
        information=information,
        single=np.where(of_theory, attributed(nats)[rows, made_by], np.nan),
        minutes=minutes,
        certain=(likely.max(axis=1) >= CERTAIN).astype(float),
        per_minute=information / mean,
        unlike=np.where(of_theory | np.isnan(limit), np.nan, surprise[rows, taken_for] > limit),
    )


def ranked(subjects: pd.DataFrame) -> pd.DataFrame:
    """Conditions, the one that tells most a minute first.

    Returns:
        A row for each ``condition``: number of ``subjects``; the mean ``information``, in bits, and
        its standard error ``se`` (NaN if a theory made one subject); the share ``single`` of
        subjects that are attributed right; the mean ``minutes``; and information ``per_minute``.
        Theories count alike.
    """
    made_by_theories = informed(subjects).dropna(subset="information")
    theories = made_by_theories.groupby(["condition", "learner"], sort=False)
    means = theories[["information", "single", "minutes"]].mean()
    by_condition = means.groupby("condition", sort=False)
    table = by_condition.mean()
    table["per_minute"] = table["information"] / table["minutes"]
    # Of a mean over theories, from each theory's own.
    squares = (theories["information"].sem() ** 2).groupby("condition", sort=False)
    table.insert(0, "subjects", made_by_theories.groupby("condition", sort=False).size())
    table.insert(2, "se", np.sqrt(squares.mean() / squares.size()))
    return table.sort_values("per_minute", ascending=False, kind="stable").reset_index()

"""Learning under protocols with many attempts, and verdicts on it by a rule that can be checked.

Under such protocols a trial does not end when it is solved, so "attempts to solve" says little;
what says much is how often attempts open the door, and in how many visits every solution was found.
A subject's visits to rooms are cut, in the order of time, into a few equal parts, and each part has
these two shares: one number for each subject, so that intervals are over subjects.

The rule (:func:`judge`) compares these shares with chance and with the subject's own start, and
allows for how much subjects differ. Chance is the share that random actions reach, computed exactly
from the room; where such a learner is in the record, also what it did, its luck included.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import Group, weighted_difference
from causal_openlock.analysis.measures import CELL, START, SUBJECT, at_places
from causal_openlock.analysis.results.chance import chance_of_finding_all, chance_of_opening
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.statistics import (
    LEAST_UNITS,
    LEVEL,
    share_interval,
    student,
)
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Section, Topic
from causal_openlock.experiment.declare import Experiment
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.world.room import positions_for

GROUP = ["learner", "protocol", "condition"]  #: columns of subjects that are judged together
PARTS = 5  #: into how many parts a phase is cut: the paper's Figure 6 has five blocks
OPENS, FINDS_ALL, ELSE = "opens", "finds_all", "else"
"""Measures of a part: the shares of attempts that open the door, of visits in which every
solution is found, and of attempts that neither unlock nor open the door."""

UNLOCKS, FOUND = "unlocks", "found"
"""Also measured: the share of attempts that unlock the door and do not open it, and how many of a
room's solutions are found in a visit, as a share."""

LEARNS = "learns"
FALLS = "rises, then falls"
FLAT = "above chance, no rise"
SOME = "some subjects learn"
NOT = "does not learn"
UNDECIDED = "undecided"
VERDICTS = (LEARNS, FALLS, FLAT, SOME, NOT, UNDECIDED)

SURE_OF_SUBJECT = 0.01  #: how likely any subject of a group at chance may be taken to learn
MARGIN = 0.1  #: the smallest share beyond chance that matters: less is not learning


def shares(trials: pd.DataFrame, parts: int = PARTS) -> pd.DataFrame:
    """The shares of every subject in each part of a phase.

    A subject's visits in a phase are cut into ``parts`` shares that are equal up to one visit; a
    phase of fewer visits has a part for each.

    Returns:
        One row for each subject, phase and part (from 1): the columns of a cell and of a subject,
        ``phase``, ``part``, ``visits``, ``attempts`` and the shares :data:`OPENS`,
        :data:`FINDS_ALL`, :data:`ELSE`, :data:`UNLOCKS` and :data:`FOUND`.
    """
    by = [*CELL, "phase", *SUBJECT]
    whole = trials.groupby(by, sort=False, observed=True)
    number, total = whole.cumcount(), whole["trial"].transform("size")
    tally = trials.assign(
        part=number * np.minimum(parts, total) // total + 1,
        visits=1,
        attempts=trials["last_attempt"],
        opened=trials[["open1", "open2", "open3"]].sum(axis=1),
        found=trials["solutions_found"] / trials["solutions"],
    )
    added = tally.groupby([*by, "part"], sort=True, observed=True)
    sums = added[["visits", "attempts", "opened", "solved", "neither", "unlock", FOUND]].sum()
    sums[OPENS] = sums.pop("opened") / sums["attempts"]
    sums[ELSE] = sums.pop("neither") / sums["attempts"]
    sums[FINDS_ALL] = sums.pop("solved") / sums["visits"]
    sums[UNLOCKS] = sums.pop("unlock") / sums["attempts"]
    sums[FOUND] /= sums["visits"]
    return sums.reset_index()


def starts(trials: pd.DataFrame) -> pd.DataFrame:
    """Measures of every subject at the start of training.

    Returns:
        One row for each subject: the columns of a cell and of a subject, ``opens``, at the
        :data:`~causal_openlock.analysis.measures.START` of its first visit, and ``finds_all``, 0 or
        1, in that visit.
    """
    by = [*CELL, *SUBJECT]
    first = trials[trials["phase"] == "train"].groupby(by, sort=False, observed=True).head(1)
    opened = first["opened_at_start"] / np.maximum(first["last_attempt"] // START, 1)
    return first[by].assign(**{OPENS: opened, FINDS_ALL: first["solved"].astype(float)})


def matrix(rows: pd.DataFrame, measure: str) -> FloatArray:
    """``[n, P]`` a measure of n subjects in each of the parts that all of them have."""
    values, _ = at_places(rows, ["part"], measure)
    return values[:, ~np.isnan(values).any(axis=0)]


def interval(values: FloatArray, level: float = LEVEL) -> tuple[float, float]:
    """Student's bounds of the mean of ``[n]`` subjects for a verdict, also where all are equal."""
    low, high = student(len(values), values.mean(), values.var(ddof=1), 0, level)
    return float(low), float(high)


def going_on(trials: pd.DataFrame, experiment: Experiment) -> pd.DataFrame:
    """The trials under protocols that continue after a trial is solved."""
    stops = {one.name for one in experiment.protocols if one.stop_when_solved}
    return trials[trials["protocol"].isin({one.name for one in experiment.protocols} - stops)]


def judge(
    start: FloatArray, parts: FloatArray, bar: float, counted: FloatArray | None = None
) -> str:
    """Whether subjects learn, by the rule that the section states.

    Args:
        start: ``[n]`` each subject's share at its start.
        parts: ``[n, P]`` its shares in successive parts of its training.
        bar: The share that chance reaches.
        counted: ``[n]`` of how many attempts, or visits, its share in the last part is; by default
            single subjects are not looked at.

    Returns:
        One of :data:`VERDICTS`.
    """
    subjects, number = parts.shape
    if subjects < LEAST_UNITS or not number:
        return UNDECIDED
    strict = 1 - (1 - LEVEL) / number
    means = parts.mean(axis=0)
    above = [interval(part, strict)[0] > bar for part in parts.T]
    learned = [
        over and mean >= 2 * start.mean() and interval(part - start, strict)[0] > 0
        for over, mean, part in zip(above, means, parts.T, strict=True)
    ]
    if not any(learned):
        if any(above):
            return FLAT
        if counted is not None and _any_able(parts[:, -1], bar, counted):
            return SOME
        # That nothing was found is no sign that there is nothing.
        return NOT if interval(parts[:, -1])[1] < bar + MARGIN else UNDECIDED
    peak = int(np.argmax(np.where(learned, means, -1.0)))
    halved = means[-1] <= means[peak] / 2
    if halved and interval(parts[:, -1] - parts[:, peak])[1] < 0:
        return FALLS
    return LEARNS if learned[-1] else UNDECIDED


def _any_able(share: FloatArray, bar: float, counted: FloatArray) -> bool:
    """Whether some subject is surely above chance; each draw of a random learner is a new one."""
    from scipy.stats import binom

    luck = binom.sf(np.rint(share * counted) - 1, counted, bar)
    return bar > 0 and bool((luck < SURE_OF_SUBJECT / len(share)).any())


def progress(trials: pd.DataFrame, experiment: Experiment) -> pd.DataFrame:
    """How far each learner came in training, under protocols with many attempts.

    Returns:
        Two rows for each learner, condition and protocol, one for each ``measure`` (``opens``,
        ``finds_all``), with the ``verdict``; the mean shares at the ``start``, in the ``first``
        part, the ``best`` and the ``last``, with the last one's 95% interval ``ci_low``,
        ``ci_high``; ``chance``, exact; ``random``, the share of the random learner (NaN without
        one); ``subjects``; and ``visits``, how many trials each of them trained in. The random
        learner itself is judged against exact chance alone.
    """
    visited = going_on(trials, experiment)
    visited = visited[visited["phase"] == "train"]
    if visited.empty:
        return pd.DataFrame(columns=_COLUMNS)
    table, by_chance = shares(visited), experiment.random_learners
    lucky = _luck(table[table["learner"].isin(by_chance)])
    began = dict(iter(starts(visited).groupby(GROUP, observed=True)))
    rooms = dict(iter(visited.groupby(GROUP, observed=True)))
    rows = []
    for group, parts in table.groupby(GROUP, observed=True):
        learner, protocol, condition = map(str, group)
        first = began[group].sort_values(SUBJECT)
        for measure in (OPENS, FINDS_ALL):
            share = matrix(parts, measure)
            counted = matrix(parts, "attempts" if measure == OPENS else "visits")[:, -1]
            means = share.mean(axis=0)
            _, low, high, _ = weighted_difference([Group.of(share[:, -1])])
            if np.isnan(low):  # where nearly all subjects are alike
                low, high = map(float, share_interval(means[-1], len(share)))
            exact = _chance(experiment, condition, protocol, rooms[group], measure)
            random, most = lucky.get((protocol, condition, measure), (np.nan, np.nan))
            bar = np.nanmax([0.0, exact, np.nan if learner in by_chance else most])
            verdict = judge(first[measure].to_numpy(float), share, float(bar), counted)
            at = (first[measure].mean(), means[0], means.max(), means[-1], low, high)
            size = (len(share), len(rooms[group]) / len(share))
            about = (learner, condition, protocol, verdict)
            rows.append((*about, *at, exact, random, *size, measure))
    return pd.DataFrame(rows, columns=_COLUMNS)


_SHARES = ["start", "first", "best", "last", "ci_low", "ci_high", "chance", "random"]
_COLUMNS = [
    *("learner", "condition", "protocol", "verdict"),
    *(*_SHARES, "subjects", "visits", "measure"),
]


def _luck(table: pd.DataFrame) -> dict[tuple[str, str, str], tuple[float, float]]:
    """Shares of random learners over all of training, and the upper ends of their intervals."""
    luck = {}
    for (_, protocol, condition), rows in table.groupby(GROUP, observed=True):
        for measure in (OPENS, FINDS_ALL):
            each = matrix(rows, measure).mean(axis=1)
            luck[protocol, condition, measure] = each.mean(), interval(each)[1]
    return luck


def _chance(
    experiment: Experiment, condition: str, protocol: str, rows: pd.DataFrame, measure: str
) -> float:
    """Mean share that random actions reach in these visits."""
    played = next(one for one in experiment.protocols if one.name == protocol)
    declared = next(one for one in experiment.conditions if one.name == condition)
    schemas = {schema.name: schema for schema in declared.schemas}
    positions = max(map(positions_for, schemas.values()))
    chances, weights = [], []
    for (name, attempts), visits in rows.groupby(["schema", "last_attempt"], observed=True):
        schema, actions = schemas[name], played.actions_for(schemas[name])
        if measure == OPENS:
            chances.append(chance_of_opening(schema, actions, positions))
            weights.append(len(visits) * attempts)
        else:
            chances.append(chance_of_finding_all(schema, actions, positions, int(attempts)))
            weights.append(len(visits))
    return float(np.average(chances, weights=weights))


def section(material: Material) -> Section | None:
    """Section on who learns: a table and its reading; None if no protocol has many attempts."""
    table = progress(material.trials, material.experiment)
    if table.empty:
        return None
    doors, alls = table[table["measure"] == OPENS], table[table["measure"] == FINDS_ALL]
    text = (
        f"Opening the door. {verdicts(doors)}",
        f"Finding every solution within a visit. {verdicts(alls)}",
        "A learner's training is cut into five parts of equally many visits. It counts as above "
        "chance in a part if the whole interval over subjects lies above chance. It counts as "
        "risen there if the mean share is at least twice that at the start, and the whole interval "
        "of the subjects' gains on their own starts lies above zero; the start is the first tenth "
        "of the attempts of the first visit (for finding every solution: the first visit). "
        "Intervals cover 95%, or, where one part of five is enough, 99%. “learns”: above chance "
        "and risen in the last part. “rises, then falls”: so in some part, and in the last at most "
        "half of the best, by an interval below zero. “above chance, no rise”: able from the "
        "start, or at no time surely twice as good. “some subjects learn”: the group is surely "
        "above chance in no part, but single subjects are in the last, by an exact binomial test "
        f"of each (p < {SURE_OF_SUBJECT} for all subjects together). “does not learn”: neither the "
        "group nor any subject is surely above chance, and the whole interval of the last part "
        f"lies less than {MARGIN} above it. “undecided”: everything else, such as risen, and in "
        f"the end neither surely above chance nor surely fallen; or fewer than {LEAST_UNITS} "
        "subjects. These verdicts follow from intervals, each by itself: they are not corrected "
        "for their number.",
    )
    tables = (
        _shown(
            "learning_door", "Which learners learn to open the door",
            "Share of attempts that open it.", doors,
        ),
        _shown(
            "learning_all", "Which learners learn to find every solution",
            "Share of visits in which every solution is found.", alls,
        ),
    )  # fmt: skip
    return Section("learning", "Which learners learn", text, tables)


def _shown(name: str, title: str, share: str, rows: pd.DataFrame) -> Table:
    frame = rows.drop(columns="measure").dropna(axis="columns", how="all").reset_index(drop=True)
    if frame["protocol"].nunique() == 1:
        frame = frame.drop(columns="protocol")
    formats = {**dict.fromkeys(_SHARES, ".2%"), "chance": ".4%", "visits": ".0f"}
    caption = (
        f"{share} Means over subjects: at the start, in the first, the best and the last of "
        f"{PARTS} parts of training, with the 95% interval of the last. chance: of random actions, "
        "exactly; random: of the random learner. visits: trials to train on."
    )
    return Table(name, title, frame, formats, caption)


def verdicts(rows: pd.DataFrame) -> str:
    """Learners and conditions of each verdict, by one measure of :func:`progress`, in words."""
    several = rows["protocol"].nunique() > 1
    learner = rows["learner"] + (" under " + rows["protocol"] if several else "")
    of = rows["condition"].groupby([rows["verdict"], learner], sort=False).agg(", ".join)
    each = [
        (verdict, "; ".join(f"{name} ({where})" for name, where in of[verdict].items()))
        for verdict in VERDICTS
        if verdict in of
    ]
    return " ".join(f"{verdict.capitalize()}: {who}." for verdict, who in each)


TOPIC = Topic("learning", 100, section)

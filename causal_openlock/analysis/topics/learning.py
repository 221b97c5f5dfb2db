"""Verdicts on whether learners learn, by a rule that is stated and can be checked.

A learner's visits to train on are cut into five parts. In each of them every subject has a share of
attempts that open the door, and a share of visits in which it found every solution. The rule
(:func:`judge`) compares these shares with chance and with the subject's own start, and allows for
how much subjects differ. Chance is the share that random actions reach, computed exactly from the
room; where such a learner is in the record, also what it did, its luck included.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import SUBJECT
from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.results.chance import chance_of_finding_all, chance_of_opening
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.visits import (
    FINDS_ALL,
    LEAST_SUBJECTS,
    OPENS,
    PARTS,
    Group,
    each_group,
    going_on,
    interval,
    matrix,
    shares,
    starts,
)
from causal_openlock.analysis.section import Section
from causal_openlock.analysis.statistics import LEVEL, mean_interval, share_interval
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Topic
from causal_openlock.experiment.declare import Experiment, default_action_limit
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.world.room import positions_for

LEARNS = "learns"
FALLS = "rises, then falls"
FLAT = "above chance, no rise"
SOME = "some subjects learn"
NOT = "does not learn"
UNDECIDED = "undecided"
VERDICTS = (LEARNS, FALLS, FLAT, SOME, NOT, UNDECIDED)

SURE_OF_SUBJECT = 0.01
"""How likely it may be that any subject of a group at chance is taken for one that learns."""

MARGIN = 0.1
"""The smallest share beyond chance that matters: surely less than this is not learning."""

MANY_CONDITIONS = 3
"""Number of conditions from which those of a learner are not named one by one."""

_PROSE = Prose(__name__)


def judge(
    start: FloatArray, parts: FloatArray, bar: float, counted: FloatArray | None = None
) -> str:
    """Whether subjects learn, by the rule that the section states (``templates/learning.txt.j2``).

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
    if subjects < LEAST_SUBJECTS or not number:
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
        ``finds_all``), with ``subjects``; ``visits``, how many trials each of them trained in; the
        mean shares at the ``start``, in the ``first`` part, the ``peak`` (the best part) and the
        ``last``, with the last one's 95% interval ``ci_low``, ``ci_high``; ``chance``, exact;
        ``random``, the share of the random learner (NaN without one); and the ``verdict``. The
        random learner itself is judged against exact chance alone.
    """
    visited = going_on(trials, experiment)
    visited = visited[visited["phase"] == "train"]
    if visited.empty:
        return pd.DataFrame(columns=_COLUMNS)
    table = shares(visited)
    each, began = dict(each_group(table)), dict(each_group(starts(visited)))
    by_chance = experiment.random_learners
    lucky = _luck(table, by_chance)
    found = []
    for group, rows in each_group(visited):
        parts = each[group]
        first = began[group].sort_values(SUBJECT)
        for measure in (OPENS, FINDS_ALL):
            share = matrix(parts, measure)
            counted = matrix(parts, "attempts" if measure == OPENS else "visits")[:, -1]
            means = share.mean(axis=0)
            low, high = mean_interval(share[:, -1])
            if np.isnan(low):  # where nearly all subjects are alike
                low, high = map(float, share_interval(share[:, -1].mean(), len(share)))
            exact = _chance(experiment, group, rows, measure)
            random, most = lucky.get((group.condition, group.protocol, measure), (np.nan, np.nan))
            own = group.learner in by_chance
            bar = np.nanmax([0.0, exact, np.nan if own else most])
            verdict = judge(first[measure].to_numpy(float), share, float(bar), counted)
            at = (first[measure].mean(), means[0], means.max(), means[-1])
            size = (len(share), len(rows) / len(share))
            found.append((*group, measure, *size, *at, low, high, exact, random, verdict))
    return pd.DataFrame(found, columns=_COLUMNS)


_COLUMNS = [
    *(*Group._fields, "measure", "subjects", "visits"),
    *("start", "first", "peak", "last", "ci_low", "ci_high", "chance", "random", "verdict"),
]


def _luck(
    table: pd.DataFrame, by_chance: set[str]
) -> dict[tuple[str, str, str], tuple[float, float]]:
    """The random learner's share over all of training, and the upper end of its interval."""
    rows = table[table["learner"].isin(by_chance)]
    luck = {}
    for group, mine in each_group(rows):
        for measure in (OPENS, FINDS_ALL):
            each = matrix(mine, measure).mean(axis=1)
            luck[group.condition, group.protocol, measure] = (each.mean(), interval(each)[1])
    return luck


def _chance(experiment: Experiment, group: Group, rows: pd.DataFrame, measure: str) -> float:
    """Mean share that random actions reach in these visits."""
    limits = {one.name: one.action_limit for one in experiment.protocols}
    (known,) = (
        {schema.name: schema for schema in condition.schemas}
        for condition in experiment.conditions
        if condition.name == group.condition
    )
    positions = max(map(positions_for, known.values()))
    chances, weights = [], []
    rooms = rows.groupby(["schema", "last_attempt"], observed=True).size()
    for (name, attempts), visited in rooms.items():
        schema = known[name]
        limit = limits[group.protocol] or default_action_limit(schema)
        if measure == OPENS:
            chances.append(chance_of_opening(schema, limit, positions))
            weights.append(visited * attempts)
        else:
            chances.append(chance_of_finding_all(schema, limit, positions, int(attempts)))
            weights.append(visited)
    return float(np.average(chances, weights=weights))


def section(material: Material) -> Section | None:
    """Section on who learns: a table and its reading; None if no protocol has many attempts."""
    table = progress(material.trials, material.experiment)
    if table.empty:
        return None
    doors, alls = table[table["measure"] == OPENS], table[table["measure"] == FINDS_ALL]
    return _PROSE.section(
        "learning",
        [_shown("learning_door", doors), _shown("learning_all", alls)],
        doors=by_verdict(doors),
        alls=by_verdict(alls),
        least=LEAST_SUBJECTS,
        margin=MARGIN,
        sure=SURE_OF_SUBJECT,
    )


def _shown(name: str, rows: pd.DataFrame) -> Table:
    first = ["learner", "condition", "protocol", "verdict"]
    last = ["subjects", "visits"]
    shares_of = [name for name in rows if name not in (*first, *last, "measure")]
    # What it is about stands first: a page may be too narrow for all of it.
    frame = rows[[*first, *shares_of, *last]].dropna(axis="columns", how="all")
    if frame["protocol"].nunique() == 1:
        frame = frame.drop(columns="protocol")
    frame = frame.rename(columns={"peak": "best"}).reset_index(drop=True)
    formats = {**dict.fromkeys((*shares_of, "best"), ".2%"), "chance": ".4%", "visits": ".0f"}
    return _PROSE.table(name, frame, formats, parts=PARTS)


def by_verdict(rows: pd.DataFrame) -> dict[str, list[dict[str, Any]]]:
    """Learners and conditions of each verdict, by one measure of :func:`progress`.

    Returns:
        By verdict, in the order of :data:`VERDICTS`: ``learner``, ``protocol`` (empty if it has
        only one) and ``conditions`` (none if it is every one of many).
    """
    found: dict[str, list[dict[str, Any]]] = {verdict: [] for verdict in VERDICTS}
    for learner, own in rows.groupby("learner", sort=False):
        several = own["protocol"].nunique() > 1
        for protocol, part in own.groupby("protocol", sort=False):
            for verdict, mine in part.groupby("verdict")["condition"]:
                every = len(mine) == len(part) >= MANY_CONDITIONS
                found[str(verdict)].append(
                    {
                        "learner": learner,
                        "protocol": protocol if several else "",
                        "conditions": [] if every else list(mine),
                    }
                )
    return {verdict: groups for verdict, groups in found.items() if groups}


TOPIC = Topic("learning", 100, section)

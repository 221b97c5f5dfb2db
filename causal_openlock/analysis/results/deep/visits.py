"""What came of each visit to a room, and how that changed over the course of a phase.

Under protocols with many attempts a trial does not end when it is solved, so "attempts to solve"
says little; what says much is how often attempts open the door and in how many visits every
solution was found. Both are shares of a subject: here its visits are cut, in the order of time,
into a few equal parts, and every part has its shares. Whatever is said of a group of subjects comes
from these numbers, one subject one number, so that intervals are over subjects.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import CELL, SUBJECT, VISIT, ordered
from causal_openlock.analysis.results.people.comparable import HUMAN_PROTOCOL
from causal_openlock.analysis.statistics import LEVEL, SEED, mean_interval
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.record import CATEGORIES
from causal_openlock.world.fsm import FloatArray

if TYPE_CHECKING:
    import pyarrow as pa

PARTS = 5
"""Into how many parts a phase is cut: the paper's Figure 6 has five blocks."""

OPENS, FINDS_ALL, ELSE = "opens", "finds_all", "else"
SHARES = {
    OPENS: "share of attempts that open the door",
    FINDS_ALL: "share of visits in which every solution is found",
    ELSE: "share of attempts that neither unlock nor open the door",
}
"""What is measured of a part, by the name of its column."""

START = 10
"""A subject's start is the first attempts of its first visit, one in so many of them."""

LEAST_SUBJECTS = 4
"""Of fewer subjects the bootstrap interval is no more than from the lowest to the highest."""


class Group(NamedTuple):
    """Subjects that are compared: a learner in a condition under a protocol."""

    learner: str
    condition: str
    protocol: str


def visits(record: pa.Table) -> pd.DataFrame:
    """Count what came of every visit.

    Args:
        record: Columns as in :func:`causal_openlock.experiment.record.record_schema`, rows in any
            order.

    Returns:
        One row for each trial that a subject visited, each subject's in the order of time:
        ``learner``, ``condition``, ``protocol``, ``experiment``, ``seed``, ``subject``, ``phase``,
        ``loop``, ``trial`` and ``schema``; ``attempts``, how many were made; a column for each of
        :data:`~causal_openlock.experiment.record.CATEGORIES` with how many of them came to it; and
        ``finds_all``, whether every solution was found.
    """
    keys = [*CELL, *SUBJECT, *VISIT, "schema"]
    held = record.select([*keys, "category", "attempt", "solutions_found", "solutions"])
    grouped = held.unify_dictionaries().group_by([*keys, "category"])
    counts = grouped.aggregate(
        [("attempt", "count"), ("solutions_found", "max"), ("solutions", "max")]
    ).to_pandas()
    for name in counts.select_dtypes("category"):
        counts[name] = counts[name].astype(str).astype(object)
    each = counts.groupby(keys, sort=True)
    table = each.agg(
        attempts=("attempt_count", "sum"),
        found=("solutions_found_max", "max"),
        solutions=("solutions_max", "max"),
    ).reset_index()
    number, many = each.ngroup().to_numpy(), counts["attempt_count"].to_numpy()
    for category in CATEGORIES:
        mine = (counts["category"] == category).to_numpy()
        tally = np.bincount(number[mine], many[mine], minlength=len(table))
        table[category] = tally.astype(np.int64)
    table[FINDS_ALL] = table["found"] >= table["solutions"]
    return table.drop(columns=["found", "solutions"])


def shares(visited: pd.DataFrame, parts: int = PARTS) -> pd.DataFrame:
    """The shares of every subject in each part of a phase.

    A subject's visits in a phase are cut into ``parts`` shares that are equal up to one visit; a
    phase of fewer visits has a part for each.

    Args:
        visited: From :func:`visits`.
        parts: How many; 1 takes the whole phase.

    Returns:
        One row for each subject, phase and part (from 1): the columns of a cell and of a subject,
        ``phase``, ``part``, ``visits``, ``attempts`` and the columns of :data:`SHARES`.
    """
    by = [*CELL, "phase", *SUBJECT]
    whole = visited.groupby(by, sort=False)
    number, total = whole.cumcount(), whole["attempts"].transform("size")
    part = number * np.minimum(parts, total) // total + 1
    tally = visited.assign(
        part=part, opened=visited[["open1", "open2", "open3"]].sum(axis=1), visits=1
    )
    added = tally.groupby([*by, "part"], sort=True)[
        ["visits", "attempts", "opened", FINDS_ALL, ELSE]
    ].sum()
    table = added.reset_index()
    table[OPENS] = table["opened"] / table["attempts"]
    table[ELSE] = table[ELSE] / table["attempts"]
    table[FINDS_ALL] = table[FINDS_ALL] / table["visits"]
    return table.drop(columns="opened")


def starts(record: pa.Table, visited: pd.DataFrame) -> pd.DataFrame:
    """What every subject could do at the start: in its very first attempts, and its first visit.

    Args:
        record: As in :func:`visits`.
        visited: From there.

    Returns:
        One row for each subject: the columns of a cell and of a subject, ``opens``, in the first
        tenth of its first visit's attempts (one at least), and ``finds_all``, 0 or 1, in that
        visit.
    """
    import pyarrow.compute as pc

    by = [*CELL, *SUBJECT]
    visit = [*by, *VISIT]
    first = visited[visited["phase"] == "train"].groupby(by, sort=False).head(1)
    first = first[[*visit, "attempts", FINDS_ALL]].astype({FINDS_ALL: float})
    if first.empty:
        return first[[*by, FINDS_ALL]].assign(**{OPENS: 0.0})
    # A small part of a long record: what can be compared as numbers is, before names are.
    here = pc.and_(*(pc.less_equal(record[c], int(first[c].max())) for c in ("loop", "trial")))
    rows = record.filter(here).select([*visit, "attempt", "opened"]).to_pandas()
    for name in rows.select_dtypes("category"):
        rows[name] = rows[name].astype(str).astype(object)
    joined = rows.merge(first, on=visit)
    early = joined[joined["attempt"] <= np.maximum(joined["attempts"] // START, 1)]
    opened = early.groupby(by, sort=True)["opened"].mean().rename(OPENS).reset_index()
    return opened.merge(first[[*by, FINDS_ALL]], on=by)


def each_group(
    table: pd.DataFrame, phase: str | None = None, learners: Sequence[str] = ()
) -> Iterator[tuple[Group, pd.DataFrame]]:
    """The rows of every learner, condition and protocol, in the order of tables.

    Args:
        table: Rows with the columns of a cell, and ``phase`` if one is asked for.
        phase: Which phase to keep; by default all.
        learners: The order of learners.
    """
    kept = table if phase is None else table[table["phase"] == phase]
    found = dict(list(kept.groupby(CELL, sort=False)))
    for learner in ordered({key[0] for key in found}, learners):
        mine = [key for key in found if key[0] == learner]
        for protocol in ordered({key[2] for key in mine}, (HUMAN_PROTOCOL,)):
            for condition in ordered({key[1] for key in mine if key[2] == protocol}):
                yield Group(learner, condition, protocol), found[(learner, condition, protocol)]


def matrix(rows: pd.DataFrame, measure: str) -> FloatArray:
    """``[n, P]`` a measure of n subjects in each of the parts that all of them have."""
    wide = rows.pivot_table(index=SUBJECT, columns="part", values=measure, sort=True)
    values: FloatArray = wide.dropna(axis="columns").to_numpy(float)
    return values


def interval(values: FloatArray, level: float = LEVEL) -> tuple[float, float]:
    """Bootstrap interval of a mean over subjects; NaN for fewer than two.

    Args:
        values: ``[n]`` one for each subject.
        level: Probability that it is to cover.
    """
    low, high = mean_interval(values[None], np.random.default_rng(SEED), level=level)
    return float(low[0]), float(high[0])


def many_attempts(experiment: Experiment) -> set[str]:
    """Names of the protocols whose trials go on after they are solved."""
    stops = {one.name for one in experiment.protocols if one.stop_when_solved}
    return {one.name for one in experiment.protocols} - stops


def going_on(record: pa.Table, experiment: Experiment) -> pa.Table:
    """The part of a record whose trials go on after they are solved; see :func:`many_attempts`.

    Counting every visit of a long record costs memory, so that what nobody asks for goes first.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    names = record["protocol"].unique().to_pylist()
    kept = many_attempts(experiment)
    if kept.issuperset(names):
        return record
    wanted = pa.array(sorted(kept), pa.string())
    chunks = record["protocol"].dictionary_encode().chunks
    return record.filter(
        pa.chunked_array(
            # A name is looked up once in each chunk, and not in each row.
            [pc.is_in(part.dictionary, value_set=wanted).take(part.indices) for part in chunks]
        )
    )

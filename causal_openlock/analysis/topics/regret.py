"""Worth of attempts: regret, information, and how much was known to be useless.

Two subjects may need equally many attempts, one of them by bad luck. So every attempt is judged by
what could be known when it was made: the ideal observer is put in the subject's place, learns from
what the subject does, and says of each action what the best one would have been
(:mod:`causal_openlock.belief.observer`). The numbers are exact, and the same for people and
learners. Only what is on record is used.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import TYPE_CHECKING

import pandas as pd

from causal_openlock.analysis.measures import CELL, SUBJECT, VISIT
from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.section import Section
from causal_openlock.analysis.statistics import mean_interval
from causal_openlock.analysis.topic import Topic
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.record import played
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.room import Layout, positions_for

if TYPE_CHECKING:
    from causal_openlock.belief.observer import Observer, Worth

_TRIAL = [*CELL, *SUBJECT, *VISIT]
_ROOM = ["schema", "layout"]
WORTH = ["used", "regret", "gained", "useless"]
"""Measures of an attempt: the fields of :class:`~causal_openlock.belief.observer.Worth`."""
MOST = 400_000
"""Records of more attempts than this are not judged: it takes half a minute for each million."""
_PROSE = Prose(__name__)
_FORMATS = {
    "subjects": ",",
    **dict.fromkeys(("regret", "ci_low", "ci_high", "information"), ".2f"),
    "useless": ".0%",
}


def regret(results: Material) -> pd.DataFrame:
    """Worth of each attempt, by the ideal observer in the subject's place.

    >>> import causal_openlock as ol
    >>> table = regret(ol.compare("CC3", ["ideal", "random"], subjects=2, workers=1))
    >>> table.groupby("learner", observed=True)["regret"].max().round(6).tolist()
    [0.0, 1.0]

    Args:
        results: What was played, with the actions.

    Returns:
        A row for each attempt until everything was found, of rooms in which levers move surely and
        the exact answer is in reach: the columns of :data:`~.measures.CELL`,
        :data:`~.measures.SUBJECT` and :data:`~.measures.VISIT`, ``schema``, ``attempt``, and

        - ``used``: how many actions it had.
        - ``regret``: attempts that its choices cost on average, whatever luck there was. A trial's
          regrets, added up, are on average the attempts beyond those of the ideal observer, and, of
          a trial that was not solved, those that would still have been needed.
        - ``gained``: bits of information that were gained.
        - ``useless``: how many actions were known to be: sure to change nothing, or at a moment at
          which nothing in the rest of the attempt could help any more.
    """
    from causal_openlock.belief.placements import TooLargeError

    record = played(results.record)
    table = record.select([*_TRIAL, *_ROOM, "attempt"]).to_pandas()
    table = table.sort_values([*_TRIAL, "attempt"])
    done = record["actions"].combine_chunks()
    ends = [0, *done.value_lengths().to_numpy().cumsum().tolist()]
    every = done.flatten().to_numpy().tobytes()  # an action is a byte, an attempt a few of them
    actions = [every[ends[row] : ends[row + 1]] for row in table.index]
    table = table.reset_index(drop=True)
    observers = _observers(results)
    worth: dict[Observer, dict[int, Worth]] = {one: {} for one, _ in observers.values()}
    sizes = table.groupby([*_TRIAL, *_ROOM], observed=True, sort=False, dropna=False).size()
    for key, end, size in zip(sizes.index, sizes.cumsum(), sizes, strict=True):
        own = range(end - size, end)  # a trial's attempts follow one another
        known = observers.get((key[0], key[1], key[-2]))
        placed = known and known[1](key[-1])
        # Play that leads the observer out of reach leaves out all rooms of its schema, whose other
        # trials are no fair sample.
        if not known or placed is None or known[0] not in worth:
            continue
        try:
            worths = known[0].trial(placed, actions[own.start : own.stop])
        except TooLargeError:
            del worth[known[0]]
        else:
            worth[known[0]].update(zip(own, worths, strict=False))
    rows = {row: one for of_schema in worth.values() for row, one in of_schema.items()}
    found = pd.DataFrame([*rows.values()], columns=WORTH, index=[*rows])
    joined = table.loc[[*rows]].join(found).sort_index().reset_index(drop=True)
    learner = pd.Categorical(joined["learner"], list(results.learners))
    return joined.drop(columns="layout").assign(learner=learner)


def _observers(
    results: Material,
) -> dict[tuple[str, str, str], tuple[Observer, Callable[[str], Layout | None]]]:
    """The observer of each learner's rooms, and their layouts by name; see :func:`_placed`.

    Keys are learner, condition and schema.
    """
    from causal_openlock.belief.observer import observer_of

    found: dict[tuple[str, str, str], tuple[Observer, Callable[[str], Layout | None]]] = {}
    for spec in results.experiment.learners:
        for condition in results.experiment.conditions:
            for schema in condition.schemas:
                limit = spec.protocol.actions_for(schema)
                if (observer := observer_of(schema, limit)) is not None:
                    found[spec.name, condition.name, schema.name] = (
                        observer,
                        cache(partial(_placed, schema)),
                    )
    return found


def _placed(schema: Schema, layout: str) -> Layout | None:
    try:
        return Layout.of(schema, layout, positions_for(schema))
    except OpenLockError:  # no layout of these levers
        return None


def regret_by_condition(table: pd.DataFrame) -> pd.DataFrame:
    """Mean worth: a row for each learner under a protocol, subjects counting alike.

    Args:
        table: From :func:`regret`.

    Returns:
        ``learner``, ``protocol``, ``subjects`` of all conditions; ``regret``, the mean of a
        trial's, with its 95% interval over subjects ``ci_low`` and ``ci_high``;
        ``information``, bits that an action gained; ``useless``, the share of actions.
    """
    subject = [*CELL, *SUBJECT]
    grouped = table.groupby(subject, observed=True, sort=True)
    each = grouped[WORTH].sum()
    trials = table.groupby([*subject, *VISIT], observed=True).size()
    each["regret"] /= trials.groupby(subject, observed=True).size()
    for name in ("gained", "useless"):
        each[name] /= each["used"]
    rows = []
    for (learner, protocol), own in each.groupby(["learner", "protocol"], observed=True):
        low, high = mean_interval(own["regret"].to_numpy(float))
        means = own[["regret", "gained", "useless"]].mean()
        rows.append((learner, protocol, len(own), means.iloc[0], low, high, *means.iloc[1:]))
    columns = ["learner", "protocol", "subjects", "regret", "ci_low", "ci_high"]
    return pd.DataFrame(rows, columns=[*columns, "information", "useless"])


def section(material: Material) -> Section | None:
    """Regret, information and useless actions; None where no attempt can be judged."""
    record = material.record
    if not 0 < record.num_rows <= MOST or "actions" not in record.column_names:
        return None
    table = regret_by_condition(regret(material))
    if table.empty:
        return None
    shown = table if table["protocol"].nunique() > 1 else table.drop(columns="protocol")
    return _PROSE.section(
        "regret", [_PROSE.table("regret", shown, _FORMATS)], rows=table.to_dict("records")
    )


TOPIC = Topic("regret", 50, section)

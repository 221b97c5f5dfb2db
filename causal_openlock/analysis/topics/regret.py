"""Worth of attempts: regret, information, and how much was known to be useless.

Two subjects may need equally many attempts, one of them by bad luck. So every attempt is judged by
what could be known when it was made: the ideal observer is put in the subject's place, learns from
what the subject does, and says of each action what the best one would have been
(:mod:`causal_openlock.belief.observer`). The numbers are exact, and the same for people and
learners. Only what is on record is used.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import Group, weighted_difference
from causal_openlock.analysis.measures import CELL, SUBJECT, VISIT
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Section, Topic, of_all_conditions
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.record import played
from causal_openlock.world.room import Layout, positions_for

if TYPE_CHECKING:
    from causal_openlock.belief.observer import Observer, Worth

_TRIAL = [*CELL, *SUBJECT, *VISIT]
_ROOM = ["schema", "layout"]
WORTH = ["used", "regret", "gained", "useless"]
"""Measures of an attempt: the fields of :class:`~causal_openlock.belief.observer.Worth`."""
MOST = 400_000  #: records of more attempts are not judged: half a minute for each million


def regret(results: Material) -> pd.DataFrame:
    """Worth of each attempt, by the ideal observer in the subject's place.

    >>> import causal_openlock as ol
    >>> table = regret(ol.compare("CC3", ["ideal", "random"], subjects=2, workers=1))
    >>> table.groupby("learner", observed=True)["regret"].max().round(6).tolist()
    [0.0, 1.0]

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
    from causal_openlock.belief.observer import observer_of
    from causal_openlock.belief.placements import TooLargeError

    record = played(results.record).select([*_TRIAL, *_ROOM, "attempt", "actions"])
    table = record.drop("actions").to_pandas().assign(actions=record["actions"].to_pylist())
    table = table.sort_values([*_TRIAL, "attempt"], ignore_index=True)
    actions = table.pop("actions").tolist()
    observers = {
        (spec.name, condition.name, schema.name): observer_of(
            schema, spec.protocol.actions_for(schema)
        )
        for spec in results.experiment.learners
        for condition in results.experiment.conditions
        for schema in condition.schemas
    }
    placed = cache(lambda one, layout: Layout.of(one.schema, layout, positions_for(one.schema)))
    worths: dict[Observer, dict[int, Worth]] = {}
    out_of_reach = set()
    begins = np.flatnonzero(table["attempt"] == 1).tolist()  # of trials
    rooms = table.loc[begins, ["learner", "condition", "schema", "layout"]].itertuples(index=False)
    for begin, end, (*room, layout) in zip(begins, [*begins[1:], len(table)], rooms, strict=True):
        observer = observers.get(tuple(room))
        if observer is None or observer in out_of_reach:
            continue
        try:
            own = observer.trial(placed(observer, layout), actions[begin:end])
        except TooLargeError:
            # All rooms of the schema are left out, as its other trials are no fair sample.
            out_of_reach.add(observer)
        except OpenLockError:
            continue  # no layout of these levers
        else:
            worths.setdefault(observer, {}).update(enumerate(own, begin))
    held = [own for observer, own in worths.items() if observer not in out_of_reach]
    worth = {row: one for own in held for row, one in own.items()}
    found = pd.DataFrame([*worth.values()], columns=WORTH, index=[*worth])
    joined = table.loc[[*worth]].join(found).sort_index().reset_index(drop=True)
    learners = pd.Categorical(joined["learner"], list(results.learners))
    return joined.drop(columns="layout").assign(learner=learners)


def regret_by_condition(table: pd.DataFrame) -> pd.DataFrame:
    """Means of :func:`regret`: a row for each learner under a protocol, subjects counting alike.

    ``regret`` is the mean of a trial's, with its 95% interval ``ci_low`` to ``ci_high``;
    ``information`` the bits that an action gained, and ``useless`` the share of such actions.
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
        mean, low, high, _ = weighted_difference([Group.of(own["regret"].to_numpy(float))])
        means = own[["gained", "useless"]].mean()
        rows.append((learner, protocol, len(own), mean, low, high, *means))
    columns = ["learner", "protocol", "subjects", "regret", "ci_low", "ci_high"]
    return pd.DataFrame(rows, columns=[*columns, "information", "useless"])


def section(material: Material) -> Section | None:
    """Regret, information and useless actions; None where no attempt can be judged."""
    if not 0 < material.record.num_rows <= MOST:
        return None
    each = regret(material)
    table = regret_by_condition(each)
    if table.empty:
        return None
    told = ", ".join(f"{row.learner} {row.regret:.2f}" for row in table.itertuples())
    text = (
        "The ideal observer, who knows the schema, is put in each subject’s place: it learns from "
        "what the subject does, and says what the best choice would have been. Attempts of a trial "
        "that choices cost, beyond those that had to be made, and, of a trial that was not solved, "
        f"those that would still have been needed: {told}."
    )
    caption = (
        f"subjects: {of_all_conditions(material.trials, each)}; regret: attempts of a trial that "
        "the choices cost on average, whatever luck there was (0 for the ideal observer), with its "
        "95% interval; information: bits that an action gained; useless: share of actions that "
        "were known to be, as they were sure to change nothing, or nothing in the rest of the "
        "attempt could help any more. What is known is what follows from the schema and from what "
        "the subject itself has seen in the room; who does not know the schema knows less."
    )
    shown = table if table["protocol"].nunique() > 1 else table.drop(columns="protocol")
    title = "Regret, information and useless actions"
    values = Table("regret", title, shown, {"useless": ".0%"}, caption)
    return Section("regret", "What attempts were worth", (text,), (values,))


TOPIC = Topic("regret", 50, section)

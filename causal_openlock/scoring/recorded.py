"""Recorded subjects, who can be played again.

Rooms and their chance are drawn from the seed of the experiment, so they are those that a subject
met; where what happens is not what is on record, nobody is put in the subject's place.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from causal_openlock.errors import StoreError
from causal_openlock.experiment.condition import SHOWN
from causal_openlock.experiment.declare import Experiment, LearnerSpec
from causal_openlock.experiment.session import AT_ONCE, Session, padded
from causal_openlock.schemas.fsm import BoolArray, IntArray

GROUP = ["learner", "condition", "protocol", "experiment", "seed"]
"""Columns that identify subjects who can be replayed in one session."""
ATTEMPT = [
    *(*GROUP, "subject", "phase", "loop", "trial", "attempt", "schema", "layout"),
    *("actions", "moved", "opened"),
]
"""Columns of a record from which it is played again."""


@dataclass(frozen=True)
class Recorded:
    """Recorded subjects of one group, who can be played again in one session."""

    group: dict[str, Any]  #: what they have in common, by the names of :data:`GROUP`
    rows: pd.DataFrame  #: their attempts
    experiment: Experiment  #: the experiment that they took part in

    @cached_property
    def numbers(self) -> list[int]:
        """Numbers of the subjects."""
        return np.unique(self.rows["subject"]).tolist()

    @cached_property
    def done_actions(self) -> pd.DataFrame:
        """A row for each action, subject by subject, with the columns of a score that say which."""
        rows = self.rows.sort_values("subject", kind="stable").rename(
            columns={"actions": "action_index"}
        )
        rows["trial"] = rows["attempt"].eq(1).groupby(rows["subject"]).cumsum()
        each = rows[["subject", "phase", "trial", "attempt", "action_index"]]
        each = each.explode("action_index").dropna(subset="action_index")
        each.insert(4, "action", each.groupby(level=0).cumcount() + 1)
        return each.astype({"action_index": np.int64})

    def done(self) -> list[IntArray]:
        """``[B]`` arrays of all actions of each subject."""
        return self._by_subject(self.done_actions["action_index"])

    @cached_property
    def actions(self) -> IntArray:
        """``[B, T]`` all actions of each subject, one after the other."""
        return padded(self.done())[0]

    @cached_property
    def asked(self) -> BoolArray:
        """``[B, T]`` which actions there are that the subjects chose: none that they were shown."""
        return padded(self._by_subject(self.done_actions["phase"].ne(SHOWN)))[0].astype(bool)

    @cached_property
    def starts(self) -> BoolArray:
        """``[B, T]`` whether an action is the first one of its attempt."""
        return padded(self._by_subject(self.done_actions["action"].eq(1)))[0].astype(bool)

    def _by_subject(self, values: pd.Series[Any]) -> list[NDArray[Any]]:
        return [own.to_numpy() for _, own in values.groupby(self.done_actions["subject"])]

    def alone(self) -> dict[str, Recorded]:
        """Each subject by itself, by its name; see :func:`subject_names`."""
        return {
            subject_names(rows).iloc[0]: replace(self, rows=rows)
            for _, rows in self.rows.groupby("subject", sort=True)
        }

    def session(
        self, scored: LearnerSpec | None = None, places: Sequence[int] | None = None
    ) -> Session:
        """A session of these subjects, or of those at some places, as it began for a learner."""
        conditions = {one.name: one for one in self.experiment.conditions}
        protocols = {one.protocol.name: one.protocol for one in self.experiment.learners}
        numbers = self.numbers if places is None else [self.numbers[place] for place in places]
        given: dict[str, Any] = {}
        if scored:
            # Another label has other random numbers: a learner that predicts subjects of its own
            # knows neither how their networks began nor what they drew.
            given = {"reward": scored.reward, "learner": f"{scored.name}, predicting"}
        return Session(
            conditions[self.group["condition"]],
            protocols[self.group["protocol"]],
            numbers,
            seed=int(self.group["seed"]),
            experiment=self.group["experiment"],
            **given,
        )

    def check(self) -> None:
        """Refuse a record whose replay differs from it."""
        session = self.session()
        for acts, step in session.following(self.done()):
            if not step.view.playing[acts].all():
                raise StoreError("the record has more actions than its protocol allows")
        places = ["subject", "phase", "loop", "trial", "attempt"]
        recorded, replayed = (
            rows.astype({"phase": str}).set_index(places)[["actions", "moved", "opened"]]
            for rows in (self.rows, session.record().to_pandas())
        )
        if not recorded.equals(replayed.reindex(recorded.index)):
            raise StoreError(
                f"what {self.group['learner']} did in {self.group['condition']} does not come out "
                "again in the rooms of its experiment, so no learner can be put in its place; was "
                "it recorded with another version?"
            )


def subject_names(table: pd.DataFrame) -> pd.Series:
    """Name of the subject of each row, unique among all subjects."""
    first, *others = (table[name].astype(str) for name in (*GROUP, "subject"))
    return first.str.cat(others, sep="/")


def record_digest(record: pa.Table, experiment: Experiment, learners: Collection[str]) -> str:
    """Return a digest of what subjects of these learners did and met; others may come and go."""
    attempts = record.select(ATTEMPT).to_pandas()
    attempts = attempts[attempts["learner"].isin(learners)]
    attempts = attempts.sort_values([*GROUP, "subject"], kind="stable")
    declared = [
        # Rooms that are on record stand in the rows of those who met them.
        *(replace(one, rooms={}).as_dict() for one in experiment.conditions),
        *(one.protocol.as_dict() for one in experiment.learners),
    ]
    met = {*attempts["condition"], *attempts["protocol"]}
    whole = hashlib.sha256(
        json.dumps([one for one in declared if one["name"] in met], sort_keys=True).encode()
    )
    actions = ["actions", "moved"]
    scalars = attempts.drop(columns=actions).assign(length=attempts["actions"].map(len))
    whole.update(pd.util.hash_pandas_object(scalars, index=False).to_numpy().tobytes())
    for name in actions:
        whole.update(b"".join(np.asarray(row, np.uint8).tobytes() for row in attempts[name]))
    return whole.hexdigest()


def recorded_subjects(
    record: pa.Table, experiment: Experiment, of: Sequence[str] = ()
) -> list[Recorded]:
    """The subjects of a record, in parts that are played again together.

    A record is as :meth:`~causal_openlock.storage.store.Store.record` gives it; with labels ``of``
    learners, only their subjects count.

    Raises:
        StoreError: If no subject has played, or what is on record cannot be played again.
    """
    attempts = record.select(ATTEMPT).to_pandas()
    attempts = attempts.astype(dict.fromkeys(["learner", "condition", "protocol", "phase"], str))
    attempts = attempts[attempts["learner"].isin(of)] if of else attempts
    if attempts.empty:
        raise StoreError("no subject of these learners has played yet; run compare to the end")
    parts = []
    for group, rows in attempts.groupby(GROUP, observed=True, sort=False):
        numbers = np.unique(rows["subject"])
        for first in range(0, len(numbers), AT_ONCE):
            own = rows[rows["subject"].isin(numbers[first : first + AT_ONCE])]
            parts.append(Recorded(dict(zip(GROUP, group, strict=True)), own, experiment))
            parts[-1].check()
    return parts

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
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from causal_openlock.errors import StoreError
from causal_openlock.experiment.declare import SHOWN, Experiment, LearnerSpec
from causal_openlock.experiment.session import AT_ONCE, Session, padded
from causal_openlock.schemas.fsm import BoolArray, IntArray
from causal_openlock.scoring.score_table import GROUP

if TYPE_CHECKING:
    import pyarrow as pa

ATTEMPT = [
    *(*GROUP, "subject", "phase", "loop", "trial", "attempt", "schema", "layout"),
    *("actions", "moved", "opened"),
]
"""Columns of a record from which it is played again."""


@dataclass(frozen=True)
class Recorded:
    """Recorded subjects of one group, who can be played again in one session.

    Attributes:
        group: What they have in common, by the names of :data:`GROUP`.
        rows: Their attempts.
        experiment: The experiment that they took part in.
    """

    group: dict[str, Any]
    rows: pd.DataFrame
    experiment: Experiment

    @cached_property
    def numbers(self) -> list[int]:
        """Numbers of the subjects."""
        return np.unique(self.rows["subject"]).tolist()

    @cached_property
    def attempts(self) -> list[list[NDArray[Any]]]:
        """Actions of each attempt, by subject, in the order of the record."""
        by_number = self.rows.groupby("subject", sort=True)["actions"]
        return [[np.asarray(one, np.int64) for one in own] for _, own in by_number]

    def done(self) -> list[IntArray]:
        """``[B]`` arrays of all actions of each subject."""
        return [np.concatenate(own) for own in self.attempts]

    @cached_property
    def actions(self) -> IntArray:
        """``[B, T]`` all actions of each subject, one after the other."""
        return padded(self.done())[0]

    @cached_property
    def asked(self) -> BoolArray:
        """``[B, T]`` which actions there are that the subjects chose: none that they were shown."""
        chose = self.rows["phase"].ne(SHOWN).groupby(self.rows["subject"], sort=True)
        _, exists = padded(self.done())
        for row, own, (_, each) in zip(exists, self.attempts, chose, strict=True):
            row[: row.sum()] = np.repeat(each.to_numpy(), [len(one) for one in own])
        return exists

    @cached_property
    def starts(self) -> BoolArray:
        """``[B, T]`` whether an action is the first one of its attempt."""
        starts = np.zeros(self.asked.shape, dtype=bool)
        for row, attempts in zip(starts, self.attempts, strict=True):
            row[np.cumsum([0, *map(len, attempts)])[:-1]] = True
        return starts

    def alone(self) -> dict[str, Recorded]:
        """Each subject by itself, by its name; see :func:`subject_names`."""
        return {
            subject_names(rows).iloc[0]: replace(self, rows=rows)
            for _, rows in self.rows.groupby("subject", sort=True)
        }

    @cached_property
    def about(self) -> dict[str, NDArray[Any]]:
        """Columns of scores that no learner changes, with a row for each action that is scored."""
        who, moment = np.nonzero(self.asked)
        trials = self.rows.sort_values("subject", kind="stable")
        trials = trials.assign(number=_trial_numbers(trials))[trials["phase"] != SHOWN]
        each = trials["actions"].map(len).to_numpy(np.int64)
        return {
            "subject": np.array(self.numbers)[who],
            "trial": np.repeat(trials["number"].to_numpy(), each),
            "attempt": np.repeat(trials["attempt"].to_numpy(), each),
            "action": np.array([place for one in each for place in range(1, one + 1)], np.int64),
            "action_index": self.actions[who, moment],
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
        again = session.record().to_pandas()
        columns = ["subject", "actions", "moved", "opened"]
        key = ["subject", "phase", "loop", "trial", "attempt"]
        both = self.rows.merge(
            again[[*key, *columns[1:]]].astype({"phase": str}), on=key, how="left"
        )
        same = len(both) == len(self.rows) and all(
            isinstance(other, np.ndarray) and np.array_equal(one, other)
            for name in ("actions", "moved")
            for one, other in zip(both[f"{name}_x"], both[f"{name}_y"], strict=True)
        )
        if not (same and (both["opened_x"] == both["opened_y"]).all()):
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
    """Return a digest of what the subjects of some learners did and met.

    Args:
        record: Attempts, as :meth:`~causal_openlock.storage.store.Store.record` gives them.
        experiment: The experiment that they are of.
        learners: Labels; subjects of others may come and go.
    """
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

    Args:
        record: Attempts, as :meth:`~causal_openlock.storage.store.Store.record` gives them.
        experiment: The experiment that they are of.
        of: Labels of the learners whose subjects are wanted; by default all.

    Raises:
        StoreError: If no subject has played, or what is on record cannot be played again.
    """
    if of:
        import pyarrow as pa
        import pyarrow.compute as pc

        record = record.filter(pc.is_in(record["learner"].cast(pa.string()), pa.array([*of])))
    attempts = record.select(ATTEMPT).to_pandas()
    attempts = attempts.astype(dict.fromkeys(["learner", "condition", "protocol", "phase"], str))
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


def _trial_numbers(rows: pd.DataFrame) -> IntArray:
    """``[N]`` the number of each attempt's trial in the whole condition, from 1."""
    first = (rows["attempt"] == 1).to_numpy()
    by_subject = pd.Series(first).groupby(rows["subject"].to_numpy())
    return by_subject.cumsum().to_numpy(np.int64)

"""A learner in a recorded subject's place: it predicts each action, and then sees what was done.

The subject's session is played again with the recorded actions. Rooms and their chance are drawn
from the seed of the experiment, so they are those that the subject met; where what happens is not
what is on record, nothing is scored. The learner learns from the subject's actions as if they were
its own, and from what the subject was shown, which is not scored. It never acts, unless it gives no
probabilities: then copies of it do (:mod:`~causal_openlock.scoring.inverse_binomial`).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from causal_openlock.contract.checks import are_probabilities, failures_of
from causal_openlock.contract.learner import InformedLearner, Learner
from causal_openlock.contract.registry import create
from causal_openlock.errors import LearnerError, StoreError
from causal_openlock.experiment.declare import SHOWN, Experiment, LearnerSpec
from causal_openlock.experiment.session import AT_ONCE, Session, padded
from causal_openlock.running.workers import worker_pool
from causal_openlock.schemas.fsm import BoolArray, IntArray
from causal_openlock.scoring.inverse_binomial import Draws, by_draws
from causal_openlock.scoring.score_table import COLUMNS, GROUP
from causal_openlock.storage.stored import StoredExperiment
from causal_openlock.wording import nearest

if TYPE_CHECKING:
    import pyarrow as pa

EXACT = Draws()
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


def score_actions(
    record: pa.Table,
    experiment: StoredExperiment,
    scored: LearnerSpec | Sequence[LearnerSpec],
    lapse: float = 0.0,
    *,
    of: Sequence[str] = (),
    draws: Draws = EXACT,
    workers: int = 1,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> pd.DataFrame:
    """Score how likely learners find each action of each subject of a record.

    Args:
        record: Attempts, as :meth:`~causal_openlock.storage.store.Store.record` gives them.
        experiment: The experiment that they are of.
        scored: The learner that predicts, or several.
        lapse: The share of a subject's actions that are taken to be random, so that one action
            that the learner would never do does not outweigh all others.
        of: Labels of the learners whose subjects are predicted; by default all.
        draws: How those are asked that give no probabilities.
        workers: How many processes work; with one it is this process.
        report: Called with how many parts of the work are done, of how many.

    Returns:
        A row for each action. ``scored`` is the learner that predicts; ``learner`` and the rest of
        :data:`GROUP` and ``subject`` say who acted; ``trial`` (in the whole condition), ``attempt``
        and ``action`` when, each from 1; ``action_index`` what. ``log_probability`` is in nats,
        with lapses, and its ``standard_error`` 0 where it is exact; ``entropy`` is that of the
        learner's own probabilities, in nats; ``highest``, the probability of the action that it
        finds likeliest (both NaN where it gives none); ``impossible``, whether it would never do
        what was done, but for lapses; ``at_limit``, whether draws stopped before it was hit, so
        that its estimate is biased; ``price``, what the subject's BIC has for parameters (here 0).

    Raises:
        LearnerError: If a learner cannot be put in another's place, or does not give
            probabilities.
        StoreError: If what is on record cannot be played again.
    """
    specs = [scored] if isinstance(scored, LearnerSpec) else list(scored)
    jobs = [(part, spec) for part in recorded_subjects(record, experiment, of) for spec in specs]
    tables = []
    for table in scored_parts(jobs, lapse, draws, workers):
        tables.append(table)
        report(len(tables), len(jobs))
    return pd.concat(tables, ignore_index=True)[[*COLUMNS]]


def scored_parts(
    jobs: Sequence[tuple[Recorded, LearnerSpec]],
    lapse: float,
    draws: Draws,
    workers: int,
) -> Iterator[pd.DataFrame]:
    """The scores of learners on parts of a record, in the order of the jobs."""
    if workers == 1:
        for part, spec in jobs:
            yield score_part(part, spec, lapse, draws)
        return
    with worker_pool(workers) as pool:
        waiting = [pool.submit(score_part, part, spec, lapse, draws) for part, spec in jobs]
        for job in waiting:
            yield job.result()


def score_part(part: Recorded, scored: LearnerSpec, lapse: float, draws: Draws) -> pd.DataFrame:
    """The scores of one learner on some subjects of a group.

    Raises:
        LearnerError: If the learner cannot be put in another's place, or fails there.
    """
    with failures_of(scored.name):
        return _scored(part, scored, lapse, draws)


def _scored(part: Recorded, scored: LearnerSpec, lapse: float, draws: Draws) -> pd.DataFrame:
    learner, session = create(scored.learner, scored.parameters), part.session(scored)
    if not learner.learns_from_others:
        raise LearnerError(
            f"{scored.name} learns from its own actions alone, so it cannot be put in the place of "
            "a subject that did others; leave it out"
        )
    session.begin(learner)
    if learner.probabilities(session.view) is None:
        drawn = by_draws(part, scored, draws, lapse, session.brief.actions)
        scores = {
            "log_probability": drawn.log_probability,
            "standard_error": np.sqrt(drawn.variance),
            **dict.fromkeys(("entropy", "highest"), np.full(part.asked.shape, np.nan)),
            "impossible": drawn.impossible,
            "at_limit": drawn.at_limit,
        }
    else:
        scores = _told(part, session, learner, scored.name, lapse)
    return pd.DataFrame(
        {
            "scored": scored.name,
            **part.group,
            **part.about,
            **{name: values[part.asked] for name, values in scores.items()},
            "price": 0.0,
        }
    )


def _trial_numbers(rows: pd.DataFrame) -> IntArray:
    """``[N]`` the number of each attempt's trial in the whole condition, from 1."""
    first = (rows["attempt"] == 1).to_numpy()
    by_subject = pd.Series(first).groupby(rows["subject"].to_numpy())
    return by_subject.cumsum().to_numpy(np.int64)


def _told(
    part: Recorded, session: Session, learner: Learner, name: str, lapse: float
) -> dict[str, NDArray[Any]]:
    """``[B, T]`` scores of a learner that gives its probabilities."""
    shape, choices = part.asked.shape, session.brief.actions
    own, entropy, highest = (np.zeros(shape) for _ in range(3))
    for moment in range(shape[1]):
        acts, action = part.asked[:, moment], part.actions[:, moment]
        found = learner.probabilities(session.view)
        if not (
            isinstance(found, np.ndarray)
            and len(found) == len(acts)
            and are_probabilities(found[acts], choices)
        ):
            raise LearnerError(
                f"the probabilities of {name} are not an array of {choices} for each subject, none "
                "below 0 and 1 in sum; its contract tests say more"
            )
        own[:, moment] = found[np.arange(len(found)), action]
        surprise = -np.log(found, where=found > 0, out=np.zeros_like(found, dtype=float))
        entropy[:, moment], highest[:, moment] = (found * surprise).sum(axis=1), found.max(axis=1)
        step = session.step(action)
        learner.learn(step)
        if isinstance(learner, InformedLearner) and step.trial_over.any():
            learner.inform(session.truth)
    with np.errstate(divide="ignore"):
        log_probability = np.log((1.0 - lapse) * own + lapse / choices)
    return {
        "log_probability": log_probability,
        "standard_error": np.zeros(shape),
        "entropy": entropy,
        "highest": highest,
        "impossible": own == 0,
        "at_limit": np.zeros(shape, dtype=bool),
    }


def known_learners(names: Sequence[str] | str, specs: Sequence[LearnerSpec]) -> list[LearnerSpec]:
    """Select learners by their labels.

    Raises:
        LearnerError: If there is none of a label.
    """
    known = {spec.name: spec for spec in specs}
    names = [names] if isinstance(names, str) else names
    for name in names:
        if name not in known:
            raise LearnerError(f"there is no learner {name!r}; {nearest(name, known)}")
    return [known[name] for name in names]

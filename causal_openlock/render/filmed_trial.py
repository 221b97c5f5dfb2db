"""The trial that a film shows: played by a learner now, or read from the record of a subject.

Both ways lead through the same rows, so a film of a recorded subject is the film that its learner
would give.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import TYPE_CHECKING, Any

from causal_openlock.contract.learner import Learner
from causal_openlock.errors import StoreError
from causal_openlock.experiment.declare import SHOWN, Condition, LearnerSpec, Protocol
from causal_openlock.experiment.plan import check_trial
from causal_openlock.experiment.session import Session
from causal_openlock.wording import nearest
from causal_openlock.world.rewards import PAPER_REWARD, RewardFunction
from causal_openlock.world.room import Room, positions_for

if TYPE_CHECKING:
    from pathlib import Path

    import pyarrow as pa


@dataclass(frozen=True)
class FilmedTrial:
    """One trial of one subject.

    Attributes:
        learner: Label of the learner.
        condition: The condition.
        protocol: Its budgets.
        subject: Number of the subject.
        trial: Number of the trial in the whole condition, from 1.
        trials: How many trials the condition has.
        attempts: The rows of the record that are its attempts.
    """

    learner: str
    condition: Condition
    protocol: Protocol
    subject: int
    trial: int
    trials: int
    attempts: Sequence[dict[str, Any]]

    @property
    def shown(self) -> bool:
        """Whether the subject was shown the trial and did not act itself."""
        return bool(self.attempts[0]["phase"] == SHOWN)

    @property
    def place(self) -> str:
        """Place in the condition: ``trial 1 of 7``, perhaps ``(shown to the subject)``."""
        return f"trial {self.trial} of {self.trials}{' (shown to the subject)' * self.shown}"

    @cached_property
    def room(self) -> Room:
        """The room."""
        schemas = {schema.name: schema for schema in self.condition.schemas}
        positions = max(map(positions_for, schemas.values()))
        return Room.of(schemas[self.attempts[0]["schema"]], self.attempts[0]["layout"], positions)

    @property
    def action_limit(self) -> int:
        """Actions in an attempt."""
        return self.protocol.actions_for(self.room.schema)

    @property
    def found(self) -> int:
        """Number of solutions found."""
        return sum(row["new_solution"] for row in self.attempts)


def play_trial(
    learner: Learner,
    condition: Condition,
    protocol: Protocol,
    *,
    trial: int = 1,
    subject: int = 0,
    seed: int = 0,
    reward: RewardFunction | str = PAPER_REWARD,
    label: str = "learner",
) -> FilmedTrial:
    """Let one subject play up to the end of a trial.

    The subject acts as in any :class:`~causal_openlock.experiment.session.Session` with
    the same condition, protocol, number, seed and label.

    Args:
        learner: The learner, not begun yet.
        condition: Which rooms are visited.
        protocol: The budgets.
        trial: Number of the trial in the whole condition, from 1.
        subject: Number of the subject.
        seed: Seed of the experiment.
        reward: The reward of each action.
        label: Label of the learner; it keys the learner's randomness.

    Raises:
        ExperimentError: If there is no such trial, or a schema does not fit the protocol.
    """
    session = Session(condition, protocol, [subject], seed=seed, reward=reward, learner=label)
    session.begin_trial(learner, trial)
    for step in session.steps(learner):
        if step.trial_over[0]:
            break
    attempts, trials = _trials(session.record())[trial - 1], session.brief.trials
    return FilmedTrial(label, condition, protocol, subject, trial, trials, attempts)


def recorded_trial(
    folder: Path | str, learner: str, condition: str, subject: int = 0, trial: int = 1
) -> FilmedTrial:
    """A trial of a recorded subject.

    Args:
        folder: The results folder of ``compare``.
        learner: Label of the learner in the experiment.
        condition: Name of the condition.
        subject: Number of the subject.
        trial: Number of the trial in the whole condition, from 1.

    Raises:
        StoreError: If the folder does not hold it.
        ExperimentError: If there is no such trial.
    """
    import pyarrow.compute as pc

    from causal_openlock.storage.store import Store

    store = Store(folder)
    experiment = store.experiment()
    spec: LearnerSpec = _named(experiment.learners, learner, f"{folder} holds no learner")
    played: Condition = _named(experiment.conditions, condition, f"{folder} holds no condition")
    begins = f"{learner}_{condition}_"
    for name in experiment.files:
        path = store.cells / name
        if not (name.startswith(begins) and path.exists()):
            continue
        record = store.read(path)
        wanted = pc.field("subject") == subject
        for column, value in (("learner", learner), ("condition", condition)):
            wanted &= pc.field(column).cast("string") == value
        if trials := _trials(record.filter(wanted)):
            break
    else:
        raise StoreError(
            f"{folder} holds no subject {subject} of {learner} in {condition}; subjects are 0 to "
            f"{spec.subjects - 1}, and compare completes what is missing"
        )
    check_trial(trial, len(trials), f"subject {subject} of {learner} in {condition}")
    attempts = trials[trial - 1]
    return FilmedTrial(learner, played, spec.protocol, subject, trial, len(trials), attempts)


def _named(parts: Sequence[Any], name: str, otherwise: str) -> Any:
    known = {part.name: part for part in parts}
    if name not in known:
        raise StoreError(f"{otherwise} {name!r}; {nearest(name, known)}")
    return known[name]


def _trials(record: pa.Table) -> list[list[dict[str, Any]]]:
    """The attempts of one subject, trial by trial."""
    runs = groupby(record.to_pylist(), key=lambda row: (row["phase"], row["loop"], row["trial"]))
    return [list(run) for _, run in runs]

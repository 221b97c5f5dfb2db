"""A learner in a recorded subject's place: it predicts each action, and is then told what was done.

The subject's session is played again with the recorded actions. Rooms and their chance are drawn
from the seed of the experiment, so they are those that the subject met; where what happens is not
what is on record, nothing is scored. The learner never acts. It learns from the subject's actions
as if they were its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from causal_openlock.contract.learner import InformedLearner, Learner
from causal_openlock.contract.registry import create
from causal_openlock.errors import LearnerError, StoreError
from causal_openlock.experiment.experiment import LearnerSpec
from causal_openlock.experiment.session import Session
from causal_openlock.experiment.stored import StoredExperiment
from causal_openlock.wording import nearest
from causal_openlock.world.fsm import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    import pyarrow as pa

GROUP = ["learner", "condition", "protocol", "experiment", "seed"]
"""What identifies subjects who can be played again in one session."""

COLUMNS = [
    *("scored", *GROUP, "subject"),
    *("trial", "attempt", "action", "action_index", "log_probability", "entropy", "highest"),
    "impossible",
]

MOST_SUBJECTS = 40
"""So many subjects are played again at once."""

Cell = tuple[str, pd.DataFrame]


def score_actions(
    record: pa.Table, experiment: StoredExperiment, scored: LearnerSpec, lapse: float = 0.0
) -> pd.DataFrame:
    """How likely a learner finds each action of each subject of a record.

    Args:
        record: Attempts, as :meth:`~causal_openlock.experiment.store.Store.record` gives them.
        experiment: The experiment that they are of.
        scored: The learner that predicts.
        lapse: The share of a subject's actions that are taken to be random, so that one action
            that the learner would never do does not outweigh all others.

    Returns:
        A row for each action. ``scored`` is the learner that predicts; ``learner`` and the rest of
        :data:`GROUP` and ``subject`` say who acted; ``trial`` (in the whole condition), ``attempt``
        and ``action`` when, each from 1; ``action_index`` what. ``log_probability`` is in nats,
        with lapses; ``entropy`` that of the learner's own probabilities, in nats; ``highest``, the
        probability of the action that it finds likeliest; ``impossible``, whether it would never
        do what was done, but for lapses.

    Raises:
        LearnerError: If the learner does not give probabilities, or what it gives are none.
        StoreError: If what is on record cannot be played again.
    """
    attempts = record.select(
        [*GROUP, "subject", "phase", "loop", "trial", "attempt", "actions", "moved", "opened"]
    ).to_pandas()
    attempts = attempts.astype(dict.fromkeys(["learner", "condition", "protocol", "phase"], str))
    if attempts.empty:
        raise StoreError("no subject of these learners has played yet; run compare to the end")
    tables = []
    for group, rows in attempts.groupby(GROUP, observed=True, sort=False):
        numbers = np.unique(rows["subject"])
        for first in range(0, len(numbers), MOST_SUBJECTS):
            own = rows[rows["subject"].isin(numbers[first : first + MOST_SUBJECTS])]
            tables.append(_scored(dict(zip(GROUP, group, strict=True)), own, experiment, scored))
    table = pd.concat(tables, ignore_index=True)
    actions = table.pop("actions")
    table["impossible"] = np.isneginf(table["log_probability"])
    mixed = (1.0 - lapse) * np.exp(table["log_probability"]) + lapse / actions
    with np.errstate(divide="ignore"):
        table["log_probability"] = np.log(mixed)
    return table[COLUMNS]


def _scored(
    group: dict[str, Any], rows: pd.DataFrame, experiment: StoredExperiment, scored: LearnerSpec
) -> pd.DataFrame:
    """The scores of some subjects of a group; ``actions`` is how many there are to choose from."""
    numbers = np.unique(rows["subject"]).tolist()
    session = _session(group, numbers, experiment, scored)
    done = [_actions_of(rows[rows["subject"] == number]) for number in numbers]
    learner = create(scored.learner, scored.parameters)
    session.begin(learner)
    parts = [*_predicted(session, learner, done, scored.name)]
    _check_same(session, rows, group)
    table = pd.DataFrame(
        {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    )
    table["subject"] = np.array(numbers)[table["subject"]]
    return table.assign(scored=scored.name, actions=session.brief.actions, **group).sort_values(
        ["subject", "trial", "attempt", "action"], ignore_index=True
    )


def _session(
    group: dict[str, Any], numbers: Sequence[int], experiment: StoredExperiment, scored: LearnerSpec
) -> Session:
    conditions = {one.name: one for one in experiment.conditions}
    protocols = {one.protocol.name: one.protocol for one in experiment.learners}
    return Session(
        conditions[group["condition"]],
        protocols[group["protocol"]],
        numbers,
        seed=int(group["seed"]),
        reward=scored.reward,
        learner=scored.name,
        experiment=group["experiment"],
    )


def _actions_of(rows: pd.DataFrame) -> IntArray:
    """All actions of a subject, in the order of time: that of a record."""
    return np.concatenate([*rows["actions"]]).astype(np.int64)


def _predicted(
    session: Session, learner: Learner, done: Sequence[IntArray], name: str
) -> Iterator[dict[str, NDArray[Any]]]:
    """The learner's probabilities, action by action, of subjects that did ``[B]`` such actions."""
    lengths = np.array([len(actions) for actions in done])
    actions = np.zeros((len(done), lengths.max()), dtype=np.int64)
    for row, own in zip(actions, done, strict=True):
        row[: len(own)] = own
    in_attempt = np.zeros(len(done), dtype=np.int64)
    for moment in range(lengths.max()):
        view, acts = session.view, moment < lengths
        if not view.playing[acts].all():
            raise StoreError("the record has more actions than its protocol allows")
        found = learner.probabilities(view)
        if found is None:
            raise LearnerError(
                f"{name} does not give the probabilities of its actions, so it cannot be scored; "
                "write its method probabilities(view)"
            )
        _check_probabilities(found, acts, session.brief.actions, name)
        in_attempt += 1
        yield _rows(found, actions[:, moment], acts, view.trial, view.attempt, in_attempt)
        step = session.step(actions[:, moment])
        learner.learn(step)
        if isinstance(learner, InformedLearner) and step.trial_over.any():
            learner.inform(session.truth)
        in_attempt[step.attempt_over] = 0


def _check_probabilities(found: FloatArray, acts: BoolArray, actions: int, name: str) -> None:
    """Refuse what are no probabilities of actions."""
    right = np.shape(found) == (len(acts), actions)
    rows = found[acts] if right else found
    if not (right and (rows >= 0).all() and np.allclose(rows.sum(axis=1), 1.0, atol=1e-6)):
        raise LearnerError(
            f"the probabilities of {name} are no array of {actions} for each subject, none below 0 "
            "and 1 in sum; its contract tests say more"
        )


def _rows(
    found: FloatArray,
    taken: IntArray,
    acts: BoolArray,
    trial: IntArray,
    attempt: IntArray,
    action: IntArray,
) -> dict[str, NDArray[Any]]:
    who = np.flatnonzero(acts)
    own = found[who]
    with np.errstate(divide="ignore", invalid="ignore"):
        surprise = np.where(own > 0, -np.log(own), 0.0)
        log_probability = np.log(own[np.arange(len(who)), taken[who]])
    return {
        "subject": who,
        "trial": trial[who],
        "attempt": attempt[who],
        "action": action[who],
        "action_index": taken[who],
        "log_probability": log_probability,
        "entropy": (own * surprise).sum(axis=1),
        "highest": own.max(axis=1),
    }


def _check_same(session: Session, rows: pd.DataFrame, group: dict[str, Any]) -> None:
    """Refuse a record of which something else comes when it is played again."""
    again = session.record().to_pandas()
    columns = ["subject", "actions", "moved", "opened"]
    key = ["subject", "phase", "loop", "trial", "attempt"]
    both = rows.merge(again[[*key, *columns[1:]]].astype({"phase": str}), on=key, how="left")
    same = len(both) == len(rows) and all(
        isinstance(other, np.ndarray) and np.array_equal(one, other)
        for name in ("actions", "moved")
        for one, other in zip(both[f"{name}_x"], both[f"{name}_y"], strict=True)
    )
    if not (same and (both["opened_x"] == both["opened_y"]).all()):
        raise StoreError(
            f"what {group['learner']} did in {group['condition']} does not come out again in the "
            "rooms of its experiment, so nobody can be put in its place; was it recorded with "
            "another version?"
        )


def known_learners(names: Sequence[str], specs: Sequence[LearnerSpec]) -> list[LearnerSpec]:
    """Those of some learners that have these labels.

    Raises:
        LearnerError: If there is none of a label.
    """
    known = {spec.name: spec for spec in specs}
    for name in names:
        if name not in known:
            raise LearnerError(f"there is no learner {name!r}; {nearest(name, known)}")
    return [known[name] for name in names]

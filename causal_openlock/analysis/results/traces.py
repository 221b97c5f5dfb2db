"""Beliefs of a subject that is on record, in one of its trials.

A record says what a subject did and not what it believed. But beliefs follow from the prior and
from what was observed, so all that the subject did up to the end of the trial is done once more, in
the same rooms, and its belief is watched. Where the results are those of another version, or the
rooms are not those on record, there is no trace.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import pandas as pd
import pyarrow as pa

from causal_openlock.analysis.measures import CELL, VISIT, ordered
from causal_openlock.analysis.results.material import Material
from causal_openlock.contract.registry import create, is_ours, learner_class, origin
from causal_openlock.errors import NothingToDrawError, OpenLockError
from causal_openlock.experiment.condition import SHOWN
from causal_openlock.experiment.declare import LearnerSpec
from causal_openlock.experiment.plan import phases_of
from causal_openlock.files.validation import whole_number
from causal_openlock.storage.versions import other_versions
from causal_openlock.version import RESULTS_VERSION
from causal_openlock.wording import nearest
from causal_openlock.world.rewards import PAPER_REWARD
from causal_openlock.world.room import Room, action_names

if TYPE_CHECKING:
    from causal_openlock.belief.trace import Trace


def installed(spec: LearnerSpec) -> type:
    """A learner's class, or ``object`` if no package brings it along: no code of results runs."""
    with suppress(OpenLockError):
        return object if ":" in spec.learner else learner_class(spec.learner)
    return object


def believers(results: Material) -> dict[str, LearnerSpec]:
    """The learners of the results that hold beliefs, in the order of the experiment."""
    from causal_openlock.belief.belief_learner import BeliefLearner

    learners = results.experiment.learners
    return {spec.name: spec for spec in learners if issubclass(installed(spec), BeliefLearner)}


def replayed(
    results: Material,
    subject: int | None = None,
    learner: str | None = None,
    condition: str | None = None,
    trial: int = 1,
) -> Trace:
    """Beliefs of a subject in a trial, by default of the first in the first.

    The ``trial`` is counted among those that the subject played, from 1.

    Raises:
        NothingToDrawError: If no learner holds beliefs, or the results are of another version or
            other rooms.
        OpenLockError: If there is no such learner, condition, subject or trial.
    """
    from causal_openlock.belief.belief_learner import BeliefLearner
    from causal_openlock.belief.structure_schemas import by_position, same_structure
    from causal_openlock.belief.trace import trace_trial

    known = believers(results)
    played = results.trials[results.trials["learner"].isin(list(known))]
    if played.empty:
        raise NothingToDrawError("no learner of these results holds beliefs, as bayes does")
    names = ordered(played["learner"], list(known))
    learner = names[0] if learner is None else learner
    if learner not in names:
        raise OpenLockError(f"no learner {learner} that holds beliefs; {nearest(learner, names)}")
    spec, own = known[learner], played[played["learner"] == learner]
    rooms = {one.name: one for one in results.experiment.conditions}
    conditions = ordered(own["condition"], list(rooms))
    condition = conditions[0] if condition is None else condition
    if condition not in conditions:
        raise OpenLockError(f"{learner} did not play {condition}; {nearest(condition, conditions)}")
    own = own[own["condition"] == condition]
    subject = int(own["subject"].min()) if subject is None else whole_number(subject, "subject")
    trial = whole_number(trial, "trial", 1)
    visits = own[own["subject"] == subject]
    visits = visits[visits["seed"] == visits["seed"].min()].sort_values(VISIT)
    if not 1 <= trial <= len(visits):
        raise OpenLockError(
            f"no trial {trial} of subject {subject} of {learner} in {condition}; there are "
            f"subjects from {own['subject'].min()} to {own['subject'].max()}, and trials from 1 to "
            f"{len(visits) or int(own.groupby('subject').size().max())}"
        )
    other = other_versions(results.experiment.versions, {"causal-openlock": RESULTS_VERSION})
    if not is_ours(spec.learner) and spec.origin.package != origin(spec.learner):
        other = f"other code of the learner, {spec.origin.package}"
    if other:
        raise _unknown(learner, other)
    row = visits.iloc[trial - 1]
    believer = create(spec.learner, spec.parameters)
    assert isinstance(believer, BeliefLearner)
    recorded = _recorded(results.record, visits.iloc[:trial])
    trace = trace_trial(
        believer,
        rooms[condition],
        spec.protocol,
        trial=trial + phases_of(rooms[condition], spec.protocol).count(SHOWN),
        subject=subject,
        seed=int(row["seed"]),
        # A user's own code is not run to read results; learners with beliefs ignore rewards.
        reward=PAPER_REWARD if spec.reward.is_own else spec.reward,
        label=spec.name,
        recorded=(action for visit in recorded for attempt in visit for action in attempt),
    )
    schema = next(one for one in rooms[condition].schemas if one.name == row["schema"])
    room = Room.of(schema, row["layout"], len(trace.nodes) - 1)
    names = action_names(room.positions)
    done = [[names.index(action.action) for action in attempt] for attempt in trace.attempts]
    if done != recorded[-1] or not same_structure(by_position(room), trace.truth):
        raise _unknown(learner, "other rooms")
    return trace


def _unknown(learner: str, trials: str) -> NothingToDrawError:
    return NothingToDrawError(
        f"beliefs of {learner} are not known: its trials are of {trials}; run the comparison again "
        "to see them"
    )


def _recorded(record: pa.Table, visits: pd.DataFrame) -> list[list[list[int]]]:
    """The actions of each attempt, of each of a subject's trials."""
    from pyarrow.compute import field

    # A number first: it leaves few rows, in which names are cheap to compare.
    own = record.filter(field("subject") == int(visits["subject"].iloc[0]))
    names = [*CELL, *VISIT]
    rows = own.select([*names, "attempt", "actions"]).to_pandas().sort_values("attempt")
    known = dict(iter(rows.groupby(names, observed=True)["actions"]))
    played = visits[names].itertuples(index=False, name=None)
    return [[actions.tolist() for actions in known.get(visit, ())] for visit in played]

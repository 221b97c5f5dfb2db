"""Reading results folders for analysis, and joining what several of them hold.

People may be left out by the rule of the paper, which removed those who completed no trial. Nobody
is unless it is asked for, and reports and methods then say how many are. Learners never are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, get_args

import pyarrow as pa

from causal_openlock.analysis.measures import CELL, SUBJECT
from causal_openlock.errors import StoreError
from causal_openlock.experiment.condition import SHOWN, Condition
from causal_openlock.experiment.declare import PERSON, LearnerSpec
from causal_openlock.storage.store import Store, StoredExperiment
from causal_openlock.storage.versions import merged_versions
from causal_openlock.wording import joined

Exclusion = Literal["completed no trial"]  #: rules by which people are left out


def read_results(
    store: Store, exclude: Exclusion | None = None
) -> tuple[pa.Table, StoredExperiment]:
    """The records of all cells as one, and the experiment they are of.

    Raises:
        StoreError: If there is no cell, one is damaged, or the rule leaves nobody.
    """
    if exclude not in (None, *get_args(Exclusion)):
        raise StoreError(
            f"no rule {exclude!r} leaves people out; {joined(get_args(Exclusion))} does"
        )
    record, experiment = store.record()
    return (record, experiment) if exclude is None else without_excluded(record, experiment)


def without_excluded(
    record: pa.Table, experiment: StoredExperiment
) -> tuple[pa.Table, StoredExperiment]:
    """Leave out the people who found every solution of no room.

    The experiment is returned with their numbers, ``excluded``.

    Raises:
        StoreError: If nobody is left.
    """
    people = [spec.name for spec in experiment.learners if spec.learner == PERSON]
    subject = [*CELL, *SUBJECT]
    columns = [*subject, "phase", "solutions_found", "solutions"]
    attempts = record.select(columns).to_pandas()
    solved = (attempts["solutions_found"] == attempts["solutions"]) & (attempts["phase"] != SHOWN)
    some = solved.groupby([attempts[name] for name in subject], observed=True).transform("any")
    out = attempts["learner"].isin(people) & ~some
    if out.all():
        raise StoreError("everybody completed no trial, so that nobody is left to report")
    gone = attempts[out].drop_duplicates(subject)["learner"].astype(str)
    excluded = {str(name): int(number) for name, number in gone.value_counts().items()}
    return record.filter(~out.to_numpy()), replace(experiment, excluded=excluded)


def together(
    results: Sequence[tuple[pa.Table, StoredExperiment]],
) -> tuple[pa.Table, StoredExperiment]:
    """Join several results into one, such as those of people and those of learners.

    The first one's name and title are kept; learners and conditions are those of all.

    Raises:
        StoreError: If two learners, or one learner's results of a condition twice, have the same
            label, or a condition has two meanings.
    """
    experiments = [experiment for _, experiment in results]
    learners: dict[str, LearnerSpec] = {}
    conditions: dict[str, Condition] = {}
    not_applicable: dict[str, dict[str, str]] = {}
    excluded: dict[str, int] = {}
    played: set[tuple[str, str]] = set()
    for record, experiment in results:
        names = record.select(["learner", "condition"]).to_pandas().drop_duplicates()
        cells = {*names.itertuples(index=False, name=None)}
        twice = sorted(played & cells)
        played |= cells
        for spec in experiment.learners:
            same = learners.setdefault(spec.name, spec) == spec
            if twice or not same:
                raise StoreError(
                    f"both of these results have a learner {twice[0][0] if twice else spec.name}; "
                    "give one of them another name where it is declared (name: in a file; in "
                    "Python learner(..., label=...))"
                )
        excluded |= experiment.excluded
        for name, own in experiment.not_applicable.items():
            not_applicable.setdefault(name, {}).update(own)
        for condition in experiment.conditions:
            if conditions.setdefault(condition.name, condition) != condition:
                raise StoreError(
                    f"the condition {condition.name} is not the same in these results; compare "
                    "those that are"
                )
    whole = replace(
        experiments[0],
        learners=tuple(learners.values()),
        # Whose rooms are on record belongs to the results that they are of.
        conditions=tuple(
            replace(one, rooms={}) if len(results) > 1 else one for one in conditions.values()
        ),
        files=tuple(name for one in experiments for name in one.files),
        missing=tuple(name for one in experiments for name in one.missing),
        failures={name: why for one in experiments for name, why in one.failures.items()},
        versions=merged_versions([one.versions for one in experiments]),
        not_applicable=not_applicable,
        excluded=excluded,
        warned=tuple(dict.fromkeys(said for one in experiments for said in one.warned)),
    )
    return pa.concat_tables([record for record, _ in results]), whole

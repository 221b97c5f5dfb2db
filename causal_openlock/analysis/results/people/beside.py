"""Results of several folders as one: people who played beside the learners of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from causal_openlock.errors import StoreError
from causal_openlock.experiment.experiment import LearnerSpec
from causal_openlock.experiment.protocol import Condition
from causal_openlock.experiment.store import merged_versions
from causal_openlock.experiment.stored import StoredExperiment

if TYPE_CHECKING:
    import pyarrow as pa


def beside(
    results: Sequence[tuple[pa.Table, StoredExperiment]],
) -> tuple[pa.Table, StoredExperiment]:
    """Several records as one.

    Args:
        results: As :meth:`causal_openlock.experiment.store.Store.record` gives them; the first
            heads the report.

    Returns:
        The rows of all, and an experiment with the learners and conditions of all.

    Raises:
        StoreError: If two learners have the same label, or a condition means two things.
    """
    import pyarrow as pa

    experiments = [experiment for _, experiment in results]
    learners: dict[str, LearnerSpec] = {}
    conditions: dict[str, Condition] = {}
    for experiment in experiments:
        for spec in experiment.learners:
            if learners.setdefault(spec.name, spec) is not spec:
                raise StoreError(
                    f"both of these results have a learner {spec.name}; give one of them another "
                    "name in its experiment file"
                )
        for condition in experiment.conditions:
            if conditions.setdefault(condition.name, condition) != condition:
                raise StoreError(
                    f"the condition {condition.name} is not the same in these results; compare "
                    "those that are"
                )
    together = replace(
        experiments[0],
        learners=tuple(learners.values()),
        conditions=tuple(conditions.values()),
        missing=tuple(name for one in experiments for name in one.missing),
        failures={name: why for one in experiments for name, why in one.failures.items()},
        versions=merged_versions([one.versions for one in experiments]),
    )
    return pa.concat_tables([record for record, _ in results]), together

"""Warnings of what the learners of an experiment will cost, before any of them plays."""

from __future__ import annotations

from collections.abc import Iterator

from causal_openlock.contract.expected_cost import expected_cost
from causal_openlock.experiment.experiment import Experiment


def cost_warnings(experiment: Experiment) -> Iterator[str]:
    """A sentence for each learner and schema of an experiment with a high cost.

    Where a learner is not applicable, it does not play and costs nothing.
    """
    schemas = dict.fromkeys(s for c in experiment.conditions for s in c.schemas)
    for entry in experiment.learners:
        for schema in schemas:
            limit = entry.protocol.actions_for(schema)
            try:
                cost = expected_cost(entry.learner, entry.parameters, schema, limit)
            except Exception as error:  # an estimate is no reason not to play
                yield f"what {entry.name} costs is not known ({type(error).__name__}: {error})"
                continue
            if cost is not None and cost.applicable:
                yield f"in {schema.name}, {entry.name} {cost}"

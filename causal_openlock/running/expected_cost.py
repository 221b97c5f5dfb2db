"""Warnings of what the learners of an experiment will cost, before any of them plays."""

from __future__ import annotations

from collections.abc import Iterator

from causal_openlock.experiment.experiment import Experiment


def cost_warnings(experiment: Experiment) -> Iterator[str]:
    """A sentence for each learner and schema of an experiment with a high cost.

    Where a learner is not applicable, it does not play and costs nothing.
    """
    for (name, schema), cost in experiment.costs.items():
        if isinstance(cost, str):
            yield f"what {name} costs is not known ({cost})"
        elif cost is not None and cost.applicable:
            yield f"in {schema.name}, {name} {cost}"

"""Results of several folders as one: people who played beside the learners of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from causal_openlock.errors import StoreError
from causal_openlock.experiment.store import merged_versions

if TYPE_CHECKING:
    import pyarrow as pa


def beside(results: Sequence[tuple[pa.Table, dict[str, Any]]]) -> tuple[pa.Table, dict[str, Any]]:
    """Several records as one.

    Args:
        results: Records with their descriptions, as
            :meth:`causal_openlock.experiment.store.Store.record` gives them; the first heads the
            report.

    Returns:
        The rows of all, and a description with the learners and conditions of all.

    Raises:
        StoreError: If two learners have the same label, or a condition means two things.
    """
    import pyarrow as pa

    first = results[0][1]
    together = dict(first)
    together["learners"] = learners = _listed(results, "learners")
    names = [one["name"] for one in learners]
    for index, name in enumerate(names):
        if name in names[:index]:
            raise StoreError(
                f"both of these results have a learner {name}; give one of them another name in "
                "its experiment file"
            )
    conditions: dict[str, Any] = {}
    for condition in _listed(results, "conditions"):
        name = condition["name"]
        if conditions.setdefault(name, condition) != condition:
            raise StoreError(
                f"the condition {name} is not the same in these results; compare those that are"
            )
    together["conditions"] = list(conditions.values())
    if missing := _listed(results, "missing_cells"):
        together["missing_cells"] = missing
    if failed := {k: v for _, one in results for k, v in one.get("failures", {}).items()}:
        together["failures"] = failed
    together["versions"] = merged_versions([description["versions"] for _, description in results])
    return pa.concat_tables([record for record, _ in results]), together


def _listed(results: Sequence[tuple[pa.Table, dict[str, Any]]], key: str) -> list[Any]:
    return [one for _, description in results for one in description.get(key, ())]

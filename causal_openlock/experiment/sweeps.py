"""Sweeps: a learner once for each value of a parameter, or for each combination of several.

In an experiment file a learner may have ``sweep: {lapse: [0.0, 0.1, 0.5]}``, and in Python
:func:`~causal_openlock.experiment.building.sweep` declares the same. Each point of the grid is a
learner of its own, whose label has the values.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from itertools import islice, product
from typing import Any

from causal_openlock.contract.registry import require_parameter
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.file_format import NAME_FORM, LearnerFile

MOST_SWEPT = 500
"""The most learners that one sweep can declare."""


def points(declared: LearnerFile) -> list[LearnerFile]:
    """The learners of a sweep with their labels; without a sweep, the learner with its label.

    >>> swept = LearnerFile(learner="bayes", sweep={"lapse": [0.0, 0.1]})
    >>> [(one.name, one.parameters) for one in points(swept)]
    [('bayes-lapse-0', {'lapse': 0.0}), ('bayes-lapse-0.1', {'lapse': 0.1})]
    """
    name = declared.name or declared.learner.rpartition(":")[2]
    found = []
    for values in islice(product(*declared.sweep.values()), MOST_SWEPT):
        point = dict(zip(declared.sweep, values, strict=True))
        changes = {
            "name": label_of(name, point, "-"),
            "parameters": {**declared.parameters, **point},
            "sweep": {},
        }
        found.append(declared.model_copy(update=changes))
    return found


def check_swept(declared: LearnerFile, key: str) -> None:
    """Check that a parameter can be swept, and the size and the labels of the grid.

    Raises:
        LearnerError: If the parameter does not exist, has another value already, or the grid is
            too large; or if a label is too long.
    """
    require_parameter(declared.learner, key)
    if key in declared.parameters:
        raise LearnerError(f"{key} is in parameters and in sweep; leave it out of one", (key,))
    if (size := math.prod(map(len, declared.sweep.values()))) > MOST_SWEPT:
        raise LearnerError(f"this sweep has {size:,} learners; sweep at most {MOST_SWEPT}")
    for one in points(declared):
        if not re.fullmatch(NAME_FORM, str(one.name)):
            raise LearnerError(f"{one.name!r} is not a label; give the learner a shorter name")


def label_of(name: str, values: Mapping[str, Any], mark: str) -> str:
    """A name with the values that are changed.

    >>> label_of("bayes", {"policy": "solve and learn", "lapse": 0.1 + 0.2}, "-")
    'bayes-policy-solve_and_learn-lapse-0.3'
    """
    words = [name]
    for key, value in values.items():
        text = f"{value:.10g}" if isinstance(value, float) else str(value)
        words += [key, re.sub(r"[^A-Za-z0-9.-]+", "_", text).strip("_")]
    return mark.join(words)


def labels(entry: Any) -> dict[str, Any]:
    """Names by which an entry of a file can be chosen: its own, and the labels of its sweep."""
    swept = points(entry) if isinstance(entry, LearnerFile) and entry.sweep else []
    return {entry.name or entry.learner: entry, **{str(one.name): one for one in swept}}

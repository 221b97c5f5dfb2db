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

from causal_openlock.contract.registry import learner_class, parameter_table, parse_parameters
from causal_openlock.errors import Faults, LearnerError
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


def check_parameters(declared: LearnerFile) -> None:
    """Check every value of a learner's parameters, and the size and the labels of its sweep.

    Raises:
        LearnerError: If there is no such learner; or with every fault as one of ``error.parts``.
    """
    faults = Faults()
    with faults.noted("learner"):
        learner_class(declared.learner)
    faults.check()
    for key, value in declared.parameters.items():
        with faults.noted("parameters"):
            _check_value(declared.learner, key, value)
    known = {row.name for row in parameter_table(declared.learner)}
    for key, values in declared.sweep.items():
        with faults.noted("sweep"):
            if key not in known:
                _check_value(declared.learner, key, None)  # which names the nearest parameter
            if key in declared.parameters:
                message = f"{key} is in parameters and in sweep; leave it out of one"
                raise LearnerError(message, (key,))
            for number, value in enumerate(values):
                with faults.noted("sweep", key, number):
                    _check_value(declared.learner, key, value)
    if declared.sweep:
        with faults.noted("sweep"):
            _check_labels(declared)
    faults.check()


def _check_value(learner: str, key: str, value: Any) -> None:
    try:
        parse_parameters(learner, {key: value})
    except LearnerError as error:
        for part in error.parts:
            if part.at == (key,):  # and not that it does not go with the defaults of others
                raise part from None


def _check_labels(declared: LearnerFile) -> None:
    if (size := math.prod(map(len, declared.sweep.values()))) > MOST_SWEPT:
        raise LearnerError(f"this sweep has {size:,} learners; sweep at most {MOST_SWEPT}")
    labels = [str(one.name) for one in points(declared)]
    for label in labels:
        if not re.fullmatch(NAME_FORM, label):
            raise LearnerError(f"{label!r} is not a label; give the learner a shorter name")
        if labels.count(label) > 1:
            raise LearnerError(
                f"this sweep has two learners with the label {label}; take one of their values out"
            )


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

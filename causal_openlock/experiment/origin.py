"""The code of a learner, so that results of different code can be distinguished."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from causal_openlock.contract.learner import InformedLearner
from causal_openlock.contract.registry import learner_class, origin, parse_parameters
from causal_openlock.errors import LearnerError, failures_as
from causal_openlock.wording import first_line

NOTES = ("prior_attempts", "informed", "about")
"""What follows from the code, and does not identify it."""
_STORED = {
    **{"class": "class_name", "package": "package", "material": "artifact_hash"},
    **{name: name for name in NOTES},
}


@dataclass(frozen=True)
class Origin:
    """The code of a learner."""

    class_name: str  #: ``module:Class``
    #: Name and version; or a file, with a hash of it and of the user's modules that it imports.
    package: str
    artifact_hash: str = ""  #: of files that its parameters name, such as trained weights
    prior_attempts: int | None = 0  #: with which it was trained before; None if unknown
    informed: bool = False  #: whether it is given what subjects cannot perceive
    about: str = ""  #: the first line of its docstring

    def as_dict(self) -> dict[str, Any]:
        """The origin as a results folder stores it with its learner."""
        data = {key: getattr(self, name) for key, name in _STORED.items()}
        if self.prior_attempts is None:
            data["prior_attempts"] = "unknown"
        return {key: value for key, value in data.items() if value}

    @classmethod
    def taken_from(cls, entry: dict[str, Any]) -> Origin:
        """The origin in the stored entry of a learner, which is left without it."""
        known = {name: entry.pop(key) for key, name in _STORED.items() if key in entry}
        if known.get("prior_attempts") == "unknown":
            known["prior_attempts"] = None
        if known["package"].startswith("causal-openlock 0.2."):
            # The package of the bundled learners has another name now.
            known["class_name"] = re.sub(r"^learners\.", "openlock_learners.", known["class_name"])
        return cls(**known)


def origin_of(learner: str, parameters: Mapping[str, Any]) -> Origin:
    """The code of a learner with some parameters."""
    kind, given = learner_class(learner), parse_parameters(learner, parameters)
    return Origin(
        class_name=f"{kind.__module__}:{kind.__qualname__}",
        package=origin(learner),
        artifact_hash=answer_of(learner, "artifact_hash", str, given),
        prior_attempts=answer_of(learner, "prior_attempts", int | None, given),
        informed=issubclass(kind, InformedLearner),
        about=first_line(kind.__doc__),
    )


def answer_of(learner: str, method: str, wanted: Any, *given: Any) -> Any:
    """Answer of a class of learners, which may be a user's, to a question about itself."""
    with failures_as(LearnerError, f"{method} of {learner} fails"):
        answer = getattr(learner_class(learner), method)(*given)
    if not isinstance(answer, wanted) or (isinstance(answer, int) and answer < 0):
        what = "a text" if wanted is str else "a whole number of attempts, or None if unknown"
        raise LearnerError(f"{method} of {learner} has to return {what}, and returned {answer!r}")
    return answer

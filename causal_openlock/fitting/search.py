"""Which parameters of a learner are searched, and between what bounds.

A search space is a YAML file, or options of the command line::

    learner: bayes
    fixed: {policy: thompson}
    search:
      forgetting: {low: 0.5, high: 0.95}
      concentration: {low: 1.0, high: 200.0, log: true}

``fixed`` holds parameters that are set and not searched; all others keep their defaults. Names and
bounds are checked against the learner's parameters before anything is played.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from causal_openlock.contract.registry import parameter_table, parse_parameters
from causal_openlock.errors import LearnerError, OpenLockError
from causal_openlock.files.validation import StrictModel
from causal_openlock.files.yaml_file import parse_document, read_document
from causal_openlock.wording import nearest

BUNDLED = Path(__file__).parent
FORM = "name=low:high, or name=low:high:log"


@dataclass(frozen=True)
class Range:
    """The bounds of a parameter.

    ``log``: its logarithm is searched evenly; ``whole``: it takes whole numbers only.
    """

    low: float
    high: float
    log: bool = False
    whole: bool = False


@dataclass(frozen=True)
class SearchSpace:
    """The parameters of a learner that are searched, and those that are set to a fixed value."""

    learner: str
    fixed: Mapping[str, Any]
    ranges: Mapping[str, Range]

    def as_dict(self) -> dict[str, Any]:
        """The space as plain data."""
        ranges = {name: asdict(one) for name, one in self.ranges.items()}
        return {"learner": self.learner, "fixed": dict(self.fixed), "search": ranges}

    def parameters(self, chosen: Mapping[str, float]) -> dict[str, Any]:
        """All parameters that differ from the defaults, for a choice of those searched."""
        searched = {
            name: int(chosen[name]) if one.whole else float(chosen[name])
            for name, one in self.ranges.items()
        }
        return {**self.fixed, **searched}


class RangeFile(StrictModel):
    """The bounds of a parameter."""

    low: Annotated[float, Field(description="The least value.")]
    high: Annotated[float, Field(description="The greatest value.")]
    log: Annotated[bool, Field(description="Whether its logarithm is searched evenly.")] = False


class SearchFile(StrictModel):
    """A search space."""

    learner: Annotated[str, Field(description="Registered name of a learner.")]
    fixed: Annotated[dict[str, Any], Field(description="Parameters that are set.")] = Field(
        default_factory=dict
    )
    search: Annotated[dict[str, RangeFile], Field(description="Parameters that are searched.")]


def search_space(
    learner: str, ranges: Mapping[str, Range], fixed: Mapping[str, Any] | None = None
) -> SearchSpace:
    """A search space, checked.

    Raises:
        LearnerError: If a parameter is unknown, is no number, is both fixed and searched, or has
            bounds that it cannot take.
    """
    fixed = dict(fixed or {})
    if not ranges:
        raise LearnerError(f"nothing is searched; choose parameters of {learner}: {FORM}")
    defaults = {info.name: info.default for info in parameter_table(learner)}
    checked = {}
    for name, one in ranges.items():
        if name not in defaults:
            raise LearnerError(
                f"the learner {learner} has no parameter {name!r}; {nearest(name, defaults)}"
            )
        default = defaults[name]
        if isinstance(default, bool) or not isinstance(default, int | float):
            raise LearnerError(
                f"the parameter {name} of {learner} is no number, so it cannot be searched; "
                f"fix it: {name}={default}"
            )
        if name in fixed:
            raise LearnerError(f"{name} is both fixed and searched; take one of them out")
        if not one.low < one.high or (one.log and one.low <= 0):
            above = ", and low above 0 for a logarithm" if one.log else ""
            raise LearnerError(
                f"{name} cannot be searched from {one.low:g} to {one.high:g}; low must be below "
                f"high{above}"
            )
        whole = isinstance(default, int)
        if whole and not (float(one.low).is_integer() and float(one.high).is_integer()):
            raise LearnerError(f"the bounds of {name} must be whole numbers, as {name} is one")
        checked[name] = Range(one.low, one.high, one.log, whole)
    space = SearchSpace(learner, fixed, checked)
    for corner in ("low", "high"):
        parse_parameters(
            learner, space.parameters({name: getattr(one, corner) for name, one in checked.items()})
        )
    return space


def read_search(path: Path | str) -> SearchSpace:
    """A search space from a file.

    Raises:
        FileError: If it is no search space.
        LearnerError: If it does not fit the learner.
    """
    content = read_document(path).validate(SearchFile)
    ranges = {name: Range(one.low, one.high, one.log) for name, one in content.search.items()}
    return search_space(content.learner, ranges, content.fixed)


def bundled_search(learner: str) -> SearchSpace | None:
    """The search space that comes with the toolkit, if there is one for the learner."""
    path = BUNDLED / f"{learner}.yaml"
    return read_search(path) if learner.isidentifier() and path.is_file() else None


def parse_range(text: str) -> tuple[str, Range]:
    """A range as written on the command line: ``name=low:high`` or ``name=low:high:log``.

    Raises:
        OpenLockError: If it has another form.
    """
    name, equals, bounds = text.partition("=")
    parts = bounds.split(":")
    try:
        low, high = map(float, parts[:2])
        known = len(parts) == 2 or parts[2:] == ["log"]
    except ValueError:
        known = False
    if not (equals and known):
        raise OpenLockError(f"{text!r} is no range; write {FORM}")
    return name.strip(), Range(low, high, log=len(parts) == 3)


def parse_setting(text: str) -> tuple[str, Any]:
    """A setting as written on the command line: ``name=value``, the value as in a YAML file.

    Raises:
        OpenLockError: If it has another form.
    """
    name, equals, value = text.partition("=")
    if not equals or not value.strip():
        raise OpenLockError(f"{text!r} is no setting; write name=value")
    return name.strip(), parse_document(f"value: {value}", "--fix").data["value"]


def changed(
    space: SearchSpace | None, learner: str, ranges: Sequence[str], fixed: Sequence[str]
) -> SearchSpace:
    """A space with the command line's ranges and settings.

    Ranges given there replace all those of the space; settings are added to it, and what is fixed
    is searched no more.

    Raises:
        OpenLockError: If they cannot be read, or do not fit the learner.
    """
    known_ranges = dict(space.ranges) if space else {}
    known_fixed = dict(space.fixed) if space else {}
    settings = dict(map(parse_setting, fixed))
    wanted = dict(map(parse_range, ranges)) or {
        name: one for name, one in known_ranges.items() if name not in settings
    }
    kept = {name: value for name, value in known_fixed.items() if name not in wanted}
    return search_space(learner, wanted, {**kept, **settings})

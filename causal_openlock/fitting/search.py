"""Search spaces: the parameters of a learner that are searched, and their bounds.

A search space is a YAML file, or options of the command line::

    learner: bayes
    fixed: {policy: thompson}
    search:
      forgetting: {low: 0.5, high: 0.95}
      concentration: {low: 1.0, high: 200.0, log: true}

``fixed`` holds parameters that are set and not searched; all others keep their defaults. Names and
bounds are checked against the learner's parameters before anything is played.

How the fit is made stands in the same file (:class:`FitSettings`)::

    fit: {candidates: 120, hold_out: none, seed: 7}
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from causal_openlock.contract.parameters import Count
from causal_openlock.contract.registry import (
    is_ours,
    parameter_table,
    parse_parameters,
)
from causal_openlock.errors import LearnerError, OpenLockError
from causal_openlock.experiment.origin import origin_of
from causal_openlock.files.validation import StrictModel
from causal_openlock.files.yaml_file import Document, read_document
from causal_openlock.scoring import LAPSE
from causal_openlock.wording import joined, nearest, significant

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


def check_chosen(chosen: Mapping[str, float], ranges: Mapping[str, Range]) -> None:
    """Raise a ValueError unless there is a value for each range, within its bounds."""
    if set(chosen) != set(ranges):
        raise ValueError("other parameters are searched")
    if not all(one.low <= chosen[name] <= one.high for name, one in ranges.items()):
        raise ValueError("a parameter is outside its bounds")


@dataclass(frozen=True)
class SearchSpace:
    """The parameters of a learner that are searched, and those that are set to a fixed value."""

    learner: str
    fixed: Mapping[str, Any]
    ranges: Mapping[str, Range]

    @cached_property
    def code(self) -> dict[str, str]:
        """Code and files by learner; none of the toolkit's, which have their version.

        Once known it stays: what is fitted while files are edited was begun with the old ones.
        """
        lowest = self.parameters({name: one.low for name, one in self.ranges.items()})
        code = _code_of(self.learner, lowest)
        return {self.learner: code} if code else {}

    def as_dict(self) -> dict[str, Any]:
        """The space as plain data, with the code of its learner."""
        data = {
            "learner": self.learner,
            "fixed": dict(self.fixed),
            "search": {name: asdict(one) for name, one in self.ranges.items()},
        }
        if self.code:
            data["code"] = self.code
        return data

    @property
    def in_words(self) -> str:
        """Form of the learner that is fitted: what is fixed, and what is chosen by default.

        >>> SearchSpace("bayes", {"policy": "thompson"}, {}).in_words
        'bayes was fitted with policy thompson (fixed) and forgets everything (default).'
        """
        own = {*self.fixed, *self.ranges}
        by_default = {
            one.name: one.default
            for one in parameter_table(self.learner)
            if isinstance(one.default, str) and one.name not in own
        }
        parts = [
            f"{', '.join(f'{name} {_plain(value)}' for name, value in values.items())} ({how})"
            for values, how in ((self.fixed, "fixed"), (by_default, "default"))
            if values
        ]
        return f"{self.learner} was fitted with {joined(parts) or 'its defaults'}."

    def parameters(self, chosen: Mapping[str, float]) -> dict[str, Any]:
        """All parameters that differ from the defaults, for a choice of those searched."""
        searched = {
            name: int(chosen[name]) if one.whole else float(chosen[name])
            for name, one in self.ranges.items()
        }
        return {**self.fixed, **searched}


def _plain(value: Any) -> str:
    """A parameter as an experiment file has it."""
    if isinstance(value, bool):
        return str(value).lower()
    return str(significant(value)) if isinstance(value, float) else str(value)


def _code_of(learner: str, parameters: Mapping[str, Any]) -> str:
    """The code of a learner and of the files that parameters name."""
    found = origin_of(learner, parameters)
    if not is_ours(learner):
        return f"{found.package} {found.artifact_hash}".strip()
    named = any(isinstance(value, str) for value in parameters.values())
    return found.artifact_hash if named else ""


class RangeFile(StrictModel):
    """The bounds of a parameter."""

    low: Annotated[float, Field(description="The least value.")]
    high: Annotated[float, Field(description="The greatest value.")]
    log: Annotated[bool, Field(description="Whether its logarithm is searched evenly.")] = False


class FitSettings(StrictModel):
    """Settings of a fit, whatever is searched."""

    candidates: Annotated[Count, Field(description="Parameter settings to try.")] = 60
    seed: Annotated[
        int,
        Field(
            ge=0,
            le=2**62,
            description="Seed of the search and of all play; three are used. Play what was fitted "
            "with another.",
        ),
    ] = 31
    hold_out: Annotated[
        str | None,
        Field(
            description="What is not fitted to but predicted, of people's points: transfer (the "
            "four tests; the default) or none; of recorded actions: trials (the default), "
            "subjects or none."
        ),
    ] = None
    # To published means:
    target: Annotated[
        str, Field(description="Whose means are fitted to: people, or model (of AAAI 2020).")
    ] = "people"
    subjects: Annotated[
        int, Field(ge=2, description="Subjects that a candidate plays in each condition.")
    ] = 40
    finalists: Annotated[
        Count, Field(description="Number of best candidates that play again; the closest is taken.")
    ] = 5
    final_subjects: Annotated[
        int, Field(ge=2, description="Subjects in each condition then, and in the end.")
    ] = 200
    # To recorded actions:
    of: Annotated[list[str], Field(description="Whose subjects are fitted to; by default all.")] = (
        Field(default_factory=list)
    )
    each: Annotated[bool, Field(description="Whether each subject is fitted by itself.")] = False
    lapse: Annotated[
        float, Field(ge=0, le=1, description="Share of actions taken to be random.")
    ] = LAPSE
    folds: Annotated[int, Field(ge=2, description="Parts, of which each is held out once.")] = 2


class SearchFile(StrictModel):
    """A plan: a search space, and perhaps how the fit is made."""

    learner: Annotated[str, Field(description="Registered name of a learner.")]
    fixed: Annotated[dict[str, Any], Field(description="Parameters that are set.")] = Field(
        default_factory=dict
    )
    search: Annotated[dict[str, RangeFile], Field(description="Parameters that are searched.")]
    fit: Annotated[FitSettings, Field(description="How the fit is made.")] = Field(
        default_factory=FitSettings
    )


def search_space(
    learner: str,
    ranges: Mapping[str, Range],
    fixed: Mapping[str, Any] | None = None,
) -> SearchSpace:
    """A search space, checked.

    Raises:
        LearnerError: If a parameter is unknown, is not a number, is both fixed and searched, or has
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
                f"the parameter {name} of {learner} is not a number, so it cannot be searched; "
                f"fix it: {name}={default}"
            )
        if name in fixed:
            raise LearnerError(f"{name} is both fixed and searched; take one of them out")
        finite = math.isfinite(one.low) and math.isfinite(one.high)
        if not (finite and one.low < one.high) or (one.log and one.low <= 0):
            above = ", and low above 0 for a logarithm" if one.log else ""
            raise LearnerError(
                f"{name} cannot be searched from {one.low:g} to {one.high:g}; low must be below "
                f"high, and both finite{above}"
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
        FileError: If it is not a search space.
        LearnerError: If it does not fit the learner.
    """
    content = read_document(path).validate(SearchFile)
    ranges = {name: Range(one.low, one.high, one.log) for name, one in content.search.items()}
    return search_space(content.learner, ranges, content.fixed)


def read_settings(path: Path | str | None, given: Mapping[str, Any]) -> FitSettings:
    """Settings of a fit: those given, else the file's, else the defaults."""
    settings = read_document(path).validate(SearchFile).fit if path else FitSettings()
    return settings.model_copy(update={k: v for k, v in given.items() if v is not None})


@cache
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
        raise OpenLockError(f"{text!r} is not a range; write {FORM}")
    return name.strip(), Range(low, high, log=len(parts) == 3)


def parse_setting(text: str) -> tuple[str, Any]:
    """A setting as written on the command line: ``name=value``, the value as in a YAML file.

    Raises:
        OpenLockError: If it has another form.
    """
    name, equals, value = text.partition("=")
    if not equals or not value.strip():
        raise OpenLockError(f"{text!r} is not a setting; write name=value")
    return name.strip(), Document(f"value: {value}", "--fix").data["value"]


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

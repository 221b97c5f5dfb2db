"""Plans of fits: which parameters of a learner are searched, between what bounds, and how.

A plan is a YAML file; options of the command line can replace any part of it::

    learner: bayes
    fixed: {policy: thompson}
    search:
      forgetting: {low: 0.5, high: 0.95}
      concentration: {low: 1.0, high: 200.0, log: true}
    fit: {candidates: 120, hold_out: none, seed: 7}

``fixed`` holds parameters that are set and not searched; all others keep their defaults. Names and
bounds are checked against the learner's parameters before anything is played. ``fit`` has the
settings of :class:`FitSettings`, which are also what ``--set`` changes and what a fit stores.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from causal_openlock.contract.parameters import Count
from causal_openlock.contract.registry import is_ours, parameter_table, parse_parameters
from causal_openlock.errors import LearnerError, OpenLockError
from causal_openlock.experiment.declare import LearnerSpec
from causal_openlock.experiment.origin import origin_of
from causal_openlock.files.validation import Part, StrictModel, part, read
from causal_openlock.files.yaml_file import Document, read_document
from causal_openlock.scoring import LAPSE
from causal_openlock.version import RESULTS_VERSION
from causal_openlock.wording import joined, nearest

BUNDLED = Path(__file__).parent
FORM = "name=low:high, or name=low:high:log"

Chosen = Mapping[str, float]  #: a value for each parameter that is searched


@part()
class Range(Part):
    """The bounds of a parameter.

    ``log``: its logarithm is searched evenly; ``whole``: it takes whole numbers only.
    """

    low: float
    high: float
    log: bool = False
    whole: bool = False

    def share(self, value: float) -> float:
        """Position of a value between the bounds, from 0 to 1.

        >>> Range(1.0, 100.0, log=True).share(10.0)
        0.5
        """
        low, high, x = (np.log(v) if self.log else v for v in (self.low, self.high, value))
        return float((x - low) / (high - low))

    def at(self, share: float) -> int | float:
        """Value at a position between the bounds, from 0 to 1.

        >>> Range(0.0, 4.0).at(0.25), Range(1, 9, whole=True).at(0.3)
        (1.0, 3)
        """
        low, high = (np.log(v) if self.log else v for v in (self.low, self.high))
        value = low + (high - low) * float(share)
        value = float(np.exp(value)) if self.log else float(value)
        value = min(max(value, self.low), self.high)
        return round(value) if self.whole else value


class FitSettings(StrictModel):
    """Settings of a fit, whatever is searched: ``fit:`` in a plan, and ``--set``."""

    candidates: Count = 160  #: most sets of parameters to try; to means by default 60
    #: of the search and of play, with the next two; play what was fitted with another
    seed: Annotated[int, Field(ge=0, le=2**62)] = 31
    #: ``trials``, ``subjects`` or ``none``; to means ``transfer`` (the four tests) or ``none``
    hold_out: str = "trials"
    # To means:
    target: Literal["people", "model"] = "people"  #: whose means (the model's are of AAAI 2020)
    subjects: Annotated[int, Field(ge=2)] = 40  #: of a candidate, in each condition
    finalists: Count = 5  #: best candidates that play again; the closest is taken
    final_subjects: Annotated[int, Field(ge=2)] = 200  #: in each condition then, and in the end
    # To actions:
    of: list[str] = Field(default_factory=list)  #: whose subjects are fitted to; by default all
    each: bool = False  #: whether each subject is fitted by itself
    lapse: Annotated[float, Field(ge=0, le=1)] = LAPSE  #: share of actions taken to be random
    folds: Annotated[int, Field(ge=2, le=1000)] = 2  #: parts, of which each is held out once


@dataclass(frozen=True)
class Plan:
    """Which parameters of a learner are searched, which are set to a fixed value, and how."""

    learner: str
    fixed: Mapping[str, Any]
    ranges: Mapping[str, Range]
    fit: FitSettings = field(default_factory=FitSettings)

    def require_hold_out(self, known: Sequence[str]) -> None:
        """Raise OpenLockError unless what is held out is one of these."""
        if (out := self.fit.hold_out) not in known:
            raise OpenLockError(
                f"{out!r} cannot be held out of this fit (hold_out); {nearest(out, known)}"
            )

    @cached_property
    def code(self) -> dict[str, str]:
        """Code and files by learner; none of the toolkit's, which have their version.

        Once known it stays: what is fitted while files are edited was begun with the old ones.
        """
        lowest = self.parameters({name: bounds.low for name, bounds in self.ranges.items()})
        origin = origin_of(self.learner, lowest)
        code = f"{origin.package} {origin.artifact_hash}".strip()
        if is_ours(self.learner):  # a text may name a file
            named = any(isinstance(value, str) for value in lowest.values())
            code = origin.artifact_hash if named else ""
        return {self.learner: code} if code else {}

    def as_dict(self) -> dict[str, Any]:
        """All that determines what is fitted, as plain data."""
        ranges = {name: asdict(bounds) for name, bounds in self.ranges.items()}
        space = {"learner": self.learner, "fixed": dict(self.fixed), "search": ranges}
        if self.code:
            space["code"] = self.code
        return {"space": space, **self.fit.model_dump(), "version": RESULTS_VERSION}

    @property
    def in_words(self) -> str:
        """Form of the learner that is fitted: what is fixed, and what is chosen by default.

        >>> Plan("bayes", {"policy": "thompson"}, {}).in_words
        'bayes was fitted with policy thompson (fixed) and forgets everything (default).'
        """
        parts = [f"{name} {value} (fixed)" for name, value in self.fixed.items()]
        for info in parameter_table(self.learner):
            if isinstance(info.default, str) and info.name not in {*self.fixed, *self.ranges}:
                parts.append(f"{info.name} {info.default} (default)")
        return f"{self.learner} was fitted with {joined(parts) or 'its defaults'}."

    @property
    def fitted_name(self) -> str:
        """Name of the fitted learner in an experiment file."""
        return f"{self.learner.rpartition(':')[2]}_fitted"

    def entry(self, chosen: Chosen) -> dict[str, Any]:
        """The fitted learner, for an experiment file."""
        parameters = self.parameters(chosen)
        return {"learner": self.learner, "name": self.fitted_name, "parameters": parameters}

    def parameters(self, chosen: Chosen) -> dict[str, Any]:
        """All parameters that differ from the defaults, for a choice of those searched."""
        searched = {
            name: int(chosen[name]) if bounds.whole else float(chosen[name])
            for name, bounds in self.ranges.items()
        }
        return {**self.fixed, **searched}

    def spec(self, chosen: Chosen) -> LearnerSpec:
        """The learner with the parameters of a choice."""
        return LearnerSpec(learner=self.learner, parameters=self.parameters(chosen))

    def changed(self, ranges: Sequence[str], fixed: Sequence[str], settings: Sequence[str]) -> Plan:
        """This plan with what the command line has.

        Ranges given there replace all others; what is fixed there is added, and searched no more.

        Raises:
            OpenLockError: If they cannot be read, or do not fit the learner.
        """
        fix = dict(parse_setting(text, "--fix") for text in fixed)
        given = dict(parse_setting(text, "--set") for text in settings)
        wanted = dict(map(parse_range, ranges)) or {
            name: bounds for name, bounds in self.ranges.items() if name not in fix
        }
        kept = {name: value for name, value in self.fixed.items() if name not in wanted}
        fit = read(FitSettings, {**self.fit.model_dump(exclude_unset=True), **given})
        return make_plan(self.learner, wanted, {**kept, **fix}, fit)


def make_plan(
    learner: str,
    ranges: Mapping[str, Range],
    fixed: Mapping[str, Any] | None = None,
    fit: FitSettings | None = None,
) -> Plan:
    """A plan, checked.

    Raises:
        LearnerError: If a parameter is unknown, is not a number, is both fixed and searched, or has
            bounds that it cannot take.
    """
    fixed, checked = dict(fixed or {}), {}
    defaults = {info.name: info.default for info in parameter_table(learner)}
    numbers = [
        name
        for name, default in defaults.items()
        if isinstance(default, int | float) and not isinstance(default, bool)
    ]
    if not ranges:
        raise LearnerError(
            f"nothing is searched; give --plan, or --search {FORM}, for a number of {learner}: "
            f"{joined(numbers) or 'it has none'}"
        )
    for name, bounds in ranges.items():
        if name not in defaults:
            raise LearnerError(
                f"the learner {learner} has no parameter {name!r}; {nearest(name, defaults)}"
            )
        default, ends = defaults[name], (bounds.low, bounds.high)
        if name not in numbers:
            raise LearnerError(
                f"the parameter {name} of {learner} is not a number, so it cannot be searched; "
                f"fix it: {name}={default}"
            )
        if name in fixed:
            raise LearnerError(f"{name} is both fixed and searched; take one of them out")
        if not (-math.inf < ends[0] < ends[1] < math.inf) or (bounds.log and ends[0] <= 0):
            raise LearnerError(
                f"{name} cannot be searched from {ends[0]:g} to {ends[1]:g}; low must be below "
                "high and both finite, and of a logarithm above 0"
            )
        whole = isinstance(default, int)
        if whole and not all(end.is_integer() for end in ends):
            raise LearnerError(f"the bounds of {name} must be whole numbers, as {name} is one")
        checked[name] = replace(bounds, whole=whole)
    plan = Plan(learner, fixed, checked, fit or FitSettings())
    for share in (0, 1):
        corner = {name: bounds.at(share) for name, bounds in checked.items()}
        parse_parameters(learner, plan.parameters(corner))
    return plan


class PlanFile(StrictModel):
    """A plan as it is written."""

    learner: str
    fixed: dict[str, Any] = Field(default_factory=dict)
    search: dict[str, Range]
    fit: FitSettings = Field(default_factory=FitSettings)


def read_plan(path: Path | str) -> Plan:
    """A plan from a file.

    Raises:
        FileError: If it is not a plan.
        LearnerError: If it does not fit the learner.
    """
    content = read_document(path).validate(PlanFile)
    return make_plan(content.learner, content.search, content.fixed, content.fit)


@cache
def bundled_plan(learner: str) -> Plan | None:
    """The plan that comes with the toolkit, if there is one for the learner."""
    path = BUNDLED / f"{learner}.yaml"
    return read_plan(path) if learner.isidentifier() and path.is_file() else None


def parse_range(text: str) -> tuple[str, Range]:
    """A range as written on the command line: ``name=low:high`` or ``name=low:high:log``.

    Raises:
        OpenLockError: If it has another form.
    """
    name, equals, bounds = text.partition("=")
    low, high, *log = [*bounds.split(":"), ""]
    try:
        if equals and log in ([""], ["log", ""]):
            return name.strip(), Range(float(low), float(high), log=len(log) == 2)
    except ValueError:
        pass
    raise OpenLockError(f"{text!r} is not a range; write {FORM}")


def parse_setting(text: str, option: str) -> tuple[str, Any]:
    """A setting as written on the command line: ``name=value``, the value as in a YAML file.

    Raises:
        OpenLockError: If it has another form.
    """
    name, equals, value = text.partition("=")
    if not equals or not value.strip():
        raise OpenLockError(f"{text!r} is not a setting; write name=value")
    return name.strip(), Document(f"value: {value}", option).data["value"]

"""References to compare learners with, such as published people or people of one's own.

A reference has means of attempts in the trials of conditions, and says which learners are
comparable with it. It appears with these in every table and figure, and with no others.
Published results are registered as entry points, each a function that returns a reference::

    [project.entry-points."causal_openlock.references"]
    people = "my_package.my_people:people"

A results folder becomes one with :func:`reference_of`, for the people whom ``causal-openlock play``
or ``import`` put there, or, where there are no people, for its learners.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import CELL, Counts, count, judged, mean_by_trial
from causal_openlock.analysis.results.reading import Exclusion, read_results
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.declare import (
    HUMAN_PROTOCOL,
    PERSON,
    Condition,
    Experiment,
    LearnerSpec,
    Protocol,
)
from causal_openlock.experiment.plan import plan
from causal_openlock.files.atomic import folder_at
from causal_openlock.files.plugins import REFERENCES, loaded, registered
from causal_openlock.schemas.fsm import BoolArray
from causal_openlock.storage.store import Store
from causal_openlock.storage.stored import StoredExperiment
from causal_openlock.wording import counted, file_names

POINT = ["condition", "phase", "trial"]
"""Columns that identify the trials that a reference has means of."""

POINT_COLUMNS = [*POINT, "subjects", "mean", "se"]
"""Columns of :attr:`Reference.points`."""

Cells = Collection[tuple[str, str, str]]
"""Labels of learners, each with the names of a condition that it played and of its protocol."""


MOST_CHARACTERS = 60
"""Longest name of a reference."""
TAKEN = frozenset({
    "learner", "condition", "protocol", "phase", "trial", "loops", "subjects", "limit", "solved",
    "found", "solutions", "median", "attempts", "score", "best", "se", "difference", "ideal",
    "measured", "informed", "reference", "n", "ideal_observer", "share_solved", "ci_low",
    "ci_high", "mode", "at_mode", "human", "model", "people", "published_model", "interval",
})  # fmt: skip
"""Names that tables have already, in lower case with underscores."""


@dataclass(frozen=True, eq=False, repr=False)
class Reference:
    """Something that learners are compared with.

    Attributes:
        name: What tables and sentences call it: letters, digits, spaces and underscores.
        points: Means of attempts, a row for each ``condition``, ``phase`` and ``trial``, with
            ``subjects``, ``mean``, ``se`` (population SD / √n; NaN if it is not known) and perhaps
            ``share_solved``, without which all trials count as solved; perhaps no rows.
        comparable: Whether a learner did what the reference did in a condition.
        judged: The same of the trials that conditions are judged by, a test as trial 1; by default
            the points.
        title: What panels of figures call it; by default its name.
        detail: What it is, for small type: ``published``.
        source: Where it is from, as a paper cites it; by default its detail.
        prefix: What its columns begin with, as in ``human_attempts``; by default its name.
        in_leaderboard: Whether the leaderboard says how many attempts more each learner needs.
        categories: Outcomes of attempts, in blocks: ``condition``, ``phase``, ``block``,
            ``category``, ``count`` and ``until``, the attempts up to the end of the block.
        protocol: Protocol of comparable rows where a record is without its experiment, so that
            names of conditions must do.
        minutes: About how many minutes people took, in a ``baseline`` and in ``transfer``, where
            that is known.
    """

    name: str
    points: pd.DataFrame
    comparable: Callable[[LearnerSpec, Condition], bool]
    judged: pd.DataFrame | None = None
    title: str = ""
    detail: str = ""
    source: str = field(default="", kw_only=True)
    prefix: str = ""
    in_leaderboard: bool = True
    categories: pd.DataFrame | None = None
    protocol: str = HUMAN_PROTOCOL
    minutes: Mapping[str, float] = field(default_factory=dict, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "title", self.title or self.name)
        object.__setattr__(self, "prefix", self.prefix or re.sub(r"\W+", "_", self.name))
        if not (re.fullmatch(r"\w[\w ]*", self.name) and len(self.name) <= MOST_CHARACTERS):
            raise OpenLockError(
                f"a reference cannot be called {self.name[:80]!r}; a name has letters, digits, "
                f"spaces and underscores, {MOST_CHARACTERS} at most: give one as NAME=FOLDER"
            )
        if not re.fullmatch(r"\w+", self.prefix):
            raise OpenLockError(f"the columns of a reference cannot begin with {self.prefix!r}")
        _check_means(self.name, "points", self.points)
        if self.judged is not None:
            _check_means(self.name, "judged", self.judged)
            if not {*self.judged["condition"]} <= {*self.points["condition"]}:
                raise OpenLockError(
                    f"reference {self.name}: there are conditions judged without points"
                )

    def means(self, judged: bool) -> pd.DataFrame:
        """The reference's points, or the means of the trials that conditions are judged by."""
        return self.judged if judged and self.judged is not None else self.points

    def __repr__(self) -> str:
        """Name of the reference, and its number of means."""
        return f"<Reference {self.name}: {counted(len(self.points), 'mean')}>"

    def beside(self, experiment: Experiment | None) -> Beside:
        """Return the reference with the learners of an experiment that it is comparable with."""
        if experiment is None:
            return Beside(self, None)
        cells = frozenset(
            (spec.name, condition.name, spec.protocol.name)
            for spec in experiment.learners
            for condition in experiment.conditions
            if self.comparable(spec, condition)
        )
        return Beside(self, cells)


@dataclass(frozen=True, eq=False)
class Beside:
    """A reference, and the learners that it is comparable with.

    Attributes:
        reference: The reference.
        cells: Learners with conditions and protocols; None where names of conditions decide.
    """

    reference: Reference
    cells: Cells | None

    def stands(self, table: pd.DataFrame) -> BoolArray:
        """``[N]`` whether it is comparable with each row: its learner, condition and protocol."""
        if self.cells is None:
            found: BoolArray = (table["protocol"] == self.reference.protocol).to_numpy(dtype=bool)
            return found
        played = zip(*(table[name] for name in CELL), strict=True)
        return np.array([cell in self.cells for cell in played], dtype=bool)

    def columns(self, table: pd.DataFrame, judged: bool = False) -> dict[str, Any]:
        """``[N]`` mean and error for each row of a table of means, NaN where not comparable.

        Args:
            table: Rows with ``learner``, ``protocol`` and :data:`POINT`.
            judged: Whether rows are of the trials that conditions are judged by.
        """
        one = self.reference
        keys = pd.MultiIndex.from_arrays([table[column].astype(object) for column in POINT])
        beside, stands = one.means(judged).set_index(POINT).reindex(keys), self.stands(table)
        return {
            f"{one.prefix}_{column}": np.where(stands, beside[value].to_numpy(float), np.nan)
            for column, value in (("attempts", "mean"), ("se", "se"))
        }

    def solved(self, condition: str) -> float:
        """The share of trials solved where a condition is judged; 1 if it is not known."""
        means = self.reference.means(judged=True)
        own = means[means["condition"] == condition]
        known = "share_solved" in own and len(own)
        return float(own["share_solved"].iloc[-1]) if known else 1.0


def _check_means(name: str, what: str, means: pd.DataFrame) -> None:
    """Refuse means that are not in form."""
    if missing := [column for column in POINT_COLUMNS if column not in means]:
        raise OpenLockError(f"reference {name}: {what} lacks the column {missing[0]}")
    if means.duplicated(POINT).any():
        raise OpenLockError(f"reference {name}: {what} has a trial of a condition twice")
    numbers = means[["subjects", "mean", "se"]].apply(pd.to_numeric, errors="coerce")
    if numbers[["subjects", "mean"]].isna().any(axis=None) or (numbers["subjects"] < 1).any():
        raise OpenLockError(
            f"reference {name}: {what} needs a mean of at least one subject in every row"
        )


def references_beside(
    experiment: Experiment | None, given: Iterable[Reference] = ()
) -> tuple[Beside, ...]:
    """Return the registered and the given references, with the learners that each suits.

    Raises:
        OpenLockError: If two have the same name, or one has the name of a learner or of a column.
    """
    known = [*_registered(tuple(registered(REFERENCES).values()))]
    labels = {spec.name for spec in experiment.learners} if experiment else set()
    for one in given:
        key = one.prefix.lower()
        if key in TAKEN or key.endswith(("_p", "_low", "_high")) or one.name in labels:
            whose = "a learner is called that" if one.name in labels else "tables use that name"
            raise OpenLockError(
                f"a reference cannot be called {one.name}: {whose}; give another one: NAME=FOLDER"
            )
        if key in {other.prefix.lower() for other in known}:
            raise OpenLockError(
                f"two references are called {one.name}; give one another name: NAME=FOLDER"
            )
        known.append(one)
    return tuple(one.beside(experiment) for one in known)


@lru_cache(maxsize=4)
def _registered(entries: tuple[Any, ...]) -> tuple[Reference, ...]:
    return tuple(loaded(entry)() for entry in entries)


def with_references(
    table: pd.DataFrame, references: Sequence[Beside], judged: bool = False
) -> tuple[pd.DataFrame, list[str]]:
    """Return a table of mean ``attempts`` with the references of each row.

    Args:
        table: As :meth:`Beside.columns` takes it.
        references: Those without points are left out.
        judged: As there.

    Returns:
        The table with ``PREFIX_attempts`` and ``PREFIX_se`` of each reference and, of those in the
        leaderboard, the ``difference`` of attempts from them, which is ``PREFIX_difference`` of all
        but the first; and the names of these columns.
    """
    added: dict[str, Any] = {}
    for one in references:
        reference = one.reference
        if reference.points.empty:
            continue
        found = one.columns(table, judged)
        added |= found
        if name := difference_from(reference, references):
            added[name] = table["attempts"] - found[f"{reference.prefix}_attempts"]
    return table.assign(**added), list(added)


def difference_from(reference: Reference, references: Sequence[Beside]) -> str:
    """The column of differences from a reference; empty if it is not in the leaderboard."""
    leading = [one.reference for one in references if one.reference.in_leaderboard]
    if reference not in leading or reference.points.empty:
        return ""
    return "difference" if reference is leading[0] else f"{reference.prefix}_difference"


def gap_column(name: str) -> str:
    """Return the column of differences from a reference of that name, such as ``to_people``."""
    return "to_" + re.sub(r"\W+", "_", name)


def beside_any(table: pd.DataFrame, references: Sequence[Beside]) -> BoolArray:
    """``[N]`` whether any reference with means is comparable with each row."""
    stands = [one.stands(table) for one in references if not one.reference.points.empty]
    found: BoolArray = np.logical_or.reduce([np.zeros(len(table), bool), *stands])
    return found


ReferenceForm = Reference | Path | str
"""A reference, or a results folder, perhaps with a name: ``"mine=results/my_people"``."""


def find_references(
    forms: ReferenceForm | Sequence[ReferenceForm] | None, exclude: Exclusion | None = None
) -> tuple[Reference, ...]:
    """Return the references that are given, each as a reference or as a results folder.

    ``exclude`` is the rule by which people of folders are left out.

    Raises:
        OpenLockError: If a folder holds no results, or a name is none.
    """
    if forms is None:
        return ()
    single = isinstance(forms, Reference | Path | str)
    found: list[Reference] = []
    for form in [forms] if single else list(_several(forms)):
        if isinstance(form, Reference):
            found.append(form)
        elif isinstance(form, Path | str):
            found += reference_of(form, exclude)
        else:
            raise OpenLockError(f"a reference is a Reference or a results folder, not {form!r}")
    return tuple(found)


def _several(forms: Any) -> Iterable[Any]:
    return forms if isinstance(forms, Iterable) else [forms]


def reference_of(folder: Path | str, exclude: Exclusion | None = None) -> list[Reference]:
    """Return the people of a results folder as a reference; without people, each of its learners.

    A learner did what they did in a condition if its rooms have the same schemas in the same order,
    as many of them, under the same budgets. Where the levers stand makes no difference.

    Args:
        folder: The folder, perhaps with a name before it: ``"mine=results/people"``.
            Without, the folder's name is taken.
        exclude: The rule by which people are left out; ``detail`` says how many are.

    Raises:
        OpenLockError: If it holds no results, or the name is none.
    """
    name, found, place = str(folder).partition("=")
    if not found or "/" in name:
        name, place = "", str(folder)
    path = folder_at(place)
    record, experiment = read_results(Store(path), exclude=exclude)
    counts = count(record)
    people = [spec.name for spec in experiment.learners if spec.learner == PERSON]
    played = set(map(str, counts.trials["learner"].unique()))
    shown = [spec for spec in experiment.learners if spec.name in played]
    shown = [spec for spec in shown if spec.name in people] or shown
    if not shown:
        raise OpenLockError(f"{path} holds no results to compare with; play or import some first")
    if not name:
        name = re.sub(r"\W+", "_", path.resolve().name).strip("_")[:MOST_CHARACTERS] or "folder"
        name = f"own {name}" if name.lower() in TAKEN else name
    if len(shown) == 1:
        return [_of_learner(name, shown[0], experiment, counts)]
    parts = file_names(spec.name for spec in shown)
    return [_of_learner(f"{name} {parts[one.name]}", one, experiment, counts) for one in shown]


def _of_learner(
    name: str, spec: LearnerSpec, experiment: StoredExperiment, counts: Counts
) -> Reference:
    trials = counts.trials[counts.trials["learner"] == spec.name]
    blocks = counts.blocks[counts.blocks["learner"] == spec.name]
    played = {one.name: _played(one, spec.protocol) for one in experiment.conditions}
    out = experiment.excluded.get(spec.name)

    def comparable(other: LearnerSpec, condition: Condition) -> bool:
        known = played.get(condition.name)
        return known is not None and known == _played(condition, other.protocol)

    return Reference(
        name,
        _means(trials),
        comparable,
        _means(judged(trials)),
        detail=f"one's own, {out:,} who completed no trial left out" if out else "one's own",
        categories=blocks.astype({"condition": str, "phase": str}) if len(blocks) else None,
        protocol=spec.protocol.name,
    )


def _means(trials: pd.DataFrame) -> pd.DataFrame:
    means = mean_by_trial(trials, ["phase", "trial"]).astype({"condition": str, "phase": str})
    # Of one subject, or of several who all needed as many, the error is not known.
    means["se"] = means["se"].where(means["se"] > 0)
    return means[[*POINT_COLUMNS, "share_solved"]]


def _played(condition: Condition, protocol: Protocol) -> list[Any]:
    """The trials of a subject, each with its schema without its title, and the budgets."""
    budgets = (protocol.attempt_limit, protocol.stop_when_solved)
    visits = plan(condition, protocol, np.random.default_rng(0))
    return [
        budgets,
        *(
            (
                visit.phase,
                visit.loop,
                visit.trial,
                {**visit.schema.as_dict(), "title": ""},
                protocol.actions_for(visit.schema),
            )
            for visit in visits
        ),
    ]

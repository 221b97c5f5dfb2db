"""References to compare learners with, such as published people.

A reference has means of attempts in the trials of conditions, and says which learners are
comparable with it. It appears with these in every table and figure, and with no others.
Published results are registered as entry points, each a function that returns a reference::

    [project.entry-points."causal_openlock.references"]
    people = "my_package.my_people:people"
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import CELL
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.condition import Condition
from causal_openlock.experiment.declare import Experiment, LearnerSpec
from causal_openlock.files.plugins import REFERENCES, loaded, registered
from causal_openlock.schemas.fsm import BoolArray
from causal_openlock.wording import counted

POINT = ["condition", "phase", "trial"]  #: columns that identify what a mean is of
POINT_COLUMNS = [*POINT, "subjects", "mean", "se"]  #: columns of :attr:`Reference.points`
Cells = Collection[tuple[str, str, str]]
"""Labels of learners, each with the names of a condition that it played and of its protocol."""


@dataclass(frozen=True, eq=False, repr=False)
class Reference:
    """Something that learners are compared with."""

    name: str  #: what tables and sentences call it
    points: pd.DataFrame
    """Means of attempts, a row for each ``condition``, ``phase`` and ``trial``, with ``subjects``,
    ``mean``, ``se`` (population SD / √n; NaN if it is not known) and perhaps ``share_solved``,
    which is not known of all; perhaps no rows."""
    comparable: Callable[[LearnerSpec, Condition], bool]
    """Whether a learner did what the reference did in a condition."""
    title: str = ""  #: what panels of figures call it; by default its name
    detail: str = ""  #: what it is, for small type: ``published``
    source: str = field(default="", kw_only=True)  #: as a paper cites it; by default its detail
    prefix: str = ""  #: what its columns begin with, as in ``human_attempts``; by default its name
    in_leaderboard: bool = True  #: whether it has a row, and learners a difference from it
    categories: pd.DataFrame | None = None
    """Outcomes of attempts, in blocks: ``condition``, ``phase``, ``block``, ``category``, ``count``
    and ``until``, the attempts up to the end of the block."""
    minutes: Mapping[str, float] = field(default_factory=dict, kw_only=True)
    """About how many minutes people took, in a ``baseline`` and in ``transfer``, where known."""
    cells: Cells = field(default=frozenset(), kw_only=True)
    """What it is comparable with of an experiment; see :meth:`within`."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "title", self.title or self.name)
        object.__setattr__(self, "prefix", self.prefix or re.sub(r"\W+", "_", self.name))
        if missing := [column for column in POINT_COLUMNS if column not in self.points]:
            raise OpenLockError(f"reference {self.name}: points lack the column {missing[0]}")
        if self.points.duplicated(POINT).any():
            raise OpenLockError(f"reference {self.name}: points have a trial of a condition twice")

    def __repr__(self) -> str:
        """Name of the reference, and its number of means."""
        return f"<Reference {self.name}: {counted(len(self.points), 'mean')}>"

    def within(self, experiment: Experiment) -> Reference:
        """Return it with the learners of an experiment that it is comparable with, ``cells``."""
        cells = frozenset(
            (spec.name, condition.name, spec.protocol.name)
            for spec in experiment.learners
            for condition in experiment.conditions
            if self.comparable(spec, condition)
        )
        return replace(self, cells=cells)

    def stands(self, table: pd.DataFrame) -> BoolArray:
        """``[N]`` whether it is comparable with each row: its learner, condition and protocol."""
        played = zip(*(table[name] for name in CELL), strict=True)
        return np.array([cell in self.cells for cell in played], dtype=bool)

    def columns(self, table: pd.DataFrame) -> dict[str, Any]:
        """``[N]`` mean and error for each row of a table of means, NaN where not comparable.

        Rows have ``learner``, ``protocol`` and :data:`POINT`.
        """
        keys = pd.MultiIndex.from_arrays([table[column].astype(object) for column in POINT])
        beside, stands = self.points.set_index(POINT).reindex(keys), self.stands(table)
        return {
            f"{self.prefix}_{column}": np.where(stands, beside[value].to_numpy(float), np.nan)
            for column, value in (("attempts", "mean"), ("se", "se"))
        }

    def solved(self, condition: str) -> float:
        """The share of trials solved where a condition is judged; NaN if it is not known."""
        own = self.points[self.points["condition"] == condition].reindex(columns=["share_solved"])
        return float(own["share_solved"].iloc[-1]) if len(own) else np.nan


def references_of(experiment: Experiment) -> tuple[Reference, ...]:
    """Return the registered references, with the learners of an experiment that each suits."""
    known = _made(tuple(registered(REFERENCES).values()))
    return tuple(one.within(experiment) for one in known)


@lru_cache(maxsize=4)  # once a process, however many results are opened
def _made(entries: tuple[Any, ...]) -> tuple[Reference, ...]:
    return tuple(loaded(entry)() for entry in entries)


def gap_column(name: str) -> str:
    """Return the column of differences from a reference of that name, such as ``to_people``."""
    return "to_" + re.sub(r"\W+", "_", name)

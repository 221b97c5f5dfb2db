"""Results in memory: what every table, figure and section is made of.

A record is counted once (:func:`~causal_openlock.analysis.measures.count`); what is compared with
it follows from the experiment: references where learners did what these did, and the attempts of
the ideal observer wherever they are known.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import Counts, count, ordered
from causal_openlock.analysis.results.bounds import Bounds, ideal_bounds
from causal_openlock.analysis.results.references import Reference, references_of
from causal_openlock.analysis.results.summary import headline, summarise
from causal_openlock.experiment.declare import PERSON
from causal_openlock.storage.store import StoredExperiment

if TYPE_CHECKING:
    import pyarrow as pa

T = TypeVar("T")


@dataclass(frozen=True)
class Material:
    """A record, and what was computed from it."""

    record: pa.Table  #: columns as in :func:`causal_openlock.experiment.record.record_schema`
    experiment: StoredExperiment  #: what was run
    trials: pd.DataFrame
    """From :func:`~causal_openlock.analysis.measures.attempts_to_solve`; their learners are
    categories in the order of ``learners``."""
    learners: tuple[str, ...]  #: labels in the order in which they are shown
    references: tuple[Reference, ...]  #: what learners are compared with, and which of them
    bounds: Bounds  #: what the ideal observer needs
    folders: tuple[Path, ...] = ()  #: the results folders that it was read from
    counted: Counts | None = None  #: what is counted in the record, if it is there already

    def __post_init__(self) -> None:
        names = ordered(self.trials["learner"].unique(), self.learners)
        learner = pd.Categorical(self.trials["learner"], list(names))
        object.__setattr__(self, "trials", self.trials.assign(learner=learner))

    def __getattribute__(self, name: str) -> Any:
        """Hand out copies of tables and mappings: who changes one does not change the results."""
        found = super().__getattribute__(name)
        if name.startswith("_"):
            return found
        if isinstance(found, pd.DataFrame):
            return found.copy(deep=False)  # its values are copied where they are changed
        if isinstance(found, Counts):
            return Counts(*(table.copy(deep=False) for table in found))
        return dict(found) if isinstance(found, dict) else found

    @classmethod
    def of(
        cls, record: pa.Table, experiment: StoredExperiment, folders: tuple[Path, ...] = ()
    ) -> Self:
        """The results of an experiment: its learners in its order, people before them.

        Raises:
            StoreError: If the record has attempts missing or twice.
        """
        counts = count(record)
        specs = sorted(experiment.learners, key=lambda spec: spec.learner != PERSON)
        learners = ordered(counts.trials["learner"], [spec.name for spec in specs])
        references, bounds = references_of(experiment), ideal_bounds(experiment)
        return cls(record, experiment, counts.trials, learners, references, bounds, folders, counts)

    @property
    def conditions(self) -> tuple[str, ...]:
        """Names of the conditions in the order in which they are shown."""
        return tuple(condition.name for condition in self.experiment.conditions)

    @cached_property
    def people(self) -> tuple[str, ...]:
        """Labels of people that learners are compared with; none where nobody else played."""
        kinds = {spec.name: spec.learner for spec in self.experiment.learners}
        people = tuple(name for name in self.learners if kinds.get(name) == PERSON)
        return () if people == self.learners else people

    @property
    def leading(self) -> list[Reference]:
        """References that the leaderboard has."""
        return [one for one in self.references if one.in_leaderboard and len(one.points)]

    @property
    def trained_before(self) -> dict[str, float]:
        """Attempts of training before the experiment, by learner, where there was any.

        NaN where nobody knows, as of a language model. A record may have learners that its
        experiment lacks; nothing is known of their training.
        """
        attempts = {spec.name: spec.origin.prior_attempts for spec in self.experiment.learners}
        return {
            name: float("nan") if number is None else number
            for name, number in attempts.items()
            if number != 0
        }

    def compared(self, trials: pd.DataFrame) -> pd.DataFrame:
        """The rows of a table with which any reference is comparable."""
        stands = [one.stands(trials) for one in self.references if len(one.points)]
        return trials[np.logical_or.reduce([np.zeros(len(trials), bool), *stands])]

    def once(self, compute: Callable[[Material], T]) -> T:
        """Return what a function computes from these results; it is called the first time alone.

        A topic, its figure and the tables of the results share numbers so. Nobody may change them.
        """
        if compute not in self._computed:
            self._computed[compute] = compute(self)
        found: T = self._computed[compute]
        return found

    @cached_property
    def _computed(self) -> dict[Callable[..., Any], Any]:
        return {}

    @cached_property
    def counts(self) -> Counts:
        """Trials, and attempts of each category by blocks of training."""
        return self.counted or count(self.record)

    @cached_property
    def summary(self) -> pd.DataFrame:
        """A row for each trial of a condition; see :func:`~.summary.summarise`."""
        return summarise(self.counts.trials, self.references, self.bounds)

    @cached_property
    def headline(self) -> pd.DataFrame:
        """A row for each learner in each condition; see :func:`~.summary.headline`."""
        return headline(self.counts.trials, self.references, self.bounds)

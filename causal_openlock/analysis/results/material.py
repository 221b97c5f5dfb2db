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
from typing import Any, Self, TypeVar

import numpy as np
import pandas as pd
import pyarrow as pa

from causal_openlock.analysis.measures import (
    CELL,
    by_subject,
    count,
    judged,
    mean_by_trial,
    ordered,
)
from causal_openlock.analysis.results.bounds import Bounds, ideal_bounds
from causal_openlock.analysis.results.references import Reference, references_of
from causal_openlock.analysis.statistics import mean_intervals
from causal_openlock.experiment.declare import PERSON
from causal_openlock.storage.store import StoredExperiment

T = TypeVar("T")
SUMMARY_COLUMNS = (
    *(*CELL, "phase", "trial", "loops", "subjects"),
    *("attempts", "se", "ci_low", "ci_high", "mode", "at_mode", "share_solved"),
)  #: first columns of a summary; those of references and ``ideal_attempts`` follow


@dataclass(frozen=True)
class Material:
    """A record, and what was computed from it."""

    record: pa.Table  #: columns as in :func:`causal_openlock.experiment.record.record_schema`
    experiment: StoredExperiment  #: what was run
    all_trials: pd.DataFrame  #: trials of the record, learners in the order of the alphabet
    blocks: pd.DataFrame  #: its attempts of each category by blocks of training
    learners: tuple[str, ...]  #: labels in the order in which they are shown
    references: tuple[Reference, ...]  #: what learners are compared with, and which of them
    bounds: Bounds  #: what the ideal observer needs
    folders: tuple[Path, ...] = ()  #: the results folders that it was read from

    def __getattribute__(self, name: str) -> Any:
        """Hand out copies of tables and mappings: who changes one does not change the results."""
        found = super().__getattribute__(name)
        if name.startswith("_"):
            return found
        if isinstance(found, pd.DataFrame):
            return found.copy(deep=False)  # its values are copied where they are changed
        return dict(found) if isinstance(found, dict) else found

    @classmethod
    def of(
        cls, record: pa.Table, experiment: StoredExperiment, folders: tuple[Path, ...] = ()
    ) -> Self:
        """The results of an experiment: its learners in its order, people before them.

        Raises:
            StoreError: If the record has attempts missing or twice.
        """
        trials, blocks = count(record)
        specs = sorted(experiment.learners, key=lambda spec: spec.learner != PERSON)
        learners = ordered(trials["learner"], [spec.name for spec in specs])
        references, bounds = references_of(experiment), ideal_bounds(experiment)
        return cls(record, experiment, trials, blocks, learners, references, bounds, folders)

    @cached_property
    def trials(self) -> pd.DataFrame:
        """From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.

        Learners are categories in the order of ``learners``.
        """
        trials = self.all_trials
        names = ordered(trials["learner"].unique(), self.learners)
        return trials.assign(learner=pd.Categorical(trials["learner"], list(names)))

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
    def summary(self) -> pd.DataFrame:
        """Every trial of every condition, with references and the ideal observer.

        A protocol with loops visits a trial number many times; a subject's visits are averaged
        first, so a row is about one trial number over all loops, and every subject counts once.

        One row for each ``learner``, ``condition``, ``protocol``, ``phase`` and ``trial``, with

        - ``loops``: visits that were averaged (the most of any subject).
        - ``subjects``: how many.
        - ``attempts``: mean attempts to solve the trial; an unsolved trial counts as the limit.
        - ``se``: population SD / √subjects, as the paper's error bars.
        - ``ci_low``, ``ci_high``: 95% interval (Student's) over subjects; NaN for fewer than five,
          or where 90% of them have one value.
        - ``mode``, ``at_mode``: the most common value of subjects, and how many have it.
        - ``share_solved``: share of visits in which every solution was found, from 0 to 1.
        - ``human_attempts``, ``human_se``: people's, as published; NaN where there are none.
        - ``difference``: ``attempts`` minus ``human_attempts``.
        - ``model_attempts``, ``model_se``: the published model's, where people's are.
        - ``NAME_attempts``, ``NAME_se``, ``NAME_difference``: the same of each further reference;
          a difference only from those in the leaderboard.
        - ``ideal_attempts``: what the ideal observer needs, which knows the schema; NaN if that is
          not known.
        """
        table, added = self._means(self.all_trials)
        return table.rename(columns={"visits": "loops"})[[*SUMMARY_COLUMNS, *added]]

    @cached_property
    def headline(self) -> pd.DataFrame:
        """The result of each learner in each condition.

        One row for each ``learner``, ``protocol`` and ``condition``, with ``measured`` (such as
        ``trial 5`` or ``test``), ``subjects``, ``attempts``, ``ci_low``, ``ci_high``, ``mode``,
        ``at_mode``, ``share_solved``, the columns of references and ``ideal_attempts`` as in
        :attr:`summary`.
        """
        table, added = self._means(judged(self.all_trials))
        first = ["learner", "protocol", "condition"]
        trial = "trial " + table["trial"].astype(str)
        table = table.assign(measured=trial.where(table["phase"] != "test", "test"))
        table = table.sort_values(first, kind="stable", ignore_index=True)
        first += ["measured", "subjects", "attempts"]
        return table[[*first, "ci_low", "ci_high", "mode", "at_mode", "share_solved", *added]]

    def _means(self, trials: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
        """The means of each trial, and the columns of references and the ideal observer."""
        by = ["phase", "trial"]
        means = mean_by_trial(trials, by).rename(columns={"mean": "attempts"})
        intervals = mean_intervals(by_subject(trials, by), [*CELL, *by], "attempts")
        table = means.assign(**intervals[["ci_low", "ci_high", "mode", "at_mode"]])
        added: dict[str, Any] = {}
        for one in self.references:
            if len(one.points):
                added |= one.columns(table)
            if one in self.leading:
                name = "difference" if one is self.leading[0] else f"{one.prefix}_difference"
                added[name] = table["attempts"] - added[f"{one.prefix}_attempts"]
        keys = table[["condition", "protocol", "phase"]].astype(str).itertuples(index=False)
        added["ideal_attempts"] = np.array([self.bounds.get(tuple(key), np.nan) for key in keys])
        return table.assign(**added), list(added)

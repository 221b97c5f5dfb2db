"""What an analysis hands to the report: a section of text, tables and plots, as data.

The report lays sections out and knows nothing of what is in them. Their sentences come from a
template (:mod:`~causal_openlock.analysis.report.prose`); their tables become HTML on the page, CSV
and LaTeX beside it (:mod:`~causal_openlock.analysis.report.table_files`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import pandas as pd
from matplotlib.figure import Figure

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.results.bounds import Bounds
from causal_openlock.analysis.results.people.published import Pairs
from causal_openlock.experiment.experiment import Experiment

if TYPE_CHECKING:
    import pyarrow as pa


@dataclass(frozen=True)
class Material:
    """What every section is made of.

    Attributes:
        record: Columns as in :func:`causal_openlock.experiment.record.record_schema`.
        experiment: What was run.
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`; their learners
            are categories in the order of ``learners``.
        learners: Labels in the order in which they are shown.
        pairs: Which learners in which conditions compare with people.
        bounds: What the ideal observer needs.
    """

    record: pa.Table
    experiment: Experiment
    trials: pd.DataFrame
    learners: tuple[str, ...]
    pairs: Pairs
    bounds: Bounds

    def __post_init__(self) -> None:
        names = ordered(self.trials["learner"].unique(), self.learners)
        learner = pd.Categorical(self.trials["learner"], list(names))
        object.__setattr__(self, "trials", self.trials.assign(learner=learner))


@dataclass(frozen=True)
class SectionTable:
    """A table that is shown, and kept as a file.

    Attributes:
        name: File name without ending.
        title: What it is.
        frame: Its values as they were computed, unrounded; columns are headed by their names.
        formats: How to print a column (``.2f``, ``+.2f``, ``.1%``, ``,``); others as text.
        caption: What a reader needs to know, in whole sentences.
    """

    name: str
    title: str
    frame: pd.DataFrame
    formats: Mapping[str, str] = field(default_factory=dict)
    caption: str = ""


@dataclass(frozen=True)
class SectionPlot:
    """A figure that is shown, and kept as files.

    Attributes:
        name: File name without ending: lower-case letters, digits and underscores.
        title: A heading.
        caption: What is seen, and what the error bars are.
        figure: The figure.
    """

    name: str
    title: str
    caption: str
    figure: Figure


@dataclass(frozen=True)
class Section:
    """A part of the report.

    Attributes:
        name: Anchor within the page; letters, digits and underscores.
        title: Its heading.
        text: Paragraphs that say what was found, in plain words.
        tables: Shown after the text.
        plots: Shown after the tables.
    """

    name: str
    title: str
    text: tuple[str, ...] = ()
    tables: tuple[SectionTable, ...] = ()
    plots: tuple[SectionPlot, ...] = ()

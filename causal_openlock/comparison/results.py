"""The results of a comparison: tables, plots and the report of one or more results folders."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import CELL, SUBJECT, VISIT
from causal_openlock.analysis.report.warnings import not_applicable, warnings_of
from causal_openlock.analysis.results.by_condition import condition_tables
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.missing import missing_cells
from causal_openlock.analysis.results.reading import Exclusion, read_results, together
from causal_openlock.analysis.table import Table
from causal_openlock.errors import StoreError
from causal_openlock.experiment.making import LearnerForm, listed
from causal_openlock.files.atomic import folder_at, is_empty, move_into, unwritable
from causal_openlock.storage.folder_lock import LOCK
from causal_openlock.storage.store import Store
from causal_openlock.wording import counted
from causal_openlock.world.room import action_names, positions_for

if TYPE_CHECKING:
    from causal_openlock.analysis.report.methods import Methods
    from causal_openlock.analysis.report.writing import Report
    from causal_openlock.comparison.plotting import Plots
    from causal_openlock.scoring.scores import Scores

SUBJECTS = [*CELL, *SUBJECT]  #: columns that identify a subject
ROOM = [*VISIT, "schema", "layout"]  #: columns that identify a trial of a subject, and its room


def _table_of(topic: str, about: str, name: str = "") -> cached_property[pd.DataFrame]:
    """A table of results, computed by the function of a topic with its name, or with this one."""
    name = name or topic

    def table(results: Results) -> pd.DataFrame:
        # Topics draw, and what draws takes half a second to load.
        module = import_module(f"causal_openlock.analysis.topics.{topic}")
        found: pd.DataFrame = results.once(getattr(module, name))
        return found

    table.__doc__ = f"{about} See :func:`causal_openlock.analysis.topics.{topic}.{name}`."
    return cached_property(table)


@dataclass(frozen=True, repr=False, eq=False)
class Results(Material):
    """The results of a comparison, read from one or more folders.

    A notebook shows the table of attempts, people next to learners that played the same, and below
    it the warnings. Tables are pandas data frames, in tidy form.

    Example:
        >>> from causal_openlock import compare
        >>> results = compare("CC4", ["oracle"], subjects=2, workers=1)
        >>> results.trials[["subject", "trial", "attempts", "solved"]].head(2).values.tolist()
        [[0, 1, 3, True], [0, 2, 3, True]]
    """

    @classmethod
    def read(cls, *folders: Path | str, exclude: Exclusion | None = None) -> Results:
        """The results in these folders together; see :func:`open_results`."""
        found = [read_results(Store(folder), exclude) for folder in folders]
        return cls.of(*together(found), tuple(Path(folder).resolve() for folder in folders))

    # -- tables ---------------------------------------------------------------------------------

    leaderboard = _table_of("leaderboard", "A row for each learner and protocol.")
    pairs = _table_of("pairwise", "Additional attempts of one learner next to another.", "pairs")
    transfer = _table_of("transfer", "What training saves in each transfer condition.")
    regret = _table_of("regret", "Worth of each attempt, by the ideal observer.")
    structure_recovery = _table_of(
        "structure_recovery", "Distance of what subjects believed from the structure of each room."
    )

    @property
    def by_condition(self) -> list[Table]:
        """Attempts in each condition, a table for each protocol."""
        return condition_tables(self)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Warnings to read before believing the numbers, a sentence each.

        Few subjects, trials that were not solved and count as the limit, cells that are missing.
        """
        warnings = *not_applicable(self.experiment.reasons), *warnings_of(self)
        if missing := missing_cells(self.experiment):
            number = f"{counted(len(missing), 'cell')} of {len(self.experiment.files)} missing"
            warnings = f"{number}: {missing[0].text}{'; ...' if missing[1:] else ''}.", *warnings
        return warnings

    @cached_property
    def attempts(self) -> pd.DataFrame:
        """A row for each attempt, in the order of time.

        Columns: the subject (``learner``, ``condition``, ``protocol``, ``experiment``, ``seed``,
        ``subject``); the trial (``phase``, ``loop``, ``trial``, ``schema``, ``layout``); the
        number of the ``attempt`` in the trial, from 1; whether the door was ``unlocked`` and
        ``opened``; the index of the ``solution`` that opened it (-1 for none), and whether it is a
        ``new_solution``; ``solutions_found`` in the trial so far, of all ``solutions``; the
        sum of the actions' ``reward``; the ``category`` of its outcome; and ``wall_time``, the
        seconds since its cell began.
        """
        return self._whole.drop(columns=["actions", "moved"])

    @cached_property
    def actions(self) -> pd.DataFrame:
        """A row for each action, in the order of time.

        Columns: the subject, the trial and the ``attempt``, as in :attr:`attempts`; the number of
        the ``action`` in the attempt, from 1; its ``action_index`` in the action space; its
        ``name``, such as ``push_UPPER``; and whether it ``moved`` something.
        """
        whole = self._whole
        lengths = whole["actions"].map(len).to_numpy()
        rows = whole.loc[whole.index.repeat(lengths), [*SUBJECTS, *ROOM, "attempt"]]
        index = np.concatenate([*whole["actions"]]).astype(int)
        names = np.full(len(rows), "", object)
        for condition in self.experiment.conditions:
            own = (rows["condition"] == condition.name).to_numpy()
            known = np.array(action_names(max(map(positions_for, condition.schemas))), object)
            names[own] = known[index[own]]
        return rows.reset_index(drop=True).assign(
            action=np.arange(len(rows)) - np.repeat(np.cumsum(lengths) - lengths, lengths) + 1,
            action_index=index,
            name=names,
            moved=np.concatenate([*whole["moved"]]).astype(bool),
        )

    def sweep(self, parameter: str | None = None) -> pd.DataFrame:
        """Results by the value of a parameter, the numbers of ``results.plot.sweep``.

        See :func:`~causal_openlock.analysis.plots.sweep.sweep_table`.
        """
        from causal_openlock.analysis.plots.sweep import sweep_table

        return sweep_table(self, parameter)

    @cached_property
    def _whole(self) -> pd.DataFrame:
        """The record in the order of :attr:`trials`, with its names."""
        whole = self.record.to_pandas()
        for name in [*SUBJECTS, *ROOM]:
            known = self.trials[name]
            whole[name] = whole[name].astype(known.dtype)
            if isinstance(known.dtype, pd.CategoricalDtype):
                # pandas takes categories in another order for the same.
                whole[name] = whole[name].cat.reorder_categories(known.cat.categories)
        return whole.sort_values([*SUBJECTS, *VISIT, "attempt"], ignore_index=True)

    @cached_property
    def scores(self) -> Scores:
        """Scores of learners on these subjects, as ``causal-openlock score`` stored them.

        See :func:`~causal_openlock.scoring.scores.scores_on_record`.
        """
        from causal_openlock.scoring.scores import scores_on_record

        return scores_on_record(self)

    def score(self, learners: LearnerForm | Sequence[LearnerForm] = (), **options: Any) -> Scores:
        """Let learners predict every action of these subjects: who predicts best?

        Arguments, errors and an example: :func:`~causal_openlock.fitting.predicting.score_folder`.
        """
        from causal_openlock.fitting.predicting import score_folder

        if len(self.folders) != 1:
            raise StoreError("score the results of one folder at a time")
        return score_folder(self.folders[0], learners, **options)

    @property
    def plot(self) -> Plots:
        """Plots of the results: ``results.plot.attempts()`` and so on."""
        from causal_openlock.comparison.plotting import Plots

        return Plots(self)

    # -- what is made of them -------------------------------------------------------------------

    def report(self, folder: Path | str | None = None, figures: bool = False) -> Report:
        """Write the report; a notebook shows its page.

        Args:
            folder: Where to write it; by default into the results folder, or, of results from
                several folders, into a temporary one.
            figures: Whether every figure is also written as PDF (``figures/``), and
                every table as CSV and LaTeX (``tables/``).

        Raises:
            OpenLockError: If it cannot be written.
        """
        from causal_openlock.analysis.report.writing import make_report

        if folder is None:
            several = len(self.folders) != 1
            folder = tempfile.mkdtemp(prefix="report-") if several else self.folders[0]
        return make_report(self, folder, figures=figures)

    def methods(self) -> Methods:
        """Return the paragraphs for one's paper: what was compared, and how.

        See :func:`~causal_openlock.analysis.report.methods.methods`.
        """
        from causal_openlock.analysis.report.methods import methods

        return methods(self)

    def save(self, folder: Path | str) -> Path:
        """Copy the results into a folder of their own, where they stay.

        Raises:
            StoreError: If the folder is a file, holds something already or cannot be written to, or
                the results are from several folders.
        """
        folder = folder_at(folder).resolve()
        if len(self.folders) != 1:
            raise StoreError(
                "these results are from several folders; save each by itself, then read them "
                "together: open_results(one, another)"
            )
        if self.folders[0] in folder.parents:
            raise StoreError(f"{folder} is inside the results; choose a folder next to them")
        if not is_empty(folder):
            raise StoreError(f"{folder} is there already; choose another name")
        try:
            folder.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".saving-") as beside_it:
                copied = Path(beside_it) / folder.name
                shutil.copytree(self.folders[0], copied, ignore=shutil.ignore_patterns(LOCK))
                move_into(copied, folder)
        except OSError as error:
            raise unwritable(folder, error) from None
        object.__setattr__(self, "folders", (folder,))
        return folder

    def __add__(self, other: Results) -> Results:
        """Join two sets of results in one table.

        Raises:
            StoreError: If they cannot be compared: a learner or a condition has two meanings.
        """
        if not isinstance(other, Results):
            return NotImplemented
        titles = dict.fromkeys(one.experiment.title for one in (self, other))
        first = replace(self.experiment, title=", and ".join(titles))
        both = together([(self.record, first), (other.record, other.experiment)])
        return self.of(*both, self.folders + other.folders)

    def __repr__(self) -> str:
        """The leaderboard as text, and the warnings."""
        from causal_openlock.comparison.console import Terminal, print_leaderboard

        text = StringIO()
        plain = {"force_terminal": False, "force_jupyter": False, "no_color": True}
        print_leaderboard(self.leaderboard, Terminal(file=text, width=100, **plain))
        return "\n".join([text.getvalue().strip(), *self.warnings])


def open_results(
    folder: Path | str,
    *others: Path | str,
    beside: Path | str | Sequence[Path | str] = (),
    exclude: Exclusion | None = None,
) -> Results:
    """The results in a folder that :func:`compare` or the command line wrote.

    Args:
        folder: The folder.
        *others: Further ones, whose results are in the same table.
        beside: The same: a folder, or several, such as that of one's own people. Where learners
            are in the results, people stand where the paper's do, and learners are compared with
            them.
        exclude: ``"completed no trial"`` leaves out the people who did, as the paper does;
            warnings and methods say how many.

    Raises:
        StoreError: If a folder holds no results, one is damaged, nobody is left, or they cannot be
            compared.
    """
    places = map(folder_at, (folder, *others, *listed(beside)))
    return Results.read(*places, exclude=exclude)

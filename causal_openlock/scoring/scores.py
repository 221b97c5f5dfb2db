"""Scores of learners: bits per action, by subject and over all subjects.

A learner that knows nothing predicts each of A actions with 1/A, which is log2 A bits an action.
The bits that a better learner saves measure what it knows. Subjects are the unit: a learner's score
is the mean of subjects, and two learners are compared on the same subjects.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from causal_openlock.analysis.effects import Group, weighted_difference
from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.statistics import mean_intervals
from causal_openlock.contract.learner import Account
from causal_openlock.errors import OpenLockError, StoreError, in_short
from causal_openlock.experiment.condition import SHOWN
from causal_openlock.experiment.declare import Experiment
from causal_openlock.files.atomic import write_bytes, write_text
from causal_openlock.files.checksums import ChecksumError, read_table, table_bytes
from causal_openlock.files.escaping import csv_of
from causal_openlock.scoring.model_selection import Selection, select_models
from causal_openlock.scoring.recorded import ATTEMPT, GROUP, record_digest
from causal_openlock.storage.store import Store
from causal_openlock.wording import joined, nearest
from causal_openlock.world.room import action_names, positions_for

SUBJECT = [*GROUP, "subject"]
LN2 = float(np.log(2.0))
COLUMNS = {
    "scored": "string",
    **dict.fromkeys(GROUP[:-1], "string"),
    **dict.fromkeys(("seed", "subject", "trial", "attempt", "action", "action_index"), "int64"),
    **dict.fromkeys(("log_probability", "standard_error", "entropy", "highest"), "double"),
    **dict.fromkeys(("impossible", "at_limit"), "bool"),
    "price": "double",
}
"""Columns of scores of actions in their file, with their types."""
RECORD = b"causal_openlock.record"
"""Where the file has the digest of the record that was scored: subjects may be played again."""
FOLDER, ACTIONS = "scores", "actions.parquet"  #: folder and file of scores in a results folder
BY_SUBJECT, FOLLOWED = "subjects.csv", "followed.csv"
"""Files derived from the scores, for other programs; nothing here reads them."""
TRANSCRIPTS = "transcripts.jsonl"  #: what a learner that speaks was asked; the report reads it


@dataclass(frozen=True)
class Scores:
    """Scores of learners on recorded subjects."""

    #: a row for each action and learner, see
    #: :func:`~causal_openlock.scoring.teacher_forcing.score_part`; all else follows
    actions: pd.DataFrame
    #: by condition, among how many actions subjects choose; empty where the experiment is not known
    choices: Mapping[str, int] = field(default_factory=dict)
    #: digest of what was scored, from :func:`~causal_openlock.scoring.recorded.record_digest`
    record: str = ""
    #: what learners say of their predictions; empty in stored scores
    accounts: tuple[Account, ...] = ()

    @cached_property
    def subjects(self) -> pd.DataFrame:
        """The score of each learner on each subject.

        A row for each ``scored`` learner and subject: how many ``actions``; ``nll``, the negative
        log-likelihood in nats, and its ``standard_error`` (0 where it is exact); ``bits`` per
        action; ``expected``, the bits per action that it would need for its own actions; ``bic``,
        with the price of parameters that were chosen to fit the subject; ``impossible``, how many
        actions it would never do; and ``at_limit``, for how many draws stopped before a hit.
        """
        table = (
            self.actions.assign(
                nll=-self.actions["log_probability"], variance=self.actions["standard_error"] ** 2
            )
            .groupby(["scored", *SUBJECT], observed=True, sort=False)
            .agg(
                actions=("nll", "size"),
                nll=("nll", "sum"),
                standard_error=("variance", "sum"),
                expected=("entropy", "mean"),
                impossible=("impossible", "sum"),
                at_limit=("at_limit", "sum"),
                bic=("price", "first"),
            )
            .reset_index()
        )
        return table.assign(
            standard_error=np.sqrt(table["standard_error"]),
            expected=table["expected"] / LN2,
            bits=table["nll"] / table["actions"] / LN2,
            bic=table["bic"] + 2.0 * table["nll"],
        )

    @cached_property
    def ranking(self) -> pd.DataFrame:
        """The learners, the one that predicts best first.

        A row for each ``scored`` learner: ``subjects``, the mean ``bits`` per action with its 95%
        interval ``low`` and ``high``; ``worse``, how much more it needs than the best, on the same
        subjects, with its interval ``worse_low`` and ``worse_high`` and the ``p`` of a paired test
        (NaN of the best, and where one cannot do what was done); and ``best_of``, for how many
        subjects none is better.

        Raises:
            OpenLockError: If no subject was scored by all of them.
        """
        wide = self._by_learner("bits")
        if wide.empty:
            raise OpenLockError(
                "none of these subjects was scored by all of these learners; score all subjects "
                "with the same learners"
            )
        means = wide.mean().sort_values(kind="stable")
        best = means.index[0]
        rows = []
        for name in means.index:
            more = _interval(wide[name] - wide[best]) if name != best else [np.nan] * 4
            best_of = int((wide[name] == wide.min(axis=1)).sum())
            rows.append((name, len(wide), *_interval(wide[name])[:3], *more, best_of))
        columns = ["scored", "subjects", "bits", "low", "high", "worse", "worse_low", "worse_high"]
        return pd.DataFrame(rows, columns=[*columns, "p", "best_of"])

    @cached_property
    def followed(self) -> pd.DataFrame:
        """Frequencies of learners, if each subject follows one.

        A row for each ``scored`` learner: its expected ``frequency`` among subjects, its
        ``exceedance`` probability and the ``protected`` one. They are those of
        :func:`~causal_openlock.scoring.model_selection.select_models`, with -BIC/2 for the log
        evidence; a learner that never does what a subject did is taken to be very unlikely for it.
        """
        selection = self._selection
        return pd.DataFrame(
            {
                "scored": self._evidence.columns,
                "frequency": selection.frequencies,
                "exceedance": selection.exceedance,
                "protected": selection.protected,
            }
        )

    @cached_property
    def attributed(self) -> pd.DataFrame:
        """The learner that each subject follows, if each follows one.

        A row for each subject: the learner that it most probably ``follows`` and the
        ``probability`` that it does, in the light of how frequent learners are among all; and how
        far its evidence, as :attr:`followed` takes it, is ``ahead`` of the best of the others, in
        nats (negative where another one is more frequent; NaN if there is no other).
        """
        evidence, probabilities = self._evidence, self._selection.followed
        best = probabilities.argmax(axis=1)
        is_best = np.eye(len(evidence.columns), dtype=bool)[best]
        ahead = evidence.to_numpy()[is_best] - evidence.mask(is_best).max(axis=1).to_numpy()
        return evidence.index.to_frame(index=False).assign(
            follows=evidence.columns[best], probability=probabilities[is_best], ahead=ahead
        )

    @cached_property
    def _evidence(self) -> pd.DataFrame:
        """-BIC/2 by subject, and learner that predicts it."""
        return (-0.5 * self._by_learner("bic")).clip(lower=-1e6)

    @cached_property
    def _selection(self) -> Selection:
        """Who follows whom, from :attr:`_evidence`."""
        return select_models(self._evidence.to_numpy(float))

    def _by_learner(self, column: str) -> pd.DataFrame:
        """A number by subject that all learners predict, and learner."""
        wide = self.subjects.set_index([*SUBJECT, "scored"])[column].unstack()
        return wide[list(dict.fromkeys(self.subjects["scored"]))].dropna()

    def of(self, learner: str) -> Scores:
        """Scores of the subjects of one learner."""
        return replace(self, actions=self.actions[self.actions["learner"] == learner])

    def by_subject(self, *columns: str) -> pd.DataFrame:
        """Mean ``bits`` and ``expected``, and actions ``done``, of each subject in each part."""
        table = self.actions.assign(
            bits=-self.actions["log_probability"] / LN2,
            expected=self.actions["entropy"] / LN2,
            done=1,
        )
        each = table.groupby([*dict.fromkeys(["scored", *columns, *SUBJECT])], observed=True)
        return each.agg({"bits": "mean", "expected": "mean", "done": "sum"}).reset_index()

    def over(self, *columns: str) -> pd.DataFrame:
        """Scores on parts of what was done, such as each trial; subjects count alike.

        Args:
            columns: What distinguishes the parts: ``trial``, ``attempt``, ...

        Returns:
            A row for each ``scored`` learner and part: the mean ``bits`` per action, with its 95%
            interval over subjects, ``ci_low`` and ``ci_high``; what the learner itself
            ``expected`` to need (NaN where it gives no probabilities); of how many ``actions`` of
            how many ``subjects``. What one does that the learner takes for impossible needs
            infinitely many, and has no interval.
        """
        by, own = ["scored", *columns], self.by_subject(*columns)
        found = own.groupby(by, observed=True).agg(
            subjects=("bits", "size"), actions=("done", "sum"), bits=("bits", "mean"),
            expected=("expected", "mean"),
        )  # fmt: skip
        known = own[np.isfinite(own.groupby(by, observed=True)["bits"].transform("max"))]
        return found.reset_index().merge(mean_intervals(known, by, "bits"), on=by, how="left")

    def plot(
        self, *, of: str | None = None, learners: Sequence[str] | None = None, ax: Any = None
    ) -> Any:
        """Draw how many bits per action learners need in each trial; the fewer, the better.

        A panel for each condition, a line for each learner that predicts, the one that predicts
        best first; with at most four a band is the 95% interval over subjects. Thin lines
        are subjects, and the dotted one is what a learner that knows nothing needs. A trial in
        which a subject did what a learner takes for impossible has no point.

        Args:
            of: Label of the learner whose subjects are predicted; by default the first.
            learners: Labels of those that predict; by default all.
            ax: As for :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.

        Raises:
            OpenLockError: If one is not in the scores.
        """
        from causal_openlock.scoring.figure import draw_scores

        whose = str(self.actions["learner"].iloc[0]) if of is None else of
        for column, asked in (("learner", [whose]), ("scored", learners or ())):
            known = self.actions[column].astype(str).unique()
            for name in asked:
                if name not in known:
                    raise OpenLockError(f"{name} is not in these scores; {nearest(name, known)}")
        own = self.of(whose)
        ranked = own.ranking["scored"].astype(str)
        names = [name for name in ranked if learners is None or name in learners]
        parts = "condition", "trial"
        return draw_scores(own.over(*parts), own.by_subject(*parts), names, self.choices, ax)

    @classmethod
    def read(cls, folder: Path) -> Scores:
        """The scores that :meth:`save` wrote into a folder.

        Raises:
            StoreError: If there are none, they are damaged or have gaps, or another version made
                them.
        """
        path = folder / ACTIONS
        try:
            table = read_table(path.read_bytes())
        except (OSError, ChecksumError) as error:
            why = "there is none" if isinstance(error, FileNotFoundError) else in_short(error)
            raise StoreError(
                f"{path}: cannot be read ({why}); remove it, and score the subjects: "
                f"causal-openlock score {folder.parent} --learner NAME"
            ) from None
        known = {field.name: str(field.type) for field in table.schema}
        record = (table.schema.metadata or {}).get(RECORD, b"").decode(errors="replace")
        actions = table.replace_schema_metadata(None).to_pandas()
        gaps = actions.drop(columns=["entropy", "highest"], errors="ignore").isna().any(axis=None)
        if known != COLUMNS or not record or actions.empty or gaps:
            raise StoreError(
                f"{path} is not whole, or was not made by this version; score the subjects again"
            )
        return cls(actions, record=record)

    def fault(self, record: pa.Table, experiment: Experiment) -> str:
        """Say what is wrong with these scores, if a record is what was scored; else nothing.

        Each action of the subjects has to have exactly one row for each learner.
        """
        if self.record != record_digest(record, experiment, set(self.actions["learner"])):
            return "they are of other actions than those on record"
        done = record.select([*SUBJECT, "phase", "actions"]).to_pandas()
        done = done[done["phase"] != SHOWN].astype(dict.fromkeys(GROUP[:-1], str))
        lengths = done["actions"].map(len).groupby([done[name] for name in SUBJECT]).sum()
        scored = self.subjects.set_index(SUBJECT)["actions"]
        places = ["scored", *SUBJECT, "trial", "attempt", "action"]
        whole = scored.eq(lengths.reindex(scored.index)).all()
        whole &= not self.actions.duplicated(places).any()
        return "" if whole else "some actions are not there, or twice"

    def save(self, folder: Path) -> list[Path]:
        """Write ``actions.parquet``, ``subjects.csv``, ``followed.csv``, what was said; say where.

        Raises:
            OSError: If they cannot be written.
        """
        files = [folder / ACTIONS, folder / BY_SUBJECT, folder / FOLLOWED]
        schema = pa.schema([(name, pa.type_for_alias(kind)) for name, kind in COLUMNS.items()])
        table = pa.Table.from_pandas(self.actions[[*COLUMNS]], schema, preserve_index=False)
        write_bytes(files[0], table_bytes(table, {RECORD: self.record.encode()}))
        write_text(files[1], csv_of(self.subjects.round(6)))
        write_text(files[2], csv_of(self.attributed.round(6)))
        said = [line for account in self.accounts for part in account.transcripts for line in part]
        if said or (folder / TRANSCRIPTS).exists():
            lines = [json.dumps(line, default=int) + "\n" for line in said]
            write_text(folder / TRANSCRIPTS, "".join(lines))
        return files


def choices_in(experiment: Experiment) -> dict[str, int]:
    """Number of actions among which a subject chooses, by condition."""
    return {
        one.name: len(action_names(max(map(positions_for, one.schemas))))
        for one in experiment.conditions
    }


def stored_scores(material: Material) -> tuple[Scores | None, list[str]]:
    """Read the scores in the folders of results.

    Returns:
        The scores, None without any; and a sentence on each part that is left out, as its subjects
        have been played again since, or cannot be compared.
    """
    parts, notes = [], []
    for folder in material.folders:
        if not (folder / FOLDER).is_dir():
            continue
        stored = Store(folder).record(ATTEMPT)
        try:
            scores = Scores.read(folder / FOLDER)
            why = scores.fault(*stored)
        except StoreError:
            why = "this version cannot read them"
        if not why:
            parts.append(scores)
            continue
        notes.append(f"The scores in {folder.name}/{FOLDER} are left out: {why}. Score these "
                     "subjects again.")  # fmt: skip
    if not parts:
        return None, notes
    record = parts[0].record if len(parts) == 1 else ""
    actions = pd.concat([scores.actions for scores in parts], ignore_index=True)
    scores = Scores(actions, choices_in(material.experiment), record)
    learners = ordered(actions["learner"].unique(), material.learners)
    by_learner = {name: scores.of(name) for name in learners}
    if apart := [name for name in learners if by_learner[name]._by_learner("bits").empty]:
        notes.append(
            f"Scores of the subjects of {joined(apart)} are left out: none of these subjects was "
            "scored by all of the learners that scored some. Score all subjects with the same "
            "learners."
        )
    whole = [own.actions for name, own in by_learner.items() if name not in apart]
    return replace(scores, actions=pd.concat(whole)) if whole else None, notes


def scores_on_record(results: Material) -> Scores:
    """Scores of learners on these subjects, as ``causal-openlock score`` stored them.

    Raises:
        StoreError: If they were not scored as they are on record, or the scores are damaged.
    """
    scores, notes = stored_scores(results)
    if scores is None:
        where = results.folders[0] if results.folders else "FOLDER"
        why = " ".join(notes) or "these subjects are not scored"
        raise StoreError(
            f"{why.rstrip('.')}; do it with: causal-openlock score {where} "
            "--learner NAME, or in Python results.score(NAMES)"
        )
    for note in notes:
        warnings.warn(note, stacklevel=4)
    return scores


def _interval(column: pd.Series[float]) -> tuple[float, float, float, float]:
    """Mean, both ends of its interval and p of numbers of subjects; NaN where one is infinite."""
    values = column.to_numpy(float)
    if not np.isfinite(values).all():
        return float(values.mean()), np.nan, np.nan, np.nan
    return weighted_difference([Group.of(values)])

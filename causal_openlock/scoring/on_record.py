"""Scores in a results folder that belong to the actions on record there.

Subjects can be played again, with other parameters or other code, and the scores stay where they
were. So each score carries a digest of what its subject did and met; those of other actions are
left out, and the report says so.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property

import pandas as pd

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.results.material import Material
from causal_openlock.errors import StoreError
from causal_openlock.scoring.score_table import COLUMNS, PLAYED, OutdatedError
from causal_openlock.scoring.scores import FOLDER, SUBJECT, Scores, choices_in
from causal_openlock.scoring.teacher_forcing import ATTEMPT, digests_of, setting_of
from causal_openlock.storage.store import Store
from causal_openlock.wording import counted, joined

_KEY = {name: (int if name in ("seed", "subject") else str) for name in SUBJECT}


@dataclass(frozen=True)
class OnRecord:
    """Scores of the actions on record.

    Attributes:
        scores: The scores, or None if there are none.
        notes: A sentence on each part that is left out, and on learners that predict with other
            settings than those with which they played.
    """

    scores: Scores | None = None
    notes: tuple[str, ...] = ()

    @cached_property
    def each(self) -> dict[str, Scores]:
        """Scores of the subjects of each learner, by its label."""
        if self.scores is None:
            return {}
        return {name: self.scores.of(name) for name in self.scores.actions["learner"].unique()}


def scores(results: Material) -> Scores:
    """Scores of learners on these subjects, as ``causal-openlock score`` stored them.

    Scores of subjects who have been played again since are left out, with a warning.

    Raises:
        StoreError: If they were not scored as they are on record, or the scores are damaged.
    """
    found = scores_on_record(results)
    if found.scores is None:
        where = results.folders[0] if results.folders else "FOLDER"
        why = " ".join(found.notes) or "these subjects are not scored"
        raise StoreError(
            f"{why.rstrip('.')}; do it with: causal-openlock score {where} "
            "--learner NAME, or in Python results.score(NAMES)"
        )
    for note in found.notes:
        warnings.warn(note, stacklevel=4)
    return found.scores


def scores_on_record(material: Material) -> OnRecord:
    """The scores in the folders of results, of the subjects that are on record.

    Raises:
        StoreError: If they are damaged.
    """
    parts, notes = [], []
    for folder in material.folders:
        if not (folder / FOLDER).is_dir():
            continue
        try:
            actions = Scores.read(folder / FOLDER).actions
        except OutdatedError:
            notes.append(
                "The scores in this folder are left out: an earlier version made them, and they do "
                "not say of which actions they are. Score these subjects again."
            )
            continue
        record, experiment = Store(folder).record(ATTEMPT)
        now = digests_of(record.to_pandas(), experiment).astype(_KEY)
        known = actions.merge(now.rename(columns={PLAYED: "now"}), on=SUBJECT)
        stale = known[PLAYED] != known["now"]
        if stale.any():
            gone = known[stale].drop_duplicates(SUBJECT)["learner"].value_counts(sort=False)
            of = [f"{counted(many, 'subject')} of {name}" for name, many in gone.items()]
            notes.append(
                f"Scores of {joined(of)} are left out: they are of other actions than those on "
                "record. Score these subjects again."
            )
        parts.append(known[~stale][COLUMNS])
    found = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=COLUMNS)
    if apart := [str(name) for name, own in found.groupby("learner") if not _compared(own)]:
        notes.append(
            f"Scores of the subjects of {joined(apart)} are left out: none of these subjects was "
            "scored by all of the learners that scored some. Score all subjects with the same "
            "learners."
        )
        found = found[~found["learner"].isin(apart)]
    if found.empty:
        return OnRecord(None, tuple(notes))

    settings = {one.name: setting_of(one) for one in material.experiment.learners}
    who = found[["scored", "setting"]].drop_duplicates()
    played = who["scored"].map(settings)
    for name in who["scored"][played.notna() & (played != who["setting"])].unique():
        notes.append(
            f"{name} predicts with another code, version or settings than it played with here."
        )
    choices = choices_in(material.experiment)
    if (found["action_index"] >= found["condition"].map(choices)).any():
        raise StoreError("the scores hold an action that there is not; score the subjects again")
    names = ordered(found["learner"].unique(), material.learners)
    order = found["learner"].map({name: place for place, name in enumerate(names)})
    found = found.loc[order.sort_values(kind="stable").index]
    return OnRecord(Scores(found.reset_index(drop=True), choices), tuple(notes))


def _compared(actions: pd.DataFrame) -> bool:
    """Whether there is a subject that is scored by all learners that score any subject."""
    by_whom = actions.groupby(SUBJECT)["scored"].nunique()
    return bool(by_whom.max() == actions["scored"].nunique())

"""Cost of language models, and the number of their answers that were not actions.

All that was said is in the transcripts of a results folder; a line for each subject has the counts.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import pandas as pd
from pydantic import BaseModel, Field, NonNegativeInt, ValidationError

from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.missing import beginnings
from causal_openlock.analysis.section import Section
from causal_openlock.analysis.topic import Topic
from causal_openlock.storage.store import Store

_PROSE = Prose(__name__)
_CELL = ["learner", "condition"]
_SILENT = "unanswered actions"


class _Counts(BaseModel):
    """Counts in the first line of a subject's transcript, which anybody may have written."""

    answers: NonNegativeInt
    tokens: tuple[NonNegativeInt, NonNegativeInt]
    latency: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    faults: dict[str, NonNegativeInt]
    unanswered: NonNegativeInt
    unreadable: NonNegativeInt

    def row(self) -> dict[str, float]:
        """The counts by column of the table."""
        asked, answered = self.tokens
        return {
            "answers": self.answers,
            "tokens of questions": asked,
            "tokens of answers": answered,
            "seconds": self.latency,
            "no action": sum(self.faults.values()),
            _SILENT: self.unanswered,
            "unreadable structures": self.unreadable,
        }


def section(material: Material) -> Section | None:
    """Answers, tokens and seconds; None where nothing was said."""
    table = _counted(material)
    if table.empty:
        return None
    groups = table.groupby(_CELL, sort=False)
    shown = groups.sum()
    shown.insert(0, "subjects", groups.size())
    by_learner = table.groupby("learner", sort=False)[_SILENT].sum()
    return _PROSE.section(
        "language_models",
        [_PROSE.table("language_models", shown.reset_index(), dict.fromkeys(shown, ",.0f"))],
        silent=by_learner[by_learner > 0].to_dict(),
    )


def _counted(material: Material) -> pd.DataFrame:
    """A row for each subject that spoke."""
    known = beginnings(material.experiment)
    rows = []
    for store in map(Store, material.folders):
        for file in material.experiment.files:
            path = store.transcript(Path(file))
            if path.is_file() and (names := known.get(file.rsplit("_", 2)[0])):
                learner, condition, _ = names
                cell = {"learner": learner, "condition": condition}
                rows += [{**cell, **counts.row()} for counts in _counts(path)]
    return pd.DataFrame(rows)


def _counts(path: Path) -> Iterator[_Counts]:
    with path.open("rb") as file:
        for line in file:
            try:
                yield _Counts.model_validate_json(line)
            except ValidationError:
                continue  # what was said


TOPIC = Topic("language_models", 60, section)

"""Cost of language models, their answers that were not actions, and their preference for letters.

All that was said is in the transcripts of results and of their scores; a line a subject has counts.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Annotated, TypeVar

import pandas as pd
from pydantic import BaseModel, Field, NonNegativeInt, StringConstraints, ValidationError

from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.missing import beginnings
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Section, Topic
from causal_openlock.storage.store import Store
from causal_openlock.wording import counted

M = TypeVar("M", bound=BaseModel)
Share = Annotated[float, Field(ge=0, le=1)]
_COLUMNS = [
    *("learner", "condition", "answers", "tokens of questions", "tokens of answers", "seconds"),
    *("no action", "unanswered actions", "unreadable structures"),
]


class _Counts(BaseModel):
    """Counts in the first line of a subject's transcript, which anybody may have written."""

    answers: NonNegativeInt
    tokens: tuple[NonNegativeInt, NonNegativeInt]
    latency: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    faults: dict[str, NonNegativeInt]
    unanswered: NonNegativeInt
    unreadable: NonNegativeInt


class _Letters(BaseModel):
    """Mean probability of each letter, and of other answers, in such a line."""

    scored: str
    letters: dict[Annotated[str, StringConstraints(pattern="^[A-Z]$")], Share]
    missing: Share


def section(material: Material) -> Section | None:
    """Answers, tokens and seconds, and the mean of letters; None where nothing was said."""
    table, letters = _counted(material), _letters(material)
    if table.empty:
        return Section("language_models", "Language models", (), letters) if letters else None
    groups = table.groupby(["learner", "condition"], sort=False)
    shown = groups.sum()
    shown.insert(0, "subjects", groups.size())
    silent = table.groupby("learner", sort=False)["unanswered actions"].sum()
    lost = [f"{counted(many, 'action')} of {name}" for name, many in silent.items() if many]
    text = ["All that was said is in the folder transcripts of these results, and their bundle."]
    if lost:
        text.append(
            "Some answers were not actions, though they were asked for again, and the action was "
            f"spent on what changes nothing: {', '.join(lost)}. How these learners fare says as "
            "much about how they were asked as about what they know."
        )
    caption = (
        "Sums over subjects. Seconds: how long answers took, most of them side by side; no action: "
        "answers that were malformed, refused or out of range; unreadable structures: answers to "
        "which lever enables which."
    )
    title = "What was asked and answered"
    formats = {"seconds": ",.0f"}
    counts = Table("language_models", title, shown.reset_index(), formats, caption)
    return Section("language_models", "Language models", tuple(text), (counts, *letters))


def _counted(material: Material) -> pd.DataFrame:
    """A row for each subject that spoke."""
    known = beginnings(material.experiment)
    rows = []
    for store, file in product(map(Store, material.folders), material.experiment.files):
        if cell := known.get(file.rsplit("_", 2)[0]):
            for one in _lines(store.transcript(Path(file)), _Counts):
                faults = sum(one.faults.values()), one.unanswered, one.unreadable
                rows.append((*cell[:2], one.answers, *one.tokens, one.latency, *faults))
    return pd.DataFrame(rows, columns=_COLUMNS)


def _letters(material: Material) -> tuple[Table, ...]:
    """How likely scored models found each letter, whatever it stood for; empty without any."""
    rows = []
    for folder in material.folders:
        for one in _lines(folder / "scores" / "transcripts.jsonl", _Letters):
            about = {"learner": one.scored, "actions": len(one.letters), "missing": one.missing}
            rows.append({**about, **one.letters})
    if not rows:
        return ()
    groups = pd.DataFrame(rows).groupby(["learner", "actions"], sort=False)
    means = groups.mean()
    means.insert(0, "subjects", groups.size())
    caption = (
        "Models that were scored were asked for the letter of their next action. What a letter "
        "stands for is drawn for each subject: with many subjects, and no preference for a letter, "
        "all have about the same mean. Means over subjects. Missing: the probability of other "
        "answers, before those of letters were divided by their sum."
    )
    formats = dict.fromkeys(means.columns[1:], ".0%")
    title = "Mean probability by letter"
    return (Table("letters", title, means.reset_index(), formats, caption),)


def _lines(path: Path, kind: type[M]) -> Iterator[M]:
    """The lines of a transcript that are of a kind; all others are what was said."""
    if path.is_file():
        with path.open("rb") as file:  # line by line: what was said can be long
            for line in file:
                with suppress(ValidationError):
                    yield kind.model_validate_json(line)


TOPIC = Topic("language_models", 60, section)

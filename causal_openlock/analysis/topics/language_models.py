"""Cost of language models, their answers that were not actions, and their preference for letters.

All that was said is in the transcripts of results and of their scores; a line a subject has counts.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Annotated

import pandas as pd
from pydantic import BaseModel, Field, NonNegativeInt, StringConstraints, ValidationError

from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.missing import beginnings
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Section, Topic
from causal_openlock.storage.store import Store
from causal_openlock.wording import counted

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
        path, cell = store.transcript(Path(file)), known.get(file.rsplit("_", 2)[0], ())
        if cell and path.is_file():
            rows += [(*cell[:2], *counts) for counts in _counts(path)]
    return pd.DataFrame(rows, columns=_COLUMNS)


def _counts(path: Path) -> Iterator[tuple[float, ...]]:
    """What was counted of each subject of a transcript, in the order of the columns."""
    with path.open("rb") as file:
        for line in file:
            with suppress(ValidationError):  # what was said
                said = _Counts.model_validate_json(line)
                faults = sum(said.faults.values()), said.unanswered, said.unreadable
                yield (said.answers, *said.tokens, said.latency, *faults)


def _letters(material: Material) -> tuple[Table, ...]:
    """How likely scored models found each letter, whatever it stood for; empty without any."""
    rows = []
    for folder in material.folders:
        path = folder / "scores" / "transcripts.jsonl"
        for line in path.read_bytes().splitlines() if path.is_file() else ():
            with suppress(ValidationError):  # what was said
                said = _Letters.model_validate_json(line)
                of = {"learner": said.scored, "actions": len(said.letters)}
                rows.append({**of, "missing": said.missing, **said.letters})
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


TOPIC = Topic("language_models", 60, section)

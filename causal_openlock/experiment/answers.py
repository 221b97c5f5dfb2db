"""Participants' answers to the structure question: a table next to the record.

It is in ``structures/``, a file of the same name as the person's in ``cells/``, with a row for
every pair of levers that the person was asked about, and whether they said that one enables the
other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from causal_openlock.errors import StoreError
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.checksums import ChecksumError, read_table, table_bytes

if TYPE_CHECKING:
    import pyarrow as pa

FOLDER = "structures"


@dataclass(frozen=True)
class Answer:
    """A subject's answer about the structure of a room.

    Attributes:
        learner: Label of who answers.
        condition: Name of the condition.
        subject: Number of the subject.
        visit: Number of the trial in the whole condition, from 1.
        levers: Positions of the levers that they were asked about.
        edges: Pairs of a lever and what it enables, by position; the door is after the last one.
        time: Seconds since the person joined.
    """

    learner: str
    condition: str
    subject: int
    visit: int
    levers: tuple[int, ...]
    edges: frozenset[tuple[int, int]]
    time: float


def answers_schema() -> pa.Schema:
    """The columns of a table of answers, each with its meaning."""
    import pyarrow as pa

    columns: list[tuple[str, Any, str]] = [
        ("learner", pa.string(), "label of who answers, as in the record"),
        ("condition", pa.string(), "name of the condition, as in the record"),
        ("subject", pa.int32(), "number of the person in this condition, as in the record"),
        ("visit", pa.int32(), "number of the trial in the whole condition, from 1"),
        ("cause", pa.int16(), "position of a lever, from 0"),
        ("effect", pa.int16(), "position of another; the number of positions is the door"),
        ("enables", pa.bool_(), "whether they said that the one enables the other"),
        ("time", pa.float64(), "seconds since the person joined, by the server's clock"),
    ]
    return pa.schema(
        [pa.field(name, kind, metadata={"meaning": text}) for name, kind, text in columns]
    )


def write_answers(path: Path, answers: Sequence[Answer], door: int) -> None:
    """Store one person's answer; ``door`` is the number of positions."""
    import pyarrow as pa

    rows = [
        {**vars(one), "cause": cause, "effect": effect, "enables": (cause, effect) in one.edges}
        for one in answers
        for cause in one.levers
        for effect in (*one.levers, door)
        if cause != effect
    ]
    names = answers_schema().names
    table = [{name: row[name] for name in names} for row in rows]
    write_bytes(path, table_bytes(pa.Table.from_pylist(table, schema=answers_schema())))


def read_answers(folder: Path | str) -> list[Answer]:
    """Participants' answers in a results folder; none if they were not asked.

    Raises:
        StoreError: If a file cannot be read.
    """
    import pyarrow as pa

    found = []
    for path in sorted((Path(folder) / FOLDER).glob("*.parquet")):
        try:
            table = read_table(path.read_bytes()).cast(answers_schema()).to_pandas()
            if table.isna().any(axis=None):
                raise ValueError("values are missing")
            if (table[["cause", "effect"]] < 0).any(axis=None):
                raise ValueError("positions are below 0")
        except (OSError, ChecksumError, pa.ArrowException, ValueError) as error:
            raise StoreError(
                f"{path} is damaged ({' '.join(str(error).split())[:120]}); start play with this "
                "folder and stop it: it is made again from the log"
            ) from None
        for (learner, condition, subject, visit), own in table.groupby(
            ["learner", "condition", "subject", "visit"], sort=False
        ):
            said = own[own["enables"]]
            pairs = zip(said["cause"].tolist(), said["effect"].tolist(), strict=True)
            levers = tuple(sorted(own["cause"].unique().tolist()))
            time = float(own["time"].iloc[0])
            found.append(
                Answer(learner, condition, int(subject), int(visit), levers, frozenset(pairs), time)
            )
    return found

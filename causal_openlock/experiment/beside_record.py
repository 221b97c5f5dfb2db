"""Tables of a person next to the record: reaction times, and answers to the structure question.

The record has a row for every attempt and is the same for people and learners. How long a person
took over an action stands in ``reactions/``, and what they said of the structure of a room in
``structures/``, in a file of the same name as theirs in ``cells/``. Reaction times also hold the
attempts of a trial that is not over yet, which a record does not.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import pyarrow as pa

from causal_openlock.errors import StoreError
from causal_openlock.experiment.record import schema_of
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.checksums import ChecksumError, read_table, table_bytes

REACTIONS, STRUCTURES = "reactions", "structures"  #: the folders of these tables

_WHO = (
    ("condition", "string", "name of the condition, as in the record"),
    ("subject", "int32", "number of the person in this condition, as in the record"),
    ("visit", "int32", "number of the trial in the whole condition, from 1"),
)
_TIME = ("time", "double", "seconds since the person joined, by the server's clock")


def reactions_schema() -> pa.Schema:
    """The columns of a table of reaction times, each with its meaning."""
    return schema_of(
        *_WHO,
        ("attempt", "int32", "number of the attempt within the trial, from 1"),
        ("moment", "int32", "number of the action within the attempt, from 1"),
        ("action", "uint8", "what was done, by action index"),
        ("moved", "bool", "whether it moved something"),
        ("reaction", "double", "seconds from when the person could act to the click"),
        _TIME,
    )


def write_reactions(
    path: Path, condition: str, subject: int, actions: Iterable[Mapping[str, Any]]
) -> None:
    """Store a person's actions, each a row of the table with ``attempt_over``.

    It lacks who acted, and which action of its attempt it is.
    """
    rows, moment = [], 0
    for action in actions:
        moment += 1
        rows.append({"condition": condition, "subject": subject, "moment": moment, **action})
        moment *= not action["attempt_over"]
    _write(path, rows, reactions_schema())


def unwritten_actions(log: Path) -> int:
    """Number of actions in a log of ``play`` that the tables of its folder lack."""
    done: dict[int, int] = {}  # by person, once they have left the practice room
    for text in log.read_bytes().splitlines() if log.exists() else ():
        with suppress(ValueError, RecursionError):  # play says what is wrong
            match json.loads(text.partition(b"\t")[0]):
                case {"join": int(person), "practice": False}:
                    done[person] = 0
                case {"of": int(person), "action": int()}:
                    if person in done:
                        done[person] += 1
                case {"of": int(person), "turn": _, **said} if said.get("edges") is None:
                    done[person] = 0
    written = 0
    for path in (log.parent / REACTIONS).glob("*.parquet"):
        with suppress(OSError, ChecksumError):
            written += read_table(path.read_bytes(), ["action"]).num_rows
    return max(0, sum(done.values()) - written)


def read_reactions(folder: Path | str) -> pa.Table:
    """The reaction times of all people in a results folder, in the order of their numbers.

    Raises:
        StoreError: If the folder has none, or a file cannot be read.
    """
    if not any((Path(folder) / REACTIONS).glob("*.parquet")):
        raise StoreError(f"{folder} holds no reaction times; give the folder that play wrote to")
    order = [(name, "ascending") for name in ("condition", "subject", "time")]
    return _read(folder, REACTIONS, reactions_schema()).sort_by(order)


def answers_schema() -> pa.Schema:
    """The columns of a table of answers: a row for every pair of levers that was asked about."""
    return schema_of(
        ("learner", "string", "label of who answers, as in the record"),
        *_WHO,
        ("cause", "uint16", "position of a lever, from 0"),
        ("effect", "uint16", "position of another; the number of positions is the door"),
        ("enables", "bool", "whether they said that the one enables the other"),
        _TIME,
        nullable=False,
    )


def write_answers(path: Path, answers: Sequence[Mapping[str, Any]]) -> None:
    """Store one person's answers, each a row of :func:`answers_schema`."""
    _write(path, answers, answers_schema())


def read_answers(folder: Path | str) -> pa.Table:
    """Participants' answers in a results folder, by :func:`answers_schema`; no rows without any.

    Raises:
        StoreError: If a file cannot be read.
    """
    return _read(folder, STRUCTURES, answers_schema())


def _write(path: Path, rows: Sequence[Mapping[str, Any]], schema: pa.Schema) -> None:
    write_bytes(path, table_bytes(pa.Table.from_pylist([*rows], schema=schema)))


def _read(folder: Path | str, name: str, schema: pa.Schema) -> pa.Table:
    """The rows of all people in a folder."""
    tables = [schema.empty_table()]
    for path in sorted((Path(folder) / name).glob("*.parquet")):
        try:
            tables.append(read_table(path.read_bytes()).cast(schema))
        except (OSError, ChecksumError, pa.ArrowException, ValueError) as error:
            raise StoreError(
                f"{path} is damaged ({' '.join(str(error).split())[:120]}); start play with this "
                "folder and stop it: it is made again from the log"
            ) from None
    return pa.concat_tables(tables)

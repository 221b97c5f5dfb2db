"""The record: one row for every attempt, from which all results are computed.

The columns below are the contract between a session, which writes them, and everything that
measures, draws or reports. A record is an Arrow table, kept as one Parquet file for each cell.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from causal_openlock.experiment.condition import SHOWN
from causal_openlock.schemas.fsm import BoolArray, IntArray

CATEGORIES = ("else", "unlock", "open1", "open2", "open3")
"""The outcome of an attempt, as in Figures 6 and 7: an event, not a sum of rewards.

``openK`` is the K-th new solution of the trial (``open3`` is the third and all later
ones); opening the door in any other way is ``open1``; ``unlock`` means that the door was unlocked
at some moment but not opened; ``else`` is the rest.
"""

PHASES = (SHOWN, "train", "test")


def played(record: pa.Table) -> pa.Table:
    """The rows of a record that its subjects played; what they were shown is left out."""
    import pyarrow.compute as pc

    shown = pc.equal(pc.cast(record["phase"], pa.string()), SHOWN)
    return record.filter(pc.invert(shown)) if pc.any(shown).as_py() else record


def schema_of(*columns: tuple[str, Any, str], nullable: bool = True) -> pa.Schema:
    """Columns from the name, the type and the meaning of each."""
    return pa.schema(
        [pa.field(name, kind, nullable, {"meaning": meaning}) for name, kind, meaning in columns]
    )


def record_schema() -> pa.Schema:
    """The columns of a record, each with its meaning."""
    text = pa.dictionary(pa.int16(), pa.string())
    layouts = pa.dictionary(pa.int32(), pa.string())  # of which there can be many
    return schema_of(
        ("experiment", text, "name of the experiment"),
        ("learner", text, "label of the learner in the experiment"),
        ("condition", text, "name of the condition, such as CC3-CC4"),
        ("protocol", text, "name of the protocol, such as human"),
        ("subject", "int32", "number of the subject, from 0"),
        ("seed", "int64", "seed of the experiment"),
        ("phase", text, "shown, train or test; a baseline condition is all train"),
        ("loop", "int32", "how often the phase's trials have been gone through, from 1"),
        ("trial", "int32", "number of the trial within the loop, from 1"),
        ("schema", text, "name of the schema that governs the room"),
        ("layout", layouts, "name of the layout, or the positions of its levers"),
        ("attempt", "int32", "number of the attempt within the trial, from 1"),
        ("actions", pa.list_(pa.uint8()), "what was done, by action index"),
        ("moved", pa.list_(pa.bool_()), "whether each action moved something"),
        ("unlocked", "bool", "whether the door was unlocked at any moment"),
        ("opened", "bool", "whether the door was opened"),
        ("solution", "int16", "index of the solution that opened the door, -1 for none"),
        ("new_solution", "bool", "whether it was found for the first time in this trial"),
        ("solutions_found", "int16", "solutions found in this trial so far, this one included"),
        ("solutions", "int16", "solutions that the room has"),
        ("reward", "double", "sum of the rewards of the attempt's actions"),
        ("category", text, "else, unlock, open1, open2 or open3"),
        ("wall_time", "float", "seconds since the cell began"),
    )


def with_times(record: pa.Table, actions: Iterable[Mapping[str, Any]], trials: int) -> pa.Table:
    """The attempts of a subject's first ``trials``, with their times in place of the session's.

    The times are those of the last of their ``actions``, which are rows as
    :func:`~causal_openlock.experiment.beside_record.write_reactions` takes them.
    """
    last = [row for row in actions if row["attempt_over"] and row["visit"] <= trials]
    times = pa.array([row["time"] or 0.0 for row in last], pa.float32())
    where = record.schema.get_field_index("wall_time")
    return record.slice(0, len(last)).set_column(where, record.schema.field(where), times)


def categorise(
    unlocked: BoolArray, opened: BoolArray, new: BoolArray, found: IntArray
) -> NDArray[np.int8]:
    """``[N]`` the outcomes of attempts by columns of a record, as indices into :data:`CATEGORIES`.

    >>> CATEGORIES[categorise(*np.array([[True], [True], [True], [2]]))[0]]
    'open2'
    """
    nth = np.where(new, np.clip(found, 1, 3), 1)
    return np.where(opened, 1 + nth, unlocked).astype(np.int8)


class AttemptLog:
    """The attempts of a session, in the order in which they ended; about 50 bytes each."""

    def __init__(self, action_limit: int) -> None:
        self.dtype = np.dtype(  #: the columns of an attempt, as far as a session knows them
            [
                ("subject", np.int32),
                ("visit", np.int32),
                ("attempt", np.int32),
                ("used", np.int8),
                ("actions", np.uint8, (action_limit,)),
                ("moved", bool, (action_limit,)),
                ("unlocked", bool),
                ("opened", bool),
                ("solution", np.int16),
                ("new_solution", bool),
                ("solutions_found", np.int16),
                ("reward", np.float64),
                ("wall_time", np.float32),
            ]
        )
        self.rows = 0  #: how many attempts there are
        self._blocks: list[NDArray[np.void]] = []

    def extend(self, attempts: NDArray[np.void]) -> None:
        """Add attempts that have just ended, or that another log has returned."""
        self._blocks.append(attempts)
        self.rows += len(attempts)

    def since(self, row: int) -> NDArray[np.void]:
        """The attempts from a row on, as a structured array."""
        self._blocks = [np.concatenate([np.zeros(0, self.dtype), *self._blocks])]
        return self._blocks[0][row:]


def assemble(
    log: AttemptLog, visits: dict[str, NDArray[Any]], constants: dict[str, Any]
) -> pa.Table:
    """A session's log as a record, sorted by subject and time.

    ``visits`` are columns ``[B, T]`` of the T trials that each of the B subjects visits, and
    ``constants`` those that are the same for all, with the ``subjects``' numbers, ``[B]``.
    """
    numbers = constants["subjects"]
    ended = log.since(0)
    attempts = ended[numbers[ended["subject"]].argsort(kind="stable")]
    subject, visit, used = attempts["subject"], attempts["visit"], attempts["used"]
    offsets = pa.array(np.concatenate([[0], np.cumsum(used)]), pa.int32())
    taken = np.arange(attempts["actions"].shape[1]) < used[:, None]
    columns: dict[str, Any] = {name: attempts[name] for name in log.dtype.names or ()}
    outcome = (columns[name] for name in ("unlocked", "opened", "new_solution", "solutions_found"))
    columns["category"] = _dictionary(categorise(*outcome), CATEGORIES)
    columns["subject"], columns["seed"] = numbers[subject], np.full(log.rows, constants["seed"])
    for name in ("actions", "moved"):
        columns[name] = pa.ListArray.from_arrays(offsets, pa.array(attempts[name][taken]))
    for name, values in visits.items():
        column = values[subject, visit]
        if column.dtype.kind in "OU":
            names, codes = np.unique(values, return_inverse=True)
            column = _dictionary(codes.reshape(values.shape)[subject, visit], names.tolist())
        columns[name] = column
    for name in ("experiment", "learner", "condition", "protocol"):
        columns[name] = _dictionary(np.zeros(log.rows, np.int32), [constants[name]])
    schema = record_schema()
    return pa.table([columns[field.name] for field in schema], schema=schema)


def _dictionary(codes: IntArray | NDArray[Any], names: Sequence[str]) -> pa.Array:
    return pa.DictionaryArray.from_arrays(codes.astype(np.int32), pa.array(names, pa.string()))

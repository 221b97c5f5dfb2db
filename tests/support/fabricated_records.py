"""Records made up for tests of what is done with them."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pyarrow as pa

from causal_openlock.experiment.record import CATEGORIES, categorise, record_schema

Row = dict[str, Any]


def trial_rows(found: list[int], solutions: int = 3, **values: Any) -> list[Row]:
    """The attempts of one trial, by how many solutions are found after each of them."""
    rows = []
    for number, (before, after) in enumerate(itertools.pairwise([0, *found]), 1):
        new = after > before
        category = f"open{min(after, 3)}" if new else values.get("otherwise", "else")
        rows.append(
            {
                "experiment": "fabricated",
                "learner": "a",
                "condition": "CC4",
                "protocol": "human",
                "subject": 0,
                "seed": 1,
                "phase": "train",
                "loop": 1,
                "trial": 1,
                "schema": "CC4",
                "layout": "trial1",
                "actions": [0, 1, 14],
                "moved": [True, True, new],
                "reward": 0.0,
                "wall_time": 0.1 * number,
                **{name: value for name, value in values.items() if name != "otherwise"},
                "attempt": number,
                "unlocked": category != "else",
                "opened": category.startswith("open"),
                "solution": after - 1 if new else -1,
                "new_solution": new,
                "solutions_found": after,
                "solutions": solutions,
                "category": category,
            }
        )
    return rows


def table(rows: list[Row]) -> pa.Table:
    """Rows as a record."""
    columns = {}
    for field in record_schema():
        kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
        column = pa.array([row[field.name] for row in rows], kind)
        columns[field.name] = (
            column.dictionary_encode() if pa.types.is_dictionary(field.type) else column
        )
    return pa.table(columns, schema=record_schema())


def schema_of(condition: str, phase: str) -> str:
    """The schema in a phase of a condition of the paper's, or CC4."""
    known = [part for part in condition.split("-") if part in ("CC3", "CE3", "CC4", "CE4")]
    return known[0 if phase == "train" else -1] if known else "CC4"


def random_cells(
    seed: int,
    *,
    learners: tuple[str, ...] = ("b", "a"),
    conditions: tuple[str, ...] = ("CE4", "CC3-CC4", "own"),
    protocols: tuple[str, ...] = ("human", "loops"),
    subjects: int = 3,
    limit: int = 6,
) -> list[pa.Table]:
    """Cells of random attempts; under ``loops`` trials go on after they are solved."""
    rng = np.random.default_rng(seed)
    cells = []
    for learner, condition, protocol in itertools.product(learners, conditions, protocols):
        rows: list[Row] = []
        loops = 1 if protocol == "human" else 2
        visits = [("train", loop, trial) for loop in range(1, loops + 1) for trial in (1, 2, 3)]
        if "-" in condition:
            visits += [("test", loop, 1) for loop in range(1, loops + 1)]
        for subject, (phase, loop, trial) in itertools.product(range(subjects), visits):
            found: list[int] = []
            while len(found) < limit and not (protocol == "human" and found[-1:] == [3]):
                step = int(rng.random() < 0.4)
                found.append(min(3, (found[-1] if found else 0) + step))
            rows += trial_rows(
                found,
                learner=learner,
                condition=condition,
                protocol=protocol,
                subject=subject,
                phase=phase,
                loop=loop,
                trial=trial,
                schema=schema_of(condition, phase),
                layout=f"layout{rng.integers(3)}",
                otherwise=str(rng.choice(["else", "unlock", "open1"])),
            )
        cells.append(table(rows))
    return cells


def record_of_every_figure() -> pa.Table:
    """A record that has something for every figure, with names that need escaping."""
    conditions = ("CC4", "CE4", "CC3-CC4", "CE3-CE4", "own <i>$x$")
    cells = random_cells(2, learners=("a", "b", "c <u> & d"), conditions=conditions)
    rows = []
    for trial in range(1, 6):
        rows += trial_rows([1, 2, 3], trial=trial, learner="five", condition="CC4")
    return pa.concat_tables([*cells, table(rows)])


def big_record(attempts: int) -> pa.Table:
    """A record of about so many attempts, made with NumPy: 8 cells, 300 attempts a trial."""
    rng = np.random.default_rng(0)
    trials = attempts // 8 // 300
    rows = trials * 300
    attempt = np.tile(np.arange(1, 301, dtype=np.int32), trials)
    visit = np.repeat(np.arange(trials), 300)
    chance = rng.random((trials, 300)) < 0.01
    found = np.minimum(np.cumsum(chance, axis=1), 3).ravel()
    new = np.diff(found.reshape(trials, 300), axis=1, prepend=0).ravel() > 0
    category = categorise(rng.random(rows) < 0.3, new, new, found)

    def name(text: str) -> pa.Array:
        return pa.DictionaryArray.from_arrays(np.zeros(rows, np.int32), [text])

    cells = []
    for condition, learner in itertools.product(("CC4", "CE4"), "abcd"):
        columns = {
            "experiment": name("e"),
            "learner": name(learner),
            "condition": name(condition),
            "protocol": name("rl"),
            "phase": name("train"),
            "schema": name(condition),
            "layout": name("trial1"),
            "category": pa.DictionaryArray.from_arrays(category.astype(np.int32), list(CATEGORIES)),
            "subject": visit // 50,
            "loop": visit % 50 // 5 + 1,
            "trial": visit % 5 + 1,
            "attempt": attempt,
            "solutions_found": found,
            "solutions": np.full(rows, 3),
            "new_solution": new,
        }
        fields = [field for field in record_schema() if field.name in columns]
        cells.append(
            pa.table(
                [pa.array(columns[field.name]).cast(field.type) for field in fields],
                schema=pa.schema(fields),
            ).append_column("seed", pa.array(np.ones(rows, np.int64)))
        )
    return pa.concat_tables(cells)

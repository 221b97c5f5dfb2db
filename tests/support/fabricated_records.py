"""Records made up for tests of what is done with them."""

import itertools

import numpy as np
import pyarrow as pa

from causal_openlock.experiment.record import record_schema


def trial_rows(found, solutions=3, **values):
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


def table(rows):
    """Rows as a record."""
    columns = {}
    for field in record_schema():
        kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
        column = pa.array([row[field.name] for row in rows], kind)
        columns[field.name] = (
            column.dictionary_encode() if pa.types.is_dictionary(field.type) else column
        )
    return pa.table(columns, schema=record_schema())


def schema_of(condition, phase):
    """The schema in a phase of a condition of the paper's, or CC4."""
    known = [part for part in condition.split("-") if part in ("CC3", "CE3", "CC4", "CE4")]
    return known[0 if phase == "train" else -1] if known else "CC4"


def random_cells(
    seed,
    *,
    learners=("b", "a"),
    conditions=("CE4", "CC3-CC4", "own"),
    protocols=("human", "loops"),
    subjects=3,
    limit=6,
):
    """Cells of random attempts; under ``loops`` trials go on after they are solved."""
    rng = np.random.default_rng(seed)
    cells = []
    for learner, condition, protocol in itertools.product(learners, conditions, protocols):
        rows = []
        loops = 1 if protocol == "human" else 2
        visits = [("train", loop, trial) for loop in range(1, loops + 1) for trial in (1, 2, 3)]
        if "-" in condition:
            visits += [("test", loop, 1) for loop in range(1, loops + 1)]
        for subject, (phase, loop, trial) in itertools.product(range(subjects), visits):
            found = []
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


def record_of_every_figure():
    """A record that has something for every figure, with names that need escaping."""
    conditions = ("CC4", "CE4", "CC3-CC4", "CE3-CE4", "own <i>$x$")
    cells = random_cells(2, learners=("a", "b", "c <u> & d"), conditions=conditions)
    rows = []
    for trial in range(1, 6):
        rows += trial_rows([1, 2, 3], trial=trial, learner="five", condition="CC4")
    return pa.concat_tables([*cells, table(rows)])

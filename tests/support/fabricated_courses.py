"""Long courses made up for tests: how often a visit's attempts open the door, chosen freely."""

import numpy as np
import pyarrow as pa

from causal_openlock.experiment.record import CATEGORIES, record_schema
from support.made_up_experiments import declared

ATTEMPTS = 20


def course(opens, *, finds_all=False, other=1.0, attempts=ATTEMPTS, trials=5, **names):
    """A record of n subjects in V visits each; a visit's openings are its last attempts.

    Args:
        opens: ``[n, V]`` share of each visit's attempts that open the door.
        finds_all: ``[n, V]`` whether three of these are new solutions, or one; there must be so
            many.
        other: ``[n, V]`` share of the other attempts that are ``else``; the rest unlock.
        attempts: Of a visit.
        trials: Visits of a loop.
        names: Values of ``learner``, ``condition``, ``protocol``, ``phase`` and ``schema``.
    """
    opened = np.rint(np.asarray(opens, float) * attempts).astype(int)
    subjects, visits = opened.shape
    three = np.broadcast_to(finds_all, opened.shape)
    assert (opened[three] >= 3).all()
    number = np.arange(1, attempts + 1)
    opening = number - (attempts - opened[..., None])  # from 1 where the door is opened
    new = (opening >= 1) & (opening <= np.where(three, 3, 1)[..., None])
    found = np.cumsum(new, axis=2)
    idle = np.rint(np.broadcast_to(other, opened.shape) * (attempts - opened)).astype(int)
    category = np.where(number <= idle[..., None], 0, 1)
    category = np.where(opening >= 1, np.where(new, 1 + found, 2), category).ravel()
    rows = category.size
    subject, visit, attempt = np.indices((subjects, visits, attempts)).reshape(3, -1)
    given = {
        "experiment": "made_up",
        "learner": "a",
        "condition": "CC4",
        "protocol": "rl",
        "phase": "train",
        "schema": "CC4",
        "layout": "trial7",
        **names,
    }
    columns = {
        **{
            name: pa.DictionaryArray.from_arrays(np.zeros(rows, np.int32), [value])
            for name, value in given.items()
        },
        "subject": subject,
        "seed": np.ones(rows),
        "loop": visit // trials + 1,
        "trial": visit % trials + 1,
        "attempt": attempt + 1,
        "actions": pa.array([[0, 1, 14]] * rows),
        "moved": pa.array([[True, True, True]] * rows),
        "unlocked": category > 0,
        "opened": category > 1,
        "solution": np.where(category > 1, 0, -1),
        "new_solution": new.ravel(),
        "solutions_found": found.ravel(),
        "solutions": np.full(rows, 3),
        "reward": np.zeros(rows),
        "category": pa.DictionaryArray.from_arrays(category.astype(np.int32), list(CATEGORIES)),
        "wall_time": np.zeros(rows),
    }
    arrays = [
        column if isinstance(column, pa.Array) else pa.array(column)
        for column in (columns[field.name] for field in record_schema())
    ]
    schema = record_schema()
    return pa.table(
        [array.cast(field.type) for array, field in zip(arrays, schema, strict=True)], schema=schema
    )


def around(means, subjects=10, spread=0.02, seed=0):
    """``[n, V]`` shares of subjects that differ a little around ``[V]`` means."""
    rng = np.random.default_rng(seed)
    means = np.asarray(means, float)
    own = rng.normal(0, spread, (subjects, 1)) + rng.normal(0, spread, (subjects, len(means)))
    return np.clip(means + own, 0, 1)


def described(folder, text):
    """The experiment of an experiment file under ``rl``, as a results folder holds it."""
    return declared(folder, f"protocol: rl\n{text}")

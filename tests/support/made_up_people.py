"""Learners that do what people did, but for so many attempts."""

import numpy as np
import pandas as pd

from causal_openlock.paper.published import people


def made_up(name="a", subjects=12, off=0.0, seed=0):
    """Trials of a learner whose means are people's, but for ``off``, and a little luck."""
    rng = np.random.default_rng(seed)
    rows = []
    for point in people().itertuples():
        luck = rng.normal(0, 1, subjects)
        attempts = point.mean + off + luck - luck.mean()
        rows += [
            (name, point.condition, "human", "made up", 1, subject, point.phase, 1, point.trial,
             value, value / 2, True)
            for subject, value in enumerate(attempts)
        ]  # fmt: skip
    columns = ["learner", "condition", "protocol", "experiment", "seed", "subject", "phase", "loop",
               "trial", "attempts", "first_solution", "solved"]  # fmt: skip
    return pd.DataFrame(rows, columns=columns)

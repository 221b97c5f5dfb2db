"""Learners made up for tests that play the paper's six conditions under the human protocol."""

from collections.abc import Callable

import numpy as np

from causal_openlock.analysis.measures import count
from causal_openlock.analysis.results.material import Material
from causal_openlock.experiment.condition import PAPER_CONDITIONS
from support.fabricated_records import table, trial_rows
from support.made_up_experiments import BESIDE_ALL, experiment_of

Attempts = Callable[[str, str, int, int], int]
"""From condition, phase, trial and subject to how many attempts a trial takes."""

LIMIT = 30


def visits(condition):
    """Phase and number of the trials of a condition of the paper."""
    if "-" not in condition:
        return [("train", trial) for trial in range(1, 6)]
    return [*(("train", trial) for trial in range(1, 7)), ("test", 1)]


def play(learner, attempts, subjects=12, conditions=PAPER_CONDITIONS, **values):
    """The rows of a learner that takes as many attempts as it is told, or does not solve it."""
    rows = []
    for condition in conditions:
        for subject in range(subjects):
            for phase, trial in visits(condition):
                many = attempts(condition, phase, trial, subject)
                tail = [1, 2, 3] if many < LIMIT else [0, 0, 0]
                rows += trial_rows(
                    [0] * (min(many, LIMIT) - 3) + tail,
                    learner=learner, condition=condition, phase=phase, trial=trial,
                    subject=subject, **values,
                )  # fmt: skip
    return rows


def scattered(seed, level=4.0):
    """A learner that gets better, is helped by congruent training and finds CE harder."""
    rng = np.random.default_rng(seed)

    def attempts(condition, phase, trial, subject):
        mean = level + 6 / trial if phase == "train" else level
        mean += 3 * (phase == "test" and condition in ("CE3-CC4", "CC3-CE4"))
        mean += 2 * condition.endswith("CE4")
        return 3 + min(20, int(rng.poisson(mean)))

    return attempts


def same(number):
    """A learner that always takes so many attempts; at 30 it never solves a trial."""
    return lambda *_: number


def material(rows, learners, **values):
    """What sections are made of, with the ideal observer at 3 attempts where CC4 is tested."""
    record = table(rows)
    trials, blocks = count(record)
    bounds = {
        (name, "human", phase): 3.0
        for name in ("CC4", "CC3-CC4", "CE3-CC4")
        for phase in ("train", "test")
    }
    return Material(
        record=record,
        experiment=values.get("experiment") or experiment_of(record),
        all_trials=trials,
        blocks=blocks,
        learners=learners,
        references=values.get("references", BESIDE_ALL),
        bounds=bounds,
    )

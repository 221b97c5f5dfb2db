"""Whether an installation is right: a small experiment against stored results.

Learners that only draw and compare numbers do the same on every machine: their actions must be
equal, one by one. Where sums of floating-point numbers decide, another processor or version can
round otherwise, and the same seed may lead elsewhere; there, means must be in the interval that
holds the mean of as many new subjects in 999 of 1,000 cases.

After a change of results, ``python -m causal_openlock.comparison.checking`` in a checkout plays the
experiment and stores what came of it.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from causal_openlock.comparison.comparing import play
from causal_openlock.comparison.results import Results, open_results
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.declare import Experiment
from causal_openlock.experiment.file import read_experiment
from causal_openlock.files.atomic import write_text
from causal_openlock.schemas.finding import bundled
from causal_openlock.storage.versions import other_versions, versions

EXACT = ("oracle", "ideal", "random", "win_stay")
"""Learners that do the same on every machine."""
MEASURES = {"attempts": "attempts in a trial", "moved": "share of actions that move something"}
LEVEL = 0.999
USUALLY = 0.5
"""Share of trials that a learner has to solve for its attempts to be compared."""
STORED = Path(__file__).with_name("expected.json")


class Check(NamedTuple):
    """A check of a learner: the expected result, the one found, and whether it is right."""

    learner: str
    measure: str
    expected: str
    found: str
    ok: bool


def check_installation(**options: Any) -> tuple[list[Check], str]:
    """Play the experiment ``check`` and compare what comes of it with what is stored.

    Args:
        **options: As for :func:`~causal_openlock.comparison.comparing.play`.

    Returns:
        A row for each thing that was compared, and which versions of packages differ from those
        that the stored results are from, in words.

    Raises:
        OpenLockError: If the experiment is another one than what is stored is from, that file is
            damaged, or all of it failed.
    """
    experiment = check_experiment()
    try:
        stored = json.loads(STORED.read_bytes())
        known, learners, before = (stored[key] for key in ("experiment", "learners", "versions"))
        for one in (before, learners, *learners.values()):
            one.items()
    except (OSError, ValueError, RecursionError, LookupError, TypeError, AttributeError) as error:
        raise OpenLockError(
            f"{STORED} is damaged ({type(error).__name__}: {error}); install the package again"
        ) from None
    if known != experiment.declaration:
        raise OpenLockError(
            f"{STORED.name} is from another experiment than {bundled('experiments')}/check.yaml; "
            "install the package again or, after a change, store the results of this one: "
            "python -m causal_openlock.comparison.checking"
        )
    results = played(experiment, **options)
    return compared(results, learners), other_versions(before, versions())


def check_experiment() -> Experiment:
    """The experiment of the package, whatever has its name where the command is given."""
    return read_experiment(bundled("experiments") / "check.yaml")


def played(experiment: Experiment, **options: Any) -> Results:
    """Play an experiment in a folder that is gone afterwards."""
    with tempfile.TemporaryDirectory() as place:
        if failed := play(experiment, Path(place) / experiment.name, **options):
            raise failed
        results = open_results(Path(place) / experiment.name)
        assert len(results.actions)  # read while the folder is there
    return results


def compared(results: Results, stored: Mapping[str, Any]) -> list[Check]:
    """Compare results with what is stored of each learner."""
    checks = []
    for learner, known in stored.items():
        own = results.actions[results.actions["learner"] == learner]
        if "actions" in known:
            found = digest(own) if len(own) else "nothing"
            right = found == known["actions"]
            checks.append(Check(learner, "every action", known["actions"], found, right))
            continue
        means = of_subjects(results, learner) if len(own) else None
        for measure, (mean, low, high) in known.items():
            value = float("nan") if means is None else float(means[measure].mean())
            words = f"{mean:.3f} ({low:.3f} to {high:.3f})"
            found = "nothing" if means is None else f"{value:.3f}"
            checks.append(Check(learner, MEASURES[measure], words, found, low <= value <= high))
    return checks


def digest(actions: pd.DataFrame) -> str:
    """The beginning of a hash of what each subject did in which room, and of what it moved."""
    left_out = ("learner", "protocol", "experiment", "name")
    text = actions.drop(columns=[*left_out]).to_csv(index=False, lineterminator="\n")
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def of_subjects(results: Results, learner: str) -> pd.DataFrame:
    """The measures of each subject, a mean over conditions."""
    keys = ["condition", "subject"]
    trials, actions = (
        table[table["learner"] == learner].groupby(keys, observed=True)
        for table in (results.trials, results.actions)
    )
    both = pd.DataFrame({"attempts": trials["attempts"].mean(), "moved": actions["moved"].mean()})
    return both.groupby("subject").mean()


def expected_of(results: Results, learner: str) -> dict[str, Any]:
    """Expected results of a learner: a hash of its actions, or means with their intervals."""
    from scipy.special import stdtrit

    if learner in EXACT:
        return {"actions": digest(results.actions[results.actions["learner"] == learner])}
    means, found = of_subjects(results, learner), {}
    solved = results.trials[results.trials["learner"] == learner]["solved"].mean()
    for measure, values in means.items():
        if measure == "attempts" and solved < USUALLY:
            continue  # the mean of the limit and of a lucky few has no interval of use
        n, mean = len(values), float(values.mean())
        half = float(stdtrit(n - 1, (1 + LEVEL) / 2) * values.std() * (2 / n) ** 0.5)
        found[str(measure)] = [round(one, 5) for one in (mean, mean - half, mean + half)]
    return found


def expected(experiment: Experiment, results: Results) -> dict[str, Any]:
    """Expected results of an experiment."""
    learners = {one.name: expected_of(results, one.name) for one in experiment.learners}
    return {
        "experiment": experiment.declaration,
        "versions": dict(results.experiment.versions),
        "learners": learners,
    }


if __name__ == "__main__":
    small = check_experiment()
    write_text(STORED, json.dumps(expected(small, played(small, warn=print)), indent=1) + "\n")
    print(STORED)

"""Design: which conditions tell theories apart, for the least of a person's time?

Theories are learners whose parameters nobody knows: every parameter for which its learner's search
space has a range, and whose value lies within it, is drawn from that range. (A value outside is
set, as in an ablation.) Subjects are simulated from every theory, each with parameters of its own,
and every theory predicts their actions, with its likelihood averaged over other draws. Rooms, and
draws of parameters that theories share, are the same for all theories and in all conditions.

How much a subject's actions tell about its theory is their mutual information. Whatever
probabilities q somebody gives to M theories once a subject's actions are seen, the mean of log2 M +
log2 q(the theory that made it) is at most this information (Barber & Agakov 2003; Foster et al.
2019), so what is computed is a lower bound. Few draws of parameters make it lower, and so does what
saves time here: after each doubling of the draws, the half of the theories that predict worst get
none any more.

A person's time is their attempts, at the pace of the people of the paper. Conditions are ranked by
information a minute.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.contract.registry import learner_class, parse_parameters
from causal_openlock.errors import LearnerError, OpenLockError
from causal_openlock.experiment.declare import Cell, Condition, Experiment, LearnerSpec
from causal_openlock.files.atomic import write_text
from causal_openlock.files.digest import digest
from causal_openlock.fitting.recovery import attributed_rows
from causal_openlock.fitting.space import Range, bundled_search
from causal_openlock.running.worker import made
from causal_openlock.running.workers import worker_pool
from causal_openlock.scoring import LAPSE
from causal_openlock.scoring.inverse_binomial import Draws
from causal_openlock.scoring.teacher_forcing import (
    known_learners,
    recorded_subjects,
    score_part,
)
from causal_openlock.version import RESULTS_VERSION
from causal_openlock.wording import joined
from causal_openlock.world import facts
from causal_openlock.world.randomness import generators

NATS = "nats "
"""Before the name of a theory: the log-likelihood of what a subject did under it."""
DOUBT = 0.02
"""Probability that no estimate is right; it is shared among the theories."""
CERTAIN = 0.95
"""Probability of a theory from which on a subject seems to follow it for certain."""
FEWEST_OWN = 20
"""Fewer subjects of a theory do not show how badly it predicts its own."""
FEWEST_DRAWS, FEWEST_THEORIES = 2, 2
"""Number of draws for every theory, and of theories that get all draws."""


@dataclass(frozen=True)
class Effort:
    """Settings of the predictions.

    Attributes:
        draws: The most sets of parameters over which a theory's likelihood is averaged.
        lapse: The share of actions that are taken to be random.
        asked: The most copies to ask of a learner without probabilities.
    """

    draws: int = 8
    lapse: float = LAPSE
    asked: int = 64


@dataclass(frozen=True)
class Simulated:
    """A subject to simulate, and the theories that predict it.

    Attributes:
        experiment: The experiment.
        condition: The subject's condition, one of the experiment's.
        maker: The theory that makes the subject.
        number: The subject's number; it decides on rooms and parameters.
        theories: The theories.
        effort: How they predict.
    """

    experiment: Experiment
    condition: Condition
    maker: LearnerSpec
    number: int
    theories: tuple[LearnerSpec, ...]
    effort: Effort

    @cached_property
    def key(self) -> str:
        """A digest of everything that determines what is found."""
        experiment = self.experiment.name, self.experiment.seed
        about: list[Any] = [RESULTS_VERSION, *experiment, self.condition.as_dict(), self.number]
        for theory in (self.maker, *self.theories):
            ranges = {name: vars(one) for name, one in unknown(theory).items()}
            about += [{**theory.as_dict(), "subjects": 1}, ranges]
        about += [vars(self.effort), FEWEST_DRAWS, FEWEST_THEORIES]
        return digest(json.dumps(about, sort_keys=True, default=str))

    def told(self) -> dict[str, Any]:
        """Simulate the subject, and let the theories predict it; a row of :func:`told_apart`."""
        experiment, seed = self.experiment, self.experiment.seed
        (maker,) = drawn(self.maker, seed, "subject", [self.number])
        session, learner = made(Cell(experiment.name, seed, maker, self.condition, self.number, 1))
        (part,) = recorded_subjects(session.play(learner), experiment)
        draws = Draws(most=self.effort.asked)

        def predict(theory: LearnerSpec, which: Sequence[int]) -> list[float]:
            own = [self.number * self.effort.draws + number for number in which]
            return [
                float(score_part(part, one, self.effort.lapse, draws)["log_probability"].sum())
                for one in drawn(theory, seed, "theory", own)
            ]

        return {
            "learner": maker.name,
            "condition": self.condition.name,
            "protocol": maker.protocol.name,
            "subject": self.number,
            "attempts": len(part.rows),
            "actions": int(part.asked.sum()),
            **{NATS + name: one for name, one in _halved(self.theories, predict, self.effort)},
        }


def unknown(theory: LearnerSpec) -> dict[str, Range]:
    """The ranges of a theory's unknown parameters: those whose value lies in a range."""
    space = bundled_search(theory.learner)
    return {
        name: one
        for name, one in (space.ranges if space else {}).items()
        if one.low <= theory.parameters[name] <= one.high
    }


def drawn(theory: LearnerSpec, seed: int, what: str, numbers: Iterable[int]) -> list[LearnerSpec]:
    """A theory with its unknown parameters drawn evenly, or their logarithms.

    Args:
        theory: The theory.
        seed: Seed of the experiment.
        what: What they are for; another word gives other numbers.
        numbers: Which draws.
    """
    found = []
    for number in numbers:
        chosen = dict(theory.parameters)
        for name, one in unknown(theory).items():
            (generator,) = generators(seed, f"{what}/{name}", [number])
            chosen[name] = one.at(generator.random())
        found.append(replace(theory, parameters=chosen))
    return found


def _halved(
    theories: Sequence[LearnerSpec],
    predict: Callable[[LearnerSpec, Sequence[int]], list[float]],
    effort: Effort,
) -> list[tuple[str, float]]:
    """Name and log-likelihood of each theory, averaged over the draws that it got."""
    found: dict[str, list[float]] = {one.name: [] for one in theories}
    left, many = list(theories), min(FEWEST_DRAWS, effort.draws)
    while True:
        for theory in left:
            own = found[theory.name]
            # With nothing unknown, all draws are the same.
            own += predict(theory, range(len(own), many if unknown(theory) else 1))
        if many >= effort.draws:
            return [(name, _mean(own)) for name, own in found.items()]
        left.sort(key=lambda one: -_mean(found[one.name]))
        left = left[: max(FEWEST_THEORIES, math.ceil(len(left) / 2))]
        many = min(2 * many, effort.draws)


def _mean(logarithms: Sequence[float]) -> float:
    return float(np.logaddexp.reduce(logarithms) - math.log(len(logarithms)))


# -- many subjects --------------------------------------------------------------------------------


def told_apart(
    experiment: Experiment,
    effort: Effort,
    *,
    outside: Sequence[str] = (),
    folder: Path,
    workers: int = 1,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> pd.DataFrame:
    """Simulate subjects of every theory in every condition, and let all theories predict them.

    Args:
        experiment: Its conditions; its learners are the theories, and their subjects are made.
        effort: How they are predicted.
        outside: Labels of learners that make subjects and predict none: as if people followed no
            theory of the set.
        folder: Where each subject is kept, so that the work continues after an interruption.
        workers: Number of processes.
        report: Called with how many subjects are done, of how many.

    Returns:
        A row for each subject: the ``learner`` that made it, ``condition``, ``protocol``,
        ``subject``, how many ``attempts`` and ``actions`` it took, and ``nats NAME`` for each
        theory.

    Raises:
        LearnerError: If a theory cannot predict others or play a condition, or there are fewer than
            two different ones.
        OpenLockError: If no action is taken to be random: one that no theory does would be
            impossible under all of them.
    """
    theories = theories_of(experiment, outside)
    _check(theories, experiment)
    if effort.lapse <= 0:
        raise OpenLockError("lapse must be above 0, or nothing can be said of unexpected actions")
    jobs = [
        Simulated(experiment, condition, maker, number, theories, effort)
        for condition in experiment.conditions
        for maker in experiment.learners
        if condition.name not in experiment.not_applicable.get(maker.name, {})
        for number in range(maker.subjects)
    ]
    paths = [folder / f"{job.key}.json" for job in jobs]
    missing = [each for each in zip(jobs, paths, strict=True) if _kept(each[1]) is None]
    done = len(jobs) - len(missing)
    report(done, len(jobs))
    if workers == 1:
        for job, path in missing:
            _keep(job, path)
            report(done := done + 1, len(jobs))
    elif missing:
        with worker_pool(min(workers, len(missing))) as pool:
            for one in as_completed([pool.submit(_keep, *each) for each in missing]):
                one.result()
                report(done := done + 1, len(jobs))
    return pd.DataFrame(map(_kept, paths))


def theories_of(experiment: Experiment, outside: Sequence[str]) -> tuple[LearnerSpec, ...]:
    """The learners of an experiment that are theories.

    Raises:
        LearnerError: If ``outside`` names a learner that is not in the experiment.
    """
    known_learners(outside, experiment.learners)
    return tuple(one for one in experiment.learners if one.name not in outside)


def _kept(path: Path) -> dict[str, Any] | None:
    """The row of a subject; None if it is not there, or its file is damaged."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return None
    return found if isinstance(found, dict) and "actions" in found else None


def _keep(job: Simulated, path: Path) -> None:
    write_text(path, json.dumps(job.told()))


def _check(theories: Sequence[LearnerSpec], experiment: Experiment) -> None:
    if len(theories) < 2:
        raise LearnerError(
            "theories are told from each other, so there must be two at least, apart from those "
            "outside; add a learner to the experiment"
        )
    if len({one.subjects for one in theories}) > 1:
        raise LearnerError(
            "theories make different numbers of subjects, so that some would count more; give all "
            "the same, with --subjects or subjects: in the file"
        )
    same: dict[str, str] = {}
    for one in theories:
        known = {name: one.parameters[name] for name in one.parameters if name not in unknown(one)}
        what = json.dumps([one.learner, known, [*unknown(one)]], sort_keys=True, default=str)
        if (other := same.setdefault(what, one.name)) != one.name:
            names = joined([*unknown(one)])
            raise LearnerError(
                f"{other} and {one.name} are the same theory"
                + (f", as {names} can be anything in its range" if names else "")
                + "; leave one of them out"
            )
        if not learner_class(one.learner).learns_from_others:
            raise LearnerError(
                f"{one.name} learns from its own actions alone, so that it cannot predict others; "
                f"leave it out, or give --outside {one.name}"
            )
        for condition, why in experiment.not_applicable.get(one.name, {}).items():
            raise LearnerError(f"{why}; leave out {condition}, or the theory")
        for corner in ("low", "high"):
            ends = {name: getattr(each, corner) for name, each in unknown(one).items()}
            parse_parameters(one.learner, {**one.parameters, **ends})


# -- what that tells ------------------------------------------------------------------------------


def minutes_an_attempt() -> float:
    """Minutes that an attempt took the people of the paper, in the baseline.

    >>> round(minutes_an_attempt(), 2)
    0.28
    """
    people = facts.results()["cogsci2018"]["human"]
    attempts = [sum(own["mean"]) for own in people["baseline"].values()]
    return float(people["minutes"]["baseline"] / np.mean(attempts))


def posterior(subjects: pd.DataFrame) -> pd.DataFrame:
    """Probability of each theory after each subject's actions, if all were as likely before.

    Args:
        subjects: From :func:`told_apart`.

    Returns:
        A column for each theory, a row for each subject; each is at least its share of
        :data:`DOUBT`.
    """
    names = [str(name) for name in subjects.columns if str(name).startswith(NATS)]
    nats = subjects[names].to_numpy(float)
    shares = np.exp(nats - nats.max(axis=1, keepdims=True))
    shares = (1 - DOUBT) * shares / shares.sum(axis=1, keepdims=True) + DOUBT / len(names)
    return pd.DataFrame(shares, subjects.index, [name.removeprefix(NATS) for name in names])


def information_ends(theories: int) -> tuple[float, float]:
    """The least and the most bits that one subject can be found to tell.

    >>> information_ends(4)[1] < 2
    True
    """
    low, high = DOUBT / theories, 1 - DOUBT + DOUBT / theories
    return math.log2(theories * low), math.log2(theories * high)


def informed(subjects: pd.DataFrame) -> pd.DataFrame:
    """Add to subjects how much their actions tell about the theory that made them.

    Args:
        subjects: From :func:`told_apart`.

    Returns:
        The subjects with six columns more: ``information``, in bits, whose mean is at most the
        mutual information; ``single``, 1 if the theory that made a subject is the likeliest, else 0
        (or its share of several that are); ``minutes``, as long as people would take;
        ``per_minute``, information divided by the mean minutes of all subjects of its condition;
        ``certain``, 1 if a theory's probability is at least :data:`CERTAIN`; and ``unlike``, 1 if
        the likeliest theory predicts this subject worse, per action, than 95% of its own. Subjects
        that no theory made have no ``information``, ``per_minute`` and ``single``, and they alone
        have ``unlike``, if that theory made :data:`FEWEST_OWN` subjects.
    """
    shares, minutes = posterior(subjects), subjects["attempts"] * minutes_an_attempt()
    names, makers = list(shares.columns), subjects["learner"].to_numpy()
    of_theory = np.isin(makers, names)
    own = np.where(of_theory, [names.index(one) if one in names else 0 for one in makers], 0)
    rows = np.arange(len(subjects))
    likely = shares.to_numpy(float)
    right = attributed_rows(subjects[[NATS + name for name in names]].to_numpy(float))
    mean = minutes[of_theory].groupby(subjects["condition"]).transform("mean")
    found = subjects.assign(
        information=np.where(of_theory, np.log2(len(names) * likely[rows, own]), np.nan),
        single=np.where(of_theory, right[rows, own], np.nan),
        minutes=minutes,
        certain=(likely.max(axis=1) >= CERTAIN).astype(float),
    )
    surprise = -subjects[[NATS + name for name in names]].div(subjects["actions"], axis=0)
    usual = {}
    for name in names:
        made = surprise.loc[makers == name, NATS + name]
        usual[name] = made.quantile(0.95) if len(made) >= FEWEST_OWN else np.nan
    taken = likely.argmax(axis=1)
    most = np.array([usual[names[place]] for place in taken])
    far = surprise.to_numpy(float)[rows, taken] > most
    found["per_minute"] = found["information"] / mean
    found["unlike"] = np.where(of_theory | np.isnan(most), np.nan, far)
    return found


def ranked(subjects: pd.DataFrame) -> pd.DataFrame:
    """Conditions, the one that tells most a minute first.

    Args:
        subjects: From :func:`told_apart`.

    Returns:
        A row for each ``condition``: number of ``subjects``; the mean ``information``, in bits, and
        its standard error ``se`` (NaN if a theory made one subject); the share ``single`` of
        subjects that are attributed right; the mean ``minutes``; and information ``per_minute``.
        Theories count alike.
    """
    made = informed(subjects).dropna(subset="information")
    theories = made.groupby(["condition", "learner"], sort=False)
    means = theories[["information", "single", "minutes"]].mean()
    by_condition = means.groupby("condition", sort=False)
    table = by_condition.mean()
    table["per_minute"] = table["information"] / table["minutes"]
    # Of a mean over theories, from each theory's own.
    squares = (theories["information"].sem() ** 2).groupby("condition", sort=False)
    table.insert(0, "subjects", made.groupby("condition", sort=False).size())
    table.insert(2, "se", np.sqrt(squares.mean() / squares.size()))
    return table.sort_values("per_minute", ascending=False, kind="stable").reset_index()

"""The search for the candidate that is most like people; it continues where it stopped.

Optuna's tree-structured Parzen estimator proposes candidates in rounds of a fixed size: each round
from the results of all rounds before it, with a seed of its own. So the proposals depend neither on
the number of workers, nor on which candidate finishes first, nor on how often the fit was killed:
results are kept in one file, which is replaced whole, and a round that was cut short is proposed
again, the same, and played to its end.

Distances are means over subjects, and the least of many noisy numbers is too good. So the best few
candidates are played again with more subjects and another seed, which decides between them; and the
numbers that are reported come from a third seed that nothing was chosen by.
"""

from __future__ import annotations

import importlib.util
import logging
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
from pydantic import TypeAdapter

from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.declare import PAPER_CONDITIONS
from causal_openlock.fitting.effect import without_effect
from causal_openlock.fitting.kept import fit_of, fitting_in, keep_fit
from causal_openlock.fitting.objective import (
    Job,
    Score,
    conditions_to_fit,
    jobs,
    joined,
    play,
    score,
)
from causal_openlock.fitting.search import SearchSpace, check_chosen
from causal_openlock.paper.likeness import points_of
from causal_openlock.running.workers import worker_pool
from causal_openlock.version import RESULTS_VERSION

FILE = "fit.json"
ROUND = 4
"""Candidates that are proposed at a time."""

Start = Callable[[Mapping[str, float], tuple[str, ...], int, int], Callable[[], pd.DataFrame]]
"""Starts to play a candidate, in some conditions, with a seed and a number of subjects.

What it returns waits until all is played, and returns the trials.
"""
Report = Callable[[int, int, str], None]
RANDOM_FIRST = 12
"""Candidates that are drawn at random before the search learns from them."""


def require_optuna() -> None:
    """Raise an OpenLockError if Optuna is not installed."""
    if importlib.util.find_spec("optuna") is None:
        raise OpenLockError(
            "a fit needs the package optuna; install it with: pip install 'causal-openlock[fit]'"
        )


@dataclass(frozen=True)
class Plan:
    """The settings of a fit."""

    space: SearchSpace
    hold_out: str = "transfer"  #: see :mod:`~causal_openlock.fitting.objective`
    candidates: int = 60
    subjects: int = 40  #: that each candidate plays in each condition
    finalists: int = 5  #: so many of the best are played again
    final_subjects: int = 200
    seed: int = 31  #: of the search and of all play; the next two seeds are used as well
    target: str = "people"  #: see :mod:`~causal_openlock.fitting.objective`

    def as_dict(self) -> dict[str, Any]:
        """All that determines the results of candidates."""
        whole = {**asdict(self), "space": self.space.as_dict(), "version": RESULTS_VERSION}
        # More candidates may be tried later.
        del whole["candidates"]
        return whole

    def score(self, points: pd.DataFrame) -> Score:
        """Distance of a learner from the target."""
        return score(points, self.hold_out, self.target)


@dataclass(frozen=True)
class Candidate:
    """Parameters that were tried, and their distance from people."""

    number: int  #: in the order of the proposals, from 0
    chosen: dict[str, int | float]
    rmse: float  #: distance from people on the points that it is fitted to


@dataclass
class Fit:
    """The state of a fit: the candidates that were tried, in the order of their numbers.

    ``again`` has the distances of the best, played again with more subjects and another seed.
    ``idle`` has the parameters that make no difference, by the number of a best candidate.
    """

    plan: Plan
    done: list[Candidate] = field(default_factory=list)
    again: dict[int, float] = field(default_factory=dict)
    idle: dict[int, tuple[str, ...]] = field(default_factory=dict)

    @property
    def best(self) -> Candidate:
        """The candidate nearest to people, among those played again."""
        number = min(self.again, key=lambda number: (self.again[number], number))
        return self.done[number]

    def table(self) -> pd.DataFrame:
        """All candidates, the nearest first: ``number``, their parameters, ``rmse``, ``again``."""
        rows = [
            {"number": one.number, **one.chosen, "rmse": one.rmse,
             "again": self.again.get(one.number, float("nan"))}
            for one in self.done
        ]  # fmt: skip
        ordered: pd.DataFrame = pd.DataFrame(rows).sort_values(["rmse", "number"])
        return ordered.reset_index(drop=True)


def fit(
    plan: Plan,
    folder: Path | str,
    *,
    workers: int = 1,
    report: Report = lambda done, total, what: None,
) -> tuple[Fit, pd.DataFrame]:
    """Run a fit, or the rest of one that was stopped.

    Args:
        plan: Its settings.
        folder: Where it is kept; one that holds a part of the same fit is completed.
        workers: How many processes play; with one it is this process.
        report: Called with how many candidates are done, of how many, and the present step.

    Returns:
        The fit, and what the best candidate did in all six conditions with a fresh seed, as
        :func:`~causal_openlock.analysis.measures.attempts_to_solve` gives it.

    Raises:
        OpenLockError: If Optuna is not installed, or the folder cannot be written to.
        StoreError: If the folder holds another fit, or another process fits there.
        LearnerError: If the learner fails. Candidates that were done stay done.
    """
    require_optuna()
    path = Path(folder) / FILE
    conditions = conditions_to_fit(plan.hold_out)
    with fitting_in(path.parent), _players(plan.space, workers) as start:
        state = _opened(plan, path)
        while (known := len(state.done)) < plan.candidates:
            first = known - known % ROUND
            proposed = _proposals(state, first)[known - first : plan.candidates - first]
            waiting = [start(one, conditions, plan.seed, plan.subjects) for one in proposed]
            for chosen, trials in zip(proposed, waiting, strict=True):
                report(len(state.done), plan.candidates, "searching")
                rmse = plan.score(points_of(trials())).fitted
                state.done.append(Candidate(len(state.done), chosen, rmse))
                _keep(state, path)
        _play_again(state, path, start, conditions, report)
        _look_for_effects(state, path, start, conditions, report)
        report(len(state.done), plan.candidates, "the best, on a fresh seed")
        best = state.best.chosen
        return state, start(best, PAPER_CONDITIONS, plan.seed + 2, plan.final_subjects)()


def _play_again(
    state: Fit, path: Path, start: Start, conditions: tuple[str, ...], report: Report
) -> None:
    """Play the best few again, with more subjects and another seed."""
    plan = state.plan
    tried = state.done[: plan.candidates]
    chosen = sorted(tried, key=lambda one: (one.rmse, one.number))[: plan.finalists]
    for number in set(state.again) - {one.number for one in chosen}:
        del state.again[number]  # others are among the best since more were tried
    waiting = {
        one.number: start(one.chosen, conditions, plan.seed + 1, plan.final_subjects)
        for one in chosen
        if one.number not in state.again
    }
    for number, trials in waiting.items():
        report(len(state.done), plan.candidates, "the best few again")
        state.again[number] = plan.score(points_of(trials())).fitted
        _keep(state, path)


def _look_for_effects(
    state: Fit, path: Path, start: Start, conditions: tuple[str, ...], report: Report
) -> None:
    """Find the parameters that make no difference around the best candidate."""
    plan, best = state.plan, state.best

    def loss(chosen: Mapping[str, float]) -> float:
        report(len(state.done), plan.candidates, "what makes a difference")
        return plan.score(
            points_of(start(chosen, conditions, plan.seed + 1, plan.subjects)())
        ).fitted

    if best.number not in state.idle:
        state.idle[best.number] = without_effect(plan.space.ranges, best.chosen, loss)
        _keep(state, path)


@contextmanager
def _players(space: SearchSpace, workers: int) -> Iterator[Start]:
    """Yield a function that plays candidates: in this process, or in several others at once."""

    def start(
        submit: Callable[[Job], Callable[[], pd.DataFrame]],
        chosen: Mapping[str, float],
        conditions: tuple[str, ...],
        seed: int,
        subjects: int,
    ) -> Callable[[], pd.DataFrame]:
        all_jobs = jobs(space.learner, space.parameters(chosen), conditions, subjects, seed)
        waiting = [submit(job) for job in all_jobs]
        return lambda: joined([trials() for trials in waiting])

    if workers == 1:
        yield partial(start, lambda job: partial(play, job))
        return
    with worker_pool(workers) as pool:
        yield partial(start, lambda job: pool.submit(play, job).result)


# -- what to try next -----------------------------------------------------------------------------


def _proposals(state: Fit, first: int) -> list[dict[str, int | float]]:
    """The candidates of the round that begins with a number, whatever was tried later."""
    done = [(known.chosen, known.rmse) for known in state.done[:first]]
    return proposals(state.plan.space, done, state.plan.seed)


def proposals(
    space: SearchSpace, done: Sequence[tuple[Mapping[str, float], float]], seed: int
) -> list[dict[str, int | float]]:
    """The next :data:`ROUND` candidates after those that were tried.

    Args:
        space: What is searched.
        done: The candidates so far, with what is to be made small.
        seed: Of the search.
    """
    import optuna
    from optuna.distributions import BaseDistribution, FloatDistribution, IntDistribution

    logging.getLogger("optuna").setLevel(logging.WARNING)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        sampler = optuna.samplers.TPESampler(
            n_startup_trials=RANDOM_FIRST,
            constant_liar=True,
            seed=(seed * 1_000_003 + len(done)) % 2**32,
        )
        study = optuna.create_study(sampler=sampler)
        distributions: dict[str, BaseDistribution] = {
            name: IntDistribution(int(one.low), int(one.high), log=one.log)
            if one.whole
            else FloatDistribution(one.low, one.high, log=one.log)
            for name, one in space.ranges.items()
        }
        for chosen, value in done:
            study.add_trial(
                optuna.trial.create_trial(
                    params=dict(chosen), distributions=distributions, value=value
                )
            )
        return [dict(study.ask(distributions).params) for _ in range(ROUND)]


# -- what is kept ---------------------------------------------------------------------------------


def _opened(plan: Plan, path: Path) -> Fit:
    """The fit that a folder holds, or a new one."""

    def read(kept: dict[str, Any]) -> Fit:
        state = Fit(
            plan,
            TypeAdapter(list[Candidate]).validate_python(kept["done"]),
            TypeAdapter(dict[int, float]).validate_python(kept["again"]),
            TypeAdapter(dict[int, tuple[str, ...]]).validate_python(kept.get("idle", {})),
        )
        if [one.number for one in state.done] != [*range(len(state.done))]:
            raise ValueError("the candidates are not numbered in order")
        for one in state.done:
            check_chosen(one.chosen, plan.space.ranges)
        return state

    parts = "its search space, the learner's code, seed, subjects, held-out points, target"
    return fit_of(path, plan.as_dict(), read, "fit", parts) or Fit(plan)


def _keep(state: Fit, path: Path) -> None:
    again = {str(number): rmse for number, rmse in sorted(state.again.items())}
    keep_fit(
        path,
        state.plan.as_dict(),
        done=[asdict(one) for one in state.done],
        again=again,
        idle={str(number): names for number, names in sorted(state.idle.items())},
    )

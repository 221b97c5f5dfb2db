"""The search for the candidate that is most like people; it goes on where it was stopped.

Candidates are proposed by Optuna's tree-structured Parzen estimator, in rounds of a fixed size: a
round is proposed from what all rounds before it came to, with a seed of its own, and is told only
when the whole round is played. So what is proposed depends neither on the number of workers, nor on
who finishes first, nor on how often the fit was killed: what each candidate came to is kept in one
file, which is replaced whole, and a round that was cut short is proposed again, the same, and
played to its end.

Distances are means over subjects, and the least of many noisy numbers flatters. So the best few
candidates are played again with more subjects and another seed, which decides between them; and the
numbers that are reported come from a third seed that nothing was chosen by.
"""

from __future__ import annotations

import importlib.util
import json
import logging
import warnings
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.protocol import PAPER_CONDITIONS
from causal_openlock.experiment.workers import worker_pool
from causal_openlock.files.atomic import sweep, write_text
from causal_openlock.fitting.objective import Job, conditions_to_fit, jobs, joined, play, score
from causal_openlock.fitting.search import SearchSpace
from causal_openlock.version import __version__

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution

FILE = "fit.json"
ROUND = 4
"""Candidates that are proposed at a time."""

Played = Callable[[], pd.DataFrame]
"""Waits until a job is played, and gives its trials."""

Submit = Callable[[Job], Played]
"""Has a job played."""

RANDOM_FIRST = 12
"""Candidates that are drawn at random before the search learns from them."""


def require_optuna() -> None:
    """Make sure that there is something to search with.

    Raises:
        OpenLockError: If Optuna is not installed.
    """
    if importlib.util.find_spec("optuna") is None:
        raise OpenLockError(
            "a fit needs the package optuna; install it with: pip install 'causal-openlock[fit]'"
        )


@dataclass(frozen=True)
class Plan:
    """What is to be done.

    Attributes:
        space: What is searched.
        hold_out: Which points are held out; see :mod:`~causal_openlock.fitting.objective`.
        candidates: How many are tried.
        subjects: How many subjects each of them plays in each condition.
        finalists: How many of the best are played again.
        final_subjects: How many subjects then.
        seed: Of the search and of all play; the next two seeds are taken as well.
    """

    space: SearchSpace
    hold_out: str = "transfer"
    candidates: int = 60
    subjects: int = 40
    finalists: int = 5
    final_subjects: int = 200
    seed: int = 2018

    def as_dict(self) -> dict[str, Any]:
        """All that determines what candidates come to."""
        whole = {**asdict(self), "space": self.space.as_dict(), "version": __version__}
        # More candidates may be tried later.
        del whole["candidates"]
        return whole


@dataclass(frozen=True)
class Candidate:
    """What was tried, and what it came to.

    Attributes:
        number: In the order of the proposals, from 0.
        chosen: The parameters that are searched.
        rmse: Distance from people on the points that it is fitted to, in attempts.
    """

    number: int
    chosen: dict[str, float]
    rmse: float


@dataclass
class Fit:
    """How far a fit has come.

    Attributes:
        plan: What is to be done.
        done: What was tried, by number.
        again: Distances of the best, played again with more subjects and another seed.
    """

    plan: Plan
    done: dict[int, Candidate] = field(default_factory=dict)
    again: dict[int, float] = field(default_factory=dict)

    @property
    def best(self) -> Candidate:
        """The nearest to people of those played again."""
        number = min(self.again, key=lambda number: (self.again[number], number))
        return self.done[number]

    def table(self) -> pd.DataFrame:
        """All candidates, the nearest first: ``number``, their parameters, ``rmse``, ``again``."""
        rows = [
            {"number": one.number, **one.chosen, "rmse": one.rmse,
             "again": self.again.get(one.number, float("nan"))}
            for one in self.done.values()
        ]  # fmt: skip
        ordered: pd.DataFrame = pd.DataFrame(rows).sort_values(["rmse", "number"])
        return ordered.reset_index(drop=True)


def fit(
    plan: Plan,
    folder: Path | str,
    *,
    workers: int = 1,
    tell: Callable[[int, int, str], None] | None = None,
) -> tuple[Fit, pd.DataFrame]:
    """Do what is not yet done of a fit.

    Args:
        plan: What is to be done.
        folder: Where it is kept; one that holds a part of the same fit is completed.
        workers: How many processes play; with one it is this process.
        tell: Called with how many candidates are done, of how many, and what is going on.

    Returns:
        The fit, and what the best candidate did in all six conditions with a fresh seed, as
        :func:`~causal_openlock.analysis.measures.attempts_to_solve` gives it.

    Raises:
        OpenLockError: If Optuna is not installed, or the folder cannot be written to.
        StoreError: If the folder holds another fit.
        LearnerError: If the learner fails. Candidates that were done stay done.
    """
    require_optuna()
    path = Path(folder) / FILE
    state = _opened(plan, path)
    told = tell or (lambda done, total, what: None)
    conditions = conditions_to_fit(plan.hold_out)
    with _players(workers) as submit:
        for first in range(0, plan.candidates, ROUND):
            size = min(ROUND, plan.candidates - first)
            numbers = [number for number in range(first, first + size) if number not in state.done]
            if not numbers:
                continue
            proposed = _proposals(state, first)
            pending = {
                number: _submitted(submit, plan, proposed[number - first], conditions, plan.seed)
                for number in numbers
            }
            for number, awaited in pending.items():
                told(len(state.done), plan.candidates, "searching")
                trials = joined([trials() for trials in awaited])
                rmse = score(trials, plan.hold_out).fitted
                state.done[number] = Candidate(number, proposed[number - first], rmse)
                _keep(state, path)
        _play_again(state, path, submit, conditions, told)
        told(len(state.done), plan.candidates, "the best, on a fresh seed")
        awaited = _submitted(
            submit,
            plan,
            state.best.chosen,
            PAPER_CONDITIONS,
            plan.seed + 2,
            subjects=plan.final_subjects,
        )
        return state, joined([trials() for trials in awaited])


def _play_again(
    state: Fit,
    path: Path,
    submit: Submit,
    conditions: tuple[str, ...],
    told: Callable[[int, int, str], None],
) -> None:
    """Let the best few play again, with more subjects and another seed."""
    plan = state.plan
    tried = sorted(
        (one for one in state.done.values() if one.number < plan.candidates),
        key=lambda one: (one.rmse, one.number),
    )
    chosen = tried[: plan.finalists]
    for number in set(state.again) - {one.number for one in chosen}:
        del state.again[number]  # others are among the best since more were tried
    waiting = {
        one.number: _submitted(
            submit, plan, one.chosen, conditions, plan.seed + 1, subjects=plan.final_subjects
        )
        for one in chosen
        if one.number not in state.again
    }
    for number, awaited in waiting.items():
        told(len(state.done), plan.candidates, "the best few again")
        trials = joined([trials() for trials in awaited])
        state.again[number] = score(trials, plan.hold_out).fitted
        _keep(state, path)


def _submitted(
    submit: Submit,
    plan: Plan,
    chosen: Mapping[str, float],
    conditions: tuple[str, ...],
    seed: int,
    subjects: int | None = None,
) -> list[Played]:
    parameters = plan.space.parameters(chosen)
    many = subjects or plan.subjects
    return [submit(job) for job in jobs(plan.space.learner, parameters, conditions, many, seed)]


@contextmanager
def _players(workers: int) -> Iterator[Submit]:
    """Something that plays jobs: this process once it is asked, or several others at once."""
    if workers == 1:
        yield lambda job: partial(play, job)
        return
    with worker_pool(workers) as pool:
        executor: Executor = pool
        yield lambda job: executor.submit(play, job).result


# -- what to try next -----------------------------------------------------------------------------


def _proposals(state: Fit, first: int) -> list[dict[str, float]]:
    """The candidates of the round that begins with a number, whatever came after it."""
    import optuna

    logging.getLogger("optuna").setLevel(logging.WARNING)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        sampler = optuna.samplers.TPESampler(
            n_startup_trials=RANDOM_FIRST,
            constant_liar=True,
            seed=(state.plan.seed * 1_000_003 + first) % 2**32,
        )
        study = optuna.create_study(sampler=sampler)
        distributions = _distributions(state.plan.space)
        for number in range(first):
            known = state.done[number]
            study.add_trial(
                optuna.trial.create_trial(
                    params=known.chosen, distributions=distributions, value=known.rmse
                )
            )
        return [dict(study.ask(distributions).params) for _ in range(ROUND)]


def _distributions(space: SearchSpace) -> dict[str, BaseDistribution]:
    from optuna.distributions import FloatDistribution, IntDistribution

    return {
        name: IntDistribution(int(one.low), int(one.high), log=one.log)
        if one.whole
        else FloatDistribution(one.low, one.high, log=one.log)
        for name, one in space.ranges.items()
    }


# -- what is kept ---------------------------------------------------------------------------------


def _opened(plan: Plan, path: Path) -> Fit:
    """What a folder holds of a fit."""
    state = Fit(plan)
    sweep(path.parent)
    if not path.exists():
        return state
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        same = kept["plan"] == json.loads(json.dumps(plan.as_dict()))
        done = [Candidate(**one) for one in kept["done"]]
        again = {int(number): float(rmse) for number, rmse in kept["again"].items()}
        if same and not all(_is_of(plan, one) for one in done):
            raise ValueError
    except (ValueError, KeyError, TypeError, AttributeError, OSError):
        raise StoreError(f"{path}: this is no fit; choose another folder with --out") from None
    if not same:
        raise StoreError(
            f"{path.parent} holds another fit (its search space, seed, subjects, held-out points "
            "or version differ); choose another folder with --out"
        )
    state.done = {one.number: one for one in done}
    state.again = again
    return state


def _is_of(plan: Plan, one: Candidate) -> bool:
    """Whether a candidate that was read has a number, a distance and a value of each range."""
    if not isinstance(one.chosen, dict) or set(one.chosen) != set(plan.space.ranges):
        return False
    return isinstance(one.number, int) and all(
        isinstance(value, int | float) for value in (one.rmse, *one.chosen.values())
    )


def _keep(state: Fit, path: Path) -> None:
    done = [
        {"number": one.number, "chosen": one.chosen, "rmse": one.rmse}
        for one in sorted(state.done.values(), key=lambda one: one.number)
    ]
    again = {str(number): rmse for number, rmse in sorted(state.again.items())}
    whole = {"plan": state.plan.as_dict(), "done": done, "again": again}
    write_text(path, json.dumps(whole, indent=1) + "\n")

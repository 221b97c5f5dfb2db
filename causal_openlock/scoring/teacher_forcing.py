"""A learner in a recorded subject's place: it predicts each action, and then sees what was done.

The subject's session is played again with the recorded actions
(:mod:`~causal_openlock.scoring.recorded`). The learner learns from the subject's actions as if they
were its own, and from what the subject was shown, which is not scored. It never acts, unless it
gives neither ``probabilities`` nor ``predictions``, or draws are wanted in place of these: then
copies of it do (:mod:`~causal_openlock.scoring.inverse_binomial`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from causal_openlock.contract.checks import are_probabilities, failures_of
from causal_openlock.contract.learner import Account, InformedLearner, Learner
from causal_openlock.contract.registry import changed_parameters, create
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.condition import SHOWN
from causal_openlock.experiment.declare import LearnerSpec
from causal_openlock.experiment.session import Session
from causal_openlock.running.workers import worker_pool
from causal_openlock.scoring.inverse_binomial import by_draws
from causal_openlock.scoring.recorded import Recorded
from causal_openlock.wording import nearest


def scored_parts(
    jobs: Sequence[tuple[Recorded, LearnerSpec]],
    lapse: float,
    draws: int | None,
    workers: int,
    accounts: list[Account],
    report: Callable[[int, int], None] = lambda done, total: None,
) -> list[pd.DataFrame]:
    """The scores of learners on parts of a record, by job; what they say goes to ``accounts``."""
    tables = []
    with worker_pool(workers) if workers > 1 else nullcontext() as pool:
        calls = [partial(score_part, part, spec, lapse, draws) for part, spec in jobs]
        for result in [pool.submit(call).result for call in calls] if pool else calls:
            table, account = result()
            tables.append(table)
            accounts.append(account)
            report(len(tables), len(jobs))
    return tables


def score_part(
    part: Recorded, scored: LearnerSpec, lapse: float, draws: int | None = None
) -> tuple[pd.DataFrame, Account]:
    """Score how likely a learner finds each action of some subjects of a group.

    Args:
        part: The subjects.
        scored: The learner that predicts.
        lapse: The share of a subject's actions that are taken to be random, so that one action
            that the learner would never do does not outweigh all others.
        draws: Most copies to ask of a learner that gives no probabilities; see
            :func:`~causal_openlock.scoring.inverse_binomial.limit_of_draws`; None for predictions.

    Returns:
        A table, and what the learner says of its predictions. The table has a row for each action:
        ``scored`` is the learner that predicts; ``learner`` and the rest of
        :data:`~causal_openlock.scoring.recorded.GROUP` and ``subject`` say who acted; ``trial``
        (in the whole condition), ``attempt`` and ``action`` when, each from 1; ``action_index``
        what. ``log_probability`` is in nats, with lapses, and its ``standard_error`` 0 where it is
        exact; ``entropy`` is that of the learner's own probabilities, in nats; ``highest``, the
        probability of the action that it finds likeliest (both NaN where it gives none);
        ``impossible``, whether it would never do what was done, but for lapses; ``at_limit``,
        whether draws stopped before it was hit, so that its estimate is biased; ``price``, what the
        subject's BIC has for the numbers among the learner's parameters that are not its defaults
        (a word or a flag, such as a policy, names another theory, or where a model is).

    Raises:
        LearnerError: If the learner cannot be put in another's place, or fails there.
    """
    with failures_of(scored.name):
        learner, session = create(scored.learner, scored.parameters), part.session(scored)
        if not learner.learns_from_others:
            raise LearnerError(
                f"{scored.name} learns from its own actions alone, so it cannot be put in the "
                "place of a subject that did others; leave it out"
            )
        session.begin(learner)
        scores = _told(part, session, learner, scored.name, lapse, draws is None)
        account = learner.account() if scores else Account()
        scores = scores or by_draws(part, scored, draws, lapse, session.brief.actions)
    which = part.done_actions[part.done_actions["phase"] != SHOWN].drop(columns="phase")
    changed, actions = changed_parameters(scored.learner, scored.parameters), which["subject"]
    numbers = sum(type(value) in (int, float) for value in changed.values())
    table = pd.DataFrame(
        {
            "scored": scored.name,
            **part.group,
            **{name: column.to_numpy() for name, column in which.items()},
            **{name: values[part.asked] for name, values in scores.items()},
            "price": numbers * np.log(actions.groupby(actions).transform("size")).to_numpy(),
        }
    )
    of = {"scored": scored.name, **part.group}
    said = zip(part.numbers, account.transcripts, strict=False)
    labelled = tuple([{**of, "subject": who, **line} for line in lines] for who, lines in said)
    return table, Account(labelled, tuple(f"{scored.name}: {one}" for one in account.remarks))


def _told(
    part: Recorded, session: Session, learner: Learner, name: str, lapse: float, predicts: bool
) -> dict[str, NDArray[Any]] | None:
    """``[B, T]`` scores of a learner that gives its probabilities, or ``predicts``; None if not."""
    shape, choices = part.asked.shape, session.brief.actions
    own, entropy, highest = (np.zeros(shape) for _ in range(3))
    for moment in range(shape[1]):
        acts, action = part.asked[:, moment], part.actions[:, moment]
        found = learner.probabilities(session.view)
        if found is None and predicts:
            found = learner.predictions(replace(session.view, playing=acts))
        if found is None and moment == 0:
            return None
        if not (
            isinstance(found, np.ndarray)
            and len(found) == len(acts)
            and are_probabilities(found[acts], choices)
        ):
            raise LearnerError(
                f"the probabilities of {name} are not an array of {choices} for each subject, none "
                "below 0 and 1 in sum; its contract tests say more"
            )
        own[:, moment] = found[np.arange(len(found)), action]
        surprise = -np.log(found, where=found > 0, out=np.zeros_like(found, dtype=float))
        entropy[:, moment], highest[:, moment] = (found * surprise).sum(axis=1), found.max(axis=1)
        step = session.step(action)
        learner.learn(step)
        if isinstance(learner, InformedLearner) and step.trial_over.any():
            learner.inform(session.truth)
    with np.errstate(divide="ignore"):
        log_probability = np.log((1.0 - lapse) * own + lapse / choices)
    return {
        "log_probability": log_probability,
        "standard_error": np.zeros(shape),
        "entropy": entropy,
        "highest": highest,
        "impossible": own == 0,
        "at_limit": np.zeros(shape, dtype=bool),
    }


def known_learners(names: Sequence[str] | str, specs: Sequence[LearnerSpec]) -> list[LearnerSpec]:
    """Select learners by their labels.

    Raises:
        LearnerError: If there is none of a label.
    """
    known = {spec.name: spec for spec in specs}
    names = [names] if isinstance(names, str) else names
    for name in names:
        if name not in known:
            raise LearnerError(f"there is no learner {name!r}; {nearest(name, known)}")
    return [known[name] for name in names]

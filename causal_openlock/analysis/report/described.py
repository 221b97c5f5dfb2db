"""What was run, told once: tables that the page shows, and of which the methods are made."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import pandas as pd

from causal_openlock.experiment.condition import Trials
from causal_openlock.experiment.declare import Experiment
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.files.validation import several
from causal_openlock.wording import counted


def described(
    experiment: Experiment, trials: pd.DataFrame | None = None
) -> dict[str, pd.DataFrame]:
    """Return what was run as tables of text, by their titles.

    The ``trials`` that were played of it say how many each subject had.

    Example:
        >>> from causal_openlock import make_experiment
        >>> described(make_experiment("CC3", "random"))["Schemas"].to_numpy().tolist()
        [['CC3', 'L0 -> L1, L2; L1 | L2 -> door', '3', 'Common cause, three levers']]
    """
    played = {} if trials is None else trials_played(trials)
    schemas = {one.name: one for condition in experiment.conditions for one in condition.schemas}
    rewards = {spec.reward.name: spec.reward.as_dict() for spec in experiment.learners}
    learners = [
        (
            spec.name,
            "\n".join([spec.origin.class_name, spec.origin.package, spec.origin.about]).strip(),
            spec.protocol.name,
            spec.subjects,
            spec.reward.name,
            pairs(spec.parameters) or "none",
        )
        for spec in experiment.learners
    ]
    conditions = [
        (
            condition.name,
            ("shown: " if condition.shown else "") + _rooms(condition.train),
            _rooms(condition.test) or "–",
            played.get(condition.name, "–"),
        )
        for condition in experiment.conditions
    ]
    actions = {
        name: sorted({protocol.actions_for(schema) for protocol in experiment.protocols})
        for name, schema in schemas.items()
    }
    edges = [
        (name, schema.to_text().removeprefix(f"{name}: "), in_words(actions[name]), schema.title)
        for name, schema in schemas.items()
    ]
    tables = {
        "Learners": (learners, "Learner", "Class", "Protocol", "n", "Reward", "Parameters"),
        "Conditions": (conditions, "Condition", "Trials", "Test", "Played by each subject"),
        "Schemas": (edges, "Schema", "Causes -> effects", "Actions in an attempt", "Title"),
        "Protocols": ([(p.name, budgets(p)) for p in experiment.protocols], "Protocol", "Budgets"),
        "Rewards": ([(name, pairs(one)) for name, one in rewards.items()], "Reward", "Terms"),
    }
    return {name: pd.DataFrame(rows, columns=heads) for name, (rows, *heads) in tables.items()}


def budgets(protocol: Protocol) -> str:
    """The budgets of a protocol in sentences.

    >>> from causal_openlock.experiment.protocol import PROTOCOLS
    >>> budgets(PROTOCOLS["human"])[:71]
    'At most 30 attempts in a trial, which ends as soon as it is solved. Bas'
    """
    limit = counted(protocol.attempt_limit, "attempt")
    baseline = _times(protocol.baseline_trials, protocol.baseline_loops, "trial")
    train = _times(protocol.training_trials, protocol.train_loops, "training trial")
    tests = 1 if protocol.test_layout else protocol.test_trials
    sentences = [
        f"At most {limit} in a trial, which ends as soon as it is solved."
        if protocol.stop_when_solved
        else f"{limit} in every trial, also after it is solved.",
        f"Baseline: {baseline}.",
        f"Transfer: {train}, then {_times(tests, protocol.test_loops, 'test trial')}.",
        "Layouts are drawn at random, unless a condition says otherwise."
        if protocol.layouts == "random"
        else "Layouts are the published ones in random order, of which there may be fewer, or "
        "random ones where none are published, unless a condition says otherwise.",
    ]
    if protocol.test_layout:
        sentences.append(f"The test is in layout {protocol.test_layout}.")
    if protocol.action_limit:
        actions = counted(protocol.action_limit, "action")
        sentences.append(f"An attempt has at most {actions}.")
    return " ".join(sentences)


def trials_played(trials: pd.DataFrame) -> dict[str, str]:
    """How many trials a subject played in each condition, from the record itself.

    By condition a text such as ``5 training trials, then 1 test trial``, for each protocol if there
    are several.
    """
    by = ["condition", "protocol"]
    counts = trials.groupby([*by, "phase"], observed=True)[["trial", "loop"]].max().reset_index()
    told: dict[str, list[str]] = {}
    for (condition, protocol), phases in counts.groupby(by, observed=True):
        train = "training trial" if len(phases) > 1 else "trial"
        kinds = {"train": train, "test": "test trial"}
        words = [_times(row.trial, row.loop, kinds[row.phase]) for row in phases.itertuples()]
        name = f"{protocol}: " if counts["protocol"].nunique() > 1 else ""
        told.setdefault(str(condition), []).append(name + ", then ".join(words))
    return {condition: "; ".join(words) for condition, words in told.items()}


def _times(trials: Any, loops: Any, kind: str) -> str:
    return counted(trials, kind) + (f", gone through {loops} times" if loops > 1 else "")


def _rooms(group: Iterable[Trials]) -> str:
    """The schemas of trials, with what the condition itself says about them."""
    told = []
    for trials in group:
        layouts = trials.layouts
        if isinstance(layouts, tuple):
            layouts = ", ".join(layout.name for layout in layouts)  # type: ignore[assignment]
        details = (
            counted(trials.number, "trial") if trials.number else "",
            f"layouts {layouts}" if layouts else "",
            "" if trials.shuffle else "in this order",
        )
        named = ", ".join(filter(None, details))
        told.append(trials.schema.name + (f" ({named})" if named else ""))
    return "; ".join(told)


def pairs(values: Mapping[str, Any]) -> str:
    """``gamma 0.8, batch_size 64``; the terms of a reward need no heading, and it no name."""
    return ", ".join(
        in_words(value) if key == "terms" else f"{key} {in_words(value)}"
        for key, value in values.items()
        if key != "name"
    )


def in_words(value: Any) -> str:
    """Plain data as a reader would write them."""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        return "(" + pairs(value) + ")"
    if several(value):
        return ", ".join(map(in_words, value))
    return str(value)

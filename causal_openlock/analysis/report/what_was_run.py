"""Description of an experiment: short texts for the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import pandas as pd

from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.table import Table
from causal_openlock.experiment.declare import Protocol
from causal_openlock.files.validation import several
from causal_openlock.schemas.schema import Schema
from causal_openlock.storage.stored import StoredExperiment

_PROSE = Prose(__name__)


def what_was_run(
    experiment: StoredExperiment, played: Mapping[str, str] = MappingProxyType({})
) -> dict[str, Any]:
    """An experiment as short texts.

    Args:
        experiment: What was run.
        played: By condition, what each subject played, from :func:`trials_played`.

    Returns:
        Tables of learners, conditions and schemas, as the template ``report.html.j2`` shows them;
        the budgets of protocols and what is in rewards by their names; and ``each`` learner.
    """
    rewards = {spec.reward.name: spec.reward.as_dict() for spec in experiment.learners}
    conditions = experiment.conditions
    met = {schema.name: schema for condition in conditions for schema in condition.schemas}
    each = [
        {
            "name": spec.name,
            "about": spec.origin.about,
            "kind": spec.origin.class_name,
            "package": spec.origin.package,
            "protocol": spec.protocol.name,
            "reward": spec.reward.name,
            "parameters": pairs(spec.parameters),
        }
        for spec in experiment.learners
    ]
    learners = [
        (
            one["name"],
            "\n".join(filter(None, (one["kind"], one["package"], one["about"]))),
            one["protocol"],
            spec.subjects,
            one["reward"],
            one["parameters"] or "none",
        )
        for one, spec in zip(each, experiment.learners, strict=True)
    ]
    rooms = [
        (
            one.name,
            _PROSE.sentence("rooms", group=one.train, shown=one.shown),
            _PROSE.sentence("rooms", group=one.test, shown=False) or "–",
            played.get(one.name, "–"),
        )
        for one in conditions
    ]
    edges_of = [(name, f"{edges(schema)}\n{schema.title}") for name, schema in met.items()]
    return {
        "each": each,
        "learners": _table(learners, "Learner", "Class", "Protocol", "n", "Reward", "Parameters"),
        "conditions": _table(
            rooms, "Condition", "Trials in rooms of", "Test in rooms of", "Played by each subject"
        ),
        "schemas": _table(edges_of, "Schema", "Cause → effects"),
        "rewards": {
            name: pairs({key: value for key, value in reward.items() if key != "name"})
            for name, reward in rewards.items()
        },
        "protocols": {protocol.name: budgets(protocol) for protocol in experiment.protocols},
        "versions": [f"{name} {in_words(each)}" for name, each in experiment.versions.items()],
    }


def _table(rows: Sequence[tuple[Any, ...]], *heads: str) -> Table | None:
    """A table that is shown on the page alone; None without rows."""
    if not rows:
        return None
    return Table("", "", pd.DataFrame(rows, columns=[*heads]), verbatim=True)


def budgets(protocol: Protocol) -> str:
    """The budgets of a protocol in sentences.

    >>> from causal_openlock.experiment.declare import PROTOCOLS
    >>> budgets(PROTOCOLS["human"])[:71]
    'At most 30 attempts in a trial, which ends as soon as it is solved. Bas'
    """
    return _PROSE.sentence("budgets", protocol=protocol)


def trials_played(trials: pd.DataFrame) -> dict[str, str]:
    """How many trials a subject played in each condition, from the record itself.

    By condition a text such as ``5 training trials, then 1 test trial``, for each protocol if there
    are several.
    """
    keys = ["condition", "protocol", "phase"]
    counts = trials.groupby(keys, observed=True)[["trial", "loop"]].max().reset_index()
    several = counts["protocol"].nunique() > 1
    return {
        str(condition): _PROSE.sentence(
            "played",
            protocols={
                protocol: {row.phase: (row.trial, row.loop) for row in phases.itertuples()}
                for protocol, phases in own.groupby("protocol", observed=True)
            },
            several=several,
        )
        for condition, own in counts.groupby("condition", observed=True)
    }


def edges(schema: Schema) -> str:
    """A schema's edges in a line, such as ``L0 → L1, L2; L1, L2 → door``.

    Strengths other than 1 stand in brackets after the effect, gates other than ``any`` at the end.
    """
    data = schema.as_dict()
    causes: dict[str, list[str]] = {}
    for cause, effects in data["edges"].items():
        named = effects if isinstance(effects, Mapping) else dict.fromkeys(effects)
        text = ", ".join(
            f"{effect} ({in_words(values['strength'])})"
            if values and "strength" in values
            else effect
            for effect, values in named.items()
        )
        causes.setdefault(text, []).append(cause)
    parts = [f"{', '.join(names)} → {effects}" for effects, names in causes.items()]
    for node, gate in data.get("gates", {}).items():
        need = f"at least {gate['at_least']}" if isinstance(gate, Mapping) else gate
        parts.append(f"{node} needs {need} of its causes")
    if schema.inert:
        parts.append(f"without effect: {', '.join(schema.inert)}")
    return "; ".join(parts)


def pairs(values: Mapping[str, Any]) -> str:
    """``gamma 0.8, batch_size 64``; a list of reward terms needs no heading."""
    return ", ".join(
        in_words(value) if key == "terms" else f"{key}\u00a0{in_words(value)}"
        for key, value in values.items()
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

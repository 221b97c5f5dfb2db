"""What was run, in words: the description of an experiment made ready for the page.

An experiment describes itself as deep plain data (``experiment.json``: every default, and every
schema as often as it is met). Here it becomes a few flat tables and sentences. Whatever has another
form than an experiment of this package gives it is kept as it is, for the page to show as an
outline, so that nothing that was said gets lost.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from causal_openlock.wording import counted

if TYPE_CHECKING:
    import pandas as pd

_HEADING = (
    *("name", "title", "seed", "version", "versions", "command", "missing_cells", "failures"),
)
"""Shown elsewhere on the page."""
_RANDOM = "random"
_RANDOM_CLASS = "learners.random:RandomLearner"
_LEARNER = {"name", "protocol", "parameters"}
_CONDITION = {"name", "train"}
_BUDGETS = {
    "name",
    "attempt_limit",
    "stop_when_solved",
    "baseline_trials",
    "training_trials",
    "test_trials",
    "baseline_loops",
    "train_loops",
    "test_loops",
}


def describe(experiment: Mapping[str, Any]) -> dict[str, Any]:
    """An experiment as short texts.

    Args:
        experiment: As :meth:`causal_openlock.experiment.experiment.Experiment.as_dict` gives it,
            and perhaps ``versions``; or any other plain data.

    Returns:
        A dictionary:

        - ``learners``: ``name``, ``kind`` (its class), ``package``, ``protocol``, ``subjects``,
          ``reward`` and ``parameters`` of each.
        - ``rewards``: by name, the terms that add up.
        - ``conditions``: ``name``, ``train`` and ``test`` of each.
        - ``schemas``: ``name``, ``title`` and ``edges`` of each schema that is met.
        - ``protocols``: by name, the budgets in a sentence.
        - ``versions``: one text for each package.
        - ``rest``: everything else, as it was given.
    """
    rest = {key: value for key, value in experiment.items() if key not in _HEADING}
    learners: Any = experiment.get("learners")
    conditions: Any = experiment.get("conditions")
    result: dict[str, Any] = {
        "learners": [],
        "conditions": [],
        "schemas": [],
        "protocols": {},
        "rewards": {},
    }
    if mappings_with(learners, _LEARNER) and all(
        mappings_with([one["protocol"]], _BUDGETS) for one in learners
    ):
        del rest["learners"]
        result["learners"] = [_learner(one) for one in learners]
        for one in learners:
            result["protocols"][str(one["protocol"]["name"])] = budgets(one["protocol"])
            if mappings_with([reward := one.get("reward")], {"name", "terms"}):
                named = {key: value for key, value in reward.items() if key != "name"}
                result["rewards"][str(reward["name"])] = _pairs(named)
    if mappings_with(conditions, _CONDITION) and mappings_with(_trials(conditions), {"schema"}):
        del rest["conditions"]
        result["conditions"] = [
            {
                "name": one["name"],
                "train": "; ".join(map(_rooms, one["train"])),
                "test": "; ".join(map(_rooms, one.get("test") or [])),
            }
            for one in conditions
        ]
        met = {str(each["schema"]["name"]): each["schema"] for each in _trials(conditions)}
        result["schemas"] = [
            {"name": name, "title": schema.get("title", ""), "edges": edges(schema)}
            for name, schema in met.items()
        ]
    versions = experiment.get("versions") or {}
    result["versions"] = [f"{name} {in_words(version)}" for name, version in versions.items()]
    result["rest"] = {
        key.replace("_", " "): value
        for key, value in rest.items()
        if value is not None and value not in ("", [], {})
    }
    return result


def budgets(protocol: Mapping[str, Any]) -> str:
    """The budgets of a protocol in sentences.

    For instance: "At most 30 attempts in a trial, which ends as soon as it is solved. Baseline: 5
    trials. Transfer: 6 training trials, then 1 test trial. Fewer where fewer layouts are published;
    a condition may say otherwise."
    """
    most = counted(protocol["attempt_limit"], "attempt")
    if protocol["stop_when_solved"]:
        said = [f"At most {most} in a trial, which ends as soon as it is solved."]
    else:
        said = [f"{most} in every trial, also after it is solved."]
    fixed = protocol.get("test_layout")
    base = _loops(protocol["baseline_trials"], protocol["baseline_loops"], "")
    training = _loops(protocol["training_trials"], protocol["train_loops"], "training ")
    test = _loops(1 if fixed else protocol["test_trials"], protocol["test_loops"], "test ")
    said.append(f"Baseline: {base}. Transfer: {training}, then {test}.")
    if protocol.get("layouts") == "random":
        said.append("A condition may say otherwise. Layouts are drawn at random.")
    else:
        said.append("Fewer where fewer layouts are published; a condition may say otherwise.")
    if fixed:
        said.append(f"The test is in layout {fixed}.")
    if protocol.get("action_limit"):
        said.append(f"An attempt has at most {counted(protocol['action_limit'], 'action')}.")
    known = {*_BUDGETS, "layouts", "test_layout", "action_limit"}
    said += [f"{key}: {in_words(value)}." for key, value in protocol.items() if key not in known]
    return " ".join(said)


def trials_played(trials: pd.DataFrame) -> dict[str, str]:
    """How many trials a subject played in each condition, from the record itself.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.

    Returns:
        By condition a text such as ``5 training trials, then 1 test trial``, for each protocol if
        there are several.
    """
    grouped = trials.groupby(["condition", "protocol", "phase"], observed=True)
    counts = grouped[["trial", "loop"]].max().reset_index()
    several = counts["protocol"].nunique() > 1
    said: dict[str, list[str]] = {}
    for (condition, protocol), phases in counts.groupby(["condition", "protocol"], observed=True):
        kinds = {"train": "training " if "test" in set(phases["phase"]) else "", "test": "test "}
        parts = [
            _loops(row["trial"], row["loop"], kinds[row["phase"]])
            for row in phases.to_dict("records")
        ]
        text = (f"{protocol}: " if several else "") + ", then ".join(parts)
        said.setdefault(str(condition), []).append(text)
    return {condition: "; ".join(texts) for condition, texts in said.items()}


def edges(schema: Mapping[str, Any]) -> str:
    """A schema's edges in a line, such as ``L0 → L1, L2; L1, L2 → door``.

    Strengths other than 1 stand in brackets after the effect, gates other than ``any`` at the end.
    """
    causes: dict[str, list[str]] = {}
    for cause, effects in schema.get("edges", {}).items():
        named = effects if isinstance(effects, Mapping) else dict.fromkeys(effects)
        text = ", ".join(
            f"{effect} ({in_words(values['strength'])})"
            if values and "strength" in values
            else effect
            for effect, values in named.items()
        )
        causes.setdefault(text, []).append(cause)
    parts = [f"{', '.join(names)} → {effects}" for effects, names in causes.items()]
    for node, gate in (schema.get("gates") or {}).items():
        need = f"at least {gate['at_least']}" if isinstance(gate, Mapping) else gate
        parts.append(f"{node} needs {need} of its causes")
    if schema.get("inert"):
        parts.append(f"without effect: {', '.join(schema['inert'])}")
    return "; ".join(parts)


def _learner(one: Mapping[str, Any]) -> dict[str, Any]:
    reward: Any = one.get("reward")
    return {
        "name": one["name"],
        "kind": one.get("class") or one.get("learner") or "",
        "package": one.get("package") or "",
        "protocol": one["protocol"]["name"],
        "subjects": one.get("subjects"),
        "reward": reward["name"]
        if mappings_with([reward], {"name", "terms"})
        else in_words(reward),
        "parameters": _pairs(one["parameters"] or {}),
    }


def _pairs(values: Mapping[str, Any]) -> str:
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
        return "(" + _pairs(value) + ")"
    if isinstance(value, Iterable) and not isinstance(value, str):
        return ", ".join(map(in_words, value))
    return str(value)


def _trials(conditions: Iterable[Mapping[str, Any]]) -> list[Any]:
    return [each for one in conditions for each in (*one["train"], *(one.get("test") or []))]


def _rooms(trials: Mapping[str, Any]) -> str:
    """Whose rooms some trials are in, with what the condition itself says about them."""
    said = []
    if trials.get("number"):
        said.append(counted(trials["number"], "trial"))
    layouts = trials.get("layouts")
    if isinstance(layouts, str):
        said.append(f"{layouts} layouts")
    elif layouts:
        said.append("layouts " + "; ".join(in_words(layout) for layout in layouts))
    if trials.get("shuffle") is False:
        said.append("in this order")
    name = str(trials["schema"]["name"])
    return f"{name} ({', '.join(said)})" if said else name


def _loops(trials: int, loops: int, kind: str) -> str:
    return counted(trials, f"{kind}trial") + (f", gone through {loops} times" if loops > 1 else "")


def mappings_with(values: Any, keys: set[str]) -> bool:
    """Whether this is a list of mappings that have these keys, one at least."""
    return (
        isinstance(values, list)
        and bool(values)
        and all(isinstance(value, Mapping) and keys <= value.keys() for value in values)
    )


def random_learners(experiment: Mapping[str, Any]) -> set[str]:
    """Labels of the learners that draw every action at random.

    Args:
        experiment: As :meth:`causal_openlock.experiment.experiment.Experiment.as_dict` gives it;
            without learners in it, whoever is called ``random`` is taken for one.
    """
    learners: Any = experiment.get("learners")
    if not mappings_with(learners, {"name"}):
        return {_RANDOM}
    return {
        str(one["name"])
        for one in learners
        if one.get("class") == _RANDOM_CLASS or one.get("learner") == _RANDOM
    }

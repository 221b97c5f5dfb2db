"""An experiment from its description: what a results folder says of itself, brought back to life.

``experiment.json`` holds an experiment as plain data, every default filled in. Here its parts
become conditions, protocols and rewards again, and the whole of it an experiment file, for whoever
wants to play it again without the file that it was declared in.

A description can be damaged, or written by anybody; what is none is a :class:`StoreError`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from causal_openlock.errors import StoreError
from causal_openlock.experiment.protocol import PROTOCOLS, Condition, Protocol, Trials
from causal_openlock.formats.schema_file import schema_from_dict
from causal_openlock.world.reference import room_facts
from causal_openlock.world.reward_code import OwnReward
from causal_openlock.world.rewards import AuthorsReward, Reward, RewardFunction, Weights
from causal_openlock.world.room import Layout, position_names, positions_for, published_layouts
from causal_openlock.world.schema import Schema

BUDGETS = (
    *("attempt_limit", "stop_when_solved", "baseline_trials", "training_trials", "test_trials"),
    *("baseline_loops", "train_loops", "test_loops", "layouts", "test_layout", "action_limit"),
)
"""What an experiment file can say of a protocol."""

Given = ParamSpec("Given")
Made = TypeVar("Made")


def _reads(what: str) -> Callable[[Callable[Given, Made]], Callable[Given, Made]]:
    """For what takes a description apart: whatever it trips over is said in a sentence."""

    def reading(take: Callable[Given, Made]) -> Callable[Given, Made]:
        @wraps(take)
        def taking(*given: Given.args, **named: Given.kwargs) -> Made:
            try:
                return take(*given, **named)
            except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
                said = " ".join(f"{type(error).__name__}: {error}".split())[:120]
                raise StoreError(
                    f"{what} in experiment.json is not as compare writes it ({said}); restore the "
                    "file, or compare again"
                ) from None

        return taking

    return reading


@_reads("a condition")
def condition_from_dict(data: Mapping[str, Any]) -> Condition:
    """A condition from :meth:`~causal_openlock.experiment.protocol.Condition.as_dict`."""
    train, test = (
        tuple(_trials_from_dict(trials) for trials in data.get(phase) or ())
        for phase in ("train", "test")
    )
    return Condition(data["name"], train, test)


def _trials_from_dict(data: Mapping[str, Any]) -> Trials:
    schema = schema_from_dict(data["schema"])
    layouts: Any = data["layouts"]
    if isinstance(layouts, list):
        layouts = tuple(_layout(schema, places) for places in layouts)
    return Trials(schema, layouts, data["number"], data["shuffle"])


def _layout(schema: Schema, places: list[int]) -> Layout:
    """A layout by its places; a published one goes by its name."""
    for name in published_layouts(schema):
        published = Layout.of(schema, name)
        if list(published.places) == places:
            return published
    return Layout(tuple(places), positions_for(schema))


def recorded_layout(schema: Schema, name: str, positions: int) -> Layout:
    """A layout by its name in the record: a published one, or its positions in order.

    Raises:
        StoreError: If it is neither.
    """
    if name in room_facts()["layouts"]:
        return Layout.of(schema, name, positions)
    known = position_names(positions)
    places = name.split()
    if len(places) != len(schema.levers) or not set(places) <= set(known):
        raise StoreError(
            f"the layout {name!r} in the record does not say where the {len(schema.levers)} "
            f"levers of {schema.name} stand; compare again to make a record that does"
        )
    return Layout(tuple(map(known.index, places)), positions)


@_reads("a protocol")
def protocol_from_dict(data: Mapping[str, Any]) -> Protocol:
    """A protocol from :meth:`~causal_openlock.experiment.protocol.Protocol.as_dict`."""
    return Protocol(**data)


@_reads("a reward")
def reward_from_dict(data: Mapping[str, Any]) -> RewardFunction:
    """A reward from what :meth:`RewardFunction.as_dict` gives; no code is loaded."""
    if "terms" in data:
        weights = Weights(**data.get("weights", {}))
        return Reward(data["name"], tuple(data["terms"]), weights)
    if "function" in data:
        return OwnReward(data["function"], data["source"])
    return AuthorsReward(**data)


@_reads("the experiment")
def experiment_file(description: Mapping[str, Any], schemas: str = "schemas") -> dict[str, Any]:
    """The experiment file of a description, as plain data.

    Args:
        description: As :meth:`~causal_openlock.experiment.experiment.Experiment.as_dict` gives it.
        schemas: The folder beside the file in which every schema is found as ``NAME.yaml``.

    Returns:
        What to write as YAML. Reading it gives an experiment of the same identity, where the
        schemas, the learners and this package are the same.
    """
    learners = description["learners"]
    protocols: dict[str, Protocol] = {}
    names: list[str] = []
    for entry in learners:
        names.append(_named(protocol_from_dict(entry["protocol"]), protocols))
    return {
        "name": description["name"],
        "title": description.get("title", ""),
        "seed": description["seed"],
        "cell_size": description["cell_size"],
        "conditions": [_condition(one, schemas) for one in description["conditions"]],
        "learners": [
            {
                "learner": entry["learner"],
                "name": entry["name"],
                "protocol": name,
                "subjects": entry["subjects"],
                "reward": reward_from_dict(entry["reward"]).written(),
                "parameters": entry["parameters"],
            }
            for entry, name in zip(learners, names, strict=True)
        ],
        **({"protocols": {n: _budgets(p) for n, p in protocols.items()}} if protocols else {}),
    }


def _named(protocol: Protocol, own: dict[str, Protocol]) -> str:
    """The name of a protocol, which is kept if the package does not have it."""
    if PROTOCOLS.get(protocol.name) != protocol:
        own[protocol.name] = protocol
    return protocol.name


def _budgets(protocol: Protocol) -> dict[str, Any]:
    held = protocol.as_dict()
    # What is none is left to the base, which has none either.
    given = {name: held[name] for name in BUDGETS if held[name] is not None}
    return {"based_on": "human", **given}


def _condition(data: Mapping[str, Any], schemas: str) -> dict[str, Any]:
    told: dict[str, Any] = {"name": data["name"]}
    for phase in ("train", "test"):
        if groups := data.get(phase):
            told[phase] = [_trials(group, schemas) for group in groups]
    return told


def _trials(data: Mapping[str, Any], schemas: str) -> dict[str, Any]:
    schema = schema_from_dict(data["schema"])
    told: dict[str, Any] = {"schema": f"{schemas}/{schema.name}.yaml"}
    layouts: Any = data["layouts"]
    if isinstance(layouts, list):
        told["layouts"] = [_layout_in_words(schema, places) for places in layouts]
    elif layouts is not None:
        told["layouts"] = layouts
    if data["number"] is not None:
        told["trials"] = data["number"]
    if not data["shuffle"]:
        told["shuffle"] = False
    return told


def _layout_in_words(schema: Schema, places: list[int]) -> Any:
    layout = _layout(schema, places)
    if layout.name in published_layouts(schema):
        return layout.name
    names = position_names(layout.positions)
    return {lever: names[place] for lever, place in zip(schema.levers, places, strict=True)}

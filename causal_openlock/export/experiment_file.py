"""An experiment as an experiment file, which :func:`read_experiment` reads back."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.protocol import PROTOCOLS, Protocol, Trials
from causal_openlock.files.json_text import present
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.room import Layout, position_names, published_layouts


def experiment_file(experiment: Experiment, schemas: str = "schemas") -> dict[str, Any]:
    """The experiment file of an experiment, as plain data to write as YAML.

    Reading it gives an experiment of the same identity where the schemas, the learners and this
    package are the same. The file names each schema as ``NAME.yaml`` in a folder next to it.
    """
    own = [one for one in experiment.protocols if PROTOCOLS.get(one.name) != one]
    return present(
        {
            "name": experiment.name,
            "title": experiment.title,
            "seed": experiment.seed,
            "cell_size": experiment.cell_size,
            "conditions": [
                present(
                    {
                        "name": one.name,
                        "train": {"shown": _trials(one.train, schemas)}
                        if one.shown
                        else _trials(one.train, schemas),
                        "test": _trials(one.test, schemas) or None,
                    }
                )
                for one in experiment.conditions
            ],
            "learners": [
                present(
                    {
                        "learner": spec.learner,
                        "name": spec.name,
                        "protocol": spec.protocol.name,
                        "subjects": spec.subjects,
                        "cell_size": spec.cell_size,
                        "reward": spec.reward.written(),
                        "parameters": spec.parameters,
                    }
                )
                for spec in experiment.learners
            ],
            "protocols": {one.name: _settings(one) for one in own} or None,
        }
    )


def _settings(protocol: Protocol) -> dict[str, Any]:
    # A setting that is None is left to the base, in which it is None as well.
    given = {name: value for name, value in asdict(protocol).items() if value is not None}
    del given["name"]
    return {"based_on": "human", **given}


def _trials(group: Iterable[Trials], schemas: str) -> list[dict[str, Any]]:
    found = []
    for trials in group:
        data: dict[str, Any] = {"schema": f"{schemas}/{trials.schema.name}.yaml"}
        if isinstance(trials.layouts, tuple):
            data["layouts"] = [_layout(trials.schema, layout) for layout in trials.layouts]
        elif trials.layouts is not None:
            data["layouts"] = trials.layouts
        if trials.number is not None:
            data["trials"] = trials.number
        if not trials.shuffle:
            data["shuffle"] = False
        found.append(data)
    return found


def _layout(schema: Schema, layout: Layout) -> str | dict[str, str]:
    if layout.name in published_layouts(schema):
        return layout.name
    names = position_names(layout.positions)
    return {lever: names[at] for lever, at in zip(schema.levers, layout.places, strict=True)}

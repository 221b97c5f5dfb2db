"""Experiments as a results folder holds them, for tests that have records and no folder."""

import json

from causal_openlock.analysis.measures import count
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import Reference, references_of
from causal_openlock.experiment.condition import PAPER_CONDITIONS, Condition, find_condition
from causal_openlock.experiment.declare import RANDOM_CLASS, LearnerSpec
from causal_openlock.experiment.making import read_experiment
from causal_openlock.experiment.origin import Origin
from causal_openlock.experiment.protocol import PROTOCOLS, Protocol
from causal_openlock.files.checksums import json_bytes, read_json
from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.storage.store import StoredExperiment, parse_experiment
from causal_openlock.world.rewards import find_reward
from support.fabricated_records import table


def stored(experiment, **known):
    """An experiment from its ``experiment.json``, and what its folder would tell of its cells."""
    data = {"identity": experiment.identity, **experiment.as_dict(), "cells": []}
    found = parse_experiment(json.loads(json.dumps(data)))
    return StoredExperiment(**{**vars(found), **known})


def declared(folder, text):
    """The experiment of an experiment file, given what follows its name."""
    path = folder / "made_up.yaml"
    path.write_text(f"name: made_up\n{text}")
    return stored(read_experiment(path))


def spec(name, protocol=PROTOCOLS["human"], **changed):
    """A learner that is not installed."""
    given = {
        "learner": "made_up",
        "parameters": {},
        "reward": find_reward("paper"),
        "subjects": 1,
        "recorded": Origin(RANDOM_CLASS if name == "random" else "made_up:Learner", "made-up 1.0"),
        **changed,
    }
    return LearnerSpec(name=name, protocol=protocol, **given)


def condition_called(name):
    """The paper's condition of that name, or one in rooms of CC4."""
    if name in PAPER_CONDITIONS or name in bundled_schemas():
        return find_condition(name)
    return Condition(name, find_condition("CC4").train)


def experiment_of(record, **known):
    """An experiment that a record may be of; protocols of other names go on when solved."""
    names = ("learner", "protocol", "condition")
    found = {n: sorted(map(str, record[n].unique().to_pylist())) for n in names}
    played = record.select(["learner", "protocol"]).to_pylist() if record.num_rows else []
    protocols = {n: PROTOCOLS.get(n) or Protocol(n, 30, False) for n in found["protocol"]}
    pairs = sorted({(row["learner"], row["protocol"]) for row in played})
    given = {
        "name": "made_up",
        "title": "Made up",
        "seed": 1,
        "cell_size": 40,
        "conditions": tuple(map(condition_called, found["condition"])),
        "learners": tuple(spec(learner, protocols[protocol]) for learner, protocol in pairs),
        **known,
    }
    return StoredExperiment(**given)


def edit_stored(folder, change):
    """Change the content of a folder's ``experiment.json``, and give it the checksum it needs."""
    path = folder / "experiment.json"
    held = read_json(path.read_bytes())
    change(held)
    path.write_bytes(json_bytes(held))


NOBODY = experiment_of(table([]))
"""An experiment that nobody plays."""

NO_ONE_BESIDE = references_of(NOBODY)
"""References that stand beside nobody."""


class BesideAll(Reference):
    """A reference that stands beside whoever played as people did by the protocol's name."""

    def stands(self, rows):
        return (rows["protocol"] == "human").to_numpy(bool)


BESIDE_ALL = tuple(
    BesideAll(**{**vars(one), "cells": frozenset({("", "", "")})}) for one in NO_ONE_BESIDE
)


def summary_table(record, experiment=None):
    """The summary of a record, beside references by the names of conditions or by experiment."""
    return _beside(record, experiment).summary


def headline_table(record, experiment=None):
    """The headline, likewise."""
    return _beside(record, experiment).headline


def _beside(record, experiment):
    if experiment:
        return Material.of(record, experiment)
    return material_of(record, experiment_of(record), references=BESIDE_ALL)


def material_of(record, experiment, **values):
    """What sections are made of, without people or bounds to compare with."""
    given = {
        **dict(zip(("all_trials", "blocks"), count(record), strict=True)),
        "learners": tuple(one.name for one in experiment.learners),
        "references": NO_ONE_BESIDE,
        "bounds": {},
        **values,
    }
    return Material(record=record, experiment=experiment, **given)

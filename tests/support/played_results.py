"""Small results in memory, most of them really played, for tests and examples of figures."""

from dataclasses import replace
from functools import cache

import pyarrow as pa

from causal_openlock.analysis.results.material import Material
from causal_openlock.contract.registry import create
from causal_openlock.experiment.condition import PAPER_CONDITIONS
from causal_openlock.experiment.making import Changes, find_experiment, read_experiment, sweep
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.experiment.session import Session
from support.fabricated_records import record_of_every_figure, table
from support.made_up_experiments import NOBODY, experiment_of, stored

SHORT = replace(
    PROTOCOLS["rl"],
    name="short",
    attempt_limit=20,
    **{size: 1 for size in vars(PROTOCOLS["rl"]) if size.endswith("_loops")},
)
"""A protocol that goes on when a trial is solved, and is over soon."""


def played(learners, conditions=PAPER_CONDITIONS, subjects=3, protocol=None):
    """Learners in conditions, under their own protocol or another."""
    changes = Changes(conditions, learners, None, subjects, 6)
    experiment = read_experiment(find_experiment("default"), changes)
    if protocol is not None:
        specs = tuple(replace(one, protocol=protocol) for one in experiment.learners)
        experiment = replace(experiment, learners=specs)
    record = pa.concat_tables(
        Session(condition, spec.protocol, subjects, seed=6, learner=spec.name).play(
            create(spec.learner, spec.parameters)
        )
        for spec in experiment.learners
        for condition in experiment.conditions
    )
    return Material.of(record, stored(experiment))


@cache
def results():
    """Two learners that played as people did; the first of them is not the first by alphabet."""
    return played(["random", "oracle"])


@cache
def trained():
    """One learner under a protocol with many attempts."""
    return played(["random"], protocol=SHORT)


@cache
def believed():
    """One learner that holds beliefs."""
    return played(["bayes"], ["CC3"], 2)


@cache
def swept():
    """A learner once for each of two values, and another one, in two conditions."""
    return played([*sweep("theory_based", top_down=[True, False]), "random"], ["CC3", "CE3"], 2)


@cache
def empty():
    """Nobody played."""
    return Material.of(table([]), NOBODY)


@cache
def fabricated():
    """Several learners, conditions and protocols, made up."""
    record = record_of_every_figure()
    return Material.of(record, experiment_of(record))

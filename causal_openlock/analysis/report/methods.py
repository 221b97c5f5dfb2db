"""The methods section of a paper, from results alone: what it takes to repeat and to judge them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import pandas as pd

from causal_openlock.analysis.effects import ALPHA
from causal_openlock.analysis.report.described import described, in_words, pairs
from causal_openlock.analysis.report.warnings import about_people
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import Reference
from causal_openlock.analysis.statistics import LEVEL, sizes
from causal_openlock.contract.registry import changed_parameters, registry
from causal_openlock.experiment.declare import PERSON, LearnerSpec
from causal_openlock.files.validation import plain
from causal_openlock.wording import counted, joined


class Methods(str):
    """Text in paragraphs, which a notebook shows as such."""

    __slots__ = ()

    def _repr_markdown_(self) -> str:
        return str(self)


def methods(results: Material) -> Methods:
    """Return the methods section of a paper on these results, in paragraphs.

    Where a learner is not installed here in the version that played, its defaults are not known,
    and all its parameters are given.

    >>> from causal_openlock import compare
    >>> results = compare("CC4", ["oracle"], subjects=2, workers=0)
    >>> print(results.methods().split(". ")[1])
    Condition CC4 (CC4): 5 trials
    """
    seeds = [str(seed) for seed in sorted(results.trials["seed"].astype(int).unique())]
    versions = [
        f"{name} {in_words(version)}"
        for name, version in results.experiment.versions.items()
        if version != "not installed"
    ]
    tables = described(results.experiment, results.trials)
    paragraphs = (
        _rooms(results, tables),
        _subjects(results, tables),
        _measures(results),
        [
            f"All randomness follows from the {'seed' if len(seeds) == 1 else 'seeds'} "
            f"{joined(seeds)}, with streams of random numbers of its own for each subject.",
            f"Played with {joined(versions)}.",
            "To cite: Edmonds et al. (2018), Human Causal Transfer: Challenges for Deep "
            "Reinforcement Learning, CogSci; and causal_openlock by its CITATION.cff.",
        ],
    )
    return Methods("\n\n".join(" ".join(filter(None, sentences)) for sentences in paragraphs))


def _rooms(results: Material, tables: Mapping[str, pd.DataFrame]) -> Iterator[str]:
    """The paragraph on subjects, rooms and budgets."""
    headline = results.headline.groupby("learner", sort=False)
    subjects = [f"{name} ({sizes(own)})" for name, own in headline]
    yield (
        f"{joined(subjects)} played in rooms of OpenLock (Edmonds et al., 2018), in which levers "
        "and a door follow a hidden causal schema; n counts the subjects in a condition."
    )
    for name, train, test, played in tables["Conditions"].to_numpy():
        rooms = train if test == "–" else f"{train}, tested in {test}"
        yield f"Condition {name} ({rooms}): {played}."
    yield "L0 -> L1 says that L1 can be moved while L0 is pushed (| while any is, & while all are)."
    for name, edges, actions, _ in tables["Schemas"].to_numpy():
        yield f"Schema {name} is {edges}; an attempt has at most {actions} actions there."
    for name, budgets in tables["Protocols"].to_numpy():
        own = tables["Learners"].query("Protocol == @name")["Learner"]
        yield f"Protocol {name} ({', '.join(own)}): {budgets}"


def _subjects(results: Material, tables: Mapping[str, pd.DataFrame]) -> Iterator[str]:
    """The paragraph on people, learners and what these had learned before."""
    experiment = results.experiment
    if experiment.missing:
        cells = f"{len(experiment.missing)} of {len(experiment.files)} cells"
        yield f"{cells} were not played and are missing from all results."
    yield about_people(results)
    yield (
        "Subjects of the same number and seed met the same rooms in the same order, whatever the "
        "learner."
    )
    for why in experiment.reasons:
        yield f"Not applicable: {why}."
    for spec in experiment.learners:
        if spec.origin.class_name == PERSON:
            yield f"{spec.name} are people."
            continue
        yield f"{_settings(spec)}."
        if spec.origin.informed:
            yield f"{spec.name} was told what subjects cannot perceive: a bound and not a learner."
    for name, attempts in results.trained_before.items():
        if attempts != attempts:
            yield f"What {name} had learned before the experiment is unknown."
            continue
        yield (
            f"{name} was trained for {counted(int(attempts), 'attempt')} before the experiment, "
            "which are not in its numbers of attempts; its subjects share this training, so "
            "intervals are over rooms and leave out how much trainings differ."
        )
    for name, terms in tables["Rewards"].to_numpy():
        yield f"The reward {name} is {terms}."


def _settings(spec: LearnerSpec) -> str:
    """A learner's name, class, and the parameters that are to be given."""
    entry, origin = registry().get(spec.learner), spec.origin
    dist = entry.dist if entry else None
    here = dist is not None and origin.package.startswith(f"{dist.name} {dist.version}")
    given = plain(spec.parameters)
    if here and entry is not None and entry.value == origin.class_name:
        changed = changed_parameters(spec.learner, given)
        parameters = f"default parameters{f' except {pairs(changed)}' if changed else ''}"
    else:
        parameters = f"the parameters {pairs(given)}" if given else "no parameters"
    return f"{spec.name} is {spec.learner} of {origin.package} with {parameters}"


def _measures(results: Material) -> Iterator[str]:
    """The paragraph on measures and statistics."""
    yield (
        "The measure is the number of attempts until every solution of a room was found, the last "
        "one included. A trial that was not solved counts as its limit. A condition is judged by "
        "the mean of a subject's test trials or, without a test, by the last trial. Means over "
        f"at least five subjects have Student's {LEVEL:.0%} intervals, but where 90% or more of "
        "the subjects have the same value. Learners are compared by mean differences of paired "
        "subjects, averaged over the conditions that both played, with intervals and two-sided "
        "tests by t with Welch and Satterthwaite's degrees of freedom, or, where 90% or more of "
        "the differences are the same, by the sign test (a permutation test where rooms differ)."
    )
    references = [_source(one) for one in results.references if one.cells and len(one.points)]
    if references:
        yield (
            "Where learners played the same rooms under the same budgets, they are compared, by "
            "the same tests for independent groups, with the means and standard errors of "
            f"{joined(references)}."
        )
    yield (
        f"An effect is called significant if p < {ALPHA} after Holm's correction over the tests of "
        "one question, such as which pairs of learners differ; whether training with the same "
        "structure helps in a test is a planned question, tested by Student's t without correction."
    )


def _source(reference: Reference) -> str:
    """``people (Edmonds et al., 2018; n = 40)``."""
    parts = filter(None, (reference.source or reference.detail, sizes(reference.points)))
    return f"{reference.name} ({'; '.join(parts)})"

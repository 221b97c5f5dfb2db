"""The paragraphs of a paper's methods section, from results alone.

What a reader needs to repeat and to judge a comparison: conditions, budgets, learners with what
differs from their defaults, subjects, training before the experiment, how uncertainty is computed,
versions, seed, and what to cite.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from causal_openlock.analysis.effects import ALPHA
from causal_openlock.analysis.measures import CELL, SUBJECT
from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.report.about_people import about_people
from causal_openlock.analysis.report.what_was_run import edges, pairs, trials_played
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.statistics import LEVEL, RESAMPLES
from causal_openlock.contract.registry import changed_parameters, registry
from causal_openlock.experiment.declare import PERSON, Condition, LearnerSpec, Protocol
from causal_openlock.files.validation import plain
from causal_openlock.schemas.finding import bundled, bundled_schemas
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.rewards import RewardFunction

PAPER_SCHEMAS = ("CC3", "CE3", "CC4", "CE4")
_PROSE = Prose(__name__)


class Methods(str):
    """Text in paragraphs, which a notebook shows as such."""

    __slots__ = ()

    def _repr_markdown_(self) -> str:
        return str(self)


def methods(results: Material) -> Methods:
    """Return the methods section of a paper on these results, a paragraph for each of its topics.

    Nothing but the results is needed. Where a learner is not installed here in the version that
    played, its defaults are not known, and all its parameters are given.

    >>> from causal_openlock import compare
    >>> results = compare("CC4", ["oracle"], subjects=2, workers=0)
    >>> print(results.methods().split(". ")[1])
    The condition was CC4 (5 trials)

    Args:
        results: The results of one or more folders.
    """
    experiment, trials = results.experiment, results.trials
    played = [spec for spec in experiment.learners if spec.name in results.learners]
    learners = [spec for spec in played if spec.origin.class_name != PERSON]
    met = {one.name: one for condition in experiment.conditions for one in condition.schemas}
    found = _PROSE.paragraphs(
        "text",
        learners=[spec.name for spec in learners],
        people=[spec.name for spec in played if spec not in learners],
        played=trials_played(trials),
        conditions=results.conditions,
        schemas={name: (edges(one), len(one.solutions)) for name, one in met.items() if _own(one)},
        actions=_actions(experiment.protocols, met.values()),
        protocols=[
            (one, [spec.name for spec in played if spec.protocol == one])
            for one in experiment.protocols
        ],
        shown=[one for one in experiment.conditions if one.shown],
        own_rooms=[one.name for one in experiment.conditions if _has_own_rooms(one)],
        subjects=_subjects(results),
        about_people=about_people(results),
        missing=len(experiment.missing),
        cells=len(experiment.files),
        described=[_described(spec) for spec in learners],
        informed=[spec.name for spec in learners if spec.origin.informed],
        trained={name: int(n) for name, n in results.trained_before.items() if n == n},
        unknown=[name for name, n in results.trained_before.items() if n != n],
        rewards={spec.reward.name: _terms(spec.reward) for spec in learners},
        not_applicable=experiment.reasons,
        references=[
            one.reference for one in results.references if one.cells and len(one.reference.points)
        ],
        level=LEVEL,
        resamples=RESAMPLES,
        alpha=ALPHA,
        seeds=[str(seed) for seed in sorted(trials["seed"].astype(int).unique())],
        versions=experiment.versions,
    )
    works = _works(experiment.versions.get("causal-openlock"), " ".join(found))
    return Methods("\n\n".join([*found, *_PROSE.paragraphs("to_cite", works=works)]))


def _described(spec: LearnerSpec) -> dict[str, Any]:
    """A learner's name, class, and the parameters that are to be given."""
    entry, origin = registry().get(spec.learner), spec.origin
    dist = entry.dist if entry else None
    here = dist is not None and origin.package.startswith(f"{dist.name} {dist.version}")
    known = here and entry is not None and entry.value == origin.class_name
    given = plain(spec.parameters)
    if known:
        given = changed_parameters(spec.learner, given)
    return {
        "name": spec.name,
        "learner": spec.learner,
        "package": origin.package,
        "parameters": pairs(given),
        "knows_defaults": known,
        "is_plain": known and not given and spec.name == spec.learner,
    }


def _terms(reward: RewardFunction) -> str:
    return pairs({key: value for key, value in reward.as_dict().items() if key != "name"})


def _own(schema: Schema) -> bool:
    """Whether a schema is another than the paper's of that name."""
    known = bundled_schemas().get(schema.name) if schema.name in PAPER_SCHEMAS else None
    return known is None or {**known.as_dict(), "title": ""} != {**schema.as_dict(), "title": ""}


def _actions(protocols: tuple[Protocol, ...], schemas: Any) -> dict[int, list[str]]:
    """Schemas of rooms, by the number of actions in an attempt there."""
    found: dict[int, list[str]] = {}
    for limit, name in {
        (one.actions_for(room), room.name) for one in protocols for room in schemas
    }:
        found.setdefault(limit, []).append(name)
    return {limit: sorted(found[limit]) for limit in sorted(found)}


def _has_own_rooms(condition: Condition) -> bool:
    """Whether the layouts of a condition are others than its protocol's."""
    trials = (*condition.train, *condition.test)
    return bool(condition.rooms) or any(one.layouts or not one.shuffle for one in trials)


def _subjects(results: Material) -> dict[str, list[str]]:
    """Learners, by their number of subjects in each condition, in words."""
    sizes = results.trials.drop_duplicates([*CELL, *SUBJECT]).groupby(CELL, observed=True).size()
    found: dict[str, list[str]] = {}
    for learner, own in sizes.groupby("learner", observed=True):
        low, high = int(own.min()), int(own.max())
        words = f"{low:,}" if low == high else f"{low:,} to {high:,}"
        found.setdefault(words, []).append(str(learner))
    return found


def _works(version: Any, text: str) -> list[Mapping[str, Any]]:
    """Works to cite, from ``CITATION.cff``: the software in the version used, and what is named."""
    from ruamel.yaml import YAML

    held = YAML(typ="safe", pure=True).load(bundled("CITATION.cff").read_text(encoding="utf-8"))
    if isinstance(version, str):
        held["version"] = version.partition("+")[0]
    named = [
        one
        for one in (held["preferred-citation"], *held["references"])
        if f"{one['authors'][0]['family-names']} et al., {one['year']}" in text
    ]
    works = {one["title"]: one for one in (held, *named)}
    return [{"year": str(one.get("date-released"))[:4], **one} for one in works.values()]

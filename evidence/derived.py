"""Tables with a row for each learner, computed from all units of a study together."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd

from causal_openlock.analysis.measures import CELL
from causal_openlock.analysis.topics.learning_cost import costs_by_learner, shown
from causal_openlock.errors import EvidenceError
from causal_openlock.paper.likeness import Likeness, distance, likeness, points_of_model
from causal_openlock.paper.noise_ceiling import beside_null_models
from causal_openlock.paper.references import people
from evidence.run import COSTS, read_units
from evidence.study import Study
from evidence.theories import confusions


def distances_from_people(study: Study, units: pd.DataFrame) -> pd.DataFrame:
    """Distances of learners from people's means, next to the noise ceiling and null models.

    Columns: as :func:`~causal_openlock.paper.noise_ceiling.beside_null_models`
    returns; ``effects``, of how many of people's six effects a learner has the sign; and ``model``,
    its distance from the fourteen means of the published model.
    """
    trials, like = beside_people(study, units)
    played = trials[trials["learner"].isin(like.points)]
    table = beside_null_models(like, played, study.file.fitted)
    effects = {name: own["like_people"].sum() for name, own in like.effects.items()}
    model = points_of_model()["mean"].to_numpy()
    far = {name: distance(own.assign(people_mean=model))[0] for name, own in like.points.items()}
    learners = table["learner"]
    return table.assign(effects=learners.map(effects).astype("Int64"), model=learners.map(far))


def beside_people(study: Study, units: pd.DataFrame) -> tuple[pd.DataFrame, Likeness]:
    """The trials of a study, and its learners compared with people's fourteen means.

    Raises:
        EvidenceError: If no learner has played all six conditions.
    """
    trials = units.rename(columns={"unit": "subject"})
    trials = trials.assign(experiment=study.name, seed=0, loop=1)
    cells = frozenset(trials[CELL].astype(str).itertuples(index=False, name=None))
    like = likeness(trials, replace(people(), cells=cells), list(dict.fromkeys(trials["learner"])))
    if like is None:
        raise EvidenceError("no learner has played all six conditions")
    return trials, like


def learning_costs(study: Study, units: pd.DataFrame) -> pd.DataFrame:
    """The attempts that each learner needs until it solves a new room well, as in a report."""
    table = shown(costs_by_learner(read_units(study, COSTS)))
    return table.set_index("learner").loc[units["learner"].unique()].reset_index()


DERIVED_TABLES = {
    "distances_from_people": distances_from_people,
    "learning_costs": learning_costs,
    "confusion": confusions,
}
"""Tables that a study may declare as ``derived``."""

"""Distances of learners from people of one's own, or any reference but the paper's people."""

from __future__ import annotations

import pandas as pd

from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.section import Section
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Topic
from causal_openlock.paper.likeness import distance, points_beside
from causal_openlock.paper.noise_ceiling import misfit, noise_ceiling
from causal_openlock.paper.references import PEOPLE
from causal_openlock.wording import file_names

_HEADS = ["learner", "points", "RMSE", "in standard errors", "misfit", "perfect"]


def section(material: Material) -> Section | None:
    """A table for each reference that is given; None if none is."""
    tables = []
    files = file_names(one.reference.prefix for one in material.leading)
    for one in material.leading:
        points = points_beside(one, material.trials)
        if one.reference.name == PEOPLE or points.empty:
            continue
        rows = [
            (name, len(own), *distance(own), misfit(own).in_words, noise_ceiling(own).both)
            for name, own in points.groupby("learner")
        ]
        frame = pd.DataFrame(rows, columns=_HEADS).sort_values("RMSE", ignore_index=True)
        formats = dict.fromkeys(("RMSE", "in standard errors", "perfect"), ".2f")
        name = one.reference.name
        caption = (
            f"Root mean square distance of mean attempts from {name} over the trials that both "
            "played, in attempts and in the reference's standard errors; misfit: the sum of "
            "squared deviations in standard errors of both, and the probability of as much for a "
            "perfect model; perfect: the distance of a perfect model, since all means have "
            "sampling error."
        )
        file = f"distance_from_{files[one.reference.prefix]}"
        tables.append(Table(file, f"Distance from {name}", frame, formats, caption))
    title = "Distance from other references"
    return Section("distance", title, tables=tuple(tables)) if tables else None


TOPIC = Topic("distance", 21, section)

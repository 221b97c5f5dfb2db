"""Distances of learners from people of one's own, or any reference but the paper's people."""

from __future__ import annotations

import pandas as pd

from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.section import Section
from causal_openlock.analysis.topic import Topic
from causal_openlock.paper.likeness import distance, points_beside
from causal_openlock.paper.noise_ceiling import misfit, noise_ceiling
from causal_openlock.paper.references import PEOPLE
from causal_openlock.wording import file_names

_PROSE = Prose(__name__)
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
        name, file = one.reference.name, f"distance_from_{files[one.reference.prefix]}"
        tables.append(_PROSE.table("distance", frame, formats, file, of=name))
    return _PROSE.section("distance", tables) if tables else None


TOPIC = Topic("distance", 21, section)

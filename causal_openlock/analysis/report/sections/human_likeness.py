"""How like people each learner is, at the points where people's means are published."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from causal_openlock.analysis.plots.likeness import clear_of_chance, plot_likeness
from causal_openlock.analysis.report.prose import Prose
from causal_openlock.analysis.report.section import Section
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.people.human_likeness import (
    EFFECTS,
    PUBLISHED_MODEL,
    effects_of,
    likeness,
    points_of_people,
    published_points,
)

_PROSE = Prose("human_likeness")


def section(material: Material) -> Section | None:
    """Of the learners that played all six conditions as people did; None if there are none."""
    like = likeness(material.trials, material.like_people, material.learners)
    if like is None:
        return None
    table, found = like.table, like.effects
    table["clear"] = [clear_of_chance(found[name]) for name in table["learner"]]
    order = ["people", *table["learner"]]
    tests = {"people": effects_of(points_of_people()), **found}
    each = pd.concat([tests[name].assign(learner=name) for name in order], ignore_index=True)
    published = table["learner"] == PUBLISHED_MODEL
    return _PROSE.section(
        "human_likeness",
        [
            _PROSE.table("human_likeness", _differences(table), _FORMATS, effects=EFFECTS),
            _PROSE.table("human_likeness_tests", each[_TESTED], _FORMATS),
        ],
        [_PROSE.plot("human_likeness", plot_likeness, material)],
        points=len(published_points()),
        effects=len(EFFECTS),
        nearest=table[~published].iloc[0],
        published=table[published].iloc[0],
    )


_TESTED = ["learner", "effect", "difference", "t", "df", "p"]
_FORMATS: Mapping[str, str] = {
    **dict.fromkeys(("RMSE", "RMSE (SE)", "t"), ".2f"),
    **{"difference": "+.2f", "p": ".3f"},
}


def _differences(table: pd.DataFrame) -> pd.DataFrame:
    """Differences as they are, with a tick or a cross, the nearest learner first."""
    ticks = {
        effect.name: [
            "" if np.isnan(value) else f"{'✓' if value > 0 else '✗'} {value:+.1f}"
            for value in table[effect.name]
        ]
        for effect in EFFECTS
    }
    names = {"rmse": "RMSE", "rmse_se": "RMSE (SE)", "shown": "signs"}
    frame = table.assign(**ticks).rename(columns=names)
    frame.insert(frame.columns.get_loc("signs") + 1, "p < .05", frame.pop("clear"))
    return frame

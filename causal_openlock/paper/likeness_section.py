"""Section on each learner's likeness to people, where people's means are published."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd

from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.section import Section
from causal_openlock.analysis.topic import Topic
from causal_openlock.paper.likeness import (
    EFFECTS,
    PUBLISHED_MODEL,
    distance,
    effects_of,
    points_of_people,
    published_points,
)
from causal_openlock.paper.likeness_figure import MOST_TOGETHER, likeness_of, plot_likeness
from causal_openlock.paper.noise_ceiling import (
    beside_null_models,
    chosen_settings,
    misfit,
    noise_ceiling,
    null_curves,
)

_PROSE = Prose(__name__)


def section(material: Material) -> Section | None:
    """Section on learners that played all six conditions as people did; None without any."""
    like = material.once(likeness_of)
    if like is None:
        return None
    table, found = like.table, like.effects
    order = ["people", *table["learner"]]
    tests = {"people": effects_of(points_of_people()), **found}
    each = pd.concat([tests[name].assign(learner=name) for name in order], ignore_index=True)
    published = table["learner"] == PUBLISHED_MODEL
    beside = beside_null_models(
        like, material.trials, chosen_settings(material.experiment.learners)
    )
    ceiling = noise_ceiling(points_of_people())
    nearest = {
        "effects": len(EFFECTS),
        "nearest": table[~published].iloc[0],
        "published": table[published].iloc[0],
        "perfect": ceiling.people,
    }
    nearest["misfit"] = misfit(like.points[nearest["nearest"]["learner"]])
    return _PROSE.section(
        "human_likeness",
        [
            _PROSE.table("human_likeness_distances", _shown(beside), _FORMATS),
            _PROSE.table("human_likeness", _differences(table), _FORMATS, effects=EFFECTS),
            _PROSE.table("human_likeness_tests", each[_TESTED], _FORMATS),
        ],
        [
            replace(
                _PROSE.plot(
                    "fourteen_points", plot_likeness, material, {"together": True},
                    most=MOST_TOGETHER,
                ),
                opening=True,
            ),
            replace(_PROSE.plot("human_likeness", plot_likeness, material), folded=True),
        ],
        answer=_PROSE.sentence("answer", **nearest),
        is_open=True,
        points=len(published_points()),
        nearest=nearest["nearest"],
        ceiling=ceiling,
        curves={name: distance(curve.points)[0] for name, curve in null_curves().items()},
        # Of those that come out no farther than the nearest one beyond people's sampling error.
        alike=beside.loc[beside["verdict"] == "not ranked", "learner"].tolist(),
    )  # fmt: skip


_TESTED = ["learner", "effect", "difference", "t", "df", "p"]
_HEADS = {
    "learner": "learner",
    "rmse": "RMSE",
    "misfit": "misfit",
    "ceiling": "perfect",
    "difference": "difference",
    "low": "low",
    "high": "high",
    "verdict": "verdict",
    "settings": "settings",
    "spreads": "spreads",
    "all": "training, all",
    "misfit_all": "misfit, all",
    "first": "training, first",
    "misfit_first": "misfit, first",
    "second": "training, second",
    "misfit_second": "misfit, second",
}
_IN_ATTEMPTS = ("rmse", "all", "first", "second")
_FORMATS: Mapping[str, str] = {
    **{_HEADS[name]: ".2f" for name in (*_IN_ATTEMPTS, "ceiling", "spreads")},
    **{"difference": "+.2f", "low": "+.2f", "high": "+.2f", "t": ".2f", "p": ".3f"},
}


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    """The distances, without those of parts of the points."""
    return table[list(_HEADS)].rename(columns=_HEADS)


def _differences(table: pd.DataFrame) -> pd.DataFrame:
    """Differences as they are, with a tick or a cross, the nearest learner first."""
    ticks = {
        effect.name: [
            "" if np.isnan(value) else f"{'✓' if value > 0 else '✗'} {value:+.1f}"
            for value in table[effect.name]
        ]
        for effect in EFFECTS
    }
    frame = table.assign(**ticks).rename(columns={"shown": "signs"})
    return frame.drop(columns=["points", "rmse", "rmse_se"])


TOPIC = Topic("human_likeness", 20, section)

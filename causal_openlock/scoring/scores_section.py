"""A section of the report: which learner predicts what subjects did, if they were scored.

It is made of what ``causal-openlock score`` left in a results folder. Statistics are those of
:mod:`~causal_openlock.scoring.scores`, for the subjects of each learner by themselves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import ALPHA, holm
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.section import Section, SectionPlot
from causal_openlock.analysis.topic import Topic
from causal_openlock.scoring.on_record import PROSE, scores_on_record
from causal_openlock.scoring.scores import SUBJECT, Scores
from causal_openlock.scoring.worst_predicted import failures, worst_attempts
from causal_openlock.wording import file_names
from causal_openlock.world.room import positions_for

MOST_PLOTS = 4
"""Maximum number of learners that get a figure; tables list all."""
MOST_SUBJECTS = 200
"""Maximum number of subjects that get a row; ``followed.csv`` lists all."""
SURE = 0.9
"""Probability from which a subject is said to follow a learner."""
_ATTRIBUTED = ["condition", "subject", "follows", "probability", "ahead"]
_NAMES = {
    **{"scored": "predicted by", "by": "predicted by", "low": "ci_low", "high": "ci_high"},
    **{"worse": "more than best", "worse_low": "low", "worse_high": "high"},
    **{"p_corrected": "p corrected", "best_of": "best of"},
}
_FORMATS = {
    **dict.fromkeys(("bits", "ci_low", "ci_high", "expected", "beyond"), ".2f"),
    **dict.fromkeys(("more than best", "low", "high"), "+.2f"),
    **{"p corrected": ".2g", "followed": ".0%", "most frequent": ".2f"},
    **{"actions": ",", "subjects": ",", "probability": ".2f", "ahead": ",.1f"},
}


def section(material: Material) -> Section | None:
    """Section: the best predictor, the learners that subjects follow, its failures; or None."""
    positions = {
        one.name: max(map(positions_for, one.schemas)) for one in material.experiment.conditions
    }
    who: list[dict[str, Any]] = []
    names = ("scores", "attributed", "failures", "worst_attempts")
    tables: dict[str, list[pd.DataFrame]] = {name: [] for name in names}
    plots: list[SectionPlot] = []
    on_record = scores_on_record(material)
    each = on_record.each
    parts = file_names(each)
    for of, one in each.items():
        ranked, shares = one.ranking, one.followed.set_index("scored")
        best = str(ranked["scored"].iloc[0])
        own = one.actions[one.actions["scored"] == best]
        worst = failures(own, positions)
        ranked = ranked.assign(
            p_corrected=holm(ranked["p"].where(ranked["worse"].notna()).to_numpy(float)),
            followed=shares.loc[ranked["scored"], "frequency"].to_numpy(),
            **{"most frequent": shares.loc[ranked["scored"], "protected"].to_numpy()},
        )
        tables["scores"].append(ranked.assign(of=of))
        if len(ranked) > 1:
            tables["attributed"].append(one.attributed[_ATTRIBUTED].assign(of=of))
        tables["failures"].append(worst.assign(of=of, by=best))
        tables["worst_attempts"].append(worst_attempts(own, positions).assign(of=of, by=best))
        sure = one.attributed.query("probability >= @SURE")["follows"].value_counts()
        found = _found(of, ranked, worst, own, one.choices)
        who.append({**found, "sure": sure.to_dict(), "at_least": SURE})
        if len(plots) < MOST_PLOTS:
            name = f"scores_{parts[of]}"
            call = f"results.scores.plot(of={of!r})"
            plots.append(
                PROSE.plot("scores", Scores.plot, one, {"of": of}, name, call, of=of,
                            bands=len(ranked))
            )  # fmt: skip
    if not (who or on_record.notes):
        return None
    if sum(map(len, tables["attributed"])) > MOST_SUBJECTS:
        del tables["attributed"]
    shown = [
        PROSE.table(name, _shown(rows, len(each)), _FORMATS)
        for name, rows in tables.items()
        if rows
    ]
    return PROSE.section("scores", shown, plots, who=who, subjects=_sizes(material, each),
                          notes=on_record.notes)  # fmt: skip


def _found(
    of: str,
    ranked: pd.DataFrame,
    worst: pd.DataFrame,
    own: pd.DataFrame,
    choices: Mapping[str, int],
) -> dict[str, Any]:
    """Values of the sentences about the subjects of one learner."""
    others = ranked.iloc[1:]
    beaten = others["p_corrected"] < ALPHA
    size = {name: np.log2(count) for name, count in choices.items()}
    return {
        "of": of,
        "best": ranked.iloc[0].to_dict(),
        "beaten": others.loc[beaten, "scored"].tolist(),
        "others": others.loc[~beaten, "scored"].tolist(),
        "uniform": float(own["condition"].astype(str).map(size).mean()),
        "actions": len(own),
        "most": ranked.loc[ranked["followed"].idxmax()].to_dict(),
        "worst": worst.iloc[0].to_dict(),
    }


def _shown(tables: Sequence[pd.DataFrame], several: int) -> pd.DataFrame:
    """Join tables; with several learners, the column of whose subjects they are is first."""
    table = pd.concat(tables, ignore_index=True).rename(columns=_NAMES)
    first = [*(["of"] if several > 1 else []), *table.columns.intersection(["predicted by"])]
    order = [*first, *(name for name in table.columns if name not in ("of", "predicted by", "p"))]
    return table[order]


def _sizes(material: Material, each: Mapping[str, Scores]) -> tuple[int, int]:
    """Number of subjects that are scored, and of those of the same learners on record."""
    scored = sum(len(one.subjects[SUBJECT].drop_duplicates()) for one in each.values())
    trials = material.trials
    known = trials[trials["learner"].isin(list(each))]
    return scored, len(known[SUBJECT].drop_duplicates())


TOPIC = Topic("scores", 25, section)

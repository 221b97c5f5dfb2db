"""A page for each learner: what it is, what it came to, and how much its subjects vary.

A mean hides whether all subjects did alike or half of them never solved a thing. So beside its
numbers each learner has a figure in which every subject counts: a circle is as large as the share
of subjects that needed so many attempts.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from causal_openlock.analysis.measures import by_subject, ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.style import Drawing
from causal_openlock.analysis.report.section import Section, Table
from causal_openlock.analysis.report.what_was_run import pairs
from causal_openlock.analysis.results.summary import judged
from causal_openlock.experiment.experiment import LearnerSpec

FORMATS = {
    "subjects": ",",
    **dict.fromkeys(("attempts", "ci_low", "ci_high", "people", "model", "ideal"), ".2f"),
    "difference": "+.2f",
    "solved": ".1%",
}
_RENAMED = {
    "share_solved": "solved",
    "human_attempts": "people",
    "model_attempts": "model",
    "ideal_attempts": "ideal",
}
_BINS = 30  # heights that circles can have
_AREA = 420.0  # of a circle that is all subjects, in square points
_CIRCLE, _PEOPLE = "#56B4E9", "#D55E00"


def learner_pages(
    trials: pd.DataFrame,
    headline: pd.DataFrame,
    learners: Sequence[str],
    specs: Sequence[LearnerSpec] = (),
) -> list[Section]:
    """A section for each learner.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.
        headline: From :func:`~causal_openlock.analysis.results.summary.headline`.
        learners: The order of the pages.
        specs: What each learner is.

    Returns:
        The sections, called ``learner_1``, ``learner_2``, ...; their tables and drawings are
        called by the learner's name.
    """
    known = {spec.name: spec for spec in specs}
    values = by_subject(judged(trials), ["phase", "trial"])
    pages, taken = [], set[str]()
    for number, name in enumerate(learners, 1):
        own = headline[headline["learner"] == name]
        if own.empty:
            continue
        label = "learner_" + (re.sub(r"\W+", "_", name.lower(), flags=re.ASCII).strip("_") or "_")
        while label in taken:  # names that differ in signs only
            label += "_2"
        taken.add(label)
        pages.append(
            Section(
                f"learner_{number}",
                name,
                tuple(_told(known.get(name))),
                (_table(own, label, name),),
                (_drawing(values[values["learner"] == name], own, trials, label, name),),
            )
        )
    return pages


def _told(spec: LearnerSpec | None) -> list[str]:
    """What a learner is, in two sentences."""
    if spec is None:
        return []
    origin = spec.origin
    return [
        f"{origin.class_name} of {origin.package}, under protocol {spec.protocol.name}, with the "
        f"reward {spec.reward.name}.",
        f"Parameters: {pairs(spec.parameters)}." if spec.parameters else "It has no parameters.",
    ]


def _table(own: pd.DataFrame, label: str, name: str) -> Table:
    frame = own.drop(columns=["learner", "human_se", "model_se"]).rename(columns=_RENAMED)
    kept = [
        column
        for column in frame.columns
        if frame[column].notna().any() and (column != "protocol" or frame[column].nunique() > 1)
    ]
    return Table(
        label,
        f"{name} in every condition",
        frame[kept].reset_index(drop=True),
        FORMATS,
        "Mean attempts to solve the trial that the condition is judged by, with the 95% bootstrap "
        "interval over subjects.",
    )


def _drawing(
    values: pd.DataFrame, own: pd.DataFrame, trials: pd.DataFrame, label: str, name: str
) -> Drawing:
    protocols = ordered(values["protocol"], ("human",))
    with style.settings():
        figure, panels = style.panels(len(protocols), columns=1, height=2.6)
        for axes, protocol in zip(panels, protocols, strict=True):
            rows = own[own["protocol"] == protocol]
            # The same scale on every learner's page, so that pages can be laid side by side.
            limit = float(trials.loc[trials["protocol"] == protocol, "last_attempt"].max())
            highest = (rows["human_attempts"] + rows["human_se"]).max()
            limit = max(limit, highest if highest == highest else 0.0)
            for place, row in enumerate(rows.to_dict("records")):
                chosen = values[
                    (values["protocol"] == protocol) & (values["condition"] == row["condition"])
                ]
                _subjects(axes, place, chosen["attempts"].to_numpy(float), limit)
                _means(axes, place, row)
            size = f"protocol {protocol}, {style.sizes(rows)}"
            if len(protocols) > 1:
                style.panel_title(axes, protocol, style.sizes(rows))
            _scale(axes, list(rows["condition"]), limit)
            axes.set_ylabel("Attempts")
        style.legend(figure, _keys(own), columns=2)
        figure.set_figheight(figure.get_figheight() + 0.2)
    people = own["human_attempts"].notna().any()
    told = [
        f"Attempts of the subjects of {name} in the trial that each condition is judged by "
        f"({size if len(protocols) == 1 else 'a panel for each protocol'}). The area of a circle "
        "is the share of subjects; black: their mean with its 95% bootstrap interval",
        "; diamond: people’s mean ± standard error" if people else "",
        "; dashed: the ideal observer" if own["ideal_attempts"].notna().any() else "",
        ". A trial that was not solved counts as the limit.",
    ]
    return Drawing(label, f"Subjects of {name}", "".join(told), figure)


def _subjects(axes: Axes, place: float, attempts: Any, limit: float) -> None:
    width = max(1.0, limit / _BINS)
    heights, counts = np.unique(np.round(attempts / width) * width, return_counts=True)
    axes.scatter(
        np.full(len(heights), place - 0.12),
        heights,
        s=_AREA * counts / len(attempts),
        color=_CIRCLE,
        alpha=0.75,
        linewidths=0.5,
        edgecolors="#1F6F9F",
        zorder=2,
        clip_on=False,
    )


def _means(axes: Axes, place: float, row: Mapping[str, Any]) -> None:
    mean, low, high = row["attempts"], row["ci_low"], row["ci_high"]
    if low == low:
        axes.plot([place + 0.14] * 2, [low, high], color="black", lw=1.4, zorder=3)
    axes.plot([place + 0.08, place + 0.2], [mean] * 2, color="black", lw=2, zorder=3)
    if row["human_attempts"] == row["human_attempts"]:
        axes.errorbar(
            place + 0.3,
            row["human_attempts"],
            row["human_se"],
            fmt="D",
            ms=4.5,
            color=_PEOPLE,
            elinewidth=1,
            capsize=2,
            zorder=3,
        )
    if row["ideal_attempts"] == row["ideal_attempts"]:
        style.ideal_line(axes, row["ideal_attempts"], place - 0.38, place + 0.4)


def _keys(own: pd.DataFrame) -> list[Any]:
    dot: Any = {"marker": "o", "ls": "", "ms": 7, "mec": "#1F6F9F", "alpha": 0.75}
    keys = [
        Line2D([], [], color=_CIRCLE, label="subjects", **dot),
        Line2D([], [], color="black", lw=2, label="mean, 95% interval"),
    ]
    if own["human_attempts"].notna().any():
        keys.append(Line2D([], [], color=_PEOPLE, marker="D", ls="", ms=4.5, label="people"))
    return [*keys, style.ideal_key()] if own["ideal_attempts"].notna().any() else keys


def _scale(axes: Axes, conditions: Sequence[str], limit: float) -> None:
    names = [name if len(name) <= 16 else f"{name[:9]}…{name[-6:]}" for name in conditions]
    axes.set_xticks(range(len(names)), [name.replace("$", r"\$") for name in names])
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.set_ylim(0, 1.03 * limit)
    axes.yaxis.set_major_locator(MaxNLocator(6, integer=True, steps=[1, 2, 5, 10]))

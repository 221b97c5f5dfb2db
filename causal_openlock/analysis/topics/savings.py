"""Savings: which share of the attempts training saves in the first room with four levers.

The first test trial after training with three levers is compared with the first trial of subjects
without any training, whatever the structure of the training was. Whether it mattered is the
question of :mod:`~causal_openlock.analysis.topics.congruency`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, PercentFormatter

from causal_openlock.analysis.measures import BASELINES, TRANSFERS, by_subject, ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, panels, trials_under
from causal_openlock.analysis.plots.rows import dots, name_rows, two_panels
from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import Reference
from causal_openlock.analysis.section import Section
from causal_openlock.analysis.statistics import LEVEL, SEED, bootstrap_interval, error_of_bar
from causal_openlock.analysis.topic import Topic
from causal_openlock.errors import NothingToDrawError
from causal_openlock.experiment.declare import HUMAN_PROTOCOL
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.wording import file_names

COLUMNS = (
    *("learner", "reference", "protocol", "condition", "subjects", "attempts", "untrained"),
    *("solved", "saved", "low", "high"),
)
"""Columns of :func:`savings`."""

_PROSE = Prose(__name__)
_FORMATS = {"attempts": ".2f", "untrained": ".2f", "solved": ".2f"}
_FORMATS |= dict.fromkeys(("saved", "low", "high"), ".1%")


def share_saved(untrained: FloatArray, trained: FloatArray) -> FloatArray:
    """Return which share of the attempts training saves: 1 − trained / untrained.

    >>> float(share_saved(np.array([10.0, 30]), np.array([5.0])))
    0.75

    Args:
        untrained: ``[..., n]`` attempts in the first trial of subjects without training.
        trained: ``[..., m]`` attempts in the first test trial of those with training.
    """
    share: FloatArray = 1 - trained.mean(axis=-1) / untrained.mean(axis=-1)
    return share


def savings(results: Material) -> pd.DataFrame:
    """Return which share of the attempts training saves in a first trial, by learner.

    Args:
        results: What was played; rows are made of the paper's conditions.

    Returns:
        A row for each learner, protocol and transfer condition whose baseline was played,
        references first where they are comparable with a learner: ``learner``, whether it is a
        ``reference``, ``protocol``, ``condition``, ``subjects``, mean ``attempts`` in the first
        test trial, the mean of those ``untrained``, the share of both trials that was ``solved``,
        the share ``saved`` (NaN if none was solved), and the ends ``low`` and ``high`` of its 95%
        interval: by bootstrap over subjects, and of references from their error bars.
    """
    trials = results.trials
    trials = trials[trials["condition"].isin([*BASELINES, *TRANSFERS])]
    first = trials[(trials["loop"] == 1) & (trials["trial"] == 1)]
    is_test = first["condition"].isin(TRANSFERS)
    first = first[first["phase"] == np.where(is_test, "test", "train")]
    each = by_subject(first, [])
    rows: list[tuple[Any, ...]] = []
    for protocol in ordered(first["protocol"].unique(), (HUMAN_PROTOCOL,)):
        here = first[first["protocol"] == protocol]
        for one in results.references:
            if one.stands(here).any():
                rows += _published(one.reference, protocol)
        for name in ordered(here["learner"].unique(), results.learners):
            own = each[(each["learner"] == name) & (each["protocol"] == protocol)]
            held = {str(key): part for key, part in own.groupby("condition", observed=True)}
            for condition in TRANSFERS:
                untrained = condition.split("-")[1]
                if condition in held and untrained in held:
                    pair = held[untrained], held[condition]
                    rows.append((name, False, protocol, condition, *_of_learner(*pair)))
    return pd.DataFrame(rows, columns=[*COLUMNS])


def _of_learner(untrained: pd.DataFrame, trained: pd.DataFrame) -> tuple[float, ...]:
    groups = [one["attempts"].to_numpy(float) for one in (untrained, trained)]
    solved = float((untrained["solved"].mean() + trained["solved"].mean()) / 2)
    saved, low, high = np.nan, np.nan, np.nan
    if solved:
        saved = float(share_saved(*groups))
        ends = bootstrap_interval(share_saved, groups, np.random.default_rng(SEED))
        if ends[0] < ends[1] or not saved:  # if nobody differs, it would claim that nobody can
            low, high = map(float, ends)
    means = float(groups[1].mean()), float(groups[0].mean())
    return len(trained), *means, solved, saved, low, high


def _published(reference: Reference, protocol: str) -> list[tuple[Any, ...]]:
    """The rows of a reference; the error of a ratio is taken to first order."""
    from scipy.special import ndtri

    z = float(ndtri((1 + LEVEL) / 2))
    points = reference.points
    baseline = ~points["condition"].isin(TRANSFERS)
    first = points[(points["trial"] == 1) & (baseline | (points["phase"] == "test"))]
    first = first.set_index("condition")
    shares = first.get("share_solved", pd.Series(1.0, first.index))
    se = error_of_bar(first["se"], first["subjects"])
    rows = []
    for condition in TRANSFERS:
        untrained = condition.split("-")[1]
        if {condition, untrained} <= {*first.index}:
            one, two = first["mean"][condition], first["mean"][untrained]
            error = float(np.hypot(se[condition] / two, one * se[untrained] / two**2))
            solved = float(shares[[condition, untrained]].mean())
            saved = 1 - one / two if solved else np.nan
            ends = saved - z * error, saved + z * error
            if not error and saved:  # as of learners: if nobody differs
                ends = np.nan, np.nan
            size = int(first["subjects"][condition])
            rows.append(
                (reference.name, True, protocol, condition, size, one, two, solved, saved, *ends)
            )
    return rows


def plot_savings(
    results: Material, *, learners: Names = None, protocol: str | None = None, ax: Any = None
) -> Any:
    """Draw the share of attempts that training saves in the first room with four levers.

    >>> [axes.get_title(loc="left") for axes in plot_savings(results)]
    ['Test of CC4', 'Test of CE4']

    Arguments, what is returned and errors are those of
    :func:`~causal_openlock.analysis.topics.congruency.plot_congruency`.
    """
    protocol, trials = trials_under(results, protocol, learners)
    if learners is None:
        table = results.once(savings)
        table = table[table["protocol"] == protocol]
    else:
        table = savings(replace(results, trials=trials))
    if table["reference"].all():
        raise NothingToDrawError(
            f"no such learner played one of the paper's transfer conditions and its baseline under "
            f"the protocol {protocol}"
        )
    names = list(dict.fromkeys(table["learner"]))
    own = style.current()
    looks = {"CC3": (own.common_cause, "o"), "CE3": (own.common_effect, "s")}
    with panels(ax, 2, two_panels(names)) as at:
        name_rows(at, names)
        for tested, axes in zip(BASELINES, at.axes, strict=True):
            for (trained, look), aside in zip(looks.items(), (-0.14, 0.14), strict=True):
                rows = table[table["condition"] == f"{trained}-{tested}"]
                dots(axes, rows, names, "saved", look, aside)
            style.panel_title(axes, f"Test of {tested}")
            axes.set_xlabel("Attempts saved by training")
            axes.xaxis.set_major_formatter(PercentFormatter(1.0))
            axes.xaxis.set_major_locator(MaxNLocator(7, steps=[1, 2, 2.5, 5, 10]))
        keys = [
            Line2D([], [], ls="", marker=marker, color=colour, mec="black", mew=0.5,
                   label=f"{trained} training")
            for trained, (colour, marker) in looks.items()
        ]  # fmt: skip
        at.legend(keys)
    return at.returned


def section(material: Material) -> Section | None:
    """Section on savings by training; None if no condition and its baseline were played."""
    found = material.once(savings)
    protocols = list(dict.fromkeys(found.loc[~found["reference"].astype(bool), "protocol"]))
    if not protocols:
        return None
    tables, plots = [], []
    for protocol, part in file_names(protocols).items():
        rows = found[found["protocol"] == protocol]
        about = {"protocol": protocol if len(protocols) > 1 else ""}
        frame = _wide(rows)
        formats: Mapping[str, str] = dict.fromkeys(frame.columns[1:], ".0%") | dict.fromkeys(
            (f"{name} untrained" for name in BASELINES), ".2f"
        )
        tables.append(_PROSE.table("savings", frame, formats, f"savings_{part}", **about))
        plots.append(
            _PROSE.plot(
                "savings", plot_savings, material, {"protocol": protocol}, f"savings_{part}",
                published=bool(rows["reference"].any()), **about,
            )
        )  # fmt: skip
    tables.append(_PROSE.table("savings_all", found, _FORMATS))
    return _PROSE.section("savings", tables, plots)


def _wide(rows: pd.DataFrame) -> pd.DataFrame:
    """A row for each learner: what untrained subjects need, and the share that training saves."""
    wide = rows.pivot(index="learner", columns="condition", values=["untrained", "saved"])
    wide = wide.reindex(
        index=list(dict.fromkeys(rows["learner"])),
        columns=pd.MultiIndex.from_product([["untrained", "saved"], TRANSFERS]),
    )
    untrained = {
        f"{tested} untrained": wide["untrained"].filter(like=f"-{tested}").bfill(axis=1).iloc[:, 0]
        for tested in BASELINES
    }
    return pd.DataFrame({**untrained, **wide["saved"]}).reset_index()


TOPIC = Topic("savings", 82, section)

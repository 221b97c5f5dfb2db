"""The paper's Figures 3 and 4: attempts in the baseline trials and in the transfer test.

Where nobody did what people did, or other conditions are asked for, the same bars are drawn of
every trial of these, without references.

References come first, such as people and the published model of them (see
:mod:`~causal_openlock.analysis.results.references`), and then every learner that did what one of
them did, one panel each with a common scale. Error bars are the paper's, population SD / √n, so
that those of people and of learners mean the same. A dashed line shows what the ideal observer
needs (see :mod:`~causal_openlock.analysis.results.bounds`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, MultipleLocator

from causal_openlock.analysis.measures import BASELINES, TRANSFERS, mean_by_trial, ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, in_rows, panels, rows_of
from causal_openlock.analysis.results.bounds import bounds_of
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.statistics import sizes
from causal_openlock.errors import NothingToDrawError

_PAPER = {"train": BASELINES, "test": TRANSFERS}


def plot_attempts(
    results: Material,
    *,
    learners: Names = None,
    conditions: Names = None,
    published: bool = True,
    ax: Any = None,
) -> Any:
    """Mean attempts in each trial; by default of CC4 next to CE4, the paper's Figure 3.

    Of other conditions, or where nobody played these as people did, bars are of every trial, the
    test's last, and there are no references.

    >>> panels = plot_attempts(results)
    >>> [axes.get_title(loc="left") for axes in panels]
    ['People', 'Published model', 'random', 'oracle']

    Args:
        results: What was played.
        learners: Labels of the learners to draw; by default all that a reference suits.
        conditions: Conditions to draw; by default CC4 and CE4, or all if nobody played these as
            people did.
        published: Whether references have panels before the learners.
        ax: An empty figure, or axes if there is a single panel; by default a new figure of pyplot.

    Returns:
        ``[P]`` the axes of the panels; of a single panel its axes.

    Raises:
        NothingToDrawError: If no such learner played such a condition.
        OpenLockError: If a learner or a condition is not in the results, or ``ax`` does not fit.
    """
    trials = rows_of(results, results.trials, learners, conditions)
    if trials.empty:
        raise NothingToDrawError("no such learner played such a condition")
    means = _comparable_means(results, trials, "train")
    as_people = len(means) > 0 and (conditions is None or {*trials["condition"]} <= {*BASELINES})
    if as_people:
        looks = {name: {"color": style.current().trained(name)} for name in BASELINES}
    else:
        means = mean_by_trial(trials)
        labels = means["learner"].astype(str)  # with the protocol, where it has several
        several = means.groupby("learner", observed=True)["protocol"].transform("nunique") > 1
        labels = labels.where(~several, labels + " (" + means["protocol"].astype(str) + ")")
        means["learner"] = pd.Categorical(labels, labels.unique())
        names = ordered(means["condition"].unique(), results.conditions)
        looks = {name: style.current().line(number, name) for number, name in enumerate(names)}
    width = 0.8 / len(looks)
    train = max([5 * as_people, *means.loc[means["phase"] == "train", "trial"]])
    last = train + max([0, *means.loc[means["phase"] == "test", "trial"]])

    def panel(axes: Axes, rows: pd.DataFrame, ideal: Mapping[str, float]) -> None:
        for number, (condition, look) in enumerate(looks.items()):
            own = rows[rows["condition"] == condition]
            places = own["trial"] + train * (own["phase"] == "test")
            _bars(axes, places + width * (number - (len(looks) - 1) / 2), own, 0.95 * width, look)
        for attempts in {*ideal.values()}:
            style.ideal_line(axes, attempts, 0.4, last + 0.6)
        step = -(-last // 12)
        ticks = [*range(1, train + 1, step), *range(train + 1, last + 1, step)]
        axes.set_xticks(ticks, [str(place) if place <= train else "test" for place in ticks])
        axes.set(xlim=(0.4, last + 0.6), xlabel="Trial")

    keys = [_key(style.label(name), look) for name, look in looks.items()]
    return _draw(results, means, published and as_people, panel, keys, ax)


def plot_transfer(
    results: Material,
    *,
    learners: Names = None,
    conditions: Names = None,
    published: bool = True,
    ax: Any = None,
) -> Any:
    """Mean attempts in the transfer test, by what was tested and trained: the paper's Figure 4.

    Tests that no learner played are left out, also those of people.

    >>> axes = plot_transfer(results, learners=["random"], published=False)
    >>> axes.get_xlabel()
    'Transfer test'

    Arguments and errors are those of :func:`plot_attempts`.

    Returns:
        ``[P]`` the axes of the panels; of a single panel its axes.
    """
    trials = rows_of(results, results.trials, learners, conditions)
    means = _comparable_means(results, trials, "test")
    if means.empty:
        raise NothingToDrawError(
            "no such learner played a transfer condition as people did, in the paper's rooms under "
            "the protocol human, or as another reference did; plot_course draws any condition"
        )
    played = {str(name)[-3:] for name in means["condition"]}
    tests = [name for name in BASELINES if name in played]

    def panel(axes: Axes, rows: pd.DataFrame, ideal: Mapping[str, float]) -> None:
        for place, condition in enumerate(name for name in TRANSFERS if name[-3:] in tests):
            own = rows[rows["condition"] == condition]
            x = place // 2 + 0.4 * (place % 2) - 0.2
            _bars(axes, x, own, 0.38, {"color": style.current().trained(condition)})
            if own.empty and (conditions is None or condition in conditions):
                axes.text(  # an empty place would look like no attempts
                    x, 1, "not played", rotation=90, ha="center", va="bottom", color="#666666",
                    backgroundcolor="white", zorder=3,
                )  # fmt: skip
        for half, attempts in {(tests.index(name[-3:]), ideal[name]) for name in ideal}:
            style.ideal_line(axes, attempts, half - 0.45, half + 0.45)
        axes.set_xticks(range(len(tests)), tests)
        axes.set(xlim=(-0.6, len(tests) - 0.4), xlabel="Transfer test")

    keys = [_key(f"{name} training", {"color": style.current().trained(name)})
            for name in ("CC3", "CE3")]  # fmt: skip
    return _draw(results, means, published, panel, keys, ax)


def _comparable_means(results: Material, trials: pd.DataFrame, phase: str) -> pd.DataFrame:
    """Means of what learners did as a reference had: the baselines (``train``) or the ``test``."""
    trials = results.compared(trials)
    trials = trials[trials["condition"].isin(_PAPER[phase]) & (trials["phase"] == phase)]
    return mean_by_trial(trials, ["phase", "trial"] if phase == "train" else ["phase"])


def _draw(
    results: Material,
    means: pd.DataFrame,
    published: bool,
    panel: Callable[[Axes, pd.DataFrame, Mapping[str, float]], None],
    keys: list[Any],
    ax: Any,
) -> Any:
    """Draw a panel for each reference, and one for each learner."""
    ideal = {name: attempts for (name, _), attempts in bounds_of(results.bounds, means).items()}
    phase = str(means["phase"].iloc[0])
    shown = []
    for one in results.references if published else ():
        rows = one.points
        rows = rows[(rows["phase"] == phase) & rows["condition"].isin(_PAPER[phase])]
        if len(rows) and one.stands(means).any():
            shown.append((one.title, f"{one.detail}, ", rows))
    shown += [(str(name), "", rows) for name, rows in means.groupby("learner", observed=True)]
    top = max(float((rows["mean"] + rows["se"].fillna(0)).max()) for _, _, rows in shown)
    with panels(ax, len(shown), in_rows(len(shown), 3, 2.3)) as at:
        for axes, (name, detail, rows) in zip(at.axes, shown, strict=True):
            panel(axes, rows, ideal)
            style.panel_title(axes, name, detail + sizes(rows))
            axes.set_ylim(0, top * 1.05)
            fives = MultipleLocator(5) if top <= 40 else MaxNLocator(integer=True)
            axes.yaxis.set_major_locator(fives)
        at.label_y("Attempts")
        at.legend([*keys, style.ideal_key()] if ideal else keys)
    return at.returned


def _key(text: str, look: Mapping[str, Any]) -> Patch:
    return Patch(ec="black", lw=0.6, label=text, fc=look["color"], ls=look.get("ls", "-"))


def _bars(axes: Axes, x: Any, rows: pd.DataFrame, width: float, look: Mapping[str, Any]) -> None:
    """Draw means with error bars; a single subject has none."""
    axes.bar(
        x, rows["mean"], width, yerr=rows["se"].where(rows["subjects"] > 1), ec="black", lw=0.6,
        error_kw={"elinewidth": 0.9, "capsize": 2}, **look,
    )  # fmt: skip

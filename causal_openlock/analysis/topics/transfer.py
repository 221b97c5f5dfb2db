"""Scores of subjects in each condition, and what training was worth.

Transfer has two scores. *Congruency*: does training with the structure of the test help more than
training with the other one? *Savings*: how many attempts does training with three levers save in
the first room with four, against subjects without any training?
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, PercentFormatter

from causal_openlock.analysis.decisions import Decided
from causal_openlock.analysis.effects import Group, weighted_difference
from causal_openlock.analysis.measures import (
    BASELINES,
    CELL,
    TRANSFERS,
    by_subject,
    judged,
    ordered,
)
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, Panels, panels, trials_under
from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import Reference
from causal_openlock.analysis.section import Section, SectionPlot
from causal_openlock.analysis.statistics import LEVEL, SEED, bootstrap_interval
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Topic
from causal_openlock.errors import NothingToDrawError
from causal_openlock.experiment.paper_conditions import paper_conditions
from causal_openlock.experiment.protocol import HUMAN_PROTOCOL
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.wording import file_names

SCORE_COLUMNS = (
    *("learner", "protocol", "score", "condition", "subjects"),
    *("attempts", "against", "value", "ci_low", "ci_high", "p"),
)
"""Columns of :func:`transfer_scores`."""
CONGRUENCY, SAVINGS = "congruency", "savings"
_COMPARED = (
    (CONGRUENCY, "CC3-CC4", "CE3-CC4"),
    (CONGRUENCY, "CE3-CE4", "CC3-CE4"),
    *((SAVINGS, name, name.split("-")[1]) for name in TRANSFERS),
)
"""Each score, the condition that it is about, and the one that it is compared with."""
CONGRUENCY_TESTS = {"CC3-CC4": "Test of CC4", "CE3-CE4": "Test of CE4"}
_ROW = 0.21  # height of a learner's row, in inches
_PROSE = Prose(__name__)
_FORMATS = {
    "attempts": ".2f", "against": ".2f", "value": ".2f", "ci_low": ".2f", "ci_high": ".2f",
    "p": ".2g",
    "CC4": "+.2f", "CC4 low": "+.2f", "CC4 high": "+.2f", "CC4 untrained": ".2f",
    "CE4": "+.2f", "CE4 low": "+.2f", "CE4 high": "+.2f", "CE4 untrained": ".2f",
    "CC3-CC4": ".1%", "CE3-CC4": ".1%", "CC3-CE4": ".1%", "CE3-CE4": ".1%",
}  # fmt: skip


def congruency(congruent: FloatArray, incongruent: FloatArray) -> FloatArray:
    """How many attempts more a test takes after training with its own structure than with another.

    >>> float(congruency(np.array([4.0, 6.0]), np.array([7.0, 9.0])))
    -3.0

    Args:
        congruent: ``[..., n]`` attempts of subjects trained with the structure of the test.
        incongruent: ``[..., m]`` attempts of those trained with the other.
    """
    difference: FloatArray = congruent.mean(axis=-1) - incongruent.mean(axis=-1)
    return difference


def savings(baseline: FloatArray, transfer: FloatArray) -> FloatArray:
    """Which share of the attempts in a first trial training saves: 1 − transfer / baseline.

    Args:
        baseline: ``[..., n]`` attempts in the first trial of subjects without training.
        transfer: ``[..., m]`` attempts in the first test trial of those with training.
    """
    share: FloatArray = 1 - transfer.mean(axis=-1) / baseline.mean(axis=-1)
    return share


def scores_by_condition(trials: pd.DataFrame) -> dict[tuple[str, str], dict[str, FloatArray]]:
    """The attempts of every subject in the trials by which its condition is judged.

    Returns:
        By learner and protocol, by condition: ``[n]`` attempts of its subjects, each subject's
        trials averaged.
    """
    return _by_condition(judged(trials))


def transfer_scores(trials: pd.DataFrame) -> pd.DataFrame:
    """What training was worth to each learner in the paper's transfer conditions.

    Congruency compares the mean of a subject's test trials; savings compare the first test trial
    with the first baseline trial.

    Returns:
        A row for each learner, protocol and score for which the conditions were played, with the
        columns :data:`SCORE_COLUMNS`:

        - ``score``: :func:`congruency` (in attempts) or :func:`savings` (a share).
        - ``condition``: the transfer condition whose test it is about; of congruency the one
          trained with the structure of its test.
        - ``subjects``: of that condition; ``attempts``: their mean.
        - ``against``: the mean of those compared with: trained with the other structure, or
          without training.
        - ``value``, ``ci_low``, ``ci_high``: the score and its 95% bootstrap interval, subjects of
          both groups resampled among themselves; NaN for an interval of one subject, and where
          nobody differs from the others of its group though the groups differ.
        - ``p``: of Welch's test that congruency is 0; NaN for savings.
    """
    tests = scores_by_condition(trials[trials["condition"].isin(TRANSFERS)])
    first_visits = trials[(trials["loop"] == 1) & (trials["trial"] == 1)]
    in_phase = first_visits["phase"] == np.where(
        first_visits["condition"].isin(TRANSFERS), "test", "train"
    )
    firsts = _by_condition(first_visits[in_phase])
    rows: list[tuple[object, ...]] = []
    for group in trials.groupby(["learner", "protocol"], observed=True).groups:
        for score, condition, other in _COMPARED:
            held = (tests if score == CONGRUENCY else firsts).get(group, {})
            if condition not in held or other not in held:
                continue
            one, two = held[condition], held[other]
            function, groups = (
                (congruency, (one, two)) if score == CONGRUENCY else (savings, (two, one))
            )
            ends = bootstrap_interval(function, groups, np.random.default_rng(SEED))
            means = (float(one.mean()), float(two.mean()), float(function(*groups)))
            if means[2] and ends[0] == ends[1]:
                ends = np.array(np.nan), np.array(np.nan)
            tested = weighted_difference([Group.of(1, one), Group.of(-1, two)])
            p = tested.p if score == CONGRUENCY else np.nan
            rows.append((*group, score, condition, len(one), *means, *ends, p))
    return pd.DataFrame(rows, columns=SCORE_COLUMNS)


def reference_scores(reference: Reference, protocol: str) -> pd.DataFrame:
    """The same of a reference, from its means, for the conditions that it has.

    Returns:
        As :func:`transfer_scores`; the intervals follow from the error bars, as if means were
        distributed normally.
    """
    from scipy.stats import norm

    z = float(norm.isf((1 - LEVEL) / 2))
    points = reference.points
    first = points[points["trial"] == 1]
    baseline = ~first["condition"].isin(TRANSFERS)
    known = {
        CONGRUENCY: reference.means(judged=True),
        SAVINGS: first[(first["phase"] == "test") | baseline],
    }
    rows: list[tuple[object, ...]] = []
    for score, condition, other in _COMPARED:
        means = known[score]
        means = means[(means["phase"] == "test") | (score == SAVINGS)].set_index("condition")
        if not {condition, other} <= {*means.index}:
            continue
        se = means["se"] * np.sqrt(means["subjects"] / (means["subjects"] - 1).clip(lower=1))
        one, two = means["mean"][condition], means["mean"][other]
        if score == CONGRUENCY:
            value, error = one - two, np.hypot(se[condition], se[other])
        else:  # the error of a ratio, to first order
            value = 1 - one / two
            error = np.hypot(se[condition] / two, one * se[other] / two**2)
        size = int(means["subjects"][condition])
        low, high = value - z * error, value + z * error
        name = reference.title
        rows.append((name, protocol, score, condition, size, one, two, value, low, high, np.nan))
    return pd.DataFrame(rows, columns=SCORE_COLUMNS)


def scores_of(results: Material) -> dict[str, pd.DataFrame]:
    """The scores of conditions that are the paper's, by protocol.

    References come first, where they stand beside a learner in a transfer condition.
    """
    trials = results.trials
    trials = trials[trials["condition"].isin(list(paper_conditions(results.experiment)))]
    own = transfer_scores(trials)
    found = {
        protocol: own[own["protocol"] == protocol]
        for protocol in ordered(own["protocol"], (HUMAN_PROTOCOL,))
    }
    tested = trials[trials["condition"].isin(TRANSFERS)]
    for protocol, scores in found.items():
        under = tested[tested["protocol"] == protocol]
        known = [
            reference_scores(one.reference, protocol)
            for one in results.references
            if len(one.reference.points) and one.stands(under).any()
        ]
        found[protocol] = pd.concat([*known, scores], ignore_index=True) if known else scores
    return found


def _titles(results: Material) -> list[str]:
    """What references are called among the learners."""
    return [one.reference.title for one in results.references]


def _by_condition(trials: pd.DataFrame) -> dict[tuple[str, str], dict[str, FloatArray]]:
    held: dict[tuple[str, str], dict[str, FloatArray]] = {}
    for key, rows in by_subject(trials, []).groupby(CELL, observed=True, sort=True):
        learner, condition, protocol = map(str, key)
        held.setdefault((learner, protocol), {})[condition] = rows["attempts"].to_numpy(float)
    return held


def plot_congruency(
    results: Material, *, learners: Names = None, protocol: str | None = None, ax: Any = None
) -> Any:
    """What training with the structure of the test saves in the transfer test.

    A panel for each test, a row for each learner, with 95% intervals; references such as
    people come first, where learners did what these did.

    >>> import causal_openlock as ol
    >>> [axes.get_title(loc="left") for axes in ol.plot_congruency(results)]
    ['Test of CC4', 'Test of CE4']

    The protocol is by default ``human``, or else the first by alphabet. The other arguments, what
    is returned and errors are those of
    :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    names, scores = _scores(results, CONGRUENCY, learners, protocol)
    with panels(ax, 2, _rows_of(names)) as at:
        _name_rows(at, names)
        for (condition, title), axes in zip(CONGRUENCY_TESTS.items(), at.axes, strict=True):
            rows = scores[scores["condition"] == condition]
            _dots(axes, rows, names, (style.current().trained(condition), "o"))
            style.panel_title(axes, title)
            axes.set_xlabel("Attempts, congruent − incongruent training")
            axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        _same_scale(at)
    return at.returned


def plot_savings(
    results: Material, *, learners: Names = None, protocol: str | None = None, ax: Any = None
) -> Any:
    """The share of attempts that training saves in the first room with four levers.

    >>> import causal_openlock as ol
    >>> [axes.get_title(loc="left") for axes in ol.plot_savings(results)]
    ['Test of CC4', 'Test of CE4']

    Arguments, what is returned and errors are those of :func:`plot_congruency`.
    """
    names, scores = _scores(results, SAVINGS, learners, protocol)
    own = style.current()
    looks = {"CC3": (own.common_cause, "o"), "CE3": (own.common_effect, "s")}
    with panels(ax, 2, _rows_of(names)) as at:
        _name_rows(at, names)
        for tested, axes in zip(BASELINES, at.axes, strict=True):
            for (trained, look), aside in zip(looks.items(), (-0.14, 0.14), strict=True):
                rows = scores[scores["condition"] == f"{trained}-{tested}"]
                _dots(axes, rows, names, look, aside)
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
        _same_scale(at)
    return at.returned


def _scores(
    results: Material, kind: str, learners: Names, protocol: str | None
) -> tuple[list[str], pd.DataFrame]:
    """Names in their order, references first, and their scores."""
    protocol, trials = trials_under(results, protocol, learners)
    scores = scores_of(replace(results, trials=trials)).get(
        protocol, pd.DataFrame(columns=SCORE_COLUMNS)
    )
    scores = scores[scores["score"] == kind]
    if scores["learner"].isin(_titles(results)).all():
        raise NothingToDrawError(
            f"no such learner played conditions whose {kind} can be scored under the protocol "
            f"{protocol}: the paper's transfer conditions"
            + (", and the baselines" if kind == SAVINGS else "")
        )
    return list(dict.fromkeys(scores["learner"])), scores


def _rows_of(names: Sequence[str]) -> Any:
    """Two panels with a row for each learner."""

    def lay_out(figure: Figure) -> list[Axes]:
        figure.set_layout_engine("constrained")
        figure.set_size_inches(style.WIDTH, 1.15 + _ROW * len(names))
        return list(figure.subplots(1, 2, sharey=True, sharex=True))

    return lay_out


def _name_rows(at: Panels, names: Sequence[str]) -> None:
    """Name the rows, the first at the top, and mark zero."""
    for axes in at.axes:
        axes.grid(axis="x")
        axes.axvline(0, color="#333333", lw=0.9, zorder=1)
        axes.set_yticks(range(len(names)), [style.label(name, 28) for name in names])
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.tick_params(axis="y", length=0)


def _same_scale(at: Panels) -> None:
    """Give the panels the same x axis, also those that were given."""
    ends = np.array([axes.get_xlim() for axes in at.axes])
    for axes in at.axes:
        axes.set_xlim(ends[:, 0].min(), ends[:, 1].max())


def _dots(
    axes: Axes, rows: pd.DataFrame, names: list[str], look: tuple[str, str], aside: float = 0.0
) -> None:
    """The score of each learner with its interval, in a colour and with a marker."""
    colour, marker = look
    y = np.array([names.index(name) + aside for name in rows["learner"]])
    ends = rows["ci_low"], rows["ci_high"]
    axes.hlines(y, *ends, color=colour, lw=1.6, zorder=2, capstyle="projecting")
    axes.plot(rows["value"], y, marker, color=colour, ms=5, mec="black", mew=0.5, zorder=3)


def compute(material: Material) -> tuple[dict[str, pd.DataFrame], list[str]]:
    """The scores of transfer, by protocol, and which of their rows are of references."""
    return scores_of(material), _titles(material)


def tests(computed: tuple[Mapping[str, pd.DataFrame], list[str]]) -> dict[Hashable, float]:
    """The p of every learner's congruency, by protocol, learner and condition."""
    return {
        (protocol, row.learner, row.condition): row.p
        for protocol, scores in computed[0].items()
        for row in scores.itertuples()
        if row.score == CONGRUENCY and row.learner not in computed[1]
    }


def section(material: Material, decided: Decided) -> Section | None:
    """What training was worth; None if no transfer condition and its counterpart were played."""
    found: dict[str, pd.DataFrame]
    found, titles = decided.computed
    findings: list[dict[str, Any]] = []
    tables: list[Table] = []
    plots: list[SectionPlot] = []
    for protocol, part in file_names(found).items():
        scores = found[protocol]
        of = {kind: scores[scores["score"] == kind] for kind in (CONGRUENCY, SAVINGS)}
        about: dict[str, Any] = {"protocol": protocol if len(found) > 1 else ""}
        for kind, found_in, frame, plot in (
            (CONGRUENCY, partial(_helped, protocol, decided, titles), _congruency, plot_congruency),
            (SAVINGS, _saved, _savings, plot_savings),
        ):
            rows = of[kind]
            if rows["learner"].isin(titles).all():
                continue
            findings.append({**about, "kind": kind, **found_in(rows)})
            name = f"transfer_{kind}_{part}"
            published = bool(rows["learner"].isin(titles).any())
            tables.append(_PROSE.table(f"transfer_{kind}", frame(rows), _FORMATS, name, **about))
            options = {"protocol": protocol}
            drawn = _PROSE.plot(
                f"transfer_{kind}", plot, material, options, name, published=published, **about
            )
            plots.append(replace(drawn, folded=kind == SAVINGS))
        every = scores.drop(columns="protocol")
        tables.append(
            _PROSE.table("transfer_scores", every, _FORMATS, f"transfer_scores_{part}", **about)
        )
    if not findings:
        return None
    return _PROSE.section("transfer_scores", tables, plots, findings=findings)


def _helped(
    protocol: str, decided: Decided, titles: Sequence[str], scores: pd.DataFrame
) -> dict[str, Any]:
    """By structure that is tested, what it saved references, and whom it helps or harms."""
    own = scores[~scores["learner"].isin(titles)]
    known = scores[scores["learner"].isin(titles)]
    tests = []
    for condition in CONGRUENCY_TESTS:
        rows = own[own["condition"] == condition]
        found = [decided.found((protocol, learner, condition)) for learner in rows["learner"]]
        beyond = rows[np.array(found, bool)]
        tests.append(
            {
                "tested": condition.split("-")[1],
                "played": len(rows),
                "helped": beyond[beyond["value"] < 0].to_dict("records"),
                "harmed": beyond[beyond["value"] > 0].to_dict("records"),
            }
        )
    saved = {
        name: [f"{-row['value']:.2f} for {row['condition'].split('-')[1]}" for row in rows]
        for name in dict.fromkeys(known["learner"])
        for rows in [known[known["learner"] == name].to_dict("records")]
    }
    return {"tests": tests, "known": saved}


def _saved(scores: pd.DataFrame) -> dict[str, Any]:
    """By learner, the least and the most that training saves."""
    values = (scores["value"] + 0.0).groupby(scores["learner"], sort=False, observed=True)
    return {"saved": values.agg(["min", "max"]).itertuples()}


def _congruency(scores: pd.DataFrame) -> pd.DataFrame:
    ends = {"value": "", "ci_low": " low", "ci_high": " high"}
    wide = _wide(scores, list(CONGRUENCY_TESTS), list(ends))
    columns = {
        f"{condition.split('-')[1]}{end}": wide[column, condition]
        for condition in CONGRUENCY_TESTS
        for column, end in ends.items()
    }
    return pd.DataFrame(columns).reset_index()


def _savings(scores: pd.DataFrame) -> pd.DataFrame:
    wide = _wide(scores, TRANSFERS, ["against", "value"])
    untrained = {
        f"{tested} untrained": wide["against"].filter(like=f"-{tested}").bfill(axis=1).iloc[:, 0]
        for tested in BASELINES
    }
    return pd.DataFrame({**untrained, **wide["value"]}).reset_index()


def _wide(scores: pd.DataFrame, conditions: Sequence[str], values: list[str]) -> pd.DataFrame:
    """A row for each learner, in their order, with the values in each of the conditions."""
    wide = scores.pivot(index="learner", columns="condition", values=values)
    columns = pd.MultiIndex.from_product([values, conditions])
    return wide.reindex(index=list(dict.fromkeys(scores["learner"])), columns=columns)


def family(key: tuple[str, str, str]) -> Hashable:
    """Whether training with the same structure helps a learner, under a protocol."""
    return key[:2]


TOPIC = Topic("transfer", 80, section, compute, tests, family)

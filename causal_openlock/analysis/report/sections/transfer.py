"""The section of the report on transfer: what training was worth, in people and in learners."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, PercentFormatter

from causal_openlock.analysis.measures import BASELINES, TRANSFERS, ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.style import Drawing
from causal_openlock.analysis.report.section import Material, Section, Table
from causal_openlock.analysis.results.people.comparable import HUMAN_PROTOCOL, paper_conditions
from causal_openlock.analysis.results.people.published import did_what_people_did, model, people
from causal_openlock.analysis.results.scores import (
    CONGRUENCY,
    SAVINGS,
    published_transfer_scores,
    transfer_scores,
)
from causal_openlock.wording import file_names, joined

PEOPLE, MODEL = "People", "Published model"
_TESTS = {"CC3-CC4": "Test of CC4", "CE3-CE4": "Test of CE4"}
_ROW = 0.21  # height of a row of a drawing, in inches


def section(material: Material) -> Section | None:
    """What training was worth; None if nobody played a transfer condition and its counterpart."""
    found = scores_of(material)
    text: list[str] = []
    tables: list[Table] = []
    drawings: list[Drawing] = []
    for protocol, part in file_names(found).items():
        scores = found[protocol]
        under = f"Protocol {protocol}. " if len(found) > 1 else ""
        ending = f", protocol {protocol}" if len(found) > 1 else ""
        own = scores.loc[~scores["learner"].isin([PEOPLE, MODEL]), "score"]
        if (own == CONGRUENCY).any():
            text.append(under + _on_congruency(scores[scores["score"] == CONGRUENCY]))
            tables.append(_congruency_table(scores, part, ending))
            drawings.append(congruency_drawing(scores, part, ending))
        if (own == SAVINGS).any():
            text.append(under + _on_savings(scores[scores["score"] == SAVINGS]))
            tables.append(_savings_table(scores, part, ending))
            drawings.append(savings_drawing(scores, part, ending))
        tables.append(_scores_table(scores, part, ending))
    if not text:
        return None
    text.append("Beyond doubt means here that the 95% interval leaves out zero.")
    return Section(
        "transfer_scores", "What training was worth", tuple(text), tuple(tables), tuple(drawings)
    )


def scores_of(material: Material) -> dict[str, pd.DataFrame]:
    """The scores of all who are shown, by protocol.

    Returns:
        Tables as :func:`~causal_openlock.analysis.results.scores.transfer_scores` has them,
        learners in the order of the material; published results come first where learners did what
        people did.
    """
    trials = material.trials
    rooms = paper_conditions(material.experiment)
    if rooms is not None:
        trials = trials[trials["condition"].isin(list(rooms))]
    own = transfer_scores(trials)
    place = {name: number for number, name in enumerate(material.learners)}
    own = own.iloc[own["learner"].map(place).argsort(kind="stable")]
    found = {
        protocol: own[own["protocol"] == protocol]
        for protocol in ordered(own["protocol"], (HUMAN_PROTOCOL,))
    }
    beside = did_what_people_did(trials, material.pairs) & trials["condition"].isin(TRANSFERS)
    if beside.any() and HUMAN_PROTOCOL in found:
        published = [
            published_transfer_scores(PEOPLE, people()),
            published_transfer_scores(MODEL, model()),
        ]
        found[HUMAN_PROTOCOL] = pd.concat([*published, found[HUMAN_PROTOCOL]], ignore_index=True)
    return found


def congruency_drawing(scores: pd.DataFrame, part: str = "human", ending: str = "") -> Drawing:
    """Congruency of everyone, a panel for each structure that is tested.

    Args:
        scores: Of one protocol, from :func:`scores_of`.
        part: What its file is called after.
        ending: What its title ends with.
    """
    chosen = scores[scores["score"] == CONGRUENCY]
    with style.settings():
        names = list(dict.fromkeys(chosen["learner"]))
        figure, panels = _rows_of(names)
        for (condition, title), axes in zip(_TESTS.items(), panels, strict=True):
            rows = chosen[chosen["condition"] == condition]
            _dots(axes, rows, names, style.trained_colour(condition), "o", 0.0)
            style.panel_title(axes, title)
            axes.set_xlabel("Attempts, congruent − incongruent training")
            axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    return Drawing(
        f"transfer_congruency_{part}",
        f"Congruency of training and test{ending}",
        "Mean attempts in the transfer test after training with the structure of the test, less "
        "those after training with the other structure: left of the line training with the same "
        f"structure helped. {_intervals(names)}",
        figure,
    )


def savings_drawing(scores: pd.DataFrame, part: str = "human", ending: str = "") -> Drawing:
    """Savings of everyone, a panel for each structure; as :func:`congruency_drawing`."""
    chosen = scores[scores["score"] == SAVINGS]
    looks = {"CC3": (style.COMMON_CAUSE, "o", -0.14), "CE3": (style.COMMON_EFFECT, "s", 0.14)}
    with style.settings():
        names = list(dict.fromkeys(chosen["learner"]))
        figure, panels = _rows_of(names)
        for tested, axes in zip(BASELINES, panels, strict=True):
            for trained, (colour, marker, aside) in looks.items():
                rows = chosen[chosen["condition"] == f"{trained}-{tested}"]
                _dots(axes, rows, names, colour, marker, aside)
            style.panel_title(axes, f"Test of {tested}")
            axes.set_xlabel("Attempts saved by training")
            axes.xaxis.set_major_formatter(PercentFormatter(1.0))
            axes.xaxis.set_major_locator(MaxNLocator(7, steps=[1, 2, 2.5, 5, 10]))
        style.legend(
            figure,
            [
                Line2D([], [], ls="", marker=marker, color=colour, mec="black", mew=0.5,
                       label=f"{trained} training")
                for trained, (colour, marker, _) in looks.items()
            ],
        )  # fmt: skip
    return Drawing(
        f"transfer_savings_{part}",
        f"Savings by training{ending}",
        "Share of the attempts in a first trial with four levers that training with three saves, "
        "against those who meet it without training (trial 1 of the baseline). "
        + _intervals(names),
        figure,
    )


def _intervals(names: Sequence[str]) -> str:
    published = "; those of people and of the published model follow from their error bars"
    return f"Lines: 95% bootstrap intervals over subjects{published if PEOPLE in names else ''}."


def _rows_of(names: Sequence[str]) -> tuple[Figure, list[Axes]]:
    """Two panels with a row for everyone, the first at the top."""
    figure = Figure(figsize=(style.WIDTH, 1.15 + _ROW * len(names)), layout="constrained")
    panels = list(figure.subplots(1, 2, sharey=True, sharex=True))
    shown = [name if len(name) <= 28 else f"{name[:27]}…" for name in names]
    for axes in panels:
        axes.grid(axis="x")
        axes.axvline(0, color="#333333", lw=0.9, zorder=0.5)
        axes.set_yticks(range(len(names)), [name.replace("$", r"\$") for name in shown])
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.tick_params(axis="y", length=0)
    return figure, panels


def _dots(
    axes: Axes, rows: pd.DataFrame, names: Sequence[str], colour: str, marker: str, aside: float
) -> None:
    for _, row in rows.iterrows():
        y = names.index(row["learner"]) + aside
        axes.plot([row["ci_low"], row["ci_high"]], [y, y], color=colour, lw=1.6, zorder=2)
        axes.plot(row["value"], y, marker, color=colour, ms=5, mec="black", mew=0.5, zorder=3)


def _congruency_table(scores: pd.DataFrame, part: str, ending: str) -> Table:
    chosen = scores[scores["score"] == CONGRUENCY]
    rows = []
    for name in dict.fromkeys(chosen["learner"]):
        row: dict[str, object] = {"learner": name}
        of = chosen[chosen["learner"] == name].set_index("condition")
        for condition in _TESTS:
            tested = condition.split("-")[1]
            known = condition in of.index
            for column, key in (("value", ""), ("ci_low", " low"), ("ci_high", " high")):
                row[f"{tested}{key}"] = of[column][condition] if known else None
        rows.append(row)
    frame = pd.DataFrame(rows)
    return Table(
        f"transfer_congruency_{part}",
        f"Congruency: attempts more after training with the structure of the test{ending}",
        frame,
        dict.fromkeys([name for name in frame if name != "learner"], "+.2f"),
        "Mean attempts in the test after congruent training less those after incongruent training, "
        "with the ends of the 95% interval; negative where training with the same structure helps. "
        "A trial that was not solved counts as the limit, which hides differences beyond it.",
    )


def _savings_table(scores: pd.DataFrame, part: str, ending: str) -> Table:
    chosen = scores[scores["score"] == SAVINGS]
    rows = []
    for name in dict.fromkeys(chosen["learner"]):
        of = chosen[chosen["learner"] == name].set_index("condition")
        row: dict[str, object] = {"learner": name}
        for tested in BASELINES:
            against = of.loc[[one for one in of.index if one.endswith(tested)], "against"]
            row[f"{tested} untrained"] = against.iloc[0] if len(against) else None
        row |= {one: of["value"][one] if one in of.index else None for one in TRANSFERS}
        rows.append(row)
    return Table(
        f"transfer_savings_{part}",
        f"Savings: share of attempts that training saves in a first trial with four levers{ending}",
        pd.DataFrame(rows),
        dict.fromkeys([f"{one} untrained" for one in BASELINES], ".2f")
        | dict.fromkeys(TRANSFERS, ".1%"),
        "Untrained: mean attempts in trial 1 of the baseline. The others: share of them that is "
        "saved in the first test trial after training; negative where training costs attempts.",
    )


def _scores_table(scores: pd.DataFrame, part: str, ending: str) -> Table:
    return Table(
        f"transfer_scores_{part}",
        f"Every score with its interval{ending}",
        scores.drop(columns="protocol"),
        dict.fromkeys(["attempts", "against", "value", "ci_low", "ci_high"], ".2f"),
        "Attempts: mean of the condition; against: mean of those it is compared with, trained with "
        "the other structure (congruency) or not at all (savings); value: the score, in attempts "
        "(congruency) or as a share (savings), with the ends of its 95% interval.",
    )


def _on_congruency(scores: pd.DataFrame) -> str:
    """Who is helped by training with the structure of the test."""
    own = scores[~scores["learner"].isin([PEOPLE, MODEL])]
    text = ["Does it help to be trained with the structure that is tested?"]
    published = scores[scores["learner"] == PEOPLE].set_index("condition")["value"]
    if len(published):
        told = [f"{-published[one]:.2f} for {one.split('-')[1]}" for one in _TESTS]
        text.append(f"It saves people attempts, {joined(told)}, against training with the other.")
    for condition in _TESTS:
        rows = own[own["condition"] == condition]
        helped, harmed = rows[rows["ci_high"] < 0], rows[rows["ci_low"] > 0]
        tested = condition.split("-")[1]
        if len(helped):
            names = [
                f"{row['learner']} ({-row['value']:.2f} fewer)" for _, row in helped.iterrows()
            ]
            text.append(f"In the test of {tested} it helps {joined(names)}.")
        elif len(rows):
            text.append(f"In the test of {tested} no learner is helped beyond doubt.")
        if len(harmed):
            text.append(f"It harms {_listed(harmed, 'more')} there.")
    return " ".join(text)


def _listed(rows: pd.DataFrame, how: str) -> str:
    return joined(
        [f"{row['learner']} ({abs(row['value']):.2f} {how})" for _, row in rows.iterrows()]
    )


def _on_savings(scores: pd.DataFrame) -> str:
    """How much training saves, whichever structure it was with."""
    told = []
    for name in dict.fromkeys(scores["learner"]):
        values = scores.loc[scores["learner"] == name, "value"] + 0.0
        ends = dict.fromkeys(
            f"{value:.0%}".replace("-", "−") for value in (min(values), max(values))
        )
        told.append(f"{name} {' to '.join(ends)}")
    return (
        "What does training save in the first room with four levers, whatever it was with? Of the "
        f"attempts that the room takes without training: {', '.join(told)}."
    )

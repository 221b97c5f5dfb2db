"""Transfer: what training in rooms with three levers saves in a room with four.

Training is *congruent* if its rooms have the causal structure of the test (common cause or common
effect). What it saves is measured twice: in attempts, against subjects that were trained with the
other structure, with the interval and the p of Student's t, as the paper has it; and as a share of
the attempts of subjects that meet such a room without any training.

The tests on CC4 and on CE4 are the paper's own planned tests, each a question by itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, PercentFormatter

from causal_openlock.analysis.effects import ALPHA, Group, weighted_difference
from causal_openlock.analysis.measures import BASELINES, TRANSFERS, by_subject, judged, ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, panels, trials_under
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import Reference, gap_column
from causal_openlock.analysis.table import Table, p_value, printed
from causal_openlock.analysis.topic import Section, Topic, drawn, sentences
from causal_openlock.errors import NothingToDrawError
from causal_openlock.experiment.protocol import HUMAN_PROTOCOL
from causal_openlock.wording import file_names, joined, some

CONGRUENT = {"CC4": "CC3-CC4", "CE4": "CE3-CE4"}  #: the congruent condition of a test
OTHER = {"CC3-CC4": "CE3-CC4", "CE3-CE4": "CC3-CE4"}
OTHER |= {other: congruent for congruent, other in OTHER.items()}
"""The condition with the same test after the other training."""

COLUMNS = (
    *("learner", "reference", "protocol", "condition", "subjects", "attempts", "other_training"),
    *("solved", "saved", "low", "high", "p"),
    *("first", "untrained", "share", "share_low", "share_high"),
)  #: columns of :func:`transfer`, before those of references

NAMED = 4  #: learners that the first screen names
NEARLY_ALL = 0.95  #: share of the tests that such a learner has solved
Means = Mapping[tuple[str, str], tuple[Group, float]]
"""By condition, and ``test`` or ``first`` trial: subjects, and the share of trials they solved."""


def transfer(results: Material) -> pd.DataFrame:
    """Return what training saves in the test of the paper's transfer conditions, by learner.

    >>> table = transfer(results)
    >>> people = table[table["learner"] == "people"].set_index("condition")
    >>> people.loc[["CC3-CC4", "CE3-CE4"], "saved"].round(2).tolist()
    [2.65, 6.02]

    Returns:
        A row for each learner, protocol and ``condition`` of which the other training or the
        baseline was played too, references first where they are comparable with a learner:

        - ``learner``, whether it is a ``reference``, ``protocol``; ``subjects``: of the smaller
          group;
        - ``attempts``: the mean in the test; ``other_training``: that after the other training;
        - ``solved``: the share of trials solved in both tests. Where it is 0 the limit says
          nothing about the effect, and the following are NaN; below 1 they may be off either way;
        - ``saved``: ``other_training`` − ``attempts``; ``low``, ``high`` and ``p``: of Student's t;
        - ``first``: mean attempts in the first trial of the test; ``untrained``: in the first
          trial of the baseline; ``share``: 1 − ``first`` / ``untrained`` (NaN if neither was
          solved), with its 95% interval, the error of a ratio being taken to first order;
        - ``to_people`` and the like, of each reference in the leaderboard: how much more than that
          reference the learner saves, in attempts, with ``_low`` and ``_high`` of Welch's t.
    """
    trials = results.trials
    is_test = trials["condition"].isin(TRANSFERS) & (trials["phase"] == "test")
    is_first = (trials["trial"] == 1) & (trials["loop"] == 1)
    first = trials[is_first & (is_test | trials["condition"].isin(BASELINES))]
    both = [judged(trials[is_test]).assign(of="test"), first.assign(of="first")]
    each = by_subject(pd.concat(both), ["of"])
    known = {one: _published(one) for one in results.references}
    published = {gap_column(one.name): one for one in results.leading}
    people = {gap_column(name): name for name in results.people}
    rows: list[dict[str, Any]] = []
    for protocol in ordered(each["protocol"].unique(), (HUMAN_PROTOCOL,)):
        here = each[each["protocol"] == protocol]
        tests = here[here["of"] == "test"]
        for one in results.references:
            if one.stands(tests).any():
                about = {"learner": one.name, "reference": True, "protocol": protocol}
                rows += [about | row for row in _rows(known[one], {})]
        played = {name: _played(own) for name, own in here.groupby("learner", observed=True)}
        for name in ordered(tests["learner"].unique(), results.learners):
            own = tests[tests["learner"] == name]
            beside = {
                column: known[one] for column, one in published.items() if one.stands(own).all()
            }
            if name not in results.people:
                beside |= {column: played.get(person, {}) for column, person in people.items()}
            about = {"learner": name, "reference": name in results.people, "protocol": protocol}
            rows += [about | row for row in _rows(played[name], beside)]
    columns = [f"{gap}{end}" for gap in (*published, *people) for end in ("", "_low", "_high")]
    return pd.DataFrame(rows, columns=[*COLUMNS, *columns]).astype({"reference": bool})


def _played(each: pd.DataFrame) -> Means:
    return {
        (str(condition), str(of)): (Group.of(rows["attempts"].to_numpy()), rows["solved"].mean())
        for (condition, of), rows in each.groupby(["condition", "of"], observed=True)
    }


def _published(reference: Reference) -> Means:
    points = reference.points
    is_test = points["phase"] == "test"
    is_first = (points["trial"] == 1) & (is_test | points["condition"].isin(BASELINES))
    both = [points[is_test].assign(of="test"), points[is_first].assign(of="first")]
    return {
        (row["condition"], row["of"]): (
            Group.published(row["mean"], row["se"], int(row["subjects"])),
            row.get("share_solved", 1.0),
        )
        for row in pd.concat(both).to_dict("records")
    }


def _rows(means: Means, beside: Mapping[str, Means]) -> list[dict[str, Any]]:
    """What each training saves a learner, and how much more than it saves references."""
    rows = []
    for condition in TRANSFERS:
        test, other_test = (condition, "test"), (OTHER[condition], "test")
        first, untrained = (condition, "first"), (condition[-3:], "first")
        row: dict[str, Any] = {}
        if {test, other_test} <= means.keys():
            row["other_training"] = means[other_test][0].mean
            row["solved"] = (means[test][1] + means[other_test][1]) / 2
            if row["solved"]:
                saved = _contrast(means, test, other_test)
                found = weighted_difference(saved, pooled=True)
                row |= zip(("saved", "low", "high", "p"), found, strict=True)
                for column, known in beside.items():
                    if {test, other_test} <= known.keys():
                        more = weighted_difference(saved + _contrast(known, other_test, test))
                        row |= more.columns(column)
        if {first, untrained} <= means.keys():
            row |= _share(means[first], means[untrained])
        if row:
            sizes = [means[key][0].size for key in (test, other_test) if key in means]
            about = {"condition": condition, "subjects": min(sizes)}
            rows.append({**about, "attempts": means[test][0].mean, **row})
    return rows


def _contrast(means: Means, one: tuple[str, str], other: tuple[str, str]) -> list[Group]:
    """The groups whose weighted difference is what ``one`` saves against the other."""
    return [means[other][0]._replace(weight=1.0), means[one][0]._replace(weight=-1.0)]


def _share(first: tuple[Group, float], untrained: tuple[Group, float]) -> dict[str, float]:
    """Which share of the attempts of untrained subjects training saves."""
    own, start = first[0], untrained[0]
    row = {"first": own.mean, "untrained": start.mean}
    if first[1] or untrained[1]:
        ratio = own.mean / start.mean
        error = weighted_difference(  # weights: derivatives of the share
            [start._replace(weight=ratio / start.mean), own._replace(weight=-1 / start.mean)]
        )
        share = 1 - ratio
        row |= {"share": share, "share_low": share + error.low, "share_high": share + error.high}
    return row


def plot_savings(
    results: Material, *, learners: Names = None, protocol: str | None = None, ax: Any = None
) -> Any:
    """Draw what training saves in the test, a row for each learner, with 95% intervals.

    Above: attempts that training with the structure of the test saves, against training with the
    other structure, shaded that of the first reference. Below: the share of the attempts of
    untrained subjects that each training saves in a first room. A learner that solved no trial has
    no dot, as the limit hides its effect, and by default no row.

    >>> [axes.get_title(loc="left") for axes in plot_savings(results)]
    ['Test of CC4', 'Test of CE4', 'Test of CC4', 'Test of CE4']

    The protocol is by default ``human``, or else the first by alphabet. The other arguments, what
    is returned and errors are those of
    :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    protocol, trials = trials_under(results, protocol, learners)
    if learners is not None:
        results = replace(results, all_trials=trials)
    table = results.once(transfer)
    table = table[table["protocol"] == protocol]
    if table["reference"].all():
        raise NothingToDrawError(
            "no such learner played one of the paper's transfer conditions, and the other training "
            f"or the baseline of its test, under the protocol {protocol}"
        )
    names = (_with_dots(table) if learners is None else []) or [*dict.fromkeys(table["learner"])]
    table = table[table["learner"].isin(names)]
    marks = {"CC3": "o", "CE3": "s"}
    looks = {name: (style.current().trained(name), mark) for name, mark in marks.items()}

    def lay_out(figure: Figure) -> Sequence[Axes]:
        figure.set_size_inches(style.WIDTH, 2 * (0.85 + 0.21 * len(names)) + 0.3)
        return list(figure.subplots(2, 2, sharey=True, sharex="row").ravel())

    with panels(ax, 4, lay_out) as at:
        columns = zip(at.axes[:2], at.axes[2:], CONGRUENT.items(), strict=True)
        for above, below, (tested, congruent) in columns:
            for axes in (above, below):
                style.name_rows(axes, names)
                axes.axvline(0, color="#333333", lw=0.9, zorder=1)
                axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
                style.panel_title(axes, f"Test of {tested}")
            rows = table[table["condition"] == congruent]
            for row in rows[rows["reference"]].head(1).itertuples():
                above.axvspan(row.low, row.high, color="#777777", alpha=0.15, lw=0, zorder=0)
            _dots(above, rows, names, ("saved", "low", "high"), looks[congruent[:3]])
            above.set_xlabel("Attempts saved by congruent training")
            for (trained, look), aside in zip(looks.items(), (-0.14, 0.14), strict=True):
                rows = table[table["condition"] == f"{trained}-{tested}"]
                _dots(below, rows, names, ("share", "share_low", "share_high"), look, aside)
            below.set_xlabel("Share of attempts saved by training")
            below.xaxis.set_major_formatter(PercentFormatter(1.0))
        edge: Any = {"ls": "", "mec": "black", "mew": 0.5}
        keys = [Line2D([], [], marker=mark, color=colour, label=f"{trained} training", **edge)
                for trained, (colour, mark) in looks.items()]  # fmt: skip
        at.legend(keys)
    return at.returned


def _with_dots(rows: pd.DataFrame) -> list[str]:
    """Learners whose savings are known: those that solved a trial."""
    known = rows[["saved", "share"]].notna().any(axis="columns")
    return list(dict.fromkeys(rows.loc[known, "learner"]))


def _dots(
    axes: Axes,
    rows: pd.DataFrame,
    names: Sequence[str],
    columns: tuple[str, str, str],
    look: tuple[str, str],
    aside: float = 0.0,
) -> None:
    """Draw values with their intervals; ``aside`` is how far below its row's middle a dot is."""
    colour, marker = look
    value, low, high = (rows[column] for column in columns)
    y = np.array([names.index(name) + aside for name in rows["learner"]])
    axes.hlines(y, low, high, color=colour, lw=1.6, zorder=2, capstyle="projecting")
    axes.plot(value, y, marker, color=colour, ms=5, mec="black", mew=0.5, zorder=3)


def section(material: Material) -> Section | None:
    """Section on what training saves; None if nothing was played to compare with."""
    found = material.once(transfer)
    protocols = list(dict.fromkeys(found.loc[~found["reference"], "protocol"]))
    if not protocols:
        return None
    tables, plots = [], []
    for protocol, part in file_names(protocols).items():
        rows = found[found["protocol"] == protocol]
        title = "What training saves in the test"
        title += f", protocol {protocol}" if len(protocols) > 1 else ""
        shown = _with_dots(rows)
        unsolved = [name for name in dict.fromkeys(rows["learner"]) if shown and name not in shown]
        caption = sentences(
            "Above: attempts saved by training with the structure of the test, against training "
            "with the other structure; below: share of the attempts of untrained subjects in a "
            "first room with four levers that training saves. Right of the line training helped.",
            "Shaded: the interval of people." if rows["reference"].any() else "",
            f"Not drawn, as they solved no trial: {joined(unsolved)}." if unsolved else "",
        )
        name = f"savings_{part}"
        plot = drawn(name, plot_savings, material, title, caption, protocol=protocol)
        plots.append(replace(plot, folded=protocol != protocols[0]))
        tables.append(_table(f"transfer_{part}", title, rows, material))
    answer = _answer(found[found["protocol"] == protocols[0]], material.trained_before)
    title = "Does training transfer?"
    return Section("transfer", title, (), tuple(tables), tuple(plots), answer, is_open=True)


def _answer(rows: pd.DataFrame, trained: Mapping[str, float]) -> str:
    """Sentences of the first screen: whom congruent training helps, and by how much.

    ``trained`` are attempts before the experiment: subjects share the network that was trained.
    """
    rows = rows[rows["condition"].isin(CONGRUENT.values()) & rows["saved"].notna()]
    own = rows[~rows["reference"]]
    if own.empty:
        return ""
    cut = own["solved"] < NEARLY_ALL  # the limit hides how large such an effect is
    found = own[(own["p"] < ALPHA) & ~cut]
    largest = found.groupby("learner")["saved"].max().sort_values(ascending=False).index
    named = [
        f"{name} {_effects(found[found['learner'] == name])}"
        + (" (one network: intervals are over rooms)" if trained.get(name, 0) > 0 else "")
        for name in largest
    ]
    people = rows[rows["reference"] & rows["condition"].isin(own["condition"])]
    people = people[people["learner"].isin(people["learner"].head(1))]
    known = [f": {name} {_effects(part)}. Significant" for name, part in people.groupby("learner")]
    untested = [*own.loc[own["p"].isna(), "learner"].unique()]
    level = f"{ALPHA:g}".removeprefix("0")
    return sentences(
        "Attempts that training with the structure of the test saves, against training with the "
        f"other structure{(known or [', significant'])[0]} for learners "
        f"(p < {level}, each test by itself): {some(named, NAMED) or 'none'}.",
        f"Not tested, as groups are too small: {some(untested, NAMED)}." if untested else "",
        f"Learners that solved less than {NEARLY_ALL:.0%} of these tests are not named, as the "
        "limit hides their effect."
        if (cut & (own["solved"] > 0)).any()
        else "",
    )


def _effects(rows: pd.DataFrame) -> str:
    each = rows.to_dict("records")
    return joined([f"{_effect(row, 'saved')} in {row['condition'][-3:]}" for row in each])


def _effect(row: Mapping[str, Any], value: str, ends: str = "") -> str:
    """An effect with its interval, marked where some trials were not solved."""
    if np.isnan(row[value]):
        return "–"
    text = printed(float(row[value]), "+.2f") + ("*" if row["solved"] < 1 else "")
    low, high = (float(row[f"{ends}{end}"]) for end in ("low", "high"))
    return text if np.isnan(low) else f"{text} [{printed(low, '.2f')}, {printed(high, '.2f')}]"


def _table(name: str, title: str, rows: pd.DataFrame, material: Material) -> Table:
    """A row for each learner in each test."""
    names = (*(one.name for one in material.leading), *material.people)
    gaps = {gap_column(name): name for name in names}
    gaps = {column: of for column, of in gaps.items() if rows[column].notna().any()}
    lines = []
    for (learner, test), part in rows.groupby(["learner", rows["condition"].str[-3:]], sort=False):
        each = part.set_index("condition").reindex(TRANSFERS).to_dict("index")
        row = each[CONGRUENT[test]]
        line = {"learner": learner, "test": test, "n": f"{part['subjects'].min():,}"}
        saved = "solved no trial" if row["solved"] == 0 else _effect(row, "saved")
        line |= {"attempts saved": saved, "p": p_value(row["p"])}
        for column, of in gaps.items():
            line[f"more than {of}"] = _effect(row, column, f"{column}_")
        line["untrained"] = printed(part["untrained"].max(), ".2f")
        for trained in ("CC3", "CE3"):
            line[f"saved by {trained}"] = printed(each[f"{trained}-{test}"]["share"], ".0%")
        lines.append(line)
    caption = sentences(
        "Attempts saved: mean attempts in the test after training with the other structure minus "
        "those after training with the structure of the test, each test being a planned question.",
        "More than people: the learner's effect minus people's." if gaps else "",
        "Untrained: mean attempts in trial 1 of the baseline; saved by CC3 or CE3: the share of "
        "these that training saves in the first test trial, negative where it costs attempts.",
        "n: subjects in the smaller group.",
        "*: trials that were not solved count as the limit, so that the effect may be more or less."
        if (rows["solved"] < 1).any()
        else "",
    )
    frame = pd.DataFrame(lines)
    return Table(name, title, frame, dict.fromkeys(frame.columns[2:], "s"), caption)


TOPIC = Topic("transfer", 10, section)

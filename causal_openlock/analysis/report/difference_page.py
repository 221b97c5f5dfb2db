"""Two results folders side by side: what changed between them, and do the results differ.

The descriptions of the two experiments are compared piece by piece, and for each learner in each
condition that both played, the means of the subjects
(:func:`~causal_openlock.analysis.effects.weighted_difference`). What is not measured twice is not
compared.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import ALPHA, contrast, holm, weighted_difference
from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import in_rows, panels
from causal_openlock.analysis.report.described import in_words
from causal_openlock.analysis.report.page import write_page
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Section, drawn
from causal_openlock.analysis.topics.pairwise import all_outcomes
from causal_openlock.storage.store import StoredExperiment
from causal_openlock.wording import counted, some

MOST_DRAWN = 60  #: differences between two results that are drawn: the first ones
FORMATS = {
    **dict.fromkeys(("subjects_first", "subjects_second"), ","),
    **dict.fromkeys(("attempts_first", "attempts_second"), ".2f"),
    **dict.fromkeys(("difference", "ci_low", "ci_high"), "+.2f"),
    **dict.fromkeys(("p", "p_holm"), ".2g"),
}
SAME, UNDECIDED, DIFFERENT, UNKNOWN = "the same", "undecided", "different", "too few subjects"
_IN_WORDS = {
    UNDECIDED: "may differ or not: undecided",
    SAME: "are the same, subject by subject",
    UNKNOWN: "are of too few subjects to say",
}


def changes(first: StoredExperiment, second: StoredExperiment) -> pd.DataFrame:
    """Differences between two experiments.

    Returns:
        One row for each difference: ``what`` (such as ``learner ddqn, parameters, gamma``), and
        what it is in the ``first`` and in the ``second``, in words; ``–`` where it is not there.
    """
    known = [_parts(experiment) for experiment in (first, second)]
    for own, other in (known, known[::-1]):
        for name in own.keys() - other.keys():
            own[name] = "there"  # no details of what only one of them has
    one, other = (dict(_flat(parts)) for parts in known)
    rows = [
        (what, one.get(what, "–"), other.get(what, "–"))
        for what in one | other
        if one.get(what) != other.get(what)
    ]
    return pd.DataFrame(rows, columns=["what", "first", "second"])


def _parts(experiment: StoredExperiment) -> dict[str, Any]:
    """An experiment as plain data, with each learner and condition by name."""
    data = experiment.as_dict()
    return {
        **{name: data[name] for name in ("name", "seed", "cell_size")},
        "missing cells": list(experiment.missing),
        "versions": dict(experiment.versions),
        **{f"learner {spec['name']}": spec for spec in data["learners"]},
        **{f"condition {condition['name']}": condition for condition in data["conditions"]},
    }


def _flat(value: Any, *above: str) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping) and value:
        for key, inner in value.items():
            yield from _flat(inner, *above, str(key))
    elif isinstance(value, list) and any(isinstance(part, Mapping | list) for part in value):
        for number, inner in enumerate(value, 1):
            yield from _flat(inner, *above, str(number))
    else:
        yield ", ".join(above), in_words(value)


def differences(first: Material, second: Material) -> pd.DataFrame:
    """Each learner in each condition, in the one results and in the other.

    Returns:
        One row for each ``learner``, ``condition`` and ``protocol`` that is in both and judged by
        the same trial, which is ``measured``; for each how many ``subjects_`` and the mean
        ``attempts_``; the ``difference`` (second less first) with its interval ``ci_low`` and
        ``ci_high``; ``p`` of the test, paired where rooms are the same, and ``p_holm``, corrected
        over all rows but those that are the same (NaN there); and a ``verdict``:
        :data:`SAME` where every subject has the same value, :data:`DIFFERENT` where ``p_holm`` is
        below 5%, otherwise :data:`UNDECIDED`, or :data:`UNKNOWN` for too few subjects.
    """
    groups = first.once(_groups), second.once(_groups)
    conditions = ordered([key[1] for key in groups[0]], first.conditions)
    rows: list[tuple[Any, ...]] = []
    for key in sorted(
        groups[0].keys() & groups[1].keys(),
        key=lambda key: (first.learners.index(key[0]), key[2], conditions.index(key[1]), key[3]),
    ):
        before, after = groups[0][key], groups[1][key]
        found = weighted_difference(contrast(after, before))
        same = np.array_equal(before, after)
        verdict = SAME if same else UNKNOWN if np.isnan(found.p) else ""
        sizes, means = (len(before), len(after)), (before.mean(), after.mean())
        rows.append((*key, *sizes, *means, *found, np.nan, verdict))
    columns = ["learner", "condition", "protocol", "measured", *FORMATS, "verdict"]
    table = pd.DataFrame(rows, columns=columns)
    table["p_holm"] = holm(table["p"].where(table["verdict"] != SAME).to_numpy(float))
    decided = np.where(table["p_holm"] < ALPHA, DIFFERENT, UNDECIDED)
    return table.assign(verdict=np.where(table["verdict"] == "", decided, table["verdict"]))


def _groups(results: Material) -> dict[tuple[str, str, str, str], pd.Series[float]]:
    """Attempts of each learner's subjects by condition, protocol and trial; indices pair them."""
    held = results.once(all_outcomes)
    return {
        (learner, condition, protocol, trial): held[protocol][learner][condition]["attempts"]
        for learner, protocol, condition, trial in results.headline.iloc[:, :4].to_numpy()
    }


def write_difference(
    first: Material,
    second: Material,
    path: Path | str,
    names: tuple[str, str],
    figures: bool = False,
) -> tuple[str, str]:
    """Write the page that compares two results of these names, such as those of their folders.

    With ``figures``, its figure and tables are also written as files next to it.

    Returns:
        Its sentences on what changed, and on whether the results differ.

    Raises:
        OpenLockError: If a file cannot be written.
    """
    path = Path(path)
    label = re.sub(r"\W+", "_", path.stem, flags=re.ASCII)
    changed, table = changes(first.experiment, second.experiment), differences(first, second)
    things = counted(len(changed), "thing differs", "things differ")
    told = f"{things} in what was run: {some(changed['what'])}."
    sentences = (
        told if len(changed) else "Nothing differs in what was run.",
        sentence_on_differences(table),
    )
    text, opening, both = [sentences[1]], [], (first, second)
    for place, name, results, other in zip(
        ("First", "Second"), names, both, both[::-1], strict=True
    ):
        missing = counted(len(results.experiment.missing), "cell")
        opening.append(
            f"{place}: {name}. {counted(results.record.num_rows, 'attempt')} in "
            f"{counted(len(results.trials), 'trial')}, seed {results.experiment.seed}"
            f"{f', {missing} missing' if results.experiment.missing else ''}."
        )
        if alone := sorted(results.once(_groups).keys() - other.once(_groups).keys()):
            only = [f"{key[0]} in {key[1]} ({key[2]}, {key[3]})" for key in alone]
            text.append(f"Only in {name}: {some(only)}.")
    shown = changed.rename(columns={"first": names[0], "second": names[1]})
    differ = Table(f"{label}_changes", "Differences of the experiments", shown)
    caption = (
        f"Mean attempts over subjects in {names[0]} (first) and {names[1]} (second); difference: "
        "second less first, so negative is better, with its 95% interval (Student’s over pairs of "
        "subjects where rooms are the same, otherwise Welch’s); p holm is p after Holm’s "
        f"correction for all rows that are not the same, and below {ALPHA} it is different; the "
        "others are undecided, which does not show that they are equal."
    )
    means = Table(f"{label}_means", "Differences of the results", table, FORMATS, caption)
    sections = [
        Section("changes", "What changed", sentences[:1], (differ,)),
        Section("noise", "Do the results differ?", tuple(text), (means,)),
    ]
    if len(table):
        title = f"Attempts in {names[1]} less those in {names[0]}"
        caption = (
            "Difference of mean attempts with its 95% interval; filled and orange: different after "
            "Holm’s correction."
        )
        if len(table) > MOST_DRAWN:
            caption += f" The first {MOST_DRAWN} of {len(table)}."
        plot = drawn(f"{label}_means", plot_differences, table, title, caption, "", names=names)
        title = "Differences with their intervals"
        sections.append(Section("intervals", title, plots=(plot,)))
    title = f"{names[0]} and {names[1]}"
    opened = [replace(section, is_open=True) for section in sections]
    write_page(path, "page.html.j2", opened, figures, title=title, opening=opening)
    return sentences


def sentence_on_differences(table: pd.DataFrame) -> str:
    """How many differences (:func:`differences`) are more than chance explains, in a sentence."""
    if table.empty:
        return "No learner played the same condition under the same protocol in both."
    rows = table[table["verdict"] == DIFFERENT]
    more = [*(rows["learner"] + " in " + rows["condition"])]
    verdicts = table["verdict"].value_counts()
    told = [
        f"{len(more)} of {len(table)} means differ by more than chance explains"
        f"{f' ({some(more)})' if more else ''}",
        *(f"{verdicts[name]} {words}" for name, words in _IN_WORDS.items() if name in verdicts),
    ]
    return f"{', '.join(told)}."


def plot_differences(table: pd.DataFrame, names: Sequence[str], ax: Any = None) -> Any:
    """Draw :func:`differences` between two results of these names, a line each."""
    table = table.head(MOST_DRAWN)
    y = np.arange(len(table))
    differs = [verdict == DIFFERENT for verdict in table["verdict"]]
    colours = [style.current().other(2) if sure else "#666666" for sure in differs]
    with panels(ax, 1, in_rows(1, 1, 0.19 * len(table) + 0.5, style.WIDTH)) as at:
        (axes,) = at.axes
        axes.hlines(y, table["ci_low"], table["ci_high"], colors=colours, lw=1.6)
        faces = [colour if sure else "white" for colour, sure in zip(colours, differs, strict=True)]
        axes.scatter(table["difference"], y, 20, faces, edgecolors=colours, zorder=3)
        style.name_rows(axes, [*(table["learner"] + "  " + table["condition"])])
        axes.axvline(0, color="black", lw=0.8, zorder=1)
        axes.grid(False, axis="y")
        first, second = (style.label(name, 24) for name in names)
        axes.set_xlabel(f"Attempts, {second} less {first}")
    return at.returned

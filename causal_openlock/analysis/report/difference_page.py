"""Two results folders side by side: what changed between them, and is it more than noise.

The descriptions of the two experiments are compared piece by piece, and for each learner in each
condition that both played, the means of the subjects
(:mod:`~causal_openlock.analysis.results.differences`). Whatever is not measured twice is not
compared.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import ALPHA, holm
from causal_openlock.analysis.measures import CELL, SUBJECT, by_subject, ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.style import Drawing
from causal_openlock.analysis.report.cautions import some
from causal_openlock.analysis.report.page import Written, render
from causal_openlock.analysis.report.section import Section, Table
from causal_openlock.analysis.results.counting import count
from causal_openlock.analysis.results.description import edges, in_words, mappings_with
from causal_openlock.analysis.results.differences import difference
from causal_openlock.analysis.results.summary import judged, measured
from causal_openlock.experiment.protocol import PAPER_CONDITIONS
from causal_openlock.files.atomic import write_text
from causal_openlock.wording import counted

if TYPE_CHECKING:
    import pyarrow as pa

Results = tuple["pa.Table", Mapping[str, Any]]
"""A record and what it is the record of."""

MOST_DRAWN = 60
"""Differences that are drawn: the first ones."""

_TOLD_ELSEWHERE = ("version", "command", "title", "cells", "identity", "failures")
FORMATS = {
    **dict.fromkeys(("subjects_first", "subjects_second"), ","),
    **dict.fromkeys(("attempts_first", "attempts_second"), ".2f"),
    **dict.fromkeys(("difference", "ci_low", "ci_high"), "+.2f"),
    **dict.fromkeys(("p", "p_holm"), ".2g"),
}
COLUMNS = (
    *("learner", "condition", "protocol", "measured", "subjects_first", "subjects_second"),
    *("attempts_first", "attempts_second", "difference", "ci_low", "ci_high", "p", "p_holm"),
    "verdict",
)
SAME, NOISE, MORE, UNKNOWN = "the same", "within noise", "more than noise", "one subject"


def changes(first: Mapping[str, Any], second: Mapping[str, Any]) -> pd.DataFrame:
    """What differs between two descriptions of experiments.

    Args:
        first: As :meth:`causal_openlock.experiment.store.Store.record` gives it.
        second: The other.

    Returns:
        One row for each difference: ``what`` (such as ``learner ddqn, parameters, gamma``), and
        what it is in the ``first`` and in the ``second``, in words; ``–`` where it is not there.
    """
    readable = [_readable(one) for one in (first, second)]
    for mine, other in (readable, readable[::-1]):
        for key in [key for key in mine if key not in other and isinstance(mine[key], Mapping)]:
            mine[key] = "there"  # what is there only once is not told apart any further
    told = [dict(_flat(one)) for one in readable]
    rows = [
        (what, told[0].get(what, "–"), told[1].get(what, "–"))
        for what in dict.fromkeys([*told[0], *told[1]])
        if told[0].get(what) != told[1].get(what)
    ]
    return pd.DataFrame(rows, columns=["what", "first", "second"])


def _readable(description: Mapping[str, Any]) -> dict[str, Any]:
    """A description with learners and conditions by name, and schemas in a line each."""
    told = {key: value for key, value in description.items() if key not in _TOLD_ELSEWHERE}
    for key, one in (("learners", "learner"), ("conditions", "condition")):
        listed: Any = told.get(key)
        if mappings_with(listed, {"name"}):
            del told[key]
            for entry in listed:
                rest = {name: value for name, value in entry.items() if name != "name"}
                told[f"{one} {entry['name']}"] = _without_schemas(rest) or "there"
    return told


def _without_schemas(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {
            key: f"{inner.get('name')}: {edges(inner)}"
            if key == "schema" and isinstance(inner, Mapping)
            else _without_schemas(inner)
            for key, inner in value.items()
        }
    return [_without_schemas(one) for one in value] if isinstance(value, list) else value


def _flat(value: Any, above: tuple[str, ...] = ()) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping) and value:
        for key, inner in value.items():
            # What a learner or a condition is called stays as it is.
            name = str(key).replace("_", " ") if above or " " not in str(key) else str(key)
            yield from _flat(inner, (*above, name))
    elif isinstance(value, list) and any(isinstance(one, Mapping | list) for one in value):
        for number, inner in enumerate(value, 1):
            yield from _flat(inner, (*above, str(number)))
    else:
        yield ", ".join(above), in_words(value)


def compared(first: pd.DataFrame, second: pd.DataFrame, learners: Sequence[str]) -> pd.DataFrame:
    """Each learner in each condition, in the one record and in the other.

    Args:
        first: Trials from :func:`~causal_openlock.analysis.measures.attempts_to_solve`.
        second: Those of the other record.
        learners: The order of the rows.

    Returns:
        One row for each ``learner``, ``condition`` and ``protocol`` that is in both and judged by
        the same trial, which is ``measured``; for each record how many ``subjects_`` and the mean
        ``attempts_``; the ``difference`` (second less first) with its bootstrap interval
        ``ci_low`` and ``ci_high``; ``p`` of Welch's test, and ``p_holm``, corrected over all rows
        but those that are the same, of which nothing is asked (NaN there); and a ``verdict``:
        :data:`SAME` where every subject has the same value, :data:`MORE` where ``p_holm`` is below
        5%, otherwise :data:`NOISE`, or :data:`UNKNOWN` for one subject.
    """
    groups = [_groups(trials) for trials in (first, second)]
    keys = [key for key in groups[0] if key in groups[1]]
    names = ordered({key[0] for key in keys}, learners)
    conditions = ordered({key[1] for key in keys}, PAPER_CONDITIONS)
    keys.sort(key=lambda key: (names.index(key[0]), key[2], conditions.index(key[1]), key[3]))
    rows: list[tuple[Any, ...]] = []
    for key in keys:
        before, after = groups[0][key], groups[1][key]
        label = "/".join(key)
        told = difference(after, before, (f"second/{label}", f"first/{label}"))
        same = len(before) == len(after) and bool((before == after).all())
        verdict = SAME if same else UNKNOWN if np.isnan(told.p) else ""
        sizes, means = (len(before), len(after)), (before.mean(), after.mean())
        rows.append((*key, *sizes, *means, *told, np.nan, verdict))
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    asked = table["p"].where(table["verdict"] != SAME)
    table["p_holm"] = holm(asked.to_numpy(float))
    decided = np.where(table["p_holm"] < ALPHA, MORE, NOISE)
    return table.assign(verdict=np.where(table["verdict"] == "", decided, table["verdict"]))


def _groups(trials: pd.DataFrame) -> dict[tuple[str, str, str, str], Any]:
    """``[n]`` values of the subjects, in their order, of each learner, condition and protocol."""
    values = by_subject(judged(trials), ["phase", "trial"])
    values = values.assign(measured=measured(values)).sort_values([*CELL, *SUBJECT], kind="stable")
    return {
        (str(key[0]), str(key[1]), str(key[2]), str(key[3])): part["attempts"].to_numpy(float)
        for key, part in values.groupby([*CELL, "measured"], observed=True)
    }


def write_difference(
    first: Results, second: Results, path: Path | str, names: tuple[str, str]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Write the page that compares two records.

    Args:
        first: A record with its description.
        second: The other.
        path: The page to write, ``NAME.html``; figures and tables are put beside it.
        names: What to call them, such as the names of their folders.

    Returns:
        :func:`changes` and :func:`compared`.

    Raises:
        OpenLockError: If a file cannot be written.
        StoreError: If a record has attempts missing or twice.
    """
    path = Path(path)
    changed = changes(first[1], second[1])
    trials = [count(record).trials for record, _ in (first, second)]
    listed: Any = first[1].get("learners", ())
    learners = [one["name"] for one in listed if isinstance(one, Mapping)]
    table = compared(trials[0], trials[1], learners)
    written = Written(path.parent)
    label = re.sub(r"\W+", "_", path.stem, flags=re.ASCII)
    sections = [
        _changes_section(changed, names, label),
        _noise_section(table, trials, names, label),
    ]
    shown = [written.section(section) for section in sections]
    page = render(
        "difference.html.j2",
        title=f"{names[0]} and {names[1]}",
        names=names,
        told=[_told(*one) for one in zip((first, second), trials, strict=True)],
        sections=shown,
        files=written.files,
    )
    write_text(path, page)
    return changed, table


def _told(results: Results, trials: pd.DataFrame) -> str:
    record, description = results
    missing = len(description.get("missing_cells") or ())
    attempts, played = counted(record.num_rows, "attempt"), counted(len(trials), "trial")
    text = f"{attempts} in {played}, seed {description.get('seed')}"
    return text + (f", {counted(missing, 'cell')} missing" if missing else "")


def _changes_section(changed: pd.DataFrame, names: tuple[str, str], label: str) -> Section:
    if changed.empty:
        text = "Nothing: both were run with the same learners, conditions, seed and versions."
        return Section("changes", "What changed", (text,))
    shown = changed.rename(columns=dict(zip(("first", "second"), names, strict=True)))
    table = Table(f"{label}_changes", "Differences of the experiments", shown)
    return Section("changes", "What changed", (said_of_changes(changed),), (table,))


def said_of_changes(changed: pd.DataFrame) -> str:
    """What differs, in a sentence."""
    if changed.empty:
        return "Nothing differs in what was run."
    things = counted(len(changed), "thing differs", "things differ")
    return f"{things} in what was run: {some(changed['what'].tolist())}."


def said_of_noise(table: pd.DataFrame) -> str:
    """How many differences are more than noise, in a sentence."""
    if table.empty:
        return "No learner played the same condition under the same protocol in both."
    told = table["verdict"].value_counts()
    where = table[table["verdict"] == MORE]
    named = [f"{row['learner']} in {row['condition']}" for row in where.to_dict("records")]
    more = f"{len(where)} of {len(table)} means differ by more than noise"
    rest = [f"{told[name]} {word}" for name, word in _REST.items() if name in told]
    return more + (f" ({some(named)})" if named else "") + "".join(f", {r}" for r in rest) + "."


_REST = {
    NOISE: "are within noise",
    SAME: "are the same, subject by subject",
    UNKNOWN: "are of one subject, which tells nothing",
}


def _noise_section(
    table: pd.DataFrame, trials: Sequence[pd.DataFrame], names: tuple[str, str], label: str
) -> Section:
    text = [said_of_noise(table)]
    cells = [set(_groups(one)) for one in trials]
    for name, only in zip(names, (cells[0] - cells[1], cells[1] - cells[0]), strict=True):
        if only:
            listed = [f"{key[0]} in {key[1]} ({key[2]}, {key[3]})" for key in sorted(only)]
            text.append(f"Only in {name}: {some(listed)}.")
    if table.empty:
        return Section("noise", "Is it more than noise?", tuple(text))
    shown = Table(
        f"{label}_means",
        "Differences of the results",
        table,
        FORMATS,
        f"Mean attempts over subjects in {names[0]} (first) and {names[1]} (second); difference: "
        "second less first, so negative is better, with its 95% bootstrap interval; p is Welch’s "
        f"test, p holm the same after Holm’s correction for all rows that are not the same, and "
        f"below {ALPHA:g} it is more than noise. The groups are taken for independent: where both "
        "have the same seed, their subjects share rooms and random numbers, and less is needed for "
        "a true difference than this asks for.",
    )
    drawing = draw_differences(table, names, f"{label}_means")
    return Section("noise", "Is it more than noise?", tuple(text), (shown,), (drawing,))


def draw_differences(
    table: pd.DataFrame, names: tuple[str, str], label: str = "differences"
) -> Drawing:
    """Every difference with its interval, a line each.

    Args:
        table: From :func:`compared`.
        names: What the records are called.
        label: Name of the drawing.
    """
    rows = table.head(MOST_DRAWN).to_dict("records")
    with style.settings():
        figure, (axes,) = style.panels(1, 1, 0.19 * len(rows) + 0.5)
        figure.set_figwidth(style.WIDTH)
        for place, row in enumerate(rows):
            sure = row["verdict"] == MORE
            colour = style.OTHER[2] if sure else "#666666"
            if row["ci_low"] == row["ci_low"]:
                axes.plot([row["ci_low"], row["ci_high"]], [place] * 2, color=colour, lw=1.6)
            face = colour if sure else "white"
            axes.plot(row["difference"], place, "o", color=colour, mfc=face, ms=4.5, zorder=3)
        labels = [f"{_short(row['learner'])}  {_short(row['condition'])}" for row in rows]
        axes.set_yticks(range(len(rows)), labels, fontsize=7.5)
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.axvline(0, color="black", lw=0.8, zorder=1)
        most = max([1.0, *(abs(x) for x in axes.get_xlim())])
        axes.set_xlim(-most, most)
        axes.grid(True, axis="x")
        axes.grid(False, axis="y")
        first, second = (_short(name) for name in names)
        axes.set_xlabel(f"Attempts, {second} less {first}")
    cut = f" The first {MOST_DRAWN} of {len(table)}." if len(table) > MOST_DRAWN else ""
    return Drawing(
        label,
        "Differences with their intervals",
        "Difference of mean attempts with its 95% bootstrap interval; filled and orange: more "
        f"than noise after Holm’s correction.{cut}",
        figure,
    )


def _short(name: str) -> str:
    return (name if len(name) <= 24 else f"{name[:13]}…{name[-10:]}").replace("$", r"\$")

"""Whether training with the structure of the test helps, and whether as much as it helps people.

A transfer condition trains in rooms with three levers and is tested in one with four. Training is
*congruent* if its rooms have the causal structure of the test (common cause or common effect). The
effect is how many attempts a test takes fewer after congruent training than after incongruent
training, in other subjects. It is estimated here and nowhere else: with the interval and the p of
Student's t, as the paper has it, and next to it the learner's effect minus that of people.

The tests on CC4 and on CE4 are the paper's own planned tests, each a question by itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.ticker import MaxNLocator

from causal_openlock.analysis.effects import ALPHA, Difference, Group, weighted_difference
from causal_openlock.analysis.measures import TRANSFERS, by_subject, judged, ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, panels, trials_under
from causal_openlock.analysis.plots.rows import dots, name_rows, two_panels
from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import Reference, gap_column
from causal_openlock.analysis.section import Section
from causal_openlock.analysis.table import Table, p_value, printed
from causal_openlock.analysis.topic import Topic
from causal_openlock.errors import NothingToDrawError
from causal_openlock.experiment.declare import HUMAN_PROTOCOL
from causal_openlock.wording import file_names, joined

COMPARED = {"CC4": ("CC3-CC4", "CE3-CC4"), "CE4": ("CE3-CE4", "CC3-CE4")}
"""Conditions with congruent and with incongruent training, by the schema of the test."""

COLUMNS = (
    *("learner", "reference", "protocol", "test", "subjects", "congruent", "incongruent"),
    *("solved", "saved", "low", "high", "p"),
)
"""Columns of :func:`congruency`, before those of references."""

_NAMED = 4  # learners that the first screen names
_NEARLY_ALL = 0.95  # share of trials that such a learner has solved
_PROSE = Prose(__name__)


def congruency(results: Material) -> pd.DataFrame:
    """Return how many attempts congruent training saves in the test, by learner.

    >>> table = congruency(results)
    >>> table.loc[table["learner"] == "people", ["test", "saved"]].round(2).values.tolist()
    [['CC4', 2.65], ['CE4', 6.02]]

    Args:
        results: What was played. Rows are made of the paper's four transfer conditions, by the
            trials that they are judged by.

    Returns:
        A row for each learner, protocol and test whose two conditions were played, references
        first where they are comparable with a learner:

        - ``learner``, whether it is a ``reference``, ``protocol``, the schema of the ``test``;
        - ``subjects``: of the smaller group; ``congruent``, ``incongruent``: mean attempts;
        - ``solved``: the share of trials solved in both. Where it is 0 the limit says nothing
          about the effect, and the following are NaN; below 1 they may be off either way;
        - ``saved``: incongruent − congruent, in attempts; ``low``, ``high`` and ``p`` are of
          Student's t (interval NaN where nobody differs from the others of its group);
        - ``to_people`` and the like, of each reference in the leaderboard: how much more training
          saves the learner, in attempts, with ``_low`` and ``_high`` of Welch's t.
    """
    trials = judged(results.trials[results.trials["condition"].isin(TRANSFERS)])
    known = {one.reference.name: _published(one.reference) for one in results.references}
    gaps = [gap_column(one.reference.name) for one in results.leading]
    each = by_subject(trials, [])
    played = {
        (str(protocol), str(learner)): _played(own)
        for (protocol, learner), own in each.groupby(["protocol", "learner"], observed=True)
    }
    rows: list[dict[str, Any]] = []
    for protocol in ordered(trials["protocol"].unique(), (HUMAN_PROTOCOL,)):
        here = trials[trials["protocol"] == protocol]
        for one in results.references:
            if one.stands(here).any():
                name = one.reference.name
                about = {"learner": name, "reference": True, "protocol": protocol}
                rows += [about | _effect(test, known[name], {}) for test in COMPARED]
        for name in ordered(here["learner"].unique(), results.learners):
            own = here[here["learner"] == name]
            beside = {
                one.reference.name: known[one.reference.name]
                for one in results.leading
                if one.stands(own).all()
            }
            about = {"learner": name, "reference": False, "protocol": protocol}
            rows += [about | _effect(test, played[protocol, name], beside) for test in COMPARED]
    columns = [*COLUMNS, *(f"{gap}{end}" for gap in gaps for end in ("", "_low", "_high"))]
    table = pd.DataFrame([row for row in rows if "saved" in row], columns=columns)
    return table.astype({"reference": bool})


Groups = Mapping[str, tuple[Group, float]]
"""Subjects of each condition, and the share of trials that they solved."""


def _played(each: pd.DataFrame) -> Groups:
    return {
        str(name): (Group.of(rows["attempts"].to_numpy(float)), float(rows["solved"].mean()))
        for name, rows in each.groupby("condition", observed=True)
    }


def _published(reference: Reference) -> Groups:
    means = reference.means(judged=True)
    means = means[(means["phase"] == "test") & means["condition"].isin(TRANSFERS)]
    return {
        row["condition"]: (
            Group.published(row["mean"], row["se"], int(row["subjects"])),
            float(row.get("share_solved", 1.0)),
        )
        for row in means.to_dict("records")
    }


def _effect(test: str, groups: Groups, beside: Mapping[str, Groups]) -> dict[str, Any]:
    """The effect in one test, and that minus those of references; nothing if it was not played."""
    if not {*COMPARED[test]} <= groups.keys():
        return {}
    (same, solved), (other, other_solved) = (groups[name] for name in COMPARED[test])
    share = (solved + other_solved) / 2
    row = {
        "test": test,
        "subjects": min(same.size, other.size),
        "congruent": same.mean,
        "incongruent": other.mean,
        "solved": share,
        **_saved(weighted_difference(_contrast(test, groups), pooled=True), share),
    }
    for name, known in beside.items():
        if {*COMPARED[test]} <= known.keys():
            gap = weighted_difference([*_contrast(test, groups), *_contrast(test, known, -1)])
            saved = _saved(gap, share)
            column = gap_column(name)
            row |= {column: saved["saved"]}
            row |= {f"{column}_{end}": saved[end] for end in ("low", "high")}
    return row


def _contrast(test: str, groups: Groups, sign: int = 1) -> list[Group]:
    """Incongruent − congruent, as groups with weights."""
    same, other = (groups[name][0] for name in COMPARED[test])
    return [other._replace(weight=sign), same._replace(weight=-sign)]


def _saved(found: Difference, solved: float) -> dict[str, float]:
    values = found if solved else Difference(*[np.nan] * 4)
    return {"saved": values.value, "low": values.low, "high": values.high, "p": values.p}


def plot_congruency(
    results: Material,
    *,
    learners: Names = None,
    protocol: str | None = None,
    ax: Any = None,
) -> Any:
    """Draw how many attempts training with the structure of the test saves in the test.

    A panel for each test, a row for each learner, with 95% intervals; references such as people
    come first. The shaded band is the interval of the first reference. A learner that solved no
    trial has no dot, as the limit hides its effect, and by default no row.

    >>> [axes.get_title(loc="left") for axes in plot_congruency(results)]
    ['Test of CC4', 'Test of CE4']

    The protocol is by default ``human``, or else the first by alphabet. The other arguments, what
    is returned and errors are those of
    :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    protocol, trials = trials_under(results, protocol, learners)
    if learners is None:
        table = results.once(congruency)
        table = table[table["protocol"] == protocol]
    else:
        table = congruency(replace(results, trials=trials))
    if table["reference"].all():
        raise NothingToDrawError(
            f"no such learner played two of the paper's transfer conditions with the same test "
            f"under the protocol {protocol}"
        )
    drawn = table if learners is not None else table[table["solved"] > 0]
    names = list(dict.fromkeys((drawn if len(drawn) else table)["learner"]))
    table = table[table["learner"].isin(names)]
    with panels(ax, 2, two_panels(names)) as at:
        name_rows(at, names)
        for (test, (same, _)), axes in zip(COMPARED.items(), at.axes, strict=True):
            rows = table[table["test"] == test]
            for row in rows[rows["reference"]].head(1).itertuples():
                axes.axvspan(row.low, row.high, color="#777777", alpha=0.15, lw=0, zorder=0)
            dots(axes, rows, names, "saved", (style.current().trained(same), "o"))
            for row in rows[rows["solved"] == 0].itertuples():
                axes.annotate(
                    "solved no trial", (0, names.index(row.learner)), xytext=(4, 0),
                    textcoords="offset points", va="center", fontsize="small", color="#777777",
                )  # fmt: skip
            style.panel_title(axes, f"Test of {test}")
            axes.set_xlabel("Attempts saved by congruent training")
            axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    return at.returned


def section(material: Material) -> Section | None:
    """Section on congruent training; None if no two conditions with one test were played."""
    found = material.once(congruency)
    if found["reference"].all():
        return None
    tables: list[Table] = []
    plots = []
    protocols = list(dict.fromkeys(found["protocol"]))
    for protocol, part in file_names(protocols).items():
        rows = found[found["protocol"] == protocol]
        if rows["reference"].all():
            continue
        about: dict[str, Any] = {"protocol": protocol if len(protocols) > 1 else "", "alpha": ALPHA}
        gaps = {
            gap_column(one.reference.name): one.reference.name
            for one in material.leading
            if rows[gap_column(one.reference.name)].notna().any()
        }
        frame = _wide(rows, gaps)
        right = dict.fromkeys(frame.columns[1:], "s") | {"n": ","}
        tables.append(
            _PROSE.table("congruency", frame, right, f"congruency_{part}", gaps=bool(gaps), **about)
        )
        drawn = _PROSE.plot(
            "congruency", plot_congruency, material, {"protocol": protocol}, f"congruency_{part}",
            published=bool(rows["reference"].any()), unsolved=_unsolved(rows), **about,
        )  # fmt: skip
        plots.append(replace(drawn, folded=protocol != protocols[0]))
    tables.append(_PROSE.table("congruency_all", found, dict.fromkeys(found.columns[5:], ".3g")))
    first = found[found["protocol"] == protocols[0]]
    return _PROSE.section(
        "congruency",
        tables,
        plots,
        answer=_PROSE.sentence("answer", **_answer(first)),
        is_open=True,
    )


def _unsolved(rows: pd.DataFrame) -> list[str]:
    """Learners that solved no trial, if there are others."""
    most = rows.groupby("learner", sort=False)["solved"].max()
    return [] if (most == 0).all() else most.index[most == 0].tolist()


def _answer(rows: pd.DataFrame) -> dict[str, Any]:
    """Sentence of the first screen: how much training helps people, and which learners."""
    own = rows[~rows["reference"]]
    cut = own["solved"] < _NEARLY_ALL  # the limit hides how large such an effect is
    helped = own[(own["p"] < ALPHA) & (own["saved"] > 0) & ~cut]
    most = helped.groupby("learner")["saved"].max().sort_values(ascending=False).index
    known = rows[rows["learner"].isin(rows.loc[rows["reference"], "learner"].head(1))]
    known = known[known["test"].isin(own["test"])]
    return {
        "known": [f"{name} {_values(part)}" for name, part in known.groupby("learner")],
        "helped": [
            f"{name} ({_values(helped[helped['learner'] == name])})" for name in most[:_NAMED]
        ],
        "more": len(most[_NAMED:]),
        "alpha": ALPHA,
        "cut": bool((cut & (own["solved"] > 0)).any()),
    }


def _values(rows: pd.DataFrame) -> str:
    return joined([f"{row.saved:.2f} in {row.test}" for row in rows.itertuples()])


def _wide(rows: pd.DataFrame, gaps: Mapping[str, str]) -> pd.DataFrame:
    """A row for each learner as it is shown: in each test the effect, its p, and what is beyond."""
    shown: dict[str, dict[str, str]] = {}
    for row in rows.to_dict("records"):
        line = shown.setdefault(row["learner"], {"learner": row["learner"], "n": row["subjects"]})
        test = row["test"]
        line[f"{test}: attempts saved"] = (
            _with_interval(row, "saved", ("low", "high")) if row["solved"] else "solved no trial"
        )
        line[f"{test}: p"] = p_value(row["p"])
        for column, name in gaps.items():
            ends = (f"{column}_low", f"{column}_high")
            line[f"{test}: more than {name}"] = _with_interval(row, column, ends)
    heads: Sequence[str] = list(dict.fromkeys(head for line in shown.values() for head in line))
    tests = [head for test in COMPARED for head in heads if head.startswith(f"{test}:")]
    return pd.DataFrame(shown.values(), columns=["learner", "n", *tests]).fillna("–")


def _with_interval(row: Mapping[str, Any], value: str, ends: tuple[str, str]) -> str:
    """An effect with its interval, marked where the limit of attempts has cut trials off."""
    if np.isnan(row[value]):
        return "–"
    text = printed(float(row[value]), "+.2f") + ("*" if row["solved"] < 1 else "")
    low, high = (float(row[end]) for end in ends)
    return text if np.isnan(low) else f"{text} [{printed(low, '.2f')}, {printed(high, '.2f')}]"


TOPIC = Topic("congruency", 10, section)

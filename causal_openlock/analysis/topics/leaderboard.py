"""How every learner stands: one row for each, over all conditions of a protocol.

It answers before anything else is explained: how many attempts each learner needs, which share of
trials it solves, where that lies between acting at random and the ideal observer, and how far it is
from the best learner and from people. A trial that is not solved is *censored* at the limit: it
would have taken more attempts than that, and nobody knows how many. So means that such trials are
in are lower bounds, and are marked as that.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import ALPHA, Difference, Group, holm, weighted_difference
from causal_openlock.analysis.measures import judged, ordered
from causal_openlock.analysis.results.chance import attempts_at_random
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import Reference, gap_column
from causal_openlock.analysis.statistics import APPROXIMATE, FEW_SUBJECTS
from causal_openlock.analysis.table import Table, number, p_value, printed, records, share
from causal_openlock.analysis.topics.pairwise import Outcomes, all_outcomes, compared
from causal_openlock.experiment.protocol import HUMAN_PROTOCOL
from causal_openlock.wording import counted, joined, some
from causal_openlock.world.room import positions_for

MOST_ATTEMPTS = 3000  #: no scores of longer trials: random actions take the square of it


def leaderboard(results: Material) -> pd.DataFrame:
    """One row for each learner and protocol; references come first where any is comparable.

    >>> table = leaderboard(results)
    >>> table[["learner", "solved", "median"]].values.tolist()[-1]
    ['oracle', 1.0, 3.0]

    The trials are those that a condition is judged by: its test, or the last trial of a baseline.
    Shares and means are those of conditions, averaged.

    Returns:
        ``learner``; whether it is a ``reference``, such as people, of which the row has what is
        known; whether it is ``informed``: given the schema or the room, and so no competitor
        either; ``protocol``, ``conditions`` (how many; 0 where the learner has played none, and
        numbers are then NaN), ``over`` (their names), ``subjects`` (the fewest in one);
        ``limit``, the most attempts that a trial may have; ``before``, the attempts of training
        before the experiment, such as meta-training; ``solved``, the share of trials;
        ``found`` of ``solutions``, means of trials; ``median`` attempts where trials were
        solved, NaN if none was; mean ``attempts``, where an unsolved trial counts as the limit;
        ``score``, 0 for the attempts of random actions and 1 for those of the ideal observer, NaN
        where these are not known, and ``unscored``, the conditions that it leaves out for that;
        the ``best`` learner, which is one that has to find out how the
        room works; ``to_best`` and, of each reference, ``to_people`` and the like, how many
        attempts more than these the learner needs, each with the ends of its 95% interval,
        ``_low`` and ``_high``; NaN if nobody differs
        (:func:`~causal_openlock.analysis.effects.weighted_difference`); and ``to_people_p``, the p
        of the difference from a reference as if it were the only test. All numbers of a row are
        over its own conditions: a difference is NaN where the other one lacks one of them.
    """
    protocols = ordered(results.trials["protocol"].unique(), (HUMAN_PROTOCOL,))
    columns = [
        *("learner", "reference", "informed", "protocol", "conditions", "over", "subjects"),
        *("limit", "before", "solved", "found", "solutions", "median", "attempts"),
        *("score", "unscored", "best"),
        *(f"to_best{end}" for end in ("", "_low", "_high")),
        *(
            gap_column(name) + end
            for name in (*(one.name for one in results.leading), *results.people)
            for end in ("", "_low", "_high", "_p")
        ),
    ]
    rows = [row for protocol in protocols for row in _rows(results, protocol)]
    return pd.DataFrame(rows, columns=columns)


def _rows(results: Material, protocol: str) -> list[dict[str, Any]]:
    """The rows of a protocol: references, learners, and learners that have not played."""
    held = results.once(all_outcomes)[protocol]
    trials = judged(results.trials[results.trials["protocol"] == protocol])
    medians = trials[trials["solved"]].groupby("learner", observed=True)["attempts"].median()
    limits = {one.name: one.attempt_limit for one in results.experiment.protocols}
    limit = limits.get(protocol, int(trials["last_attempt"].max()))
    ends = _ends(results, protocol, limit)
    informed = {one.name for one in results.experiment.learners if one.origin.informed}
    competing = {name: own for name, own in held.items() if name not in results.people}
    best = best_learner(competing, informed)
    of_best = {} if best is None else held[best]
    headline = results.headline[results.headline["protocol"] == protocol]
    before = results.trained_before
    common = {"protocol": protocol, "limit": limit, "best": best}

    def about(name: str) -> dict[str, Any]:
        known = {"informed": name in informed, "before": before.get(name, 0)}
        return {**common, "learner": name, "reference": name in results.people, **known}

    rows: list[dict[str, Any]] = []
    for one in results.leading:
        if known := _published(one, headline):
            row = {**common, "learner": one.name, "reference": True, "informed": False}
            row["solved"] = np.mean([one.solved(name) for name in known])
            gap = _against(known, _groups(of_best))
            rows.append({**row, **_means(known, ends), **gap.columns("to_best")})
    people = {name: _groups(held.get(name, {})) for name in results.people}
    for name, own in held.items():
        groups = _groups(own)
        shares = [table[["solved", "found", "solutions"]].mean() for table in own.values()]
        row = {**about(name), **pd.DataFrame(shares).mean(), **_means(groups, ends)}
        row["median"] = medians.get(name, np.nan)
        paired = name != best and own.keys() <= of_best.keys()
        row |= compared(own, of_best if paired else {})[0].columns("to_best")
        others = {one.name: _published(one, headline, name) for one in results.leading}
        for other, known in (others | ({} if name in people else people)).items():
            row |= _against(groups, known).columns(gap_column(other))
        rows.append(row)
    return rows + [
        {**about(spec.name), "conditions": 0, "subjects": 0}
        for spec in results.experiment.learners
        if spec.protocol.name == protocol and spec.name not in held
    ]


def _means(known: Mapping[str, Group], ends: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    """Means over conditions; scores are 0 at the first end and 1 at the second."""
    scores = [
        (ends[name][0] - group.mean) / (ends[name][0] - ends[name][1])
        for name, group in known.items()
        if name in ends
    ]
    return {
        "conditions": len(known),
        "over": (*sorted(known),),
        "subjects": min(group.size for group in known.values()),
        "attempts": float(np.mean([group.mean for group in known.values()])),
        "score": float(np.mean(scores)) if scores else np.nan,
        "unscored": (*sorted(known.keys() - ends),),
    }


def best_learner(held: Outcomes, informed: set[str]) -> str | None:
    """The learner that needs the fewest attempts, of those that have to find out how rooms work.

    Learners that are ``informed`` of the schema or the room do not compete, unless there are no
    others; none is the best where none solves a trial. The others are ranked over the same
    conditions: those of the learner that played the most.
    """
    able = [name for name, own in held.items() if any(one["solved"].any() for one in own.values())]
    able = [name for name in able if name not in informed] or able
    most = max((held[name] for name in able), key=len, default={})
    means = {
        name: float(np.mean([one["attempts"].mean() for one in held[name].values()]))
        for name in able
        if held[name].keys() == most.keys()
    }
    return min(means, key=means.__getitem__, default=None)


def _ends(results: Material, protocol: str, limit: int) -> dict[str, tuple[float, float]]:
    """Attempts of random actions and of the ideal observer where each condition is judged."""
    protocols = {one.name: one for one in results.experiment.protocols}
    ends = {}
    for condition in results.experiment.conditions if limit <= MOST_ATTEMPTS else ():
        phase = "test" if condition.test else "train"
        if ideal := results.bounds.get((condition.name, protocol, phase)):
            schema = (condition.test or condition.train)[0].schema
            actions = protocols[protocol].actions_for(schema)
            positions = max(map(positions_for, condition.schemas))
            random = attempts_at_random(schema, actions, positions, limit)
            if random > ideal:
                ends[condition.name] = (random, ideal)
    return ends


def _published(
    one: Reference, headline: pd.DataFrame, learner: str | None = None
) -> dict[str, Group]:
    """A reference by condition, where it is comparable with this learner, or with any."""
    means, errors = (f"{one.prefix}_{of}" for of in ("attempts", "se"))
    rows = headline[headline[means].notna()]
    rows = rows if learner is None else rows[rows["learner"] == learner]
    sizes = one.points.groupby("condition")["subjects"].min()
    known = zip(rows["condition"].astype(str), rows[means], rows[errors], strict=True)
    return {name: Group.published(mean, se, int(sizes[name])) for name, mean, se in known}


def _groups(own: Mapping[str, pd.DataFrame]) -> dict[str, Group]:
    return {name: Group.of(one["attempts"].to_numpy(float)) for name, one in own.items()}


def _against(one: Mapping[str, Group], other: Mapping[str, Group]) -> Difference:
    """How many attempts more the one needs than the other, if that one has all its conditions."""
    groups = []
    if one.keys() <= other.keys():
        groups = [group._replace(weight=1 / len(one)) for group in one.values()]
        groups += [other[name]._replace(weight=-1 / len(one)) for name in one]
    return weighted_difference(groups)


# -- as it is shown -------------------------------------------------------------------------------


def leaderboard_tables(
    ranked: pd.DataFrame, about: Mapping[str, str] | None = None
) -> dict[str, Table]:
    """Return the table of each protocol, as page, terminal and notebook show it.

    ``about`` says of learners what they are, in a line.
    """
    tables = {}
    for protocol, rows in ranked.groupby("protocol", sort=False):
        # References come first, people before all others; the rest stay in their order.
        asked = sorted(records(rows), key=lambda row: (not row["reference"], not row["informed"]))
        references = [row["learner"] for row in asked if row["reference"]]
        played = rows[rows["conditions"] > 0]
        uneven = played["over"].nunique() > 1
        columns = {
            # Counts that are equal do not show that the conditions are others: names do.
            "conditions" if played["conditions"].nunique() > 1 else "over": "Conditions",
            "before": "Training before",
            "attempts": "Attempts",
            **{gap_column(name): f"More than {name}" for name in references},
            "to_best": f"More than {rows['best'].iloc[0]}",
            "score": "Score",
            "solved": "Solved",
            "found": "Found",
            "subjects": "n",
        }
        empty = {column for column in columns if rows[column].isna().all()}
        empty |= set() if uneven else {"over"}
        trained = any(row["before"] != 0 for row in asked if not row["reference"])
        empty |= set() if trained else {"before"}
        columns = {column: head for column, head in columns.items() if column not in empty}
        texts = [
            [
                "\n".join(filter(None, [row["learner"], (about or {}).get(row["learner"])])),
                *(_cell(column, row, uneven) for column in columns),
            ]
            for row in asked
        ]
        heads = ["Learner", *columns.values()]
        beside = [at for at, row in enumerate(asked) if row["reference"] or row["informed"]]
        tables[str(protocol)] = Table(
            "leaderboard",
            f"Results, protocol {protocol}",
            pd.DataFrame(texts, columns=heads),
            dict.fromkeys(heads[1:], "s"),
            _caption(asked, columns),
            dict.fromkeys(beside, "published"),
            verbatim=True,
        )
    return tables


def _cell(column: str, row: Mapping[str, Any], uneven: bool) -> str:
    """A value as it is shown; the interval of a difference is a line of its own."""
    value = row[column]
    if column == "to_best" and row["learner"] == row["best"]:
        return "best"
    if column == "before" and value is None and not row["reference"]:
        return "unknown"
    if value is None or not row["conditions"]:
        return "–"
    if column == "attempts":
        if row["solved"] == 0:
            return f"> {row['limit']}"
        return number(value) if row["solved"] == 1 else f"≥ {number(value)}"
    if column == "solved":
        return share(value)
    if column == "found":
        return f"{value:.3g} of {row['solutions']:.3g}"
    if column == "over":
        return some(value)
    if column == "score":
        return printed(float(value), ".2f")
    if column in ("conditions", "before", "subjects"):
        return f"{value:,.0f}"
    text = printed(float(value), "+.2f")
    if uneven:  # the other's mean is over the conditions of this row, and not that of its own row
        text += f" from {number(row['attempts'] - value)}"
    low, high = row[f"{column}_low"], row[f"{column}_high"]
    if low is None:
        return text
    about = "≈ " if row["subjects"] * row["conditions"] < APPROXIMATE else ""
    return f"{text}\n{about}[{printed(low, '.2f')}, {printed(high, '.2f')}]"


def _caption(rows: Sequence[Mapping[str, Any]], columns: Collection[str]) -> str:
    """What the columns and marks of a table mean, and which rows are of few subjects."""
    played = [row for row in rows if row["conditions"]]
    most = max(row["conditions"] for row in played)
    uneven = not {"conditions", "over"}.isdisjoint(columns)
    over = "the conditions of each row" if uneven else counted(most, "condition")
    said = [f"Means over {over}; a room has at most {counted(rows[0]['limit'], 'attempt')}."]
    if any(row["informed"] for row in rows):
        said.append("Learners above the line are given the schema or the room.")
    if any(column.startswith("to_") for column in columns):
        said.append(
            "Brackets: 95% intervals, ≈ of fewer than ten subjects, those of all conditions "
            "together; none of fewer than five, and where (nearly) all differ by the same."
        )
    if "score" in columns:
        left_out = joined(sorted({name for row in played for name in row["unscored"]}))
        but = f", over the conditions where both are known: not {left_out}" if left_out else ""
        said.append(f"Score: 0 as at random, 1 as the ideal observer{but}.")
    said.append("Solved: share of trials. Found: solutions in a trial, of how many, on average.")
    if "before" in columns:
        said.append("Training before: attempts of meta-training, which no other column counts.")
    if any((row["before"] or 0) > 0 for row in played):
        said.append("Subjects share the network that was trained: intervals are over rooms.")
    if any(row["solved"] != 1 for row in played):
        said.append(
            "≥: trials that were not solved count as the limit, in differences too, which may be "
            "off either way."
        )
    if any(row["reference"] and row["solved"] is None for row in played):
        said.append("How many of people's trials were not solved is not published.")
    if few := {row["learner"]: n for row in played if (n := row["subjects"]) < FEW_SUBJECTS}:
        said.append(
            f"Fewer than {FEW_SUBJECTS} subjects, so intervals are unreliable: {some(few)}."
        )
    return " ".join(said)


def answers(ranked: pd.DataFrame, pairs: pd.DataFrame) -> dict[str, tuple[str, ...]]:
    """Results in a few sentences, by protocol, from :func:`leaderboard` and :func:`~.pairs`.

    Which learner needs the fewest attempts, how that compares with people, and which learners
    cannot be distinguished from it; all of it over the conditions of the best learner.
    """
    return {
        str(protocol): tuple(filter(None, _answer(rows, pairs[pairs["protocol"] == protocol])))
        for protocol, rows in ranked.groupby("protocol", sort=False)
    }


def _answer(rows: pd.DataFrame, pairs: pd.DataFrame) -> Iterator[str]:
    own = [row for row in records(rows) if not row["reference"]]
    best = next((row for row in own if row["learner"] == row["best"]), None)
    if best is None:
        yield "No learner solved a trial that counts."
        return
    name = best["learner"]
    others = [row for row in own if row["informed"] == best["informed"] and row is not best]
    conditions = best["conditions"]
    rivals = [
        row for row in others if row["conditions"] == conditions and row["to_best"] is not None
    ]
    apart = [row["learner"] for row in others if row not in rivals]
    given = "the schema or the room" if best["informed"] else "neither the schema nor the room"
    among = f"Of the learners that are given {given}, " if len(own) > len(others) + 1 else ""
    over = ""
    if apart:
        over = f" over {counted(conditions, 'condition')} ({joined(apart)} did not play the same)"
    after = _after(best)
    if not after and any(row["before"] != 0 for row in own):
        after = ", without training before the experiment"
    if rivals:
        yield f"{among}{name} needs the fewest attempts, {_mean(best)} on average{over}{after}."
    else:
        yield f"{name} needs {_mean(best)} attempts on average{over}{after}."
    yield from (_difference(best, row, own) for row in records(rows) if row["reference"])
    p = {
        row.other if row.learner == name else row.learner: row.p_corrected
        for row in pairs.itertuples()
        if name in (row.learner, row.other)
    }
    alike = [row for row in rivals if p[row["learner"]] >= ALPHA]
    rule = f"p {{}} {printed(ALPHA, '.2g').removeprefix('0')}, corrected for all pairs"
    if alike:
        names = some(f"{row['learner']} ({_mean(row)}{_after(row)})" for row in alike)
        yield f"Not distinguishable from {name} ({rule.format('≥')}): {names}."
    elif rivals and all(p[row["learner"]] < ALPHA for row in rivals):
        yield f"Every other one that is ranked needs significantly more ({rule.format('<')})."


def _difference(
    best: Mapping[str, Any], reference: Mapping[str, Any], learners: Sequence[Mapping[str, Any]]
) -> str:
    """How far the best of the learners is from a reference, and whether that is significant."""
    name, column = reference["learner"], gap_column(reference["learner"])
    gap = best[column]
    if gap is None:
        none = set(reference["over"]).isdisjoint(best["over"])
        known = "none of these conditions is" if none else "not all of these conditions are"
        return f"Not compared with {name}, of whom {known} known."
    ps = np.array([row[f"{column}_p"] for row in learners], float)
    p = float(holm(ps)[learners.index(best)])
    mean = ("" if reference["solved"] == 1 else "≥ ") + number(best["attempts"] - gap)
    found = f"It needs {abs(gap):.2f} {'fewer' if gap < 0 else 'more'} than {name} ({mean})"
    if np.isnan(p):
        return f"{found}, which cannot be tested with these subjects."
    verdict = "a significant difference" if p < ALPHA else "not a significant difference"
    low, high = (printed(best[f"{column}_{end}"], "+.2f") for end in ("low", "high"))
    interval = f"95% interval of the difference {low} to {high}; " if low != "–" else ""
    equals = "" if p < 0.001 else "= "
    tested = counted(int(np.isfinite(ps).sum()), "learner")
    return f"{found}, {verdict} ({interval}p {equals}{p_value(p)}, corrected for {tested})."


def _mean(row: Mapping[str, Any]) -> str:
    return f"{'at least ' if row['solved'] < 1 else ''}{row['attempts']:.2f}"


def _after(row: Mapping[str, Any]) -> str:
    """What training a learner had before the experiment; empty if it had none."""
    if row["before"] == 0:
        return ""
    if row["before"] is None:
        return ", after training of unknown length"
    trained = f"{row['before']:,.0f} attempts of training"
    return f", after {trained} (one network: intervals are over rooms)"

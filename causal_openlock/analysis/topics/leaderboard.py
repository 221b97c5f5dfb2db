"""How every learner stands: one row for each, over all conditions of a protocol.

It answers before anything else is explained: which share of trials is solved, how many attempts
that takes where it succeeds, where that lies between acting at random and the ideal observer, and
how far it is from the best learner and from people. A trial that is not solved is *censored* at
the limit: it would have taken more attempts than that, and nobody knows how many. So means that
such trials are in are lower bounds, and are marked as that.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import ALPHA, Difference, Group, holm, weighted_difference
from causal_openlock.analysis.measures import judged, ordered
from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.results.by_condition import records
from causal_openlock.analysis.results.chance import attempts_at_random
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import Beside, gap_column
from causal_openlock.analysis.statistics import FEW_SUBJECTS, LEAST_UNITS, too_few
from causal_openlock.analysis.table import Table, number, printed, share
from causal_openlock.analysis.topics.pairwise import Outcomes, all_outcomes, compared
from causal_openlock.experiment.declare import HUMAN_PROTOCOL, default_action_limit
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.wording import counted
from causal_openlock.world.room import positions_for

MOST_ATTEMPTS = 3000
"""No scores where trials may have more: what random actions need is computed in its square."""
_NONE = Difference(np.nan, np.nan, np.nan, np.nan)
Cell = tuple[str, str]
"""A value, and its interval or other text next to it in small type."""
_PROSE = Prose(__name__)
_EVERY = "in nearly every subject"
_LEADERS = 4  # fewer learners than these share the first sentence where they do not differ
_EVERY_OF_A_CONDITION = "nearly the same in every subject of a condition"


def normalised_score(
    attempts: FloatArray, random: FloatArray | float, ideal: FloatArray | float
) -> FloatArray:
    """Score of attempts between chance and the best that is possible.

    >>> normalised_score(np.array([30.0, 10.0, 5.0]), 30, 5).tolist()
    [0.0, 0.8, 1.0]

    Args:
        attempts: ``[...]`` attempts to solve.
        random: ``[...]`` or a number: attempts of a learner that acts at random.
        ideal: Attempts of the ideal observer.

    Returns:
        ``[...]`` 0 for as many attempts as at random and 1 for the ideal; below 0 or above 1 for
        more or fewer than these. NaN where random needs no more than ideal.
    """
    span = np.asarray(random, float) - np.asarray(ideal, float)
    width = np.where(span > 0, span, np.nan)
    score: FloatArray = (np.asarray(random, float) - np.asarray(attempts, float)) / width
    return score


def leaderboard(results: Material) -> pd.DataFrame:
    """One row for each learner and protocol; references come first where any is comparable.

    >>> table = leaderboard(results)
    >>> table[["learner", "solved", "median"]].values.tolist()[-1]
    ['oracle', 1.0, 3.0]

    Args:
        results: What was played. The trials are those that a condition is judged by: its test, or
            the last trial of a baseline. Shares and means are those of conditions, averaged.

    Returns:
        ``learner``; whether it is a ``reference``, such as people, of which the row has what is
        known; whether it is ``informed``: given the schema or the room, and so no competitor
        either; ``protocol``, ``conditions`` (how many; 0 where the learner has played none, and
        numbers are then NaN), ``subjects`` (the fewest in one);
        ``limit``, the most attempts that a trial may have; ``before``, the attempts of training
        before the experiment, such as meta-training; ``solved``, the share of trials;
        ``found`` of ``solutions``, means of trials; ``median`` attempts where trials were
        solved, NaN if none was; mean ``attempts``, where an unsolved trial counts as the limit;
        ``score``, 0 for the attempts of random actions and 1 for those of the ideal observer, NaN
        where these are not known; the ``best`` learner, which is one that has to find out how the
        room works; ``to_best`` and, of each reference, ``to_people`` and the like, how many
        attempts more than these the learner needs, each with the ends of its 95% interval,
        ``_low`` and ``_high``; NaN if nobody differs
        (:func:`~causal_openlock.analysis.effects.weighted_difference`); and ``to_people_p``, the p
        of the difference from a reference as if it were the only test. All numbers of a row are
        over its own conditions: a difference is NaN where the other one lacks one of them.
    """
    tables = [
        _rows(results, protocol)
        for protocol in ordered(results.trials["protocol"].unique(), (HUMAN_PROTOCOL,))
    ]
    columns = [
        *("learner", "reference", "informed", "protocol", "conditions", "subjects", "limit"),
        "before",
        *("solved", "found", "solutions", "median", "attempts", "score", "best"),
        *(f"to_best{end}" for end in ("", "_low", "_high")),
        *(
            gap_column(one.reference.name) + end
            for one in results.leading
            for end in ("", "_low", "_high", "_p")
        ),
    ]
    return pd.DataFrame([row for rows in tables for row in rows], columns=columns)


def _gap(name: str, gap: Difference) -> dict[str, float]:
    return {name: gap.value, f"{name}_low": gap.low, f"{name}_high": gap.high, f"{name}_p": gap.p}


def _rows(results: Material, protocol: str) -> list[dict[str, Any]]:
    held = results.once(all_outcomes)[protocol]
    trials = judged(results.trials[results.trials["protocol"] == protocol])
    medians = trials[trials["solved"]].groupby("learner", observed=True)["attempts"].median()
    limits = {one.name: one.attempt_limit for one in results.experiment.protocols}
    limit = limits.get(protocol, int(trials["last_attempt"].max()))
    ends = _ends(results, protocol, limit)
    best = best_learner(results, held)
    of_best = {} if best is None else held[best]
    headline = results.headline[results.headline["protocol"] == protocol]
    informed = _informed(results)
    before = results.trained_before
    played = {condition for own in held.values() for condition in own}
    common = {"protocol": protocol, "limit": limit, "best": best}
    rows: list[dict[str, Any]] = []
    for one in results.leading:
        known = _groups(one, headline)
        if not known:
            continue
        attempts = {name: group.mean for name, group in known.items()}
        # Beside learners', a mean or a score would be of other rooms if it has not played them all.
        whole = set(attempts) == played
        rows.append(
            {
                **common,
                "learner": one.reference.name,
                "reference": True,
                "informed": False,
                "conditions": len(known),
                "subjects": min(group.size for group in known.values()),
                "solved": np.mean([one.solved(name) for name in known])
                if "share_solved" in one.reference.points
                else np.nan,
                "attempts": np.mean([*attempts.values()]) if whole else np.nan,
                "score": _score(attempts, ends) if whole else np.nan,
                **_gap("to_best", _against(known, _as_groups(of_best))),
            }
        )
    for name, own in held.items():
        means = pd.DataFrame({condition: one.mean() for condition, one in own.items()}).T
        to_best = _NONE
        if name != best and own.keys() <= of_best.keys():
            to_best = compared(own, of_best)[0]
        row = {
            **common,
            "learner": name,
            "reference": False,
            "informed": name in informed,
            "conditions": len(own),
            "subjects": min(map(len, own.values())),
            "before": before.get(name, 0),
            **means[["solved", "found", "solutions"]].mean(),
            "median": medians.get(name, np.nan),
            "attempts": means["attempts"].mean(),
            "score": _score(means["attempts"].to_dict(), ends),
            **_gap("to_best", to_best),
        }
        for one in results.leading:
            gap = _against(_as_groups(own), _groups(one, headline, name))
            row |= _gap(gap_column(one.reference.name), gap)
        rows.append(row)
    for spec in results.experiment.learners:
        if spec.protocol.name == protocol and spec.name not in held:
            name = spec.name
            own = {"learner": name, "reference": False, "informed": name in informed}
            rows.append(
                {**common, **own, "conditions": 0, "subjects": 0, "before": before.get(name, 0)}
            )
    return rows


def best_learner(results: Material, held: Outcomes) -> str | None:
    """The learner that needs the fewest attempts, of those that have to find out how rooms work.

    Learners that know the schema or the room do not compete, unless there are no others; none
    is the best where none solves a trial. The others are ranked over the same conditions: those of
    the learner that played the most.
    """
    informed = _informed(results)
    able = [name for name, own in held.items() if any(one["solved"].any() for one in own.values())]
    able = [name for name in able if name not in informed] or able
    most = max((held[name] for name in able), key=len, default={})
    ranked = [name for name in able if held[name].keys() == most.keys()]
    means = {
        name: float(np.mean([one["attempts"].mean() for one in held[name].values()]))
        for name in ranked
    }
    return min(means, key=means.__getitem__, default=None)


def _informed(results: Material) -> set[str]:
    """Learners that are given what subjects cannot perceive."""
    return {spec.name for spec in results.experiment.learners if spec.origin.informed}


def _ends(results: Material, protocol: str, limit: int) -> dict[str, tuple[float, float]]:
    """Attempts of random actions and of the ideal observer where each condition is judged."""
    budgets = {one.name: one.action_limit for one in results.experiment.protocols}
    found = {}
    for condition in results.experiment.conditions:
        phase = "test" if condition.test else "train"
        bound = results.bounds.get((condition.name, protocol, phase))
        schemas = {one.name: one for one in condition.schemas}
        if bound is None or bound.schema not in schemas or limit > MOST_ATTEMPTS:
            continue
        schema = schemas[bound.schema]
        actions = budgets.get(protocol) or default_action_limit(schema)
        positions = max(map(positions_for, condition.schemas))
        random = attempts_at_random(schema, actions, positions, limit)
        found[condition.name] = (random, bound.attempts)
    return found


def _score(attempts: Mapping[str, float], ends: Mapping[str, tuple[float, float]]) -> float:
    scores = [
        float(normalised_score(np.array(mean), *ends[name]))
        for name, mean in attempts.items()
        if name in ends
    ]
    return float(np.mean(scores)) if scores else np.nan


def _groups(one: Beside, headline: pd.DataFrame, of: str | None = None) -> dict[str, Group]:
    """A reference by condition, where it is comparable with this learner, or with any."""
    if one.reference.points.empty:
        return {}
    rows = headline[headline[f"{one.reference.prefix}_attempts"].notna()]
    rows = rows if of is None else rows[rows["learner"] == of]
    sizes = one.reference.points.groupby("condition")["subjects"].min()
    found = {}
    for row in rows.to_dict("records"):
        n = int(sizes[row["condition"]])
        mean, se = (float(row[f"{one.reference.prefix}_{of}"]) for of in ("attempts", "se"))
        found[str(row["condition"])] = Group.published(mean, se, n)
    return found


def _as_groups(own: Mapping[str, pd.DataFrame]) -> dict[str, Group]:
    return {name: Group.of(one["attempts"].to_numpy(float)) for name, one in own.items()}


def _against(one: Mapping[str, Group], other: Mapping[str, Group]) -> Difference:
    """How many attempts more the one needs than the other, if that one has all its conditions."""
    if not one.keys() <= other.keys():
        return _NONE
    groups = [group._replace(weight=1 / len(one)) for group in one.values()]
    groups += [other[name]._replace(weight=-1 / len(one)) for name in one]
    return weighted_difference(groups)


@dataclass(frozen=True)
class LeaderboardTable:
    """The standing of every learner under a protocol.

    Attributes:
        protocol: Its name.
        limit: The most attempts of a trial.
        conditions: How many were played.
        best: The best learner that is given neither the schema nor the room; None where there is
            none.
        references: Names of the rows that do not compete: references such as people, and
            learners that are given the schema or the room. They stand first.
        given: Names of these learners.
        marks: Which marks its values have: ``≥``, ``≤``, ``*`` and ``all``.
        few: Warns of few subjects; empty where there are enough.
        uneven: Whether rows are of different numbers of conditions.
        columns: What the columns are, those on the left mattering most.
        heads: Over the columns, in words; the first is over the names.
        short_heads: The same for a narrow table.
        rows: By learner, what is in the other columns; references stand first.
        short_rows: The same for a narrow table, a text each.
        above: Whether a score is shown as above 1, that of the ideal observer.
    """

    protocol: str
    limit: int
    conditions: int
    best: str | None
    references: tuple[str, ...]
    given: frozenset[str]
    few: str
    uneven: bool
    columns: tuple[str, ...]
    heads: tuple[str, ...]
    short_heads: tuple[str, ...]
    rows: Mapping[str, tuple[Cell, ...]]
    short_rows: Mapping[str, tuple[str, ...]]
    marks: frozenset[str]
    above: bool

    def table(self, about: Mapping[str, str]) -> Table:
        """Return the wide table, as a page shows it.

        Args:
            about: By learner, what it is, in a line.
        """
        rows = []
        for learner, cells in self.rows.items():
            what = "\n" + about[learner] if about.get(learner) else ""
            rows.append([f"{learner}{what}", *("\n".join(filter(None, one)) for one in cells)])
        looks = {row: "published" for row, name in enumerate(self.rows) if name in self.references}
        frame = pd.DataFrame(rows, columns=[*self.heads])
        right = dict.fromkeys(self.heads[1:], "s")
        return Table("leaderboard", "Results", frame, right, looks=looks, verbatim=True)

    @property
    def measured(self) -> str:
        """Measure of the table, in words."""
        of = f", {self.conditions} conditions together" if self.conditions > 1 else ""
        if self.uneven:
            of += " at most; each row is the mean of the conditions that it has"
        return f"at most {counted(self.limit, 'attempt')} in a room{of}"


def leaderboard_tables(table: pd.DataFrame) -> Iterator[LeaderboardTable]:
    """A table for each protocol.

    Args:
        table: From :func:`leaderboard`.
    """
    for protocol, rows in table.groupby("protocol", sort=False):
        best = next((name for name in rows["best"] if isinstance(name, str)), None)
        played = rows[rows["conditions"] > 0]
        gaps = {
            column: name for column, name in _called(rows).items() if rows[column].notna().any()
        }
        columns = {
            "before": ("Training before, in attempts", "before"),
            "attempts": ("Attempts (mean)", "attempts"),
            **{name: (f"Attempts more than {of}", f"− {of}") for name, of in gaps.items()},
            "to_best": (f"Attempts more than {best}", f"− {best}"),
            "score": ("Score", "score"),
            "solved": ("Trials solved", "solved"),
            "found": ("Solutions found", "found"),
            "n": ("n", "n"),
        }
        if best is None:
            del columns["to_best"]
        if rows["score"].isna().all():
            del columns["score"]
        if (rows.loc[~rows["reference"].astype(bool), "before"] == 0).all():
            del columns["before"]
        narrow = ("attempts", *gaps, "to_best", "score", "solved", "found", "n")
        narrow = tuple(name for name in narrow if name in columns)
        # References come first, people before all others; the rest stay in their order.
        asked = sorted(records(rows), key=lambda row: (not row["reference"], not row["informed"]))
        # Differences from one whose trials the limit has cut off are bounds the other way.
        solved = {row["learner"]: row["solved"] for row in asked}
        others = {"to_best": best, **gaps}
        cut = {column for column, of in others.items() if (solved.get(of) or 1) < 1}
        cut |= {column for column, of in gaps.items() if solved.get(of) == 0}
        wide = {
            str(row["learner"]): tuple(_cell(name, row, cut) for name in columns) for row in asked
        }
        yield LeaderboardTable(
            protocol=str(protocol),
            limit=int(rows["limit"].iloc[0]),
            conditions=int(rows["conditions"].max()),
            best=best,
            references=tuple(
                str(row["learner"]) for row in asked if row["reference"] or row["informed"]
            ),
            given=frozenset(str(row["learner"]) for row in asked if row["informed"]),
            few=_few(played[~played["reference"].astype(bool)]),
            uneven=played["conditions"].nunique() > 1,
            columns=tuple(columns),
            heads=("Learner", *(wide_head for wide_head, _ in columns.values())),
            short_heads=("", *(columns[name][1] for name in narrow)),
            rows=wide,
            short_rows={
                str(row["learner"]): tuple(_short_cell(name, row, cut) for name in narrow)
                for row in asked
            },
            marks=frozenset(
                mark
                for mark, text in (("≥", "≥"), ("≤", "≤"), ("*", "*"), ("all", "every subject"))
                if any(text in part for cells in wide.values() for cell in cells for part in cell)
            ),
            above=bool((rows["score"].astype(float).round(2) > 1).any()),
        )


def _called(table: pd.DataFrame) -> dict[str, str]:
    """Reference of each column of differences."""
    return {
        gap_column(name): name for name in table.loc[table["reference"].astype(bool), "learner"]
    }


def legend(tables: Sequence[LeaderboardTable], narrow: bool = False) -> str:
    """Meaning of the columns and marks that occur in tables.

    Args:
        tables: From :func:`leaderboard_tables`.
        narrow: Whether it is below the narrow tables, whose heads are shorter.
    """
    columns = {name for table in tables for name in table.columns}
    return _PROSE.sentence(
        "legend",
        narrow=narrow,
        columns=columns,
        gaps=any(name.startswith("to_") for name in columns),
        marks=frozenset().union(*(table.marks for table in tables)),
        given=any(table.given for table in tables),
        above=any(table.above for table in tables),
    )


def answers(table: pd.DataFrame, pairs: Mapping[str, pd.DataFrame]) -> dict[str, tuple[str, ...]]:
    """Results in a few sentences, by protocol.

    Which learner needs the fewest attempts and how that compares with people, which ones cannot be
    distinguished from it, and which solved no trial that counts. All of that is over the conditions
    of the best learner; learners and references that lack some of these are named.

    Args:
        table: From :func:`leaderboard`.
        pairs: From :func:`~causal_openlock.analysis.topics.pairwise.all_pairs`.
    """
    found = {}
    for protocol, rows in table.groupby("protocol", sort=False):
        own = {row["learner"]: row for row in records(rows) if not row["reference"]}
        best = own.get(next((name for name in rows["best"] if isinstance(name, str)), ""))
        ranked = {
            name: row
            for name, row in own.items()
            if row is best
            or (best and row["conditions"] == best["conditions"] and row["to_best"] is not None)
        }
        gaps = [
            {
                "name": called,
                **{end: best[f"{name}{end}"] for end in ("_low", "_high")},
                "value": best[name],
                "found": p < ALPHA,
                "tested": not np.isnan(p),
            }
            for name, called in _called(rows).items()
            if best and best[name] is not None
            for p in [_corrected(rows, name)[best["learner"]]]
        ]
        few = too_few(best["subjects"], where=" in a condition") if best else ""
        alike = [
            name
            for name, row in ranked.items()
            if best
            and not few
            and not row["informed"]
            and _alike(pairs[str(protocol)], best["learner"], name)
        ]
        found[str(protocol)] = _PROSE.paragraphs(
            "answer",
            best=best,
            level=[own[name] for name in alike] if len(alike) < _LEADERS else [],
            several=sum(not row["informed"] for row in ranked.values()) > 1,
            few=few,
            gaps=gaps,
            apart=[name for column, name in _called(rows).items() if best and best[column] is None],
            lacking=[
                name
                for name, row in own.items()
                if best and name not in ranked and (best["informed"] or not row["informed"])
            ],
            alike=alike,
            unsolved=[name for name, row in own.items() if row["solved"] == 0],
        )
    return found


def _corrected(rows: pd.DataFrame, column: str) -> dict[str, float]:
    """The p of every learner's difference from a reference, corrected for all these learners."""
    own = rows[~rows["reference"].astype(bool)]
    return dict(zip(own["learner"], holm(own[f"{column}_p"].to_numpy(float)), strict=True))


def _alike(pairs: pd.DataFrame, best: str, other: str) -> bool:
    """Whether a learner was compared with the best and no difference was found."""
    both = pairs[["learner", "other"]].isin([best, other]).all(axis=1)
    return bool((~(pairs.loc[both, "p_corrected"] < ALPHA)).any())


def _few(rows: pd.DataFrame) -> str:
    few = {row["learner"]: row["subjects"] for row in records(rows)}
    few = {name: size for name, size in few.items() if size < FEW_SUBJECTS}
    sizes = set(few.values())
    return _PROSE.sentence(
        "few", few=few, all=len(few) == len(rows), sizes=sorted(sizes), least=FEW_SUBJECTS
    )


def _cell(column: str, row: Mapping[str, Any], cut: Collection[str]) -> Cell:
    value = row["subjects" if column == "n" else column]
    if not row["conditions"]:
        return "–", ""
    if column == "attempts" and None not in (row["solved"], value):
        if row["solved"] == 0:
            return f"> {row['limit']}", ""
        return ("≥ " if row["solved"] < 1 else "") + number(value), ""
    if column == "before" and value is None and not row["reference"]:
        return "unknown", ""
    if value is None:
        return ("best", "") if column == "to_best" and row["learner"] == row["best"] else ("–", "")
    if column == "attempts":
        return number(value), ""
    if column == "solved":
        return share(value), ""
    if column == "found":
        return f"{_plain(value)} of {_plain(row['solutions'])}", ""
    if column == "n":
        return f"{value:g}", ""
    if column == "before":
        return f"{value:,.0f}", ""
    if column == "score":
        return printed(float(value), ".2f"), ""
    low, high = row[f"{column}_low"], row[f"{column}_high"]
    before, after = _marks(column, row, cut)
    small = _without_interval(column, row)
    if low is not None:
        small = f"[{printed(float(low), '.2f')}, {printed(float(high), '.2f')}]"
    return f"{before}{printed(float(value), '+.2f')}{after}", small


def _without_interval(column: str, row: Mapping[str, Any]) -> str:
    """Reason for a missing interval: too few subjects, or nearly all differ by the same."""
    few = row["subjects"] * row["conditions"] < LEAST_UNITS
    if column != "to_best" or few or row["reference"]:
        return "no interval"
    return _EVERY if row["conditions"] == 1 else _EVERY_OF_A_CONDITION


def _short_cell(column: str, row: Mapping[str, Any], cut: Collection[str]) -> str:
    main, small = _cell(column, row, cut)
    if not small:
        return main.replace("not within ", "> ")
    low, value, high = row[f"{column}_low"], row[column], row[f"{column}_high"]
    before, after = _marks(column, row, cut)
    interval = "all" if small in (_EVERY, _EVERY_OF_A_CONDITION) else "–"
    if low is not None:
        interval = f"{_narrow(low)}, {_narrow(high)}"
    return f"{before}{_narrow(value)}{after} [{interval}]"


def _marks(column: str, row: Mapping[str, Any], cut: Collection[str]) -> tuple[str, str]:
    """Marks before and after a difference that the limit of attempts has cut off."""
    if row["solved"] is None or row["solved"] == 1:
        return ("≤ " if column in cut else ""), ""
    return ("", "*") if column in cut else ("≥ ", "")


def _narrow(value: float) -> str:
    return printed(float(value), ".2f" if abs(value) < 10 else ".1f")


def _plain(value: float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".")

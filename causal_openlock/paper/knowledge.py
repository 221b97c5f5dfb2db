"""Attempts that each piece of knowledge saves, from nothing to the schema, next to people's.

The first four steps are of a search that never repeats a sequence of actions and uses nothing else
that it sees. Among N sequences, k of which are solutions, it finds the first after
(N + 1) / (k + 1) attempts and all after k (N + 1) / (k + 1). Knowledge makes N smaller:

===================================  ==============================================
knows                                N sequences, n levers being active
===================================  ==============================================
nothing                              15³: seven pushes, seven pulls and the door
that pulls are useless               8³
that two moves precede the door      7 · 6
which levers are active              n (n - 1)
===================================  ==============================================

The last two are of an ideal observer (:mod:`causal_openlock.belief.worth`), who also uses which
levers move: first with the prior of the learner ``bayes``, after the training if there is any, and
then with the schema. All are exact.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import cache
from typing import Any

import pandas as pd
from matplotlib.patches import Patch

from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import in_rows, panels
from causal_openlock.belief.worth import PAPER_LIMIT, listed_schemas, schema_worth
from causal_openlock.errors import NothingToDrawError, OpenLockError
from causal_openlock.files.validation import known_arguments
from causal_openlock.paper.published import people, people_in_training
from causal_openlock.schemas.finding import find_schema
from causal_openlock.wording import joined, nearest

CONDITIONS = ("CC3", "CE3", "CC4", "CE4", "CC3-CC4", "CE3-CC4", "CE3-CE4", "CC3-CE4")
"""Training in three-lever rooms, and the six conditions of the paper."""
SEARCHES: Mapping[str, Callable[[int], int]] = {
    "nothing": lambda levers: 15**3,
    "pulls are useless": lambda levers: 8**3,
    "two moves precede the door": lambda levers: 7 * 6,
    "active levers": lambda levers: levers * (levers - 1),
}
"""Sequences that a search goes through, by what it knows."""
MOVES, SCHEMA, WITHOUT_LEVERS = "what movements tell", "schema", "schema, not the active levers"
TRAINING_ROOMS = 6
_DRAWN = {"CC4": "all", "CE4": "all", "CC3": "first", "CE3": "first"}
"""Condition of each panel, and the solutions until which attempts count there."""


def knowledge_steps(conditions: Collection[str] = CONDITIONS) -> pd.DataFrame:
    """Return the least expected attempts with more and more knowledge, in each condition.

    A trial of people ends after 30 attempts; these numbers have no such limit. Where several
    policies are optimal by the prior, that with the least attempts in these rooms counts.

    >>> knowledge_steps(["CC3"])["attempts"].round(2).tolist()
    [2250.67, 342.0, 28.67, 4.67, 3.0, 2.67, 4.9]

    Args:
        conditions: Names of some of :data:`CONDITIONS`.

    Returns:
        One row for each ``condition`` and for what its observer ``knows`` more than in the row
        before: ``attempts`` until all solutions and until the ``first``, in its test rooms or, if
        there is no test, its first room; ``saved`` since the row before; and the ``method``. The
        last row of a condition, an ideal observer who knows the schema but not the active levers,
        is not a step, so that it has no ``saved``.
    """
    if isinstance(conditions, str) or not isinstance(conditions, Collection):
        raise OpenLockError(f"conditions are a list of names, not {conditions!r}")
    rows = []
    for condition in dict.fromkeys(conditions):
        if condition not in CONDITIONS:
            others = nearest(str(condition), CONDITIONS)
            raise OpenLockError(f"nothing is known of people in {condition}; {others}")
        *training, name = condition.split("-")
        schema = find_schema(name)
        many = len(schema.solutions)
        for knows, sequences in SEARCHES.items():
            first = (sequences(len(schema.levers)) + 1) / (many + 1)
            rows.append((condition, knows, many * first, first, "search without repeats"))
        prior, known, unplaced = _ideal(name, *training)
        for knows, attempts, method in (
            (MOVES, prior, "ideal observer, prior of bayes"),
            (SCHEMA, known, "ideal observer"),
            (WITHOUT_LEVERS, unplaced, "ideal observer"),
        ):
            rows.append((condition, knows, sum(attempts), attempts[0], method))
    table = pd.DataFrame(rows, columns=["condition", "knows", "attempts", "first", "method"])
    saved = table.groupby("condition", sort=False)["attempts"].diff(-1).shift()
    return (
        table.assign(saved=saved.where(table["knows"] != WITHOUT_LEVERS))
        .round(9)
        .replace(-0.0, 0.0)
    )


@cache
def _ideal(name: str, *training: str) -> tuple[tuple[float, ...], ...]:
    """Attempts for each solution in rooms of a schema.

    By the prior after the training, who knows the schema, and who knows it but not the levers.
    """
    known_rooms = [*map(find_schema, training * TRAINING_ROOMS)]
    prior = dict(listed_schemas(find_schema(name), PAPER_LIMIT, known_rooms))
    by_prior = schema_worth(name, prior)
    unplaced = schema_worth(name, [name], levers_known=False)
    return by_prior.unknown.here, by_prior.known.here, unplaced.known.here


@known_arguments
def plot_knowledge_steps(steps: pd.DataFrame | None = None, *, ax: Any = None) -> Any:
    """Draw what each piece of knowledge saves, next to people's first and last rooms.

    Args:
        steps: As :func:`knowledge_steps` returns them, by default computed now.
        ax: Four axes, an empty figure, or None for a new one.

    Returns:
        The axes: attempts until all solutions in rooms of CC4 and CE4, and until the first in
        rooms of CC3 and CE3. A bar is as long as the attempts that its knowledge saves.
    """
    steps = knowledge_steps([*_DRAWN]) if steps is None else steps
    if not isinstance(steps, pd.DataFrame):
        raise OpenLockError(
            f"plot_knowledge_steps draws what knowledge_steps returns, not {type(steps).__name__}"
        )
    held = {*steps["condition"]} if "condition" in steps else {}
    if lacking := [one for one in _DRAWN if one not in held]:
        raise NothingToDrawError(
            f"steps are what knowledge_steps returns of {joined([*_DRAWN])}; {joined(lacking)} "
            f"{'is' if len(lacking) == 1 else 'are'} missing"
        )
    steps = steps[steps["knows"] != WITHOUT_LEVERS]
    published = pd.concat([people().assign(solution="all"), people_in_training()])
    rooms = published.groupby(["condition", "solution"])["mean"]  # in the order of trials
    with panels(ax, 4, in_rows(4, 2, 2.4)) as at:
        for axes, (condition, solution) in zip(at.axes, _DRAWN.items(), strict=True):
            own = steps[steps["condition"] == condition].reset_index(drop=True)
            colour = style.current().trained(condition)
            ends = own["first" if solution == "first" else "attempts"].to_numpy(float)
            axes.scatter(ends, own.index, color=colour, s=18, zorder=3)
            axes.barh(own.index[1:], ends[:-1] - ends[1:], left=ends[1:], color=colour, alpha=0.45)
            for place, value in enumerate(ends):
                axes.annotate(
                    f"{value:,.2f}", (value, place), xytext=(-5, 0), textcoords="offset points",
                    ha="right", va="center", fontsize="small",
                )  # fmt: skip
            means = rooms.get_group((condition, solution))
            first, last = means.iloc[0], means.iloc[-1]
            axes.axvspan(last, first, color="#777777", alpha=0.2, lw=0)
            axes.set_xscale("log")
            axes.set_xlim(0.3, 5000)
            axes.set_yticks(own.index, own["knows"], fontsize="small")
            axes.set_ylim(len(own) - 0.5, -0.5)
            axes.set_xlabel("Attempts")
            what = "first solution" if solution == "first" else "all solutions"
            style.panel_title(axes, condition, f"until {what}; people {first:.1f} to {last:.1f}")
        at.legend([
            Patch(color="#777777", alpha=0.2, label="people, first to last room"),
            Patch(color="#777777", alpha=0.6, label="saved by knowing this as well"),
        ])  # fmt: skip
    return at.returned

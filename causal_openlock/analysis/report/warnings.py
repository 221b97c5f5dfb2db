"""Warnings to read before believing the numbers of a report, and sentences about its people.

A person's time is that from the first action in a room of the experiment to the last one, with
what they took over the first. Instructions and the practice room are left out. Breaks are not, so
medians are given.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from causal_openlock.analysis.measures import CELL, SUBJECT
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.table import share
from causal_openlock.experiment.beside_record import REACTIONS, read_reactions
from causal_openlock.experiment.declare import PERSON
from causal_openlock.experiment.protocol import HUMAN_PROTOCOL
from causal_openlock.wording import counted, joined, some

IN_WORDS = {"baseline": "a baseline", "transfer": "transfer"}  #: kinds of conditions


def warnings_of(results: Material) -> Iterator[str]:
    """Warnings to read before believing the numbers, a sentence each."""
    summary, trials = results.summary, results.all_trials
    yield from results.experiment.warned
    yield from exclusions(results)
    if others := _called_alike(results):
        yield (
            "Some conditions are called like the paper's and have other rooms, trials or budgets, "
            f"so published results are not shown next to them ({some(others)})."
        )
    measured = results.headline.groupby(["protocol", "condition"])["measured"].unique()
    if apart := {name: joined(by) for (_, name), by in measured.items() if len(by) > 1}:
        yield (
            "Not all learners or people played a condition to its end, so they are judged by "
            f"different trials, which cannot be compared ({some(apart)})."
        )
    subjects = summary.groupby(CELL, observed=True)["subjects"].agg(["min", "max"])
    if uneven := [*map(_label, subjects.index[subjects["min"] != subjects["max"]])]:
        yield (
            "Not every subject played every trial, so means of different trials are about "
            f"different subjects ({some(uneven)})."
        )
    solved = trials.groupby(["learner", "protocol"], observed=True)["solved"].mean()
    lowest = solved[solved < 1].sort_values(kind="stable")
    if shares := {_label(key): share(1 - part) for key, part in lowest.items()}:
        yield (
            "Some trials were not solved, so means there are lower than what solving them would "
            "have taken (share of all trials that were not solved, training included: "
            f"{some(shares)})."
        )
    for package, versions in results.experiment.versions.items():
        if not isinstance(versions, str):
            several = ", ".join(sorted(versions))
            yield f"Cells were run with different versions of {package} ({several})."


def not_applicable(reasons: Iterable[str]) -> tuple[str, ...]:
    """Say why learners have no results, where they cannot play: a dash in tables.

    >>> not_applicable(["ideal cannot play in rooms of wide: they are too many"])
    ('Not applicable (–): ideal cannot play in rooms of wide: they are too many.',)
    """
    return tuple(f"Not applicable (–): {why}." for why in reasons)


def _called_alike(results: Material) -> list[str]:
    """Cells of conditions that are called like published ones, and are others."""
    summary = results.summary
    published = {name for one in results.references for name in one.points["condition"]}
    named = summary[summary["condition"].isin(published) & (summary["protocol"] == HUMAN_PROTOCOL)]
    others = named.drop(results.compared(named).index)[CELL].drop_duplicates()
    return [_label(key) for key in others.itertuples(index=False)]


def _label(key: Any) -> str:
    """``ddqn, CC4 (human)``: a learner, perhaps a condition, and a protocol."""
    *names, protocol = map(str, key)
    return f"{', '.join(names)} ({protocol})"


def exclusions(results: Material) -> tuple[str, ...]:
    """Say how many people are left out, a sentence for each of their labels."""
    sizes = results.trials.drop_duplicates([*CELL, *SUBJECT])["learner"].value_counts()
    return tuple(
        f"Of {counted(out + sizes.get(name, 0), 'person', 'people')} ({name}), {out} completed no "
        f"trial and {'was' if out == 1 else 'were'} left out."
        for name, out in results.experiment.excluded.items()
    )


def about_people(results: Material) -> str:
    """Say who is left out and how long people took; empty without people or times.

    Raises:
        StoreError: If a file of reaction times is damaged.
    """
    took = [
        f"{counted(len(minutes), 'person', 'people')} took {np.median(minutes):.1f} minutes in "
        f"{IN_WORDS[kind]}"
        for kind, minutes in sorted(_minutes(results).items())
    ]
    if not took:
        return " ".join(exclusions(results))
    told = [f"From the first action to the last, {joined(took)} (median)"]
    for one in results.references:
        if known := [f"{value} in {IN_WORDS[kind]}" for kind, value in one.minutes.items()]:
            told.append(f"{one.name} ({one.source}) took about {joined(known)}")
    return " ".join([*exclusions(results), "; ".join(told) + "."])


def _minutes(results: Material) -> dict[str, list[float]]:
    """The minutes that each person took, by the kind of condition."""
    kinds = {
        one.name: "transfer" if one.test else "baseline" for one in results.experiment.conditions
    }
    people = [one.name for one in results.experiment.learners if one.learner == PERSON]
    own = results.trials[results.trials["learner"].isin(people)]
    included = {*zip(own["condition"].astype(str), own["subject"], strict=True)}
    minutes: dict[str, list[float]] = {}
    for folder in results.folders:
        if not people or not any((folder / REACTIONS).glob("*.parquet")):
            continue
        known = read_reactions(folder).to_pandas().dropna(subset="time")
        for (condition, subject), acts in known.groupby(["condition", "subject"]):
            if (condition, subject) in included:
                first = acts["reaction"].fillna(0.0).iloc[0]
                seconds = acts["time"].iloc[-1] - acts["time"].iloc[0] + first
                minutes.setdefault(kinds[condition], []).append(seconds / 60)
    return minutes

"""Sentences of a report about people themselves: who is left out, and how long they took.

A person's time is that from the first action in a room of the experiment to the last one, with
what they took over the first. Instructions and the practice room are left out. Breaks are not, so
medians are given.
"""

from __future__ import annotations

import numpy as np

from causal_openlock.analysis.measures import CELL, SUBJECT
from causal_openlock.analysis.results.material import Material
from causal_openlock.experiment.beside_record import REACTIONS, read_reactions
from causal_openlock.experiment.declare import PERSON
from causal_openlock.wording import counted, joined

IN_WORDS = {"baseline": "a baseline", "transfer": "transfer"}
"""Kinds of conditions, in which people took some time."""


def exclusions(results: Material) -> tuple[str, ...]:
    """Say how many people are left out, a sentence for each of their labels."""
    sizes = results.trials.drop_duplicates([*CELL, *SUBJECT])["learner"].value_counts()
    people = {
        name: counted(out + int(sizes.get(name, 0)), "person", "people")
        for name, out in results.experiment.excluded.items()
    }
    return tuple(
        f"Of {people[name]} ({name}), {out} completed no trial and "
        f"{'was' if out == 1 else 'were'} left out."
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
    for reference in (one.reference for one in results.references if one.reference.minutes):
        known = [f"{value} in {IN_WORDS[kind]}" for kind, value in reference.minutes.items()]
        told.append(f"{reference.name} ({reference.source}) took about {joined(known)}")
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

"""Sentences of a report about people themselves: who is left out, and how long they took.

A person's time is that from the first action in a room of the experiment to the last one, with
what they took over the first. Instructions and the practice room are left out. Breaks are not, so
medians are given.
"""

from __future__ import annotations

import pandas as pd

from causal_openlock.analysis.measures import CELL, SUBJECT
from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.results.material import Material
from causal_openlock.experiment.beside_record import REACTIONS, read_reactions
from causal_openlock.experiment.declare import PERSON

_PROSE = Prose(__name__)
KINDS = ("baseline", "transfer")


def exclusions(results: Material) -> tuple[str, ...]:
    """Say how many people are left out, a sentence for each of their labels."""
    sizes = results.trials.drop_duplicates([*CELL, *SUBJECT])["learner"].value_counts()
    return tuple(
        _PROSE.sentence("excluded", name=name, out=out, of=out + int(sizes.get(name, 0)))
        for name, out in results.experiment.excluded.items()
    )


def about_people(results: Material) -> str:
    """Say who is left out and how long people took; empty without people or times.

    Raises:
        StoreError: If a file of reaction times is damaged.
    """
    people = [one.name for one in results.experiment.learners if one.learner == PERSON]
    took = minutes_taken(results, people)
    said = [*exclusions(results)]
    if not took.empty:
        published = [one.reference for one in results.references if one.reference.minutes]
        rows = took.to_dict("records")
        said.append(_PROSE.sentence("minutes", took=rows, published=published))
    return " ".join(said)


def minutes_taken(results: Material, people: list[str]) -> pd.DataFrame:
    """Return how long people took: ``kind`` of condition, number of ``people``, median ``minutes``.

    Args:
        results: What was played; times are with it, in its folders.
        people: Labels of those who are people.
    """
    kinds = {one.name: KINDS[bool(one.test)] for one in results.experiment.conditions}
    own = results.trials[results.trials["learner"].isin(people)]
    counted = {*zip(own["condition"].astype(str), own["subject"], strict=True)}
    rows = []
    for folder in results.folders:
        if not people or not any((folder / REACTIONS).glob("*.parquet")):
            continue
        known = read_reactions(folder).to_pandas().dropna(subset="time")
        for (condition, subject), acts in known.groupby(["condition", "subject"]):
            if (condition, subject) in counted:
                first = acts["reaction"].fillna(0.0).iloc[0]
                seconds = acts["time"].iloc[-1] - acts["time"].iloc[0] + first
                rows.append((kinds[condition], seconds / 60))
    table = pd.DataFrame(rows, columns=["kind", "minutes"]).groupby("kind")["minutes"]
    return table.agg(people="size", minutes="median").reset_index()

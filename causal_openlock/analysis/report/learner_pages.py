"""A page for each learner: what it is, its results, and how much its subjects vary.

A mean hides whether all subjects did alike or half of them never solved a trial. So next to its
numbers each learner has a figure in which every subject counts: a circle is as large as the share
of subjects that needed that number of attempts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd

from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.subjects import plot_subjects
from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import Beside, difference_from
from causal_openlock.analysis.section import Section
from causal_openlock.wording import file_names

_RENAMED = {"share_solved": "solved", "ideal_attempts": "ideal"}
_PROSE = Prose(__name__)


def learner_pages(material: Material) -> list[Section]:
    """A section for each learner: ``learner_1``, ``learner_2``, ... in the order of learners.

    Their tables and plots are called by the learner's name.
    """
    about = {spec.name: spec.origin.about for spec in material.experiment.learners}
    headline, learners = material.headline, material.learners
    played = [name for name in learners if (headline["learner"] == name).any()]
    pages = []
    for name, part in file_names(played).items():
        own = headline[headline["learner"] == name]
        label = f"learner_{part}"
        one = own["protocol"].nunique() == 1
        plot = _PROSE.plot(
            "learner", plot_subjects, material, {"learners": [name]}, label,
            learner=name,
            size=f"protocol {own['protocol'].iloc[0]}, {style.sizes(own)}" if one else "",
            known=[
                one.reference.name
                for one in material.leading
                if own[f"{one.reference.prefix}_attempts"].notna().any()
            ],
            ideal=bool(own["ideal_attempts"].notna().any()),
        )  # fmt: skip
        page = _PROSE.section(
            f"learner_{learners.index(name) + 1}",
            [
                _PROSE.table(
                    "learner",
                    _shown(own, material.references),
                    _formats(material.references),
                    label,
                    learner=name,
                )
            ],
            [plot],
        )
        text = (about[name],) if about.get(name) else ()
        pages.append(replace(page, title=name, text=text))
    return pages


def _shown(own: pd.DataFrame, references: Sequence[Beside]) -> pd.DataFrame:
    """The headline of a learner, without columns that say nothing."""
    names = {f"{one.reference.prefix}_attempts": one.reference.name for one in references}
    errors = {f"{one.reference.prefix}_se" for one in references} & {*own.columns}
    frame = own.drop(columns=["learner", *errors]).rename(columns=names | _RENAMED)
    if frame["protocol"].nunique() == 1:
        frame = frame.drop(columns="protocol")
    return frame.dropna(axis="columns", how="all").reset_index(drop=True)


def _formats(references: Sequence[Beside]) -> dict[str, str]:
    """How the columns of :func:`_shown` are printed."""
    differences = [difference_from(one.reference, references) for one in references]
    return {
        "subjects": ",",
        **dict.fromkeys(("attempts", "ci_low", "ci_high", "ideal"), ".2f"),
        **{one.reference.name: ".2f" for one in references},
        **{name: "+.2f" for name in differences if name},
        "solved": ".1%",
    }

"""The sections of the report, in reading order.

To add one, write a module here with a function ``section(material)``, which returns a
:class:`~causal_openlock.analysis.report.section.Section`, or None where the record holds nothing
that it is about; write its sentences into ``templates/NAME.txt.j2``
(:mod:`~causal_openlock.analysis.report.prose`); and name it in :data:`ORDER`, or, in a package of
its own, register it as an entry point (:func:`order_of_all`). A section that calls
effects found has two functions more: ``compute(material)``, whose result is computed once, and
``tests(computed)``, which takes from it the p of each effect by a key of its own. Its
``section(material, decisions)`` asks what was computed and what is found
(:class:`~causal_openlock.analysis.results.decisions.Decisions`): all tests of a report are
corrected together, before anything of it is written. Columns of the record that are read on request
only (:data:`~causal_openlock.analysis.results.reading.UNREAD`) are named in ``COLUMNS`` of the
module.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any

import pandas as pd

from causal_openlock.analysis.report.section import Section
from causal_openlock.analysis.results.decisions import Decisions
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.standing import beside_people, standings
from causal_openlock.files.plugins import TOPICS, registered

ORDER = (
    "learning_cost",
    "survival",
    "waste",
    "understanding",
    "language_models",
    "human_likeness",
    "paper_findings",
    "transfer",
    "pairwise",
    "learning",
    "agreement",
    "reward_study",
    "exploration",
    "belief_traces",
)
"""Modules of this package, in the order in which their sections are read."""


def order_of_all() -> tuple[str, ...]:
    """Return :data:`ORDER` with the modules registered as ``causal_openlock.topics``.

    A module's ``BEFORE`` names the section that its own precedes; without, it is the last.
    """
    names = [*ORDER]
    for entry in registered(TOPICS).values():
        before = getattr(import_module(entry.module), "BEFORE", None)
        place = names.index(before) if before in names else len(names)
        names.insert(place, entry.module)
    return tuple(names)


def decisions_of(
    material: Material, order: Sequence[str] = ORDER, standing: pd.DataFrame | None = None
) -> Decisions:
    """What is found in a report of these sections, of all their tests together.

    Args:
        material: What they are made of.
        order: As :func:`sections_of` takes it.
        standing: What :func:`~causal_openlock.analysis.results.standing.standings` makes of it, if
            that is there already.
    """
    decisions = Decisions()
    if set(ORDER) <= set(order):  # a whole report, with its first screen
        table = standings(material) if standing is None else standing
        decisions.register("standing", beside_people(table))
    for name in order:
        if hasattr(module := _module(name), "tests"):
            computed = module.compute(material)
            decisions.register(name, module.tests(computed), computed)
    return decisions


def sections_of(
    material: Material, order: Sequence[str] = ORDER, decisions: Decisions | None = None
) -> list[Section]:
    """All sections that the record has something for.

    Args:
        material: What they are made of.
        order: Modules of this package, or others by their full names.
        decisions: From :func:`decisions_of`; by default of these sections.

    Raises:
        ValueError: If two sections, tables or plots have the same name.
    """
    decided = decisions_of(material, order) if decisions is None else decisions
    found = [
        module.section(material, decided) if hasattr(module, "tests") else module.section(material)
        for module in map(_module, order)
    ]
    sections = [section for section in found if section is not None]
    for what, names in (
        ("sections", [section.name for section in sections]),
        ("tables", [table.name for section in sections for table in section.tables]),
        ("plots", [plot.name for section in sections for plot in section.plots]),
    ):
        if twice := {name for name in names if names.count(name) > 1}:
            raise ValueError(f"two {what} of the report are called {min(twice)}")
    return sections


def columns_of(order: Sequence[str] = ORDER) -> list[str]:
    """Columns of a record that sections need, of those that are read on request only."""
    return sorted({name for one in order for name in getattr(_module(one), "COLUMNS", ())})


def _module(name: str) -> Any:
    return import_module(name if "." in name else f"{__name__}.{name}")

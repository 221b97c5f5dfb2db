"""The sections of the report, in reading order, and what calls for them.

Each is a module with one function ``section(material)``, which gives a
:class:`~causal_openlock.analysis.report.section.Section`, or ``None`` where the record holds
nothing that it is about. To add one, write such a module and name it in :data:`PROVIDERS`. A module
that looks at columns that are not read unless asked for
(:data:`~causal_openlock.analysis.results.reading.UNREAD`) names them in ``COLUMNS``.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any

from causal_openlock.analysis.report.section import Material, Section

PROVIDERS = (
    ".human_likeness",
    ".paper_findings",
    ".transfer",
    ".pairwise",
    ".learning",
    ".agreement",
    ".reward_study",
    ".exploration",
    ".belief_traces",
)
"""Modules of :mod:`causal_openlock.analysis.report.sections`, in the order in which their sections
are read."""


def sections_of(material: Material, providers: Sequence[str] = PROVIDERS) -> list[Section]:
    """The sections that there is something to say in.

    Args:
        material: What they are made of.
        providers: Modules of :mod:`causal_openlock.analysis.report.sections`, by a leading dot, or
            full names.

    Raises:
        ValueError: If two sections, tables or drawings have the same name.
    """
    found = [_module(name).section(material) for name in providers]
    sections = [section for section in found if section is not None]
    for what, names in (
        ("sections", [section.name for section in sections]),
        ("tables", [table.name for section in sections for table in section.tables]),
        ("drawings", [drawing.name for section in sections for drawing in section.drawings]),
    ):
        if twice := {name for name in names if names.count(name) > 1}:
            raise ValueError(f"two {what} of the report are called {min(twice)}")
    return sections


def columns_of(providers: Sequence[str] = PROVIDERS) -> list[str]:
    """Columns of a record that some section needs, of those not read unless asked for."""
    return sorted({name for one in providers for name in getattr(_module(one), "COLUMNS", ())})


def _module(name: str) -> Any:
    return import_module(name, "causal_openlock.analysis.report.sections")

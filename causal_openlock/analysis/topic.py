"""A topic: one idea of a report, whole, from its numbers to its sentences.

A topic is a module with its numbers, its figure and its section, which says them in sentences, and
a :class:`Topic` called ``TOPIC``. Those of the toolkit are in
:mod:`causal_openlock.analysis.topics`; a package of its own registers one as an entry point::

    [project.entry-points."causal_openlock.topics"]
    pay = "my_package.pay:TOPIC"

The tests of one question, such as which pairs of learners differ, are corrected together where they
are made, in a column ``p_corrected``: what else is in the report changes no answer that is not
about it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import NamedTuple

from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.section import Section
from causal_openlock.files.plugins import TOPICS, loaded, registered


class Topic(NamedTuple):
    """One idea of a report.

    Attributes:
        name: Letters, digits and underscores.
        place: Where its section stands; topics of the toolkit have places from 10 to 140.
        section: From the results to the section; None where they hold nothing that it is about.
    """

    name: str
    place: int
    section: Callable[[Material], Section | None]


def all_topics() -> list[Topic]:
    """Return the topics of the toolkit and those that packages register, in reading order."""
    ours = import_module("causal_openlock.analysis.topics").MODULES
    topics = [import_module(f"causal_openlock.analysis.topics.{name}").TOPIC for name in ours]
    topics += [loaded(entry) for entry in registered(TOPICS).values()]
    return sorted(topics, key=lambda topic: topic.place)


def sections_of(
    material: Material, topics: Sequence[Topic], begin: Callable[[str], None] = lambda _: None
) -> list[Section]:
    """Return all sections that the record has something for.

    Args:
        material: What they are made of.
        topics: What they are about, in order.
        begin: Called with the name of each topic before its section is made.

    Raises:
        ValueError: If two sections, tables or plots have the same name.
    """
    sections = []
    for topic in topics:
        begin(topic.name)
        section = topic.section(material)
        sections += [] if section is None else [section]
    tables = [table for section in sections for table in section.tables]
    plots = [plot for section in sections for plot in section.plots]
    for what, made in (("sections", sections), ("tables", tables), ("plots", plots)):
        names = [one.name for one in made]
        if twice := {name for name in names if names.count(name) > 1}:
            raise ValueError(f"two {what} of the report are called {min(twice)}")
    return sections

"""A topic: one idea of a report, whole, from its numbers to its sentences.

A topic is a module with its numbers, its figure and its section, a template next to it with the
sentences (:mod:`~causal_openlock.analysis.prose`), and a :class:`Topic` called ``TOPIC`` that names
them. Those of the toolkit are in :mod:`causal_openlock.analysis.topics`; a package of its own
registers one as an entry point::

    [project.entry-points."causal_openlock.topics"]
    pay = "my_package.pay:TOPIC"
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from causal_openlock.analysis.decisions import Decided, Decisions
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.section import Section
from causal_openlock.files.plugins import TOPICS, loaded, registered


def _nothing(_: Material) -> None:
    return None


def _silent(_: str) -> None:
    return None


def _one_question(_: Hashable) -> None:
    return None


def _no_tests(_: Any) -> Mapping[Hashable, float]:
    return {}


@dataclass(frozen=True)
class Topic:
    """One idea of a report.

    Attributes:
        name: Names its tests; letters, digits and underscores.
        place: Where its section stands: topics are read in the order of their places, which
            :func:`all_topics` lists. Those of the toolkit are from 0 to 140.
        section: From the results, and what was computed and decided, to the section; None where
            the results hold nothing that it is about.
        compute: From the results to what the tests are taken from, computed once.
        tests: From what was computed to the p value of each effect, by a key of its own.
        family: From a key to the question that its test is about: the tests of one question are
            corrected together. By default a topic asks one question.
        columns: Columns of the record that it needs, of those that are read on request only
            (:data:`~causal_openlock.analysis.results.reading.UNREAD`).
    """

    name: str
    place: int
    section: Callable[[Material, Decided], Section | None]
    compute: Callable[[Material], Any] = _nothing
    tests: Callable[[Any], Mapping[Hashable, float]] = _no_tests
    family: Callable[[Any], Hashable] = _one_question
    columns: tuple[str, ...] = ()


def all_topics() -> list[Topic]:
    """Return the topics of the toolkit and those that packages register, in reading order."""
    ours = import_module("causal_openlock.analysis.topics").MODULES
    topics = [import_module(f"causal_openlock.analysis.topics.{name}").TOPIC for name in ours]
    topics += [loaded(entry) for entry in registered(TOPICS).values()]
    return sorted(topics, key=lambda topic: topic.place)


def decisions_of(
    material: Material, topics: Sequence[Topic], begin: Callable[[str], None] = _silent
) -> Decisions:
    """Return what is found in a report on these topics, of all their tests together.

    ``begin`` is called with the name of each topic before it is computed.
    """
    decisions = Decisions()
    for topic in topics:
        begin(topic.name)
        computed = topic.compute(material)
        decisions.register(topic.name, topic.tests(computed), computed, topic.family)
    return decisions


def sections_of(
    material: Material,
    topics: Sequence[Topic],
    decisions: Decisions | None = None,
    begin: Callable[[str], None] = _silent,
) -> list[Section]:
    """Return all sections that the record has something for.

    Args:
        material: What they are made of.
        topics: What they are about, in order.
        decisions: From :func:`decisions_of`; by default of these topics.
        begin: Called with the name of each topic before its section is made.

    Raises:
        ValueError: If two sections, tables or plots have the same name.
    """
    decided = decisions_of(material, topics) if decisions is None else decisions
    sections = []
    for topic in topics:
        begin(topic.name)
        section = topic.section(material, decided.of(topic.name))
        sections += [] if section is None else [section]
    for what, names in (
        ("sections", [section.name for section in sections]),
        ("tables", [table.name for section in sections for table in section.tables]),
        ("plots", [plot.name for section in sections for plot in section.plots]),
    ):
        if twice := {name for name in names if names.count(name) > 1}:
            raise ValueError(f"two {what} of the report are called {min(twice)}")
    return sections


def columns_of(topics: Sequence[Topic]) -> list[str]:
    """Return the columns of a record that topics need, of those read on request only."""
    return sorted({name for topic in topics for name in topic.columns})

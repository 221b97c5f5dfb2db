"""Topics of the report by their names."""

from __future__ import annotations

from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.topic import Section, Topic, all_topics, sections_of


def topics_called(*names: str) -> list[Topic]:
    """Return these topics, in reading order."""
    return [topic for topic in all_topics() if topic.name in names]


def section_on(topic: Topic, material: Material) -> Section | None:
    """Return the section on one topic."""
    return next(iter(sections_of(material, [topic])), None)

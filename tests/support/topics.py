"""Topics of the report by their names."""

from causal_openlock.analysis.topic import all_topics, sections_of


def topics_called(*names):
    """Return these topics, in reading order."""
    return [topic for topic in all_topics() if topic.name in names]


def section_on(topic, material):
    """Return the section on one topic."""
    return next(iter(sections_of(material, [topic])), None)

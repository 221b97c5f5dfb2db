"""A topic: one idea of a report, whole, from its numbers to its sentences.

A topic is a module with its numbers, its figure and its section, which says them in sentences, and
a :class:`Topic` called ``TOPIC``. Those of the toolkit are in
:mod:`causal_openlock.analysis.topics`; a package of its own registers one as an entry point::

    [project.entry-points."causal_openlock.topics"]
    pay = "my_package.pay:TOPIC"

A :class:`Section` is data: sentences beside the numbers that they tell, tables and plots. The
report lays it out and knows nothing of what is in it. The tests of one question, such as which
pairs of learners differ, are corrected together where they are made: ``p_corrected``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any, NamedTuple

from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.table import Table
from causal_openlock.files.plugins import TOPICS, loaded, registered
from causal_openlock.wording import joined

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class SectionPlot:
    """A figure that is shown; its files, where they are wanted, are called ``name``.

    The caption says what is seen and what the error bars are; the call is the line of Python that
    makes it again. One that is ``folded`` is closed on the page until it is opened; the page opens
    with the one that is ``opening``.
    """

    name: str
    title: str
    caption: str
    figure: Figure
    call: str = ""
    folded: bool = False
    opening: bool = False


@dataclass(frozen=True)
class Section:
    """A part of the report: paragraphs that say what was found, then tables, then plots.

    Its name is its anchor within the page. The ``answer`` is its sentence on the first screen. A
    section is closed on the page until it is opened, unless it ``is_open``.
    """

    name: str
    title: str
    text: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    plots: tuple[SectionPlot, ...] = ()
    answer: str = ""
    is_open: bool = False


def sentences(*parts: str) -> str:
    """Join sentences, or captions, that are not empty, into a paragraph.

    >>> sentences("Means over subjects.", "" if True else "Bands: intervals.", "n = 3.")
    'Means over subjects. n = 3.'
    """
    return " ".join(filter(None, parts))


def of_all_conditions(trials: pd.DataFrame, judged: pd.DataFrame) -> str:
    """Say that ``judged`` rows are of all conditions of some trials, or which are left out.

    >>> import pandas as pd
    >>> played = pd.DataFrame({"condition": ["CC3", "mine"]})
    >>> of_all_conditions(played, played[:1])
    'of all conditions but mine, where the ideal observer is not known'
    """
    left_out = joined(sorted({*trials["condition"]} - {*judged["condition"]}))
    but = f" but {left_out}, where the ideal observer is not known" if left_out else ""
    return f"of all conditions{but}"


def drawn(
    name: str,
    function: Callable[..., Any],
    data: Any,
    title: str,
    caption: str,
    call: str | None = None,
    **options: Any,
) -> SectionPlot:
    """Draw a figure for a section, by a function that takes the data and an empty figure as ``ax``.

    The ``call``, which makes the figure again, is by default that of ``results.plot``.
    """
    from matplotlib.figure import Figure

    figure = Figure()
    function(data, **options, ax=figure)
    if call is None:
        given = ", ".join(f"{key}={value!r}" for key, value in options.items())
        call = f"results.plot.{function.__name__.removeprefix('plot_')}({given})"
    return SectionPlot(name, title, caption, figure, call)


class Topic(NamedTuple):
    """One idea of a report."""

    name: str  #: letters, digits and underscores
    place: int  #: where its section stands; topics of the toolkit have places from 10 to 140
    section: Callable[[Material], Section | None]  #: None where results hold nothing on it


def all_topics() -> list[Topic]:
    """Return the topics of the toolkit and those that packages register, in reading order."""
    ours = "causal_openlock.analysis.topics"
    found = iter_modules(import_module(ours).__path__)
    modules = [import_module(f"{ours}.{module.name}") for module in found]
    topics = [module.TOPIC for module in modules if hasattr(module, "TOPIC")]
    topics += [loaded(entry) for entry in registered(TOPICS).values()]
    return sorted(topics, key=lambda topic: topic.place)


def sections_of(
    material: Material, topics: Sequence[Topic], begin: Callable[[str], None] = lambda _: None
) -> list[Section]:
    """Return all sections that the record has something for, in the order of the topics.

    ``begin`` is called with the name of each topic before its section is made.

    Raises:
        ValueError: If two sections, tables or plots have the same name.
    """
    sections = []
    for topic in topics:
        begin(topic.name)
        if section := topic.section(material):
            sections.append(section)
    names = {
        "sections": [section.name for section in sections],
        "tables": [table.name for section in sections for table in section.tables],
        "plots": [plot.name for section in sections for plot in section.plots],
    }
    for what, given in names.items():
        if twice := {name for name in given if given.count(name) > 1}:
            raise ValueError(f"two {what} of the report are called {min(twice)}")
    return sections

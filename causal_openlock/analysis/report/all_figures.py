"""The figures that a report opens with: each is what a function of ``analysis.plots`` draws."""

from __future__ import annotations

from causal_openlock.analysis.plots.categories import KINDS, counts_like_ddqn, plot_categories
from causal_openlock.analysis.plots.course import course_of, plot_course
from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.results.bounds import bounds_in_words
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.section import SectionPlot
from causal_openlock.wording import file_names

_PROSE = Prose(__name__)


def figures_of(material: Material) -> list[SectionPlot]:
    """Every figure that the record has data for, in the order of the page."""
    plots = []
    for kind in KINDS:
        if len(counts_like_ddqn(material, kind)):
            plots.append(
                _PROSE.plot(f"{kind}_categories", plot_categories, material, {"kind": kind})
            )
    for protocol, part in file_names(material.trials["protocol"].unique()).items():
        course = course_of(material, protocol)
        plots.append(
            _PROSE.plot(
                "attempts_by_trial", plot_course, material, {"protocol": protocol},
                f"attempts_by_trial_{part}",
                protocol=protocol,
                averaged=course.averaged,
                limit=course.limit,
                tested=set(course.trials["phase"]) == {"train", "test"},
                ideal=bounds_in_words(course.ideal.values()),
            )
        )  # fmt: skip
    return plots

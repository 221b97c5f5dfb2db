"""Figures of the course of trials and of the categories of attempts."""

from __future__ import annotations

from dataclasses import replace

from causal_openlock.analysis.plots.categories import KINDS, counts_like_ddqn, plot_categories
from causal_openlock.analysis.plots.course import course_of, plot_course
from causal_openlock.analysis.results.bounds import bounds_in_words
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.topic import SectionPlot, drawn
from causal_openlock.wording import file_names

CATEGORIES = {
    "baseline": (
        "Categories of baseline attempts",
        "Frequency of each category in five successive blocks of the attempts of the baseline "
        "conditions; the first panel shows the paper's own DDQN (Figure 6).",
    ),
    "transfer": (
        "Categories of attempts in the transfer test",
        "Frequency of each category among attempts of the test phase in the transfer conditions; "
        "the first panel shows the paper's own DDQN (Figure 7).",
    ),
}
"""By kind of conditions, the title of a figure and what it shows."""

HEIGHTS = (
    "Open 1, 2 and 3: the attempt opened the door with the first, second or third new solution of "
    "its trial (later ones count as the third, a repeated one as open 1); unlock: it unlocked the "
    "door but did not open it; else: neither. The height of a segment is log10 of its number of "
    "attempts, all subjects together, so one attempt has no height, panels of unequal totals "
    "differ in height, and a stack shrinks as one category takes over."
)


def figures_of(material: Material) -> list[SectionPlot]:
    """Every figure that the record has data for, in the order of the page."""
    plots = []
    for kind in KINDS:
        if len(counts_like_ddqn(material, kind)):
            title, caption = CATEGORIES[kind]
            name = f"{kind}_categories"
            caption = f"{caption} {HEIGHTS}"
            plots.append(drawn(name, plot_categories, material, title, caption, kind=kind))
    for protocol, part in file_names(material.trials["protocol"].unique()).items():
        course = course_of(material, protocol)
        several = f" (a point averages up to {course.averaged} trials in a row)"
        caption = (
            "Mean attempts to solve each trial, in the order in which trials were played"
            f"{several if course.averaged > 1 else ''}. Shaded or with bars: ± 1 standard error "
            "(population SD / √n)."
        )
        if course.limit:
            caption += " Dotted: the limit."
        if set(course.trials["phase"]) == {"train", "test"}:
            caption += " Right of the upright line: the transfer test."
        if ideal := bounds_in_words(course.ideal.values()):
            caption += f" Dashed and level: ideal observer (schema known), {ideal}."
        name, title = f"attempts_by_trial_{part}", f"Trial by trial, protocol {protocol}"
        plots.append(drawn(name, plot_course, material, title, caption, protocol=protocol))
    return [replace(plot, folded=True) for plot in plots]

"""Attempts to solve as survival curves: nothing at the limit passes for a number of attempts."""

from __future__ import annotations

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.plots.survival import MOST_BANDS, plot_survival
from causal_openlock.analysis.report.prose import Prose
from causal_openlock.analysis.report.section import Section
from causal_openlock.analysis.results.material import Material
from causal_openlock.wording import file_names

_PROSE = Prose("survival")


def section(material: Material) -> Section | None:
    """A figure for each protocol; None of an empty record."""
    trials = material.trials
    names = ordered(trials["protocol"].unique(), ("human",))
    plots = []
    for protocol, part in file_names(names).items():
        learners = trials.loc[trials["protocol"] == protocol, "learner"].nunique()
        plots.append(
            _PROSE.plot(
                "survival", plot_survival, material, {"protocol": protocol}, f"survival_{part}",
                protocol=protocol, bands=learners <= MOST_BANDS,
            )
        )  # fmt: skip
    return _PROSE.section("survival", plots=plots) if plots else None

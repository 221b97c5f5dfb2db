"""Plots of results, each one line: ``results.plot.attempts()``.

They are functions of :mod:`causal_openlock.analysis`, which draw the report's figures too, with the
results as their first argument.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

from causal_openlock.analysis.plots.attempts import plot_attempts, plot_transfer
from causal_openlock.analysis.plots.belief import plot_beliefs
from causal_openlock.analysis.plots.categories import plot_categories
from causal_openlock.analysis.plots.course import plot_course
from causal_openlock.analysis.plots.style import plot_style
from causal_openlock.analysis.plots.subjects import plot_subjects
from causal_openlock.analysis.plots.sweep import plot_sweep
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.topics.learning_cost import plot_cost
from causal_openlock.analysis.topics.pairwise import plot_pairs
from causal_openlock.analysis.topics.structure_recovery import plot_structure_recovery
from causal_openlock.analysis.topics.survival import plot_survival
from causal_openlock.analysis.topics.transfer import plot_savings
from causal_openlock.files.validation import check_arguments
from causal_openlock.paper.likeness_figure import plot_likeness


class Plot:
    """A plot function as a method of :class:`Plots`, which refuses an argument that it lacks."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = f"plot.{name}"

    def __get__(self, plots: Plots, owner: type) -> Callable[..., Any]:
        @wraps(self.function)
        def plot(*values: Any, **options: Any) -> Any:
            changes = {key: options.pop(key) for key in ("labels", "colors") if key in options}
            check_arguments(options, self.function, self.name)
            with plot_style(**changes):
                return self.function(plots.results, *values, **options)

        return plot


class Plots:
    """Every plot of some results; each takes ``ax=`` and returns the axes that it drew into.

    Each also takes ``labels={"bayes": "Bayesian"}`` and ``colors={"bayes": "black"}``: what to call
    learners and conditions, and their colours.

    Example:
        >>> from causal_openlock import compare
        >>> results = compare("CC4", ["oracle", "random"], subjects=2, workers=1)
        >>> axes = results.plot.survival()
        >>> axes.get_xlabel()
        'Attempts'
    """

    def __init__(self, results: Material) -> None:
        self.results = results

    attempts = Plot(plot_attempts)
    transfer = Plot(plot_transfer)
    course = Plot(plot_course)
    categories = Plot(plot_categories)
    survival = Plot(plot_survival)
    cost = Plot(plot_cost)
    savings = Plot(plot_savings)
    pairs = Plot(plot_pairs)
    subjects = Plot(plot_subjects)
    beliefs = Plot(plot_beliefs)
    sweep = Plot(plot_sweep)
    structure_recovery = Plot(plot_structure_recovery)
    likeness = Plot(plot_likeness)

    def __repr__(self) -> str:
        return f"plots: {', '.join(dir(self))}; each takes ax= and returns the axes"

    def __dir__(self) -> list[str]:
        """The plots, for completion."""
        return [name for name, plot in vars(type(self)).items() if isinstance(plot, Plot)]

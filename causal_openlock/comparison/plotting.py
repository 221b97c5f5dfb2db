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
from causal_openlock.paper.likeness_section import plot_likeness


def _method(function: Callable[..., Any]) -> Callable[..., Any]:
    """A plot function as a method of :class:`Plots`, which refuses an argument that it lacks."""

    @wraps(function)
    def plot(plots: Plots, *values: Any, **options: Any) -> Any:
        changes = {key: options.pop(key) for key in ("labels", "colors") if key in options}
        check_arguments(options, function, function.__name__.replace("_", ".", 1))
        with plot_style(**changes):
            return function(plots.results, *values, **options)

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

    attempts = _method(plot_attempts)
    transfer = _method(plot_transfer)
    course = _method(plot_course)
    categories = _method(plot_categories)
    survival = _method(plot_survival)
    cost = _method(plot_cost)
    savings = _method(plot_savings)
    pairs = _method(plot_pairs)
    subjects = _method(plot_subjects)
    beliefs = _method(plot_beliefs)
    sweep = _method(plot_sweep)
    structure_recovery = _method(plot_structure_recovery)
    likeness = _method(plot_likeness)

    def __repr__(self) -> str:
        return f"plots: {', '.join(dir(self))}; each takes ax= and returns the axes"

    def __dir__(self) -> list[str]:
        """The plots, for completion."""
        return [name for name in vars(Plots) if not name.startswith("_")]

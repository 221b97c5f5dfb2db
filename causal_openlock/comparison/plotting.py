"""Plots of results, each one line: ``results.plot.attempts()``.

They are the public functions of :mod:`causal_openlock.analysis.plots`, which draw the report's
figures too, with the results as their first argument.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any

from causal_openlock.analysis.plots.attempts import plot_attempts, plot_transfer
from causal_openlock.analysis.plots.belief import plot_beliefs
from causal_openlock.analysis.plots.categories import plot_categories
from causal_openlock.analysis.plots.course import plot_course
from causal_openlock.analysis.plots.subjects import plot_subjects
from causal_openlock.analysis.plots.sweep import plot_sweep
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.topics.congruency import plot_congruency
from causal_openlock.analysis.topics.learning_cost import plot_cost
from causal_openlock.analysis.topics.pairwise import plot_pairs
from causal_openlock.analysis.topics.savings import plot_savings
from causal_openlock.analysis.topics.structure_recovery import plot_structure_recovery
from causal_openlock.analysis.topics.survival import plot_survival
from causal_openlock.errors import renamed
from causal_openlock.files.validation import check_arguments


class _Of:
    """A plot function as a method: the results are its first argument.

    It has the signature and the docstring of the function, which a method written out would repeat.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.__doc__ = function.__doc__

    def __get__(self, plots: Plots | None, owner: type) -> Callable[..., Any]:
        if plots is None:
            return self.function
        return bound_to(plots.results, self.function)


def bound_to(results: Material, function: Callable[..., Any]) -> Callable[..., Any]:
    """A plot function of some results, which refuses an argument that it lacks in a sentence."""

    @wraps(function)
    def plot(*values: Any, **options: Any) -> Any:
        check_arguments(options, function, f"plot.{function.__name__.removeprefix('plot_')}")
        return function(results, *values, **options)

    return plot


class Plots:
    """Every plot of some results; each takes ``ax=`` and returns the axes that it drew into.

    Example:
        >>> from causal_openlock import compare
        >>> results = compare("CC4", ["oracle", "random"], subjects=2, workers=1)
        >>> axes = results.plot.survival()
        >>> axes.get_xlabel()
        'Attempts'
    """

    def __init__(self, results: Material) -> None:
        self.results = results

    attempts = _Of(plot_attempts)
    transfer = _Of(plot_transfer)
    course = _Of(plot_course)
    categories = _Of(plot_categories)
    survival = _Of(plot_survival)
    cost = _Of(plot_cost)
    congruency = _Of(plot_congruency)
    savings = _Of(plot_savings)
    pairs = _Of(plot_pairs)
    subjects = _Of(plot_subjects)
    beliefs = _Of(plot_beliefs)
    sweep = _Of(plot_sweep)
    structure_recovery = _Of(plot_structure_recovery)

    @property
    def likeness(self) -> Callable[..., Any]:
        """Draw people's means at the fourteen points, and one learner's in each panel.

        See :func:`~causal_openlock.paper.likeness_figure.plot_likeness`.
        """
        from causal_openlock.paper.likeness_figure import plot_likeness

        return bound_to(self.results, plot_likeness)

    if not TYPE_CHECKING:  # a misspelt name is still an error of types

        def __getattr__(self, name: str) -> Any:
            if name == "understanding":
                renamed("results.plot.understanding", "results.plot.structure_recovery")
                return self.structure_recovery
            raise AttributeError(f"{type(self).__name__} has no plot {name!r}", name=name)

    def __repr__(self) -> str:
        return f"plots: {', '.join(dir(self))}; each takes ax= and returns the axes"

    def __dir__(self) -> list[str]:
        """The plots, for completion."""
        return [name for name, plot in vars(type(self)).items() if isinstance(plot, _Of | property)]

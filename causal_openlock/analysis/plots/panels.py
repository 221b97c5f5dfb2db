"""Axes of a figure: given ones, or those of a figure that is laid out for them.

Every plot function takes ``ax``, which is one of three things:

* None: a figure is made with pyplot, so that a notebook shows it.
* An empty :class:`~matplotlib.figure.Figure`: it is given its size and its panels. The report does
  this, so that pyplot holds none of its figures.
* Axes, if the figure has a single panel. Its legend is then inside of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.results.material import Material
from causal_openlock.errors import NothingToDrawError, OpenLockError
from causal_openlock.files.validation import several
from causal_openlock.wording import nearest

Names = Collection[str] | None  #: labels of learners or conditions; None for all
Layout = Callable[[Figure], Sequence[Axes]]  #: gives a figure its size and its panels


@dataclass(frozen=True)
class Panels:
    """The axes of the panels, in order."""

    axes: list[Axes]
    figure: Figure | None  #: that was made for them; None if they were given

    @property
    def returned(self) -> Any:
        """Axes that a plot function returns: ``[P]``, or the only ones."""
        return self.axes[0] if len(self.axes) == 1 else np.array(self.axes, dtype=object)

    def label_y(self, text: str) -> None:
        """Name the y axis, of a row of panels once."""
        for number, axes in enumerate(self.axes):
            place = axes.get_subplotspec()
            if number == 0 or (place and place.is_first_col()):
                axes.set_ylabel(text)

    def legend(self, handles: Sequence[Any], columns: int | None = None) -> None:
        """A legend above all panels, or in the axes that were given."""
        if self.figure is None:
            self.axes[0].legend(handles=list(handles), fontsize="small")
        else:
            self.figure.legend(
                handles=list(handles), loc="outside upper left",
                ncols=columns or min(len(handles), 7), handlelength=1.6, columnspacing=1.4,
            )  # fmt: skip


@contextmanager
def panels(ax: Any, count: int, lay_out: Layout) -> Iterator[Panels]:
    """The axes to draw in, and the style's settings for what is drawn in a figure made here.

    Raises:
        OpenLockError: If ``ax`` is something else, or axes of a figure with several panels.
    """
    if isinstance(ax, Axes) and count == 1:
        yield Panels([ax], None)
    elif ax is None or isinstance(ax, Figure):
        with style.settings():
            if ax is None:
                import matplotlib.pyplot as plt

                ax = plt.figure()
            ax.set_layout_engine("constrained")
            yield Panels(list(lay_out(ax)), ax)
    else:
        axes = " or axes" if count == 1 else f", as this plot has {count} panels"
        raise OpenLockError(f"pass ax=plt.figure(){axes}, and not {type(ax).__name__}")


def in_rows(
    count: int,
    columns: int,
    height: float,
    width: float | None = None,
    common: bool = True,
    above: float = 0.5,
) -> Layout:
    """Lay out ``count`` panels, in rows of at most ``columns``.

    A panel has a height in inches, and so has what is ``above`` all of them. The figure is by
    default as wide as the page, or 0.62 of that with a single column. With a ``common`` y axis only
    the first of a row has labels.
    """
    rows = math.ceil(count / columns)
    columns = math.ceil(count / rows)  # four panels are two and two, not three and one

    def lay_out(figure: Figure) -> list[Axes]:
        wide = width or style.WIDTH * (1 if columns > 1 else 0.62)
        figure.set_size_inches(wide, rows * height + above)
        grid = figure.subplots(rows, columns, sharey=common, squeeze=False).ravel().tolist()
        for unused in grid[count:]:
            unused.remove()
        for axes in grid[:count]:
            axes.tick_params(axis="x", length=0)
        return grid[:count]

    return lay_out


def rows_of(
    results: Material, table: pd.DataFrame, learners: Names = None, conditions: Names = None
) -> pd.DataFrame:
    """The rows of these learners and conditions.

    Raises:
        OpenLockError: If one is not in the results.
    """
    for column, asked in (("learner", learners), ("condition", conditions)):
        known = [str(name) for name in results.trials[column].unique()]
        names = known if asked is None else [*map(str, asked if several(asked) else [asked])]
        for name in names:
            if name not in known:
                raise OpenLockError(f"no {column} {name} in these results; {nearest(name, known)}")
        table = table[table[column].isin(names)]
    return table


def trials_under(
    results: Material, protocol: str | None, learners: Names = None, conditions: Names = None
) -> tuple[str, pd.DataFrame]:
    """A protocol, by default ``human`` or else the first by alphabet, and the trials under it.

    Raises:
        OpenLockError: If the protocol, a learner or a condition is not in the results.
        NothingToDrawError: If none of the learners played one of the conditions under it.
    """
    known = ordered(results.trials["protocol"].unique(), ("human",))
    name = known[0] if protocol is None and known else str(protocol)
    if known and name not in known:
        raise OpenLockError(f"no protocol {name} in these results; {nearest(name, known)}")
    trials = rows_of(results, results.trials, learners, conditions)
    trials = trials[trials["protocol"] == name].astype({"learner": str})
    if trials.empty:
        under = f" under the protocol {name}" if known else ""
        raise NothingToDrawError(f"no such learner played such a condition{under}")
    return name, trials

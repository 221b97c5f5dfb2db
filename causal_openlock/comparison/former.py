"""Former names of public functions; they stay for one release."""

from __future__ import annotations

from typing import Any

import pandas as pd

from causal_openlock.analysis.results.material import Material
from causal_openlock.errors import renamed


def standings(results: Material) -> pd.DataFrame:
    """Former name of :func:`~causal_openlock.analysis.topics.leaderboard.leaderboard`."""
    from causal_openlock.analysis.topics.leaderboard import leaderboard

    renamed("causal_openlock.standings", "causal_openlock.leaderboard")
    return leaderboard(results)


def waste(results: Material) -> pd.DataFrame:
    """Former name of :func:`~causal_openlock.analysis.topics.regret.regret`."""
    from causal_openlock.analysis.topics.regret import regret

    renamed("causal_openlock.waste", "causal_openlock.regret")
    return regret(results)


def understanding(results: Material, **options: Any) -> pd.DataFrame:
    """Former name of :func:`~.topics.structure_recovery.structure_recovery`."""
    from causal_openlock.analysis.topics.structure_recovery import structure_recovery

    renamed("causal_openlock.understanding", "causal_openlock.structure_recovery")
    return structure_recovery(results, **options)


def plot_understanding(results: Material, **options: Any) -> Any:
    """Former name of :func:`~.topics.structure_recovery.plot_structure_recovery`."""
    from causal_openlock.analysis.topics.structure_recovery import plot_structure_recovery

    renamed("causal_openlock.plot_understanding", "causal_openlock.plot_structure_recovery")
    return plot_structure_recovery(results, **options)

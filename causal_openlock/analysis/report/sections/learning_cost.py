"""What learning costs: attempts, all training counted, until a new room is solved well."""

from __future__ import annotations

import numpy as np
import pandas as pd

from causal_openlock.analysis.plots.cost import plot_cost
from causal_openlock.analysis.report.prose import Prose
from causal_openlock.analysis.report.section import Section
from causal_openlock.analysis.results.cost import WITHIN, learning_costs
from causal_openlock.analysis.results.material import Material

_PROSE = Prose("learning_cost")


def section(material: Material) -> Section | None:
    """The cost of learning; None where the ideal observer's attempts are known of no condition."""
    table = learning_costs(material)
    if table.empty:
        return None
    able = table[np.isfinite(table["attempts"])].sort_values("attempts", kind="stable")
    return _PROSE.section(
        "learning_cost",
        [_PROSE.table("learning_cost", shown(table), {"reached": ".0%", "n": ","})],
        [_PROSE.plot("learning_cost", plot_cost, material, name="cost_of_learning")],
        within=WITHIN,
        able=able.assign(attempts=able["attempts"].map(_printed)).to_dict("records"),
        total=len(table),
        unable=table.loc[np.isinf(table["attempts"]), "learner"].tolist(),
    )


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """The costs as texts: what is beyond the attempts that were made is "not within" them."""
    rows = []
    for row in table.to_dict("records"):
        never = f"not within {row['asked']:,}"
        ends = [_printed(row[end]) if np.isfinite(row[end]) else "beyond"
                for end in ("ci_low", "ci_high")]  # fmt: skip
        known = np.isfinite(row["attempts"])
        rows.append(
            {
                "learner": row["learner"],
                "protocol": row["protocol"],
                "n": row["subjects"],
                "reached": row["reached"],
                "before the experiment": f"{row['before']:,}" if row["before"] else "none",
                "attempts, median": _printed(row["attempts"]) if known else never,
                "95% interval": " to ".join(ends) if known else "",
            }
        )
    frame = pd.DataFrame(rows)
    return frame.drop(columns="protocol") if frame["protocol"].nunique() == 1 else frame


def _printed(attempts: float) -> str:
    """Attempts; of a median between two whole numbers with its half."""
    return f"{attempts:,.1f}".removesuffix(".0")

"""Store what knowledge saves, and draw it: ``python docs/figures/knowledge.py``.

Writes ``steps.csv``, ``people.csv`` and ``steps.svg`` into ``evidence/worth``, in a minute or two.
Everything is exact, so that repeating it gives the same.
"""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from causal_openlock.analysis.plots import style
from causal_openlock.paper.knowledge import knowledge_steps, peoples_rooms, plot_knowledge_steps

FOLDER = Path(__file__).parents[2] / "evidence" / "worth"


def main() -> None:
    """Compute, store and draw."""
    steps = knowledge_steps()
    steps.to_csv(FOLDER / "steps.csv", index=False)
    peoples_rooms().to_csv(FOLDER / "people.csv", index=False)
    figure = Figure()
    with style.settings():
        plot_knowledge_steps(steps, ax=figure)
        (FOLDER / "steps.svg").write_bytes(style.image(figure, "svg"))


if __name__ == "__main__":
    main()

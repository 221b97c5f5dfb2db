"""Draw the pictures of docs/gallery.md: ``python docs/figures/gallery.py``.

Three small comparisons are played: four learners as people played, one under a shortened protocol
of the paper's networks, and a sweep. Takes about two minutes on two cores.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from matplotlib.figure import Figure

import causal_openlock as ol
from causal_openlock.analysis.plots import style
from causal_openlock.experiment.condition import PAPER_CONDITIONS
from causal_openlock.files.atomic import write_bytes

HERE = Path(__file__).parent / "gallery"
SHORT = replace(ol.PROTOCOLS["rl"], name="short", attempt_limit=100, baseline_loops=8)
LIKE_PEOPLE = {
    **{"policy": "thompson", "forgets": "failures", "forgetting": 0.8, "concentration": 60.0},
    **{"by_colour": 0.003, "directness": 1.1},
}


def main() -> None:
    """Play, and draw every plot into a file of its name."""
    like_people = ol.learner("bayes", label="like_people", **LIKE_PEOPLE)
    learners = ["bayes", like_people, "random", "oracle"]
    results = ol.compare([*PAPER_CONDITIONS], learners, subjects=12, seed=1)
    trained = ol.compare(["CC4", "CE4"], "random", protocol=SHORT, subjects=4, seed=1)
    grid = ol.sweep("bayes", lapse=[0.0, 0.1, 0.3, 0.6], policy=["solve_and_learn", "thompson"])
    swept = ol.compare(["CC4", "CC3-CC4"], grid, subjects=12, seed=1)
    names = ("attempts", "transfer", "course", "survival", "cost", "likeness", "pairs", "savings")
    plots = {name: (results, {}) for name in names}
    plots["structure_recovery"] = (results, {})
    plots["subjects"] = (results, {"learners": ["like_people"]})
    plots["beliefs"] = (results, {"condition": "CC3-CC4", "trial": 7})
    plots["categories"] = (trained, {})
    plots["sweep"] = (swept, {"parameter": "lapse"})
    for name, (drawn, options) in plots.items():
        figure = Figure()
        getattr(drawn.plot, name)(**options, ax=figure)
        write_bytes(HERE / f"{name}.png", style.image(figure, "png", dots=110))


if __name__ == "__main__":
    main()

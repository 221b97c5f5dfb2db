"""How a DDQN loses what it had learned, and its units: ``python docs/figures/decline.py``.

Three subjects play the baseline CE4 for 100 loops, at the learning rate of the paper's text and at
that of the authors' program. Takes some ten minutes on two cores.
"""

from __future__ import annotations

import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from causal_openlock import Condition, Session, find_schema
from causal_openlock.analysis.plots import style
from causal_openlock.contract.learner import Step
from causal_openlock.experiment.protocol import PROTOCOLS
from openlock_learners.ddqn import DDQN, DDQNParameters

HERE = Path(__file__).parent
RATES = (0.001, 0.005)
LOOPS, SUBJECTS, SEED = 100, 3, 2018


class Watched(DDQN):
    """Notes how many of its units are dead at the end of every trial."""

    def learn(self, step: Step) -> None:
        """As ever."""
        super().learn(step)
        if step.trial_over.any():
            self.noted.append(self.metrics()["dead_units"])

    noted: list[float]


def play(rate: float) -> dict[str, list[float]]:
    """Share of attempts that open the door, and of dead units, visit by visit."""
    protocol = replace(PROTOCOLS["rl"], name="long", baseline_loops=LOOPS)
    session = Session(Condition.named("CE4", find_schema), protocol, SUBJECTS, seed=SEED)
    learner = Watched(DDQNParameters(learning_rate=rate, device="cpu"))
    learner.noted = []
    record = session.play(learner)
    opened = record["opened"].to_numpy().reshape(SUBJECTS, -1, protocol.attempt_limit)
    return {"opened": opened.mean(axis=(0, 2)).tolist(), "dead": learner.noted}


def draw(found: dict[str, dict[str, list[float]]]) -> Figure:
    """The figure: means over twenty visits."""
    with style.settings():
        figure = Figure(figsize=(style.WIDTH, 2.6), layout="constrained")
        left, right = figure.subplots(1, 2)
        for (rate, course), colour in zip(found.items(), style.current().others, strict=False):
            for axes, name in ((left, "opened"), (right, "dead")):
                means = np.array(course[name]).reshape(-1, 20).mean(axis=1)
                attempts = (np.arange(len(means)) + 0.5) * 20 * 300 / 1000
                axes.plot(attempts, means, color=colour, label=f"learning rate {rate}")
                axes.set_xlabel("Attempts, thousands")
                axes.set_ylim(0, 1)
        left.set_ylabel("Share of attempts\nthat open the door")
        right.set_ylabel("Share of hidden units\nthat are dead")
        left.legend(loc="upper right")
    return figure


def main() -> None:
    """Play, and write the figure and its numbers."""
    with ProcessPoolExecutor(len(RATES)) as pool:
        found = dict(zip(map(str, RATES), pool.map(play, RATES), strict=True))
    (HERE / "decline.json").write_text(json.dumps(found) + "\n", encoding="utf-8")
    with style.settings():
        style.save(draw(found), HERE / "decline")


if __name__ == "__main__":
    main()

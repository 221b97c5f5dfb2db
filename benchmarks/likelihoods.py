"""Likelihoods that are estimated, beside exact ones and beside their own stated errors.

Inverse binomial sampling asks copies of a learner what they would do; a learner that gives
probabilities can be scored exactly, too. Here both are done for every learner that allows it, on
subjects of its own and on those of another learner: how many of its own standard errors is the sum
of log-probabilities off? Of learners without exact probabilities there is nothing to compare with.
There one can ask whether the stated error is as large as the differences from one set of random
numbers to another.

    python benchmarks/likelihoods.py --json benchmarks/measured/likelihoods.json
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

import numpy as np
import pyarrow.compute as pc

import causal_openlock as ol
from causal_openlock.contract.registry import learner_class
from causal_openlock.experiment.building import make_experiment
from causal_openlock.running.runner import run
from causal_openlock.scoring.inverse_binomial import Draws
from causal_openlock.scoring.teacher_forcing import score_actions
from causal_openlock.storage.store import Store
from openlock_learners.bayes import Bayes

SHORT = ol.Protocol("short", 6, stop_when_solved=True, baseline_trials=1)
LAPSE = 0.2
SMALL: dict[str, Any] = {"hidden_units": 8, "hidden_layers": 2, "batch_size": 8, "replay_size": 16}
LIKE_PEOPLE: dict[str, Any] = {
    "policy": "thompson", "forgets": "failures", "forgetting": 0.8, "concentration": 60.0,
    "by_colour": 0.003, "directness": 1.1,
}  # fmt: skip
BOTH = [
    "random", "oracle", "ideal", "bayes",
    ol.learner("bayes", label="bayes_like_people", **LIKE_PEOPLE),
    ol.learner("bayes", label="bayes_noisy", temperature=0.5, lapse=0.1),
    ol.learner("bayes", label="bayes_consistent", policy="random_consistent"),
    "theory_based", ol.learner("theory_based", label="theory_mean", beliefs="mean"),
    "associative", "win_stay", "tabular_q", "rl2",
    ol.learner("ddqn", **SMALL), ol.learner("semi_markov_ddqn", **SMALL),
    ol.learner("bayes_net_ddqn", **SMALL),
    ol.learner("recurrent", hidden_units=8, burn_in=2, unroll=4, batch_size=2, replay_size=16),
]  # fmt: skip
OTHER = "win_stay"
CALIBRATED = ["posterior_sampling", "theory_based", "win_stay", "bayes_consistent"]
ASKED = ("bayes", "rl2", "ddqn", "semi_markov", "recurrent")
"""Those that rely on having been asked before they are told."""


def main() -> None:
    """Measure, print, and write what was found."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--subjects", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=6, help="sets of random numbers, each")
    parser.add_argument("--seeds", type=int, default=30, help="the same, where nothing is exact")
    parser.add_argument("--json", type=Path, default=None)
    asked = parser.parse_args()
    experiment = make_experiment(
        ["CC3"], [*BOTH, "posterior_sampling"], subjects=asked.subjects, protocol=SHORT, seed=3
    )
    with tempfile.TemporaryDirectory() as folder:
        run(experiment, Path(folder), workers=0)
        record, played = Store(Path(folder)).record()
    specs = {one.name: one for one in experiment.learners}
    found: dict[str, Any] = {"command": " ".join(["python", *sys.argv]), "lapse": LAPSE}

    def sums(name: str, of: str, **more: Any) -> tuple[float, float]:
        own = record.filter(pc.equal(record["learner"].cast("string"), of))
        scores = score_actions(own, played, specs[name], LAPSE, **more)
        return float(scores["log_probability"].sum()), float(
            np.sqrt((scores["standard_error"] ** 2).sum())
        )

    def by_draws(kind: type, name: str, of: str, seeds: int) -> tuple[np.ndarray, np.ndarray]:
        """Sums of log-probabilities and their errors, by so many sets of random numbers."""
        told, learn = kind.probabilities, kind.learn

        def as_promised(self: Any, step: Any) -> None:
            # A learner that gives probabilities may count on being asked for them before.
            if isinstance(self, Bayes):
                self.beliefs.enter(step.view)  # all that is needed of it
            else:
                told(self, step.view)
            learn(self, step)

        with patch.object(kind, "probabilities", lambda *_: None):
            if name.startswith(ASKED):
                with patch.object(kind, "learn", as_promised):
                    pairs = [sums(name, of, draws=Draws(seed=seed)) for seed in range(seeds)]
            else:
                pairs = [sums(name, of, draws=Draws(seed=seed)) for seed in range(seeds)]
        values, errors = np.array(pairs).T
        return values, errors

    found["agreement"] = []
    for name, spec in specs.items():
        if name == "posterior_sampling":
            continue
        for of in dict.fromkeys((name, OTHER)):
            began = time.process_time()
            exact, own_error = sums(name, of)
            drawn, errors = by_draws(learner_class(spec.learner), name, of, asked.repeats)
            error = float(np.hypot(np.sqrt((errors**2).mean() / len(errors)), own_error))
            row = {"scored": name, "of": of, "exact": round(exact, 3),
                   "drawn": round(float(drawn.mean()), 3), "standard_error": round(error, 3),
                   "errors_off": round(float((drawn.mean() - exact) / error), 2),
                   "seconds": round(time.process_time() - began, 1)}  # fmt: skip
            found["agreement"].append(row)
            print(row, flush=True)
    off = [row["errors_off"] for row in found["agreement"]]
    found["root_mean_square_of_errors_off"] = round(float(np.sqrt(np.mean(np.square(off)))), 2)
    found["calibration"] = []
    for name in CALIBRATED:
        for of in dict.fromkeys((name, OTHER)):
            values, errors = by_draws(learner_class(specs[name].learner), name, of, asked.seeds)
            row = {"scored": name, "of": of, "seeds": asked.seeds,
                   "mean": round(float(values.mean()), 3),
                   "spread": round(float(values.std(ddof=1)), 3),
                   "stated": round(float(np.sqrt((errors**2).mean())), 3)}  # fmt: skip
            found["calibration"].append(row)
            print(row, flush=True)
    if asked.json:
        asked.json.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()

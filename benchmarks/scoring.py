"""What it costs to score 40 subjects in each of the paper's six conditions by the Bayesian family.

    python benchmarks/scoring.py --json benchmarks/measured/scoring.json

Subjects are those of ``bayes_like_people``, who need as many attempts as people do. Seconds are
the processor's, on one core, for everything that ``causal-openlock score`` does once it has read
the folder: what is enumerated and planned once serves all later subjects.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

from likelihoods import LIKE_PEOPLE

import causal_openlock as ol
from causal_openlock.experiment.building import make_experiment
from causal_openlock.experiment.protocol import PAPER_CONDITIONS
from causal_openlock.running.runner import run
from causal_openlock.scoring.scores import score_learners
from causal_openlock.storage.store import Store

PEOPLE = "bayes_like_people"
FAMILY = ["bayes", ol.learner("bayes", label=PEOPLE, **LIKE_PEOPLE)]


def main() -> None:
    """Score, print seconds by part, and write what was found."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--subjects", type=int, default=40)
    parser.add_argument(
        "--folder", type=Path, help="results of these subjects, if they have played"
    )
    parser.add_argument("--json", type=Path, default=None)
    asked = parser.parse_args()
    made = make_experiment(PAPER_CONDITIONS, FAMILY[1:], subjects=asked.subjects, seed=2018)
    with tempfile.TemporaryDirectory() as own:
        if not asked.folder:
            run(made, Path(own), workers=0)
        record, played = Store(asked.folder or Path(own)).record()
    scored = make_experiment(["CC4"], FAMILY).learners
    began, at = time.process_time(), [0.0]

    def report(done: int, total: int) -> None:
        at.append(time.process_time() - began)
        print(f"{done} of {total} parts, {at[-1]:.1f} seconds", flush=True)

    scores = score_learners(record, played, scored, of=[PEOPLE], report=report)
    found = {
        "command": " ".join(["python", *sys.argv]),
        "subjects": int(
            scores.subjects["subject"].nunique() * scores.subjects["condition"].nunique()
        ),
        "learners": [one.name for one in scored],
        "actions": len(scores.actions) // len(scored),
        "seconds": round(time.process_time() - began, 1),
        "seconds_by_part": [round(later - before, 1) for before, later in pairwise(at)],
        "bits": scores.ranking.set_index("scored")["bits"].round(3).to_dict(),
    }
    print(found)
    if asked.json:
        asked.json.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()

"""Running a study of what learners measure of themselves, such as what a replay buffer holds.

A learner's metrics (:meth:`Learner.metrics`) are in no record: they are taken here at the end of
every visit, and averaged over a subject's visits. As they are means over the subjects of a cell,
each cell has one. Such studies are short, and do not continue where they stopped.
"""

from __future__ import annotations

import time

import pandas as pd

from causal_openlock.errors import EvidenceError
from causal_openlock.evidence.keeping import (
    Measured,
    Watched,
    of_this_run,
    parts_of,
    stored_whole,
    write_measured,
)
from causal_openlock.evidence.study import METRICS, Study
from causal_openlock.evidence.study_files import UNITS
from causal_openlock.experiment.declare import Cell
from causal_openlock.running.worker import made
from causal_openlock.storage.versions import versions
from causal_openlock.wording import joined


def run_metrics(study: Study, watched: Watched, anew: bool = False) -> None:
    """Play a study whose measures are metrics of learners, unless all of it is stored.

    The arguments are those of :func:`~causal_openlock.evidence.running.run_study`.

    Raises:
        EvidenceError: If a cell has several subjects, or a learner has no such metrics.
    """
    if not anew and stored_whole(study):
        return
    cells = study.asked.cells()
    if any(cell.subjects > 1 for cell in cells):
        raise EvidenceError(f"{study.experiment}: metrics are of a cell; write cell_size: 1")
    before = time.process_time()
    rows = []
    for number, cell in enumerate(cells, 1):
        rows.append(unit_of(cell))
        watched.say(f"{study.name}: {number} of {len(cells)} subjects have played")
    measured = Measured(
        tables={UNITS: pd.DataFrame(rows)},
        cells=tuple(cell.file_name for cell in cells),
        missing=0,
        seconds=time.process_time() - before,
        run=of_this_run(study, time.time(), versions()),
    )
    write_measured(study, {parts_of(study)[0].name: measured}, known=False)


def unit_of(cell: Cell) -> dict[str, object]:
    """A row of ``units.parquet``: means of the metrics over the visits of a cell's only subject.

    Raises:
        EvidenceError: If its learner has no such metrics.
    """
    session, learner = made(cell)
    session.begin(learner)
    found = [learner.metrics() for step in session.steps(learner) if step.trial_over.any()]
    if missing := [name for name in METRICS if name not in found[-1]]:
        raise EvidenceError(f"{cell.spec.name} has no metric {joined(missing)}")
    means = pd.DataFrame(found)[[*METRICS]].mean()
    return {
        "learner": cell.spec.name,
        "condition": cell.condition.name,
        "protocol": cell.spec.protocol.name,
        "phase": "train",
        "judged": True,
        "unit": cell.first_subject,
        "trials": len(found),
        **means,
    }

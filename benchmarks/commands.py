"""What a user waits for: ``make compare``, and the report that it ends with.

Both are processes, timed in seconds of the processor. The peer is another checkout of this project
(``--against``), run by the same Python, so that a change is measured in one run; without one, it is
24 figures, about as many as a report has, drawn by matplotlib alone. Entry points stay those of the
installed checkout, so the other one has to have the same learners and commands.
"""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from measure import Measurement, Row, in_turns

ROOT = Path(__file__).parent.parent
COMMAND = [sys.executable, "-m", "causal_openlock"]
FIGURES = """\
import io
from matplotlib.figure import Figure
for _ in range(24):
    figure = Figure((7.2, 4.0), layout="constrained")
    for axes in figure.subplots(2, 2).flat:
        axes.plot(range(10), label="a")
        axes.legend()
    figure.savefig(io.BytesIO(), format="svg")
"""


def commands(turns: int, against: Path | None = None) -> Iterator[Row]:
    """The comparison ``default``, and its report once it is played."""
    for case, ours, peer_name, peer in _cases(against):
        yield in_turns(case, "s", ours, peer_name, peer, turns)


def _cases(against: Path | None) -> Iterator[tuple[str, Measurement, str, Measurement]]:
    places = [ROOT, *([against] if against else [])]
    name = str(against) if against else "24 figures of matplotlib"
    with tempfile.TemporaryDirectory() as folder:
        played = [Path(folder, str(number)) for number in range(len(places))]

        def compared(place: int) -> float:
            shutil.rmtree(played[place], ignore_errors=True)
            return _processor(
                [*COMMAND, "compare", "default", "--out", str(played[place])], places[place]
            )

        def reported(place: int) -> float:
            return _processor([*COMMAND, "report", str(played[place])], places[place])

        def figures() -> float:
            return _processor([sys.executable, "-c", FIGURES], ROOT)

        for case, measure in (("compare default", compared), ("report of default", reported)):
            yield case, partial(measure, 0), name, partial(measure, 1) if against else figures


def _processor(command: list[str], checkout: Path) -> float:
    """Seconds of the processor that a process takes, its workers included."""
    path = os.pathsep.join((str(checkout), str(checkout / "learners")))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        command,
        check=True,
        cwd=tempfile.gettempdir(),
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

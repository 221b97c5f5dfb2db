"""Start-up: how long a fresh process takes, against one that imports Gymnasium.

The time is that of the whole process, as a user waits for it.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

from measure import Measurement, Row, Target, in_turns, stopwatch

PEER = "import gymnasium"
CASES = {
    "import causal_openlock": (["-c", "import causal_openlock"], Target("at most", 1.5)),
    "causal-openlock --help": (["-m", "causal_openlock", "--help"], Target("under", 2)),
}
HEAVY = ("torch", "pgmpy", "matplotlib", "pandas", "scipy", "pyarrow", "networkx", "pydantic")
FORBIDDEN = {"torch", "pgmpy", "matplotlib"}


def startup(repeats: int) -> Iterator[Row]:
    """Importing the package, and asking the command line for help."""
    peer = _process(["-c", PEER])
    for case, (arguments, target) in CASES.items():
        mine, others = in_turns(_process(arguments), peer, repeats)
        loaded = _loaded(arguments)
        broken = FORBIDDEN.intersection(loaded)
        yield Row(
            "startup",
            case,
            "s",
            mine,
            PEER,
            others,
            target,
            broken=f"it loads {', '.join(sorted(broken))}" if broken else "",
            note=f"of {', '.join(HEAVY)} it loads {', '.join(loaded) or 'none'}",
        )


def _process(arguments: list[str]) -> Measurement:
    def measure() -> float:
        with stopwatch() as seconds:
            subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
            return seconds()

    return measure


def _loaded(arguments: list[str]) -> list[str]:
    """Which of the heavy packages a process loads, as Python's own list of imports tells."""
    said = subprocess.run(
        [sys.executable, "-X", "importtime", *arguments],
        check=True,
        capture_output=True,
        text=True,
    ).stderr
    imported = {line.rsplit("|", 1)[-1].strip() for line in said.splitlines() if "|" in line}
    return [package for package in HEAVY if package in imported]

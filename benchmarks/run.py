"""How fast the toolkit is, against named peers: ``python benchmarks/run.py``.

Every row is the median of the ratios of repeated turns, with the least and the most of them; on a
busy machine look at ratios, and run it again where they spread.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

# One core. NumPy and torch read this when they are loaded, so benchmarks are imported after it.
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
HOMES = {"environments": "environments", "ddqn": "learning", "commands": "commands"}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", metavar="NAME", nargs="+", choices=HOMES, default=list(HOMES))
    parser.add_argument("--turns", metavar="N", type=int, default=3, help="turns (default 3)")
    parser.add_argument(
        "--against", metavar="FOLDER", type=Path, help="another checkout, as peer of commands"
    )
    parser.add_argument("--json", metavar="FILE", type=Path, help="write every measurement here")
    chosen = parser.parse_args(arguments)
    if chosen.turns < 1:
        parser.error("--turns must be at least 1")
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    rows = []
    for name in chosen.only:
        benchmark = getattr(import_module(HOMES[name]), name)
        if name == "commands":
            benchmark = partial(benchmark, against=chosen.against and chosen.against.resolve())
        for row in benchmark(chosen.turns):
            print(row, flush=True)
            rows.append(row)
    where = machine()
    print(", ".join(f"{key} {value}" for key, value in where.items()))
    if chosen.json:
        told = [vars(row) | {"ratios": row.ratios} for row in rows]
        text = json.dumps({"machine": where, "rows": told}, indent=1)
        chosen.json.write_text(text + "\n", encoding="utf-8")


def machine() -> dict[str, str]:
    """What this ran on."""
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    packages = ("numpy", "gymnasium", "torch", "stable-baselines3", "matplotlib")
    return {
        "CPU": models[0] if models else platform.processor() or platform.machine(),
        "cores": str(os.cpu_count()),
        "load": f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown",
        "Python": platform.python_version(),
        **{package: version(package) for package in packages},
    }


if __name__ == "__main__":
    main()

"""How fast the toolkit is, against named peers: ``python benchmarks/run.py``.

Every number is the median of repeated turns, with its spread in brackets; on a busy machine look
at the ratios, and run it again where they spread. A missed target is reported and is no error.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import Any

# Everything is about one core. NumPy and torch read this when they are loaded, which is why the
# benchmarks are imported only after it.
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
HOMES = {
    "single": "environments",
    "vector": "environments",
    "session": "sessions",
    "memory": "memory",
    "startup": "startup",
    "ddqn": "learning",
    "meta_training": "learning",
    "beliefs": "beliefs",
    "physics": "physics",
    "playing": "playing",
    "rendering": "rendering",
    "reporting": "reporting",
}
SCALES = {
    "steps/s": ((1e6, "M/s"), (1e3, "k/s"), (1, "/s")),
    "actions/s": ((1e6, "M/s"), (1e3, "k/s"), (1, "/s")),
    "frames/s": ((1e3, "k/s"), (1, "/s")),
    "pairs/s": ((1e6, "M/s"), (1e3, "k/s"), (1, "/s")),
    "subjects/s": ((1, "/s"),),
    "s": ((1e-3, "ms"),),
    "bytes/attempt": ((1, "B"),),
}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", metavar="NAME", nargs="+", choices=HOMES, default=list(HOMES))
    parser.add_argument("--repeats", metavar="N", type=int, default=5, help="turns (default 5)")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write every measurement here")
    chosen = parser.parse_args(arguments)
    if chosen.repeats < 1:
        parser.error("--repeats must be at least 1")

    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    from rich.console import Console

    console = Console()
    if not console.is_terminal:
        console = Console(width=140)
    rows = []
    for name in chosen.only:
        with console.status(f"measuring: {name}"):
            benchmark = getattr(import_module(HOMES[name]), name)
            rows += list(benchmark(chosen.repeats))
    where = machine()
    if chosen.json:
        said = {"machine": where, "repeats": chosen.repeats, "rows": [r.as_dict() for r in rows]}
        chosen.json.write_text(json.dumps(said, indent=1) + "\n", encoding="utf-8")
    show(console, rows, chosen.repeats)
    console.print(", ".join(f"{key} {value}" for key, value in where.items()), highlight=False)


def show(console: Any, rows: Sequence[Any], repeats: int) -> None:
    """Print the table, and below it what the rows have to add."""
    from rich.table import Table

    table = Table(title=f"Median of {repeats} turns (least..most)")
    for heading in ("benchmark", "case", "ours", "peer", "ours / peer", "target", "reached"):
        table.add_column(heading, justify="right" if "ours" in heading else "left")
    last = ""
    for row in rows:
        if last and row.benchmark != last:
            table.add_section()
        table.add_row(
            row.benchmark if row.benchmark != last else "",
            row.case,
            spread(row.ours, row.unit),
            f"{amount(median(row.peer), row.unit)} {row.peer_name}" if row.peer else "",
            spread(row.ratios) if row.peer else "",
            wanted(row),
            {None: "", True: "[green]yes[/green]", False: "[bold red]no[/bold red]"}[row.reached],
        )
        last = row.benchmark
    console.print(table)
    for row in rows:
        if row.note or row.broken:
            said = "; ".join(filter(None, (row.broken, row.note)))
            console.print(f"{row.case}: {said}", highlight=False)


def amount(value: float, unit: str) -> str:
    """A number with its unit, scaled to be read."""
    scale, name = next((x for x in SCALES[unit] if value >= x[0]), SCALES[unit][-1])
    return f"{value / scale:.3g} {name}"


def spread(values: Sequence[float], unit: str | None = None) -> str:
    """The median, and the least and the most in brackets."""
    scale, name = 1.0, "x"
    if unit:
        scales = SCALES[unit]
        scale, name = next((x for x in scales if median(values) >= x[0]), scales[-1])
    middle, least, most = (f"{f(values) / scale:.3g}" for f in (median, min, max))
    return f"{middle} {name} ({least}..{most})"


def wanted(row: Any) -> str:
    """The target in words."""
    if row.target is None:
        return ""
    bound = row.target.bound
    said = f"{bound:g}x" if row.target.on == "ratio" else amount(bound, row.unit)
    return f"{row.target.sense} {said}"


def machine() -> dict[str, str]:
    """What this ran on."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    told = {
        "cores": str(cores),
        "CPU": _cpu(),
        "Python": platform.python_version(),
        "NumPy": version("numpy"),
        "Gymnasium": version("gymnasium"),
    }
    if hasattr(os, "getloadavg"):
        told["load"] = f"{os.getloadavg()[0]:.1f}"
    return told


def _cpu() -> str:
    path = Path("/proc/cpuinfo")
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


if __name__ == "__main__":
    main()

"""Single-bit flips over the files of a results folder: is every one of them noticed?

Cells of several sizes are played, and ``experiment.json`` is taken with them. Then bits are flipped
one at a time, at places drawn at random over all bytes of each file, and the file is read as every
reader reads it. A flip is *noticed* if that says in a sentence that the file is damaged; otherwise
it was read as the *same* table, as *another* one, or ended in a *foreign* exception. All but the
first column of what is printed should be nought:

    python benchmarks/bit_flips.py --flips 30000
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

EXPERIMENT = """\
name: flips
seed: 9
cell_size: {size}
subjects: {size}
protocol: {protocol}
conditions: [CC4, {{name: anywhere, train: [{{schema: CC4, layouts: random, trials: 5}}]}}]
learners: [random, oracle]
protocols:
  short: {{attempt_limit: 6, baseline_trials: 2}}
"""
SIZES = ((1, "short"), (5, "human"), (40, "human"), (200, "human"))
"""Subjects in a cell, and its protocol: cells of 10 to 80 kB."""
KINDS = ("noticed", "same", "another", "foreign")


def main() -> int:
    """Flip bits and count; returns 1 if one was not noticed."""
    asked = argparse.ArgumentParser(description="Flip bits in the files of results folders.")
    asked.add_argument("--flips", type=int, default=30_000)
    asked.add_argument("--seed", type=int, default=0)
    given = asked.parse_args()
    rng = np.random.default_rng(given.seed)
    total: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        files = list(results(Path(folder)))
        print(f"{'file':44} {'bytes':>9} {'flips':>7}", *(f"{kind:>8}" for kind in KINDS))
        for number, (path, read) in enumerate(files):
            flips = given.flips // len(files) + (number < given.flips % len(files))
            counts = flipped(path, read, flips, rng)
            total += counts
            size = path.stat().st_size
            print(
                f"{path.name[:44]:44} {size:9,} {flips:7,}",
                *(f"{counts[kind]:8,}" for kind in KINDS),
            )
    print(f"{'all':54} {given.flips:7,}", *(f"{total[kind]:8,}" for kind in KINDS))
    return int(total["noticed"] != given.flips)


def results(folder: Path) -> list[tuple[Path, Callable[[], Any]]]:
    """Results folders of several sizes: their files, and how each is read."""
    from concurrent.futures import ThreadPoolExecutor

    from causal_openlock.experiment.file import read_experiment
    from causal_openlock.running.runner import run

    found: list[tuple[Path, Callable[[], Any]]] = []
    for size, protocol in SIZES:
        declared = folder / f"{size}.yaml"
        declared.write_text(EXPERIMENT.format(size=size, protocol=protocol), encoding="utf-8")
        with ThreadPoolExecutor(1) as pool:
            store = run(read_experiment(declared), folder / str(size), executor=pool)
        found.append((store.folder / "experiment.json", store.description))
        for path in store.files()[0]:
            found.append((path, lambda store=store, path=path: store.read(path)))
    return found


def flipped(
    path: Path, read: Callable[[], Any], flips: int, rng: np.random.Generator
) -> Counter[str]:
    """What came of single bits flipped in a file; in the end it is as it was."""
    from causal_openlock.errors import StoreError

    content, true = path.read_bytes(), read()
    counts: Counter[str] = Counter()
    for place in rng.integers(8 * len(content), size=flips).tolist():
        changed = bytearray(content)
        changed[place // 8] ^= 1 << place % 8
        path.write_bytes(changed)
        try:
            held = read()
        except StoreError as error:
            counts["noticed" if "is damaged" in str(error) else "foreign"] += 1
        except Exception:
            counts["foreign"] += 1
        else:
            same = held.equals(true) if hasattr(held, "equals") else held == true
            counts["same" if same else "another"] += 1
    path.write_bytes(content)
    return counts


if __name__ == "__main__":
    sys.exit(main())

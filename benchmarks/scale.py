"""How cost grows: ``python benchmarks/scale.py --out docs/figures/scale.svg``.

Measures what a comparison costs as subjects, levers, attempts on record and workers grow, and
draws it. Costs are seconds of the processor, which a busy machine changes little; of workers wall
time is measured, too. A measurement that is expected to take longer than ``--patience`` is left
out, and so are larger ones. Beside the figure, with the same name, are the CSV of its numbers, and
what they were measured on. Costs against hypotheses are those of ``belief_scaling.py``.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import resource
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from run import ONE_THREAD, machine

HYPOTHESES = Path(__file__).parents[1] / "docs" / "figures" / "belief_scaling.json"
LEARNERS = ("random", "tabular_q", "bayes", "ddqn")
CONDITION = "CC3-CC4"
MEASURED = ("subjects", "levers", "attempts", "workers")


class Cost(NamedTuple):
    """One measurement: what it costs (``value``) for how many (``size``) of what grows."""

    grows: str
    of: str
    size: int
    value: float
    unit: str


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", metavar="FILE", type=Path, required=True, help="the figure")
    parser.add_argument("--only", nargs="+", choices=MEASURED, default=MEASURED, help="these parts")
    parser.add_argument("--redraw", action="store_true", help="draw the numbers that are there")
    parser.add_argument("--patience", type=float, default=10.0, help="seconds a measurement")
    parser.add_argument("--subjects", type=int, default=10_000, help="at most")
    parser.add_argument("--levers", type=int, default=12, help="at most")
    parser.add_argument("--attempts", type=int, default=1_000_000, help="on record, at most")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="at most")
    chosen = parser.parse_args()
    numbers = chosen.out.with_suffix(".csv")
    if not chosen.redraw:
        os.environ.update(dict.fromkeys(ONE_THREAD, "1"))  # before NumPy is loaded
        there = _read(numbers) if numbers.exists() else []
        costs = [cost for cost in there if cost.grows not in chosen.only]
        for cost in measure(chosen):
            costs.append(cost)
            print(f"{cost.grows:9} {cost.of:22} {cost.size:>9,} {cost.value:.4g} {cost.unit}")
        chosen.out.parent.mkdir(parents=True, exist_ok=True)
        with numbers.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([Cost._fields, *costs])
        about = json.dumps(machine(), indent=1) + "\n"
        chosen.out.with_suffix(".json").write_text(about, encoding="utf-8")
    draw([*_read(numbers), *hypotheses()], chosen.out)


def _read(numbers: Path) -> list[Cost]:
    with numbers.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return [
        Cost(one["grows"], one["of"], int(one["size"]), float(one["value"]), one["unit"])
        for one in rows
    ]


# -- measuring ------------------------------------------------------------------------------------


def measure(chosen: Any) -> Iterator[Cost]:
    """All that was asked for."""
    parts = {
        "subjects": lambda: subjects(chosen.subjects, chosen.patience),
        "levers": lambda: levers(chosen.levers, chosen.patience),
        "attempts": lambda: attempts(chosen.attempts, chosen.patience),
        "workers": lambda: workers(chosen.workers),
    }
    for part in chosen.only:
        yield from parts[part]()


def subjects(most: int, patience: float) -> Iterator[Cost]:
    """One cell of more and more subjects, in people's protocol."""
    from causal_openlock import Condition, Session, create, find_schema
    from causal_openlock.experiment.protocol import PROTOCOLS

    condition = Condition.named(CONDITION, find_schema)

    def played(learner: str, many: int) -> float:
        began = time.process_time()
        Session(condition, PROTOCOLS["human"], many).play(create(learner))
        return time.process_time() - began

    for learner in LEARNERS:
        played(learner, 1)  # what is loaded and compiled once
        yield from _growing("subjects", learner, _decades(0, most), played, patience)


def levers(most: int, patience: float) -> Iterator[Cost]:
    """One subject in two trials with a common cause of more and more levers."""
    from belief_levers import rooms

    from causal_openlock import Condition, Session, create
    from causal_openlock.experiment.protocol import PROTOCOLS

    protocol = replace(PROTOCOLS["human"], baseline_trials=2)

    def played(learner: str, many: int) -> float:
        schema = next(one for one in rooms(many) if one.name.startswith("cause"))
        began = time.process_time()
        condition = Condition.named(schema.name, {schema.name: schema}.__getitem__)
        Session(condition, protocol, 1).play(create(learner))
        return time.process_time() - began

    for learner in LEARNERS:
        yield from _growing("levers", learner, range(3, most + 1), played, patience)


def attempts(most: int, patience: float) -> Iterator[Cost]:
    """To keep a record of more and more attempts, to read it, to summarise it; and its size."""
    from causal_openlock import Condition, Session, create, find_schema
    from causal_openlock.analysis.results.summary import summary_table
    from causal_openlock.experiment.protocol import PROTOCOLS
    from causal_openlock.experiment.record import compact
    from causal_openlock.files.checksums import read_table, table_bytes

    condition = Condition.named("CC4", find_schema)
    for many in _decades(4, most):
        record = Session(condition, PROTOCOLS["human"], -(-many // 150)).play(create("random"))
        record = record.slice(0, many)
        took, content = {}, b""
        began = time.process_time()
        content = table_bytes(record, {})
        took["written"] = time.process_time() - began
        began = time.process_time()
        read = compact(read_table(content))
        took["read"] = time.process_time() - began
        began = time.process_time()
        summary_table(read)
        took["summarised"] = time.process_time() - began
        for name, seconds in took.items():
            yield Cost("attempts", name, many, seconds, "s")
        yield Cost("attempts", "on disk", many, len(content), "bytes")
        if 10 * sum(took.values()) > patience:
            return


EXPERIMENT = """\
name: scale
subjects: {cells}
cell_size: 1
conditions: [CC4]
protocol: long
protocols: {{long: {{based_on: rl, baseline_loops: {loops}}}}}
learners: [random]
"""


def workers(most: int) -> Iterator[Cost]:
    """What more workers cost and gain, and what a cell costs the one who hands it out."""
    from causal_openlock.experiment.file import read_experiment
    from causal_openlock.running.runner import run

    with tempfile.TemporaryDirectory() as place:
        file = Path(place, "scale.yaml")

        def timed(name: str, cells: int, loops: int, **options: Any) -> tuple[float, float, float]:
            """Wall time, and the processor's: of this process, and of all."""
            file.write_text(EXPERIMENT.format(cells=cells, loops=loops), encoding="utf-8")
            experiment = read_experiment(file)
            began = time.perf_counter(), _used(), _used(resource.RUSAGE_CHILDREN)
            run(experiment, Path(place, name), **options)
            own = _used() - began[1]
            of_all = own + _used(resource.RUSAGE_CHILDREN) - began[2]
            return time.perf_counter() - began[0], own, of_all

        def kinds(many: int) -> list[tuple[str, dict[str, Any]]]:
            return [("processes", {"workers": many}), ("Dask", {"cluster": f"local:{many}"})]

        many = 1
        while many <= most:
            for kind, options in kinds(many):
                wall, _, of_all = timed(f"{kind}{many}", 8, 8, **options)
                yield Cost("workers", f"{kind}, wall", many, wall, "s")
                yield Cost("workers", f"{kind}, processor", many, of_all, "s")
            many *= 2
        for kind, options in kinds(2):
            few, lots = (timed(f"{kind}of{n}", n, 1, **options)[1] for n in (10, 50))
            yield Cost("workers", f"{kind}, own time a cell", 1, (lots - few) / 40, "s")


def _used(who: int = resource.RUSAGE_SELF) -> float:
    used = resource.getrusage(who)
    return used.ru_utime + used.ru_stime


def _growing(grows: str, of: str, sizes: Any, played: Any, patience: float) -> Iterator[Cost]:
    """Costs of a learner for more and more, until the next would take too long."""
    before, last = 0.0, 0
    for size in sizes:
        if last and before * (size / last) > patience:
            return
        before, last = played(of, size), size
        yield Cost(grows, of, size, before, "s")


def _decades(least: int, most: int) -> list[int]:
    return [10**power for power in range(least, 9) if 10**power <= most]


def hypotheses() -> Iterator[Cost]:
    """What ``belief_scaling.py`` has measured."""
    costs = json.loads(HYPOTHESES.read_text(encoding="utf-8"))["costs"]
    for cost in costs:
        if cost["measured"] in ("update", "decision, capped"):
            yield Cost("hypotheses", cost["measured"], cost["hypotheses"], cost["value"], "s")


# -- drawing --------------------------------------------------------------------------------------

PANELS = {
    "subjects": ("Subjects of a cell", f"{CONDITION}, people's protocol"),
    "levers": ("Active levers", "a subject, common cause"),
    "hypotheses": ("Hypotheses", "one decision, one update"),
    "attempts": ("Attempts on record", "of random, in one cell"),
    "workers": ("Workers", "eight cells, all processes"),
}
COLOURS = ("#00427A", "#E69F00", "#009E73", "#D55E00")
MARKERS = "osD^"


def draw(costs: list[Cost], path: Path) -> None:
    """A panel for each thing that grows, time against how many there are."""
    from matplotlib.figure import Figure

    from causal_openlock.analysis.plots import style

    with style.settings():
        figure = Figure(figsize=(style.WIDTH, 5.2), layout="constrained")
        panels = figure.subplots(2, 3).flatten()
        for axes, (grows, (title, about)) in zip(panels, PANELS.items(), strict=False):
            here = [cost for cost in costs if cost.grows == grows and cost.unit == "s"]
            # Wall times say little of a machine that does other work.
            here = [cost for cost in here if "a cell" not in cost.of and "wall" not in cost.of]
            for index, of in enumerate(dict.fromkeys(cost.of for cost in here)):
                line = [(cost.size, cost.value) for cost in here if cost.of == of]
                axes.plot(
                    *zip(*line, strict=True),
                    color=COLOURS[index], marker=MARKERS[index], ms=4, lw=1.2,
                    label=of.removesuffix(", processor"),
                )  # fmt: skip
            axes.set(xscale="linear" if grows == "levers" else "log", yscale="log")
            if grows == "workers":
                axes.set(yscale="linear", ylim=(0, None))
            if grows in ("levers", "workers"):
                ticks = sorted({cost.size for cost in here})
                axes.set_xticks(ticks, ticks, minor=False)
                axes.minorticks_off()
            axes.set_ylabel("Seconds")
            below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.12)}
            axes.legend(fontsize=7, ncols=2, handlelength=1.4, columnspacing=1.0, **below)
            style.panel_title(axes, title, about)
        panels[-1].axis("off")
        style.save(figure, path.with_suffix(""))


if __name__ == "__main__":
    main()

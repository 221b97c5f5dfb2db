"""What beliefs cost as hypotheses grow: ``python benchmarks/belief_scaling.py --out FILE.svg``.

One subject stands in a room of seven active levers and holds structures that fit what it sees, all
equally probable: nothing is as costly to plan with as not to know anything. The structures are
drawn from the free form, and each is taken with its levers renamed in several ways, which keeps
what they have to fit. Beside the figure, with the same name and suffix, is the CSV of its numbers.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import time
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from run import ONE_THREAD, machine

ROOM = "seven"
PER_DECADE, LEAST, MOST = 2, 2, 6  # from 10^2 to 10^6
PATIENCE = 20.0  # seconds; what took longer is not measured with more hypotheses
ENOUGH = 0.1  # seconds of a measurement at least
SLOW = 2.0  # seconds; what takes longer is done once
RENAMED = 50  # ways in which the levers of a drawn structure are called
BATCH = 5000


class Cost(NamedTuple):
    """One measurement."""

    measured: str
    hypotheses: int
    value: float
    unit: str


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", metavar="FILE", type=Path, required=True, help="the figure")
    parser.add_argument("--redraw", action="store_true", help="draw the numbers that are there")
    chosen = parser.parse_args()
    numbers = chosen.out.with_suffix(".json")
    if not chosen.redraw:
        os.environ.update(dict.fromkeys(ONE_THREAD, "1"))  # before NumPy is loaded
        said = {"machine": machine(), "costs": [cost._asdict() for cost in measure()]}
        chosen.out.parent.mkdir(parents=True, exist_ok=True)
        numbers.write_text(json.dumps(said, indent=1) + "\n", encoding="utf-8")
    costs = json.loads(numbers.read_text(encoding="utf-8"))["costs"]
    draw([Cost(**cost) for cost in costs], chosen.out)


# -- measuring ------------------------------------------------------------------------------------


def measure() -> Iterator[Cost]:
    """Time and memory for more and more hypotheses, and how many real rooms have."""
    import numpy as np

    from causal_openlock import Condition, Session, find_schema
    from causal_openlock.belief.beliefs import Belief
    from causal_openlock.experiment.protocol import PROTOCOLS
    from openlock_learners.bayes import Bayes, BayesParameters

    for name, noise in (("CC3", 0.0), ("CC4", 0.0), ("noisy_CC3", 0.5)):
        session = Session(Condition.named(name, find_schema), PROTOCOLS["human"], 1)
        learner = Bayes(BayesParameters(noise=noise))
        learner.begin(session.brief)
        learner.beliefs.enter(session.view)
        many = len(learner.belief(0).which)
        yield Cost(f"room {name}", many, float(many), "hypotheses")

    sizes = [
        round(10 ** (e / PER_DECADE)) for e in range(LEAST * PER_DECADE, MOST * PER_DECADE + 1)
    ]
    session = Session(Condition.named(ROOM, find_schema), PROTOCOLS["human"], 1)
    view = session.view
    learners = {}
    for name, planned in (("capped", BayesParameters().planned), ("uncapped", 10**9)):
        learners[name] = Bayes(BayesParameters(planned=planned))
        learners[name].begin(session.brief)
    capped = learners["capped"]
    step = session.step(np.array([0]))
    whole = _space(sizes[-1])
    slow: set[str] = set()
    for many in sizes:
        space = _part(whole, many)
        share = np.full(many, 1.0 / many)

        def believe(learner: Any, space: Any = space, share: Any = share) -> None:
            # A space of its own each time, for plans are kept by space.
            which, slots = np.arange(len(share)), np.arange(7)
            learner.beliefs.of[0] = Belief(replace(space), slots, which, share.copy())

        cases: dict[str, tuple[Any, Callable[[], Any]]] = {
            "update": (capped, lambda: capped.beliefs.update(step)),
            "information": (capped, lambda: capped.gains(0, view)),
            "decision, capped": (capped, lambda: capped.act(view)),
            "decision": (learners["uncapped"], lambda: learners["uncapped"].act(view)),
        }
        for name, (learner, work) in cases.items():
            if name not in slow:
                took = _seconds(lambda learner=learner: believe(learner), work)
                yield Cost(name, many, took, "s")
                if took > PATIENCE:
                    slow.add(name)
        believe(capped)
        belief = capped.belief(0)
        yield Cost("belief", many, belief.which.nbytes + belief.weight.nbytes, "bytes")
        own = space.hypotheses
        shared = sum(getattr(own, field).nbytes for field in own.__dataclass_fields__)
        yield Cost("shared", many, shared, "bytes")
        for name in ("update", "information", "decision, capped"):
            learner, work = cases[name]
            believe(learner)
            yield Cost(f"{name}, peak", many, _peak(work), "bytes")


def _space(many: int) -> Any:
    """So many structures of seven levers as hypotheses about the room."""
    import numpy as np

    from causal_openlock.belief.catalogue import Catalogue, fits
    from causal_openlock.belief.hypotheses import Block, RoomSight, Space, strengths
    from causal_openlock.belief.knowledge import Prior
    from causal_openlock.belief.sampling import Sampler
    from causal_openlock.belief.structures import Structures

    sight = RoomSight(positions=7, grey=7, solutions=3, action_limit=4)
    generator = np.random.default_rng(0)
    sampler = Sampler(7, Prior().simplicity, 1.0)
    parts: list[Structures] = []
    while sum(map(len, parts)) < many:
        drawn = sampler.draw(BATCH, generator)[0]
        drawn = drawn[fits(drawn, sight.solutions, sight.action_limit)]
        parts += [drawn.on_slots(generator.permutation(7), 7) for _ in range(RENAMED)]
    order = generator.permutation(sum(map(len, parts)))[:many]
    members = Structures(
        np.concatenate([part.causes for part in parts])[order],
        np.concatenate([part.threshold for part in parts])[order],
    )
    index = np.arange(many)
    own = Catalogue(members, index, index, np.zeros_like(index), np.full(many, 1 / many))
    block = Block(tuple(range(7)), own)
    hypotheses = block.placed(sight.positions)
    return Space(sight, strengths(0.0, 1.0, 1.0, 1), (block,), hypotheses)


def _part(space: Any, many: int) -> Any:
    import numpy as np

    return replace(space, hypotheses=space.hypotheses[np.arange(many)])


def _seconds(prepare: Callable[[], None], work: Callable[[], Any]) -> float:
    """The median time of the processor for some work, which a busy machine changes little."""
    times: list[float] = []
    while not times or (times[0] < SLOW and len(times) < 6) or sum(times) < ENOUGH:
        prepare()
        gc.collect()
        began = time.process_time()
        work()
        times.append(time.process_time() - began)
    return median(times[1:] or times)  # the first is colder than the others


def _peak(work: Callable[[], Any]) -> float:
    """The most bytes that some work holds in addition."""
    tracemalloc.start()
    work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return float(peak)


# -- drawing --------------------------------------------------------------------------------------

LOOKS: dict[str, tuple[str, str, str]] = {  # name, colour, marker
    "decision": ("decision, every hypothesis planned for", "#D55E00", "^"),
    "decision, capped": ("decision of the learner, which plans for some", "#E69F00", "D"),
    "information": ("expected information, all next actions", "#56B4E9", "s"),
    "update": ("update by one action", "#00427A", "o"),
    "information, peak": ("while the information is computed", "#56B4E9", "s"),
    "decision, capped, peak": ("while it decides", "#E69F00", "D"),
    "update, peak": ("while it updates", "#00427A", "o"),
    "shared": ("the hypotheses, shared by all subjects", "#009E73", "v"),
    "belief": ("the belief of a subject", "#000000", "p"),
}
TIMES = {1e-4: "0.1 ms", 1e-3: "1 ms", 1e-2: "10 ms", 0.1: "0.1 s", 1.0: "1 s", 10.0: "10 s"}
BYTES = {
    1e3: "1 kB",
    1e4: "10 kB",
    1e5: "100 kB",
    1e6: "1 MB",
    1e7: "10 MB",
    1e8: "100 MB",
    1e9: "1 GB",
}


def draw(costs: list[Cost], path: Path) -> None:
    """Draw time and memory against the number of hypotheses."""
    from matplotlib.figure import Figure

    from causal_openlock.analysis.plots import style

    rooms = {cost.measured[5:]: cost.hypotheses for cost in costs if cost.unit == "hypotheses"}
    with style.settings():
        figure = Figure(figsize=(style.WIDTH, 3.8), layout="constrained")
        left, right = figure.subplots(1, 2)
        _panel(left, [cost for cost in costs if cost.unit == "s"], TIMES)
        _panel(right, [cost for cost in costs if cost.unit == "bytes"], BYTES)
        style.panel_title(left, "Time on one core", "seven active levers, four actions an attempt")
        style.panel_title(right, "Memory", "of one subject, but for what is shared")
        for axes in (left, right):
            _mark_rooms(axes, rooms)
        style.save(figure, path.with_suffix(""))


def _panel(axes: Any, costs: list[Cost], ticks: dict[float, str]) -> None:
    for name, (label, colour, marker) in LOOKS.items():
        line = [(cost.hypotheses, cost.value) for cost in costs if cost.measured == name]
        if line:
            axes.plot(
                *zip(*line, strict=True),
                color=colour, marker=marker, ms=4.5, lw=1.3, label=label, mec="white", mew=0.4,
            )  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel="Hypotheses (marked: before the first action)")
    low, high = min(cost.value for cost in costs), max(cost.value for cost in costs)
    axes.set_yticks(list(ticks), list(ticks.values()))
    axes.minorticks_off()
    axes.set_ylim(low / 25, high * (high / low) ** 0.5)  # a third of the panel is for the legend
    axes.legend(loc="upper left", borderaxespad=0.2, handlelength=1.8, fontsize=7.5)


def _mark_rooms(axes: Any, rooms: dict[str, int]) -> None:
    """Say how many hypotheses a subject begins with in real rooms."""
    floor = axes.get_xaxis_transform()
    for name, many in rooms.items():
        axes.plot([many, many], [0, 0.03], color="#444444", lw=1.0, transform=floor)
        axes.text(
            many, 0.04, name.replace("_", " "),
            rotation=90, ha="center", va="bottom", fontsize=6.5, color="#444444", transform=floor,
        )  # fmt: skip


if __name__ == "__main__":
    main()

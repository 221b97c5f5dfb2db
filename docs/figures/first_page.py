"""Draw the README's figures: ``python docs/figures/first_page.py``.

The graphs of CC4 and CE4 as the schemas declare them; people and learners trial by trial, and what
learning costs, from what the study ``evidence/default`` stored. The last line of these two files
names their source with its SHA-256, which a test compares. Takes seconds; nothing is played.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from causal_openlock.analysis.plots import style
from causal_openlock.analysis.topics.learning_cost import draw_costs
from causal_openlock.files.atomic import write_text
from causal_openlock.paper.likeness import points_of, points_of_people
from causal_openlock.render.graph import draw_schema
from causal_openlock.schemas.finding import find_schema

HERE = Path(__file__).parent
STUDY = HERE.parents[1] / "evidence" / "default"
SOURCES = {"people_and_learners.svg": "units.parquet", "cost_of_learning.svg": "costs.parquet"}
LEARNERS = ["theory_based", "bayes", "rl2", "ddqn"]
TESTS = ["CC3-CC4", "CE3-CC4", "CC3-CE4", "CE3-CE4"]
LIMIT = 30


def graphs() -> Figure:
    """The common cause CC4 beside the common effect CE4."""
    figure = Figure(figsize=(4.2, 2.3))
    for place, (name, meaning) in enumerate((("CC4", "common cause"), ("CE4", "common effect"))):
        axes = figure.add_axes((0.5 * place, 0.02, 0.5, 0.84))
        draw_schema(find_schema(name), axes)
        axes.set_title(f"{name}: {meaning}", fontsize=10, fontweight="bold")
    return figure


def people_and_learners(units: pd.DataFrame) -> Figure:
    """Mean attempts in each trial of the baselines and in the four tests of transfer."""
    own = units[units["learner"].isin(LEARNERS)].rename(columns={"unit": "subject"})
    played = points_of(own.assign(experiment="default", seed=0, loop=1))
    means = pd.concat([points_of_people(), played], ignore_index=True)
    with style.settings():
        figure = Figure(figsize=(style.WIDTH, 2.9), layout="constrained")
        panels = figure.subplots(1, 3, sharey=True, width_ratios=(1, 1, 1.15))
        for axes, name in zip(panels, ("CC4", "CE4", ""), strict=True):
            for learner, look in looks().items():
                _course(axes, means[means["learner"] == learner], name, look)
            axes.axhline(LIMIT, color="#666666", lw=0.8, ls=(0, (1, 1.5)), zorder=0)
            axes.set_ylim(0, LIMIT + 2)
        for axes, name in zip(panels[:2], ("common cause", "common effect"), strict=True):
            axes.set_title(f"{name[0].upper()}{name[1:]}, four levers", loc="left")
            axes.set(xlabel="Trial: each in a new room", xticks=range(1, 6), xlim=(0.7, 5.3))
        panels[0].set_ylabel("Attempts until solved")
        panels[0].annotate("limit: 30", (0.75, LIMIT), xytext=(0, -3), va="top", color="#666666",
                           textcoords="offset points", fontsize="small")  # fmt: skip
        panels[2].set_title("After training, four levers", loc="left")
        panels[2].set_xticks(range(4), TESTS, fontsize="small")
        panels[2].set(xlabel="Trained (3 levers) - tested (4 levers)", xlim=(-0.4, 3.4))
        names = {"people": "people (40 each)", "rl2": "rl2 (trained before)"}
        handles = [
            Line2D([], [], label=names.get(name, name), **look) for name, look in looks().items()
        ]
        figure.legend(handles=handles, loc="outside upper left", ncols=len(handles))
    return figure


def looks() -> dict[str, dict[str, Any]]:
    """How each is drawn: people in grey and broad, so that they are seen behind learners."""
    people: dict[str, Any] = {"color": "#8A8A8A", "lw": 3, "marker": "o", "ms": 6}
    narrow: dict[str, Any] = {"lw": 1.3, "ms": 4.5}
    marks = dict(zip(LEARNERS, "DsvX", strict=True))
    return {"people": people} | {
        name: {**narrow, "color": style.current().other(number), "marker": mark}
        for number, (name, mark) in enumerate(marks.items())
    }


def _course(axes: Axes, points: pd.DataFrame, condition: str, look: dict[str, Any]) -> None:
    """One learner's points in one baseline, or in the tests, which no line connects."""
    own = points[points["condition"].isin([condition] if condition else TESTS)]
    places = own["trial"] if condition else own["condition"].map(TESTS.index)
    look = look if condition else {**look, "ls": ""}
    axes.errorbar(places, own["mean"], own["se"], elinewidth=1, capsize=0, **look)


def costs(table: pd.DataFrame) -> Figure:
    """What learning costs each subject, all training counted."""
    figure = Figure()
    shown = ["ideal", *LEARNERS]
    draw_costs(table[table["learner"].isin(shown)], shown, figure)
    return figure


def made_from(svg: str) -> str:
    """The SHA-256 of the source that a figure names."""
    return re.findall(r"^<!-- made from .*, SHA-256 (\w+) -->$", svg, flags=re.MULTILINE)[-1]


def main() -> None:
    """Write the three figures."""
    drawn = {"people_and_learners.svg": people_and_learners, "cost_of_learning.svg": costs}
    write_text(HERE / "CC4_and_CE4.svg", style.image(graphs(), "svg").decode())
    for name, source in SOURCES.items():
        path = STUDY / source
        svg = style.image(drawn[name](pd.read_parquet(path)), "svg").decode().rstrip()
        mark = hashlib.sha256(path.read_bytes()).hexdigest()
        place = f"evidence/default/{source}"
        write_text(HERE / name, f"{svg}\n<!-- made from {place}, SHA-256 {mark} -->\n")


if __name__ == "__main__":
    main()

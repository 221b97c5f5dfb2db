"""One made-up experiment that has every case of the report, and a page as plain text."""

from dataclasses import replace

import pandas as pd
import pyarrow as pa

from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import POINT_COLUMNS, Reference
from causal_openlock.contract.registry import create
from causal_openlock.experiment.condition import PAPER_CONDITIONS
from causal_openlock.experiment.declare import PERSON
from causal_openlock.experiment.origin import Origin
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.experiment.session import Session
from causal_openlock.version import RESULTS_VERSION, __version__
from causal_openlock.world.rewards import find_reward
from support.fabricated_courses import around, course
from support.fabricated_records import table
from support.html_page import Page
from support.made_up_experiments import condition_called, experiment_of, spec
from support.paper_play import LIMIT, play, same, scattered

OWN = "own <i>$x$"
"""A condition of one's own, whose name has to be escaped."""

STRANGE = "strange <u> & d"
"""A learner whose name has to be escaped."""

NOTHING, RISES, FALLS = [0.0] * 5, [0.2, 0.4, 0.5, 0.6, 0.6], [0.2, 0.6, 0.5, 0.3, 0.1]
RL = {
    "random": (NOTHING, NOTHING),
    "basic": (RISES, FALLS),
    "unique": (NOTHING, NOTHING),
    "ladder": (RISES, RISES),
}
"""By learner of the reward study, shares of attempts that open the door in CC4 and in CE4."""


def half(condition, phase, trial, subject):
    """Every second subject solves its trials, in nine attempts."""
    return 9 if subject % 2 else LIMIT


def human_rows():
    """What is played under the human protocol, from a record made up row by row."""
    own = [{**row, "condition": OWN} for row in play("able", scattered(4), 20, ("CC4",))]
    return [
        *play("able", scattered(1), 20),
        *own,
        *play(STRANGE, scattered(2, 9.0), 20),
        *play("half", half, 20, ("CC4", "CC3-CC4", "CE3-CC4")),
        *play("told", same(3), 20, ("CC4", "CC3-CC4")),
        *play("never", same(LIMIT), 3, ("CC3-CC4", "CE3-CC4")),
        *play("visitors", scattered(5, 5.0), 10, ("CC4", "CE4", "CC3-CC4")),
    ]


def rl_cells():
    """What is played under the protocol of reinforcement learning, many attempts a visit."""
    return [
        course(
            around(shares, spread=0.02 if any(shares) else 0),
            finds_all=name == "ladder",
            learner=name,
            condition=condition,
            schema=condition,
        )
        for name, both in RL.items()
        for condition, shares in zip(("CC4", "CE4"), both, strict=True)
    ]


def whole_material():
    """Learners of every kind, people, rewards, failed cells and a reference of one's own."""
    believer = Session(condition_called("CC4"), PROTOCOLS["human"], 2, seed=1, learner="bayes")
    record = pa.concat_tables([table(human_rows()), *rl_cells(), believer.play(create("bayes"))])
    trained = Origin("made_up:Able", "made-up 1.0", prior_attempts=12_000, about="Was trained.")
    told = Origin("made_up:Told", "made-up 1.0", informed=True)
    rewards = {"basic": "basic", "unique": "unique_solutions", "ladder": "paper"}
    learners = (
        spec("able", recorded=trained, subjects=20, parameters={"rate": 0.001, "hidden": [8, 4]}),
        spec(STRANGE, subjects=20),
        spec("half", subjects=20),
        spec("told", recorded=told, subjects=20),
        spec("never", subjects=3),
        spec("visitors", learner=PERSON, recorded=Origin(PERSON, "causal-openlock 1"), subjects=10),
        spec("bayes", learner="bayes", subjects=2, recorded=None),
        spec("random", PROTOCOLS["rl"], subjects=10),
        *(
            spec(name, PROTOCOLS["rl"], subjects=10, reward=find_reward(reward))
            for name, reward in rewards.items()
        ),
    )
    cells = ("half_CC3-CE4_0-19_0123456789ab", "never_CE3-CE4_0-2_0123456789ab")
    experiment = experiment_of(
        record,
        title="Whole <script>alert(1)</script> & more",
        command="causal-openlock compare whole.yaml",
        conditions=tuple(map(condition_called, (*PAPER_CONDITIONS, OWN))),
        learners=learners,
        versions={"numpy": ["2.0", "2.1"], "causal-openlock": RESULTS_VERSION},
        files=(*cells, "able_CC4_0-19_0123456789ab"),
        missing=cells,
        failures={cells[0]: "half in CC3-CE4, subjects 0-19: it failed on <purpose>"},
        not_applicable={"told": {"CE3-CE4": "rooms of CE4 are too large for told"}},
        excluded={"visitors": 2},
    )
    points = pd.DataFrame(
        [("CC4", "train", 5, 9, 12.5, 0.5), ("CE4", "train", 5, 9, 8.0, 0.25)],
        columns=POINT_COLUMNS,
    )
    guests = Reference("guests", points, lambda spec, condition: spec.protocol.name == "human")
    made = Material.of(record, experiment)
    return replace(made, references=(*made.references, guests.within(experiment)))


BLOCKS = ("p", "h1", "h2", "h3", "h4", "li", "summary", "figcaption", "tr", "dt", "dd", "pre")


class _Lines(Page):
    """A page whose text is in lines: one for each block, and for each row of a table."""

    def handle_starttag(self, tag, attributes):
        super().handle_starttag(tag, attributes)
        mark = f"{tag}: " if tag in ("h1", "h2", "h3", "h4", "summary") else ""
        between = {"td": " | ", "th": " | ", "small": " / "}
        self.text += f"\n{mark}" if tag in BLOCKS else between.get(tag, "")

    def handle_endtag(self, tag):
        super().handle_endtag(tag)
        self.text += "\n" if tag in BLOCKS else ""

    def handle_data(self, data):
        if not {"svg", "title"} & {*self.open}:
            super().handle_data(data)


def lines_of(html):
    """Text of a page as its reader sees it, with every fold open and without figures."""
    lines = (" ".join(line.split()) for line in _Lines(html).text.splitlines())
    text = "\n".join(line for line in lines if line not in ("", "summary:"))
    return text.replace(RESULTS_VERSION, "RESULTS_VERSION").replace(__version__, "VERSION")

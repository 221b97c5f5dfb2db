"""What notebooks show: schemas, rooms, records, experiments and learners as HTML."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
import xml.etree.ElementTree as ET
from collections import Counter
from typing import Any

import matplotlib as mpl
import pyarrow as pa
import pytest

from causal_openlock import Condition, Gate, Protocol, Room, Schema, Session, find_schema
from causal_openlock.contract.learner import Learner
from causal_openlock.contract.registry import create
from causal_openlock.experiment.building import Changes
from causal_openlock.experiment.file import find_experiment, read_experiment
from causal_openlock.notebook import (
    ENDS,
    experiment_html,
    learner_html,
    record_html,
    room_html,
    schema_html,
)
from causal_openlock.world.room import position_names
from support.html_page import Page

SVG = "{http://www.w3.org/2000/svg}"
SHORT = Protocol("short", 4, stop_when_solved=True, baseline_trials=2)


def read(html: str) -> Page:
    """A piece of HTML in which every element is closed."""
    page = Page(html)
    assert page.open == []
    return page


def bold(html: str) -> list[str]:
    """What is set bold, apart from the title."""
    return re.findall("<b>(.*?)</b>", html)[1:]


def picture(html: str) -> ET.Element:
    return ET.fromstring(html[html.index("<svg") : html.index("</svg>") + len("</svg>")])


def played(*conditions: str, subjects: int = 2, learner: str = "random") -> pa.Table:
    sessions = [
        Session(Condition.named(name, find_schema), SHORT, subjects, seed=1, learner=learner)
        for name in conditions
    ]
    return pa.concat_tables([session.play(create(learner)) for session in sessions])


def test_a_schema_shows_its_graph_and_its_solutions() -> None:
    levers, edges = ["left", "right"], {"left": ["door"], "right": {"door": 0.8}}
    schema = Schema("pair", levers, edges, gates={"door": Gate("all")}, title="<b>two & two</b>")
    html = schema_html(schema)
    written = {text.text for text in picture(html).iter(f"{SVG}text")}
    assert written == {"left", "right", "door", "all", "0.8"}
    assert "<style" not in html  # which would hold for the whole page
    assert "1 solution:left right door" in read(html).text
    assert "pair: <b>two & two</b>" in read(html).text  # as text, and not as markup


def test_of_many_solutions_a_dozen_is_listed() -> None:
    names = [f"L{lever}" for lever in range(6)]
    gates = {"door": Gate("at_least", 2)}
    schema = Schema("many", names, {name: ["door"] for name in names}, gates=gates)
    _, text = read(schema_html(schema)).text.split("15 solutions:")
    assert text.count(" door") == 12
    assert text.endswith("and 3 more")


def test_what_a_notebook_has_set_for_its_figures_changes_nothing() -> None:
    schema = find_schema("CC3")
    usual = schema_html(schema)
    with mpl.rc_context(), warnings.catch_warnings():
        warnings.simplefilter("error")
        mpl.rcParams.update({"figure.constrained_layout.use": True, "font.size": 30})
        assert schema_html(schema) == usual
        assert mpl.rcParams["font.size"] == 30


def test_a_room_shows_its_levers_in_their_colours_and_where_each_stands() -> None:
    room = Room.of(find_schema("CC4"), "trial7")
    html = room_html(room)
    fills = {}
    for group in picture(html).iter(f"{SVG}g"):
        kind, _, place = group.attrib["id"].partition("_")
        if kind == "lever":
            fills[place] = group[-1].attrib["fill"]
    assert set(fills) == set(position_names(7))
    grey = {"LOWERLEFT", "UPPERRIGHT", "LOWERRIGHT", "UPPERLEFT"}
    assert {place for place, fill in fills.items() if fill == "#999999"} == grey
    assert "L0 LOWERLEFT, L1 UPPERRIGHT, L2 LOWERRIGHT, L3 UPPERLEFT" in read(html).text


def test_a_record_shows_its_first_and_last_attempts() -> None:
    record = played("CC3", "CE4")
    page = read(str(record_html(record)))
    head, *rows = page.tables[0]
    assert len(rows) == 2 * ENDS + 1
    shown = [dict(zip(head, row, strict=True)) for row in rows if row[0] != "…"]
    numbers = [*range(ENDS), *range(record.num_rows - ENDS, record.num_rows)]
    for row, whole in zip(shown, record.take(numbers).to_pylist(), strict=True):
        for name in ("condition", "subject", "trial", "schema", "layout", "attempt", "category"):
            assert row[name] == str(whole[name])
        assert row["actions"].split() == [str(action) for action in whole["actions"]]
        assert row["found"] == f"{whole['solutions_found']} of {whole['solutions']}"
    # What all rows share is said once.
    assert not {"learner", "protocol", "seed", "phase", "loop"} & set(head)
    assert f"{record.num_rows} attempts, 2 subjects, " in page.text
    assert "learner random, protocol short, seed 1, phase train, loop 1" in page.text


def test_a_short_record_is_shown_whole_and_what_moved_something_is_bold() -> None:
    record = played("CC3", subjects=1, learner="oracle")
    html = str(record_html(record))
    assert len(read(html).tables[0]) == 1 + record.num_rows
    rows = record.to_pylist()
    moved = [a for row in rows for a, m in zip(row["actions"], row["moved"], strict=True) if m]
    assert Counter(bold(html)) == Counter(map(str, moved))


def test_an_empty_record_and_other_tables_are_no_trouble() -> None:
    record = played("CC3", subjects=1)
    assert "0 attempts" in read(str(record_html(record.slice(0, 0)))).text
    assert record_html(record.drop_columns(["actions"])) is None
    assert record_html(pa.table({"a": [1]})) is None


IN_A_SHELL = """
from IPython.core.interactiveshell import InteractiveShell
shell = InteractiveShell.instance()
import pyarrow as pa
from causal_openlock import Condition, Protocol, Session, find_schema
from causal_openlock.contract.registry import create
session = Session(Condition.named("CC3", find_schema), Protocol("p", 2, True), 1)
schema, learner = find_schema("CC3"), create("oracle")
for shown in (session.play(learner), pa.table({"a": [1]}), schema, learner):
    print("text/html" in shell.display_formatter.format(shown)[0])
"""
ELSEWHERE = """
import sys
import causal_openlock, causal_openlock.experiment.session, causal_openlock.experiment.store
print({"IPython", "matplotlib", "pandas", "pyarrow", "torch"} & set(sys.modules))
"""


@pytest.mark.parametrize(
    ("program", "says"), [(IN_A_SHELL, "True\nFalse\nTrue\nTrue\n"), (ELSEWHERE, "set()\n")]
)
def test_in_ipython_formatters_are_registered_and_elsewhere_nothing_is_imported(
    program: str, says: str
) -> None:
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (0, says), done.stderr


def test_an_experiment_shows_who_plays_and_what_is_changed_of_them() -> None:
    changes = Changes(conditions=["CC4", "CC3-CE4"], learners=["oracle", "random"], subjects=3)
    experiment = read_experiment(find_experiment("default"), changes)
    page = read(experiment_html(experiment))
    assert [row[:5] for row in page.tables[0][1:]] == [
        ["oracle", "oracle", "human", "paper", "3"],
        ["random", "random", "human", "paper", "3"],
    ]
    assert "conditions CC4, CC3-CE4; seed 2018; 4 cells" in page.text


def test_of_an_experiments_learners_only_changed_parameters_are_shown(tmp_path: Any) -> None:
    path = tmp_path / "e.yaml"
    path.write_text(
        "name: e\nconditions: [CC3]\nlearners:\n"
        "  - {learner: bayes, parameters: {policy: thompson, beta: 3.0}}\n"
    )
    assert read(experiment_html(read_experiment(path))).tables[0][1][-1] == "policy thompson"


def test_a_learner_shows_its_parameters_and_those_that_were_changed_bold() -> None:
    html = learner_html(create("bayes", {"lapse": 0.25}))
    page = read(html)
    rows = {name: (value, meaning) for name, value, meaning in page.tables[0][1:]}
    assert rows["lapse"] == ("0.25", "share of actions that are random")
    assert rows["policy"][0] == "solve_and_learn"
    assert bold(html) == ["0.25"]
    assert "Acts on a posterior over the causal structure of the room." in page.text


def test_a_learner_for_one_subject_shows_itself(tmp_path: Any, monkeypatch: Any) -> None:
    text = (
        "from dataclasses import dataclass\n"
        "from typing import Annotated\n"
        "from causal_openlock import OneSubjectLearner\n"
        "@dataclass(frozen=True)\n"
        "class Settings:\n"
        '    zeal: Annotated[float, "a < b"] = 0.5\n'
        "class Shown(OneSubjectLearner):\n"
        '    """Like :class:`~somewhere.Other`."""\n'
        "    Parameters = Settings\n"
        "    def act(self, observation):\n"
        "        return 0\n"
    )
    (tmp_path / "shown_here.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    learner: Learner = create("shown_here:Shown", {"zeal": 0.7})
    page = read(learner_html(learner))
    assert page.tables[0][1] == ["zeal", "0.7", "a < b"]
    assert "ShownLike somewhere.Other." in page.text

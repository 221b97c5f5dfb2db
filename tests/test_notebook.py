"""What notebooks show: schemas, rooms, records, experiments and learners as HTML."""

from __future__ import annotations

import re
import subprocess
import sys
import time
import warnings
import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import matplotlib as mpl
import pyarrow as pa
import pytest

import causal_openlock as ol
from causal_openlock import Condition, Gate, Protocol, Room, Schema, Session, find_schema
from causal_openlock.contract.learner import Learner
from causal_openlock.contract.registry import create
from causal_openlock.experiment.building import Changes
from causal_openlock.experiment.file import find_experiment, read_experiment
from causal_openlock.notebook import (
    ENDS,
    LARGEST,
    experiment_html,
    learner_html,
    opened_html,
    picture_html,
    playable_html,
    record_html,
    room_html,
    schema_html,
    watched_html,
    watched_widgets,
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


def test_a_room_to_try_out_shows_its_console_and_what_can_be_done() -> None:
    room = ol.room("CC4", layout="trial7")
    room.step("LOWERLEFT")
    page = read(playable_html(room))
    assert page.text.startswith("CC4 in trial7")
    assert "push LOWERLEFT" in page.text
    assert "the lever moves" in page.text
    assert page.text.endswith(f"push or pull {', '.join(position_names(7))}; or push door")
    *_, seen = [room.step(action) for action in ("UPPERRIGHT", "door")]
    html = picture_html(seen)
    assert read(html).text.startswith("push door: the door opens: a new solution")
    assert {text.text for text in picture(html).iter(f"{SVG}text")} >= {"LOWERLEFT, UPPERRIGHT"}
    levers = [group[-1].attrib for group in picture(html).iter(f"{SVG}g")][1:8]
    pushed = [group[-1].attrib for group in picture(playable_html(room)).iter(f"{SVG}g")][1:8]
    assert [a != b for a, b in zip(levers, pushed, strict=True)] == [
        name in ("LOWERLEFT", "UPPERRIGHT") for name in position_names(7)
    ]


def test_an_opened_room_shows_its_link() -> None:
    with ol.play_room("CC3", browser=False) as opened:
        page = read(opened_html(opened))
    assert ("a", {"href": opened.url, "target": "_blank"}) in page.tags


@pytest.mark.parametrize(("learner", "attempts"), [("bayes", 10), ("random", 30)])
def test_a_watched_trial_is_a_strip_without_scripts(learner: str, attempts: int) -> None:
    watched = ol.watch(learner, "CC4", attempts=attempts)
    html = watched_html(watched)
    page = read(html)
    assert len(html) < 1_000_000
    assert not {"script", "style", "img", "link"} & {tag for tag, _ in page.tags}
    assert not [name for _, pairs in page.tags for name in pairs if name.startswith("on")]
    moments = 1 + sum(len(attempt.actions) for attempt in watched.trial.attempts[:attempts])
    shown = [tag for tag, _ in page.tags].count("figure")
    assert shown == moments
    assert page.text.count(" bits left, ") == (shown if learner == "bayes" else 0)
    assert ("dashed: the true schema" in page.text) == (learner == "bayes")


def test_a_long_strip_is_cut_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    watched = ol.watch("bayes", "seven", attempts=4)
    one_attempt = watched_html(replace(watched, attempts=1))
    assert LARGEST + len(one_attempt) < 1_000_000  # there is one picture more than fits
    monkeypatch.setattr("causal_openlock.notebook.LARGEST", 1)
    page = read(watched_html(watched))
    actions = sum(len(attempt.actions) for attempt in watched.trial.attempts[:4])
    assert [tag for tag, _ in page.tags].count("figure") == 1
    assert f"and {actions} more actions" in page.text


def test_a_moment_is_drawn_in_less_than_50_milliseconds() -> None:
    watched = ol.watch("bayes", "CC4")
    watched_html(watched)
    seconds = []
    for _ in range(3):
        began = time.perf_counter()
        watched_html(watched)
        seconds.append(time.perf_counter() - began)
    assert min(seconds) < 0.05 * len(watched.shots)


IN_A_KERNEL = """
import sys
import time
from types import SimpleNamespace
from IPython.core.interactiveshell import InteractiveShell
shell = InteractiveShell.instance()
import causal_openlock as ol
watched = ol.watch("oracle", "CC3")
VIEW = "application/vnd.jupyter.widget-view+json"
for kernel, there in ((False, True), (True, False), (True, True)):
    if kernel:
        shell.kernel = None
    hidden = {} if there else {"ipywidgets": None}
    with __import__("unittest.mock").mock.patch.dict(sys.modules, hidden):
        shown = shell.display_formatter.format(watched)[0]
    print(VIEW in shown, shown["text/html"].count("<figure"), shown["text/plain"][:13])
"""


def test_sliders_where_they_can_be_and_a_strip_everywhere() -> None:
    done = subprocess.run(
        [sys.executable, "-c", IN_A_KERNEL], capture_output=True, text=True, check=False
    )
    assert done.stdout.splitlines() == [
        "False 7 oracle in CC3",
        "False 7 oracle in CC3",
        "True 7 oracle in CC3",
    ], done.stderr


def test_the_slider_goes_over_all_moments_in_the_browser(monkeypatch: pytest.MonkeyPatch) -> None:
    links: list[Any] = []
    monkeypatch.setattr("ipywidgets.jslink", lambda *ends: links.append(ends))
    monkeypatch.setattr("IPython.core.getipython.get_ipython", lambda: SimpleNamespace(kernel=None))
    watched = ol.watch("oracle", "CC3")
    assert watched_widgets(watched)
    ((player, _), (slider, _)), ((_, moment), (stack, index)) = links
    assert (moment, index) == ("value", "selected_index")
    assert (slider.min, slider.max) == (player.min, player.max) == (0, len(watched.shots) - 1)
    assert stack.selected_index == slider.value == 0
    for shot, picture_there in zip(watched.shots, stack.children, strict=True):
        text = read(picture_there.value).text
        assert f"Attempt {shot.attempt} of at most 30" in text
        assert f"Actions left: {shot.panel.actions_left}" in text


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
import time
import causal_openlock, causal_openlock.experiment.session, causal_openlock.storage.store
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
    assert "ShownLike Other." in page.text

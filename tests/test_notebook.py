"""What notebooks show as HTML; the words of it stand in tests/golden/notebook."""

import re
import subprocess
import sys
import time
import warnings
import xml.etree.ElementTree as ET
from types import SimpleNamespace

import matplotlib as mpl
import pyarrow as pa
import pytest

import causal_openlock as ol
from causal_openlock.notebook import (
    learner_html,
    opened_html,
    playable_html,
    record_html,
    room_html,
    schema_html,
    watched_html,
    watched_widgets,
)
from support.html_page import Page

SVG = "{http://www.w3.org/2000/svg}"
POSITIONS = ["UPPERRIGHT", "UPPER", "UPPERLEFT", "LEFT", "LOWERLEFT", "LOWER", "LOWERRIGHT"]


def read(html):
    """A piece of HTML in which every element is closed."""
    page = Page(html)
    assert page.open == []
    return page


def groups(html):
    """By its name, what each group of the first picture is drawn as at last."""
    picture = ET.fromstring(html[html.index("<svg") : html.index("</svg>") + len("</svg>")])
    return {group.attrib.get("id"): group[-1].attrib for group in picture.iter(f"{SVG}g")}


def levers(html):
    """How each lever of a room is drawn, by its position."""
    return {n.removeprefix("lever_"): a for n, a in groups(html).items() if n.startswith("lever_")}


def figures(page):
    return [tag for tag, _ in page.tags].count("figure")


def test_schema_is_shown_as_in_any_notebook_and_its_title_is_no_markup():
    schema = ol.schema('pair "<i>two & two</i>": left, right (0.8) -> door')
    usual = schema_html(schema)
    assert "<style" not in usual  # which would hold for the whole page
    assert "pair: <i>two & two</i>" in read(usual).text
    with mpl.rc_context(), warnings.catch_warnings():
        warnings.simplefilter("error")
        mpl.rcParams.update({"figure.constrained_layout.use": True, "font.size": 30})
        assert schema_html(schema) == usual
        assert mpl.rcParams["font.size"] == 30


def test_of_many_solutions_a_dozen_is_listed():
    text = read(schema_html(ol.schema("2 of (A, B, C, D, E, F) -> door"))).text
    listed = text.split("15 solutions:")[1]
    assert listed.count(" door") == 12
    assert listed.endswith("and 3 more")


def test_room_shows_its_levers_in_their_colours_and_what_is_pushed():
    drawn = levers(room_html(ol.Room.of(ol.find_schema("CC4"), "trial7")))
    grey = [place for place in POSITIONS if drawn[place]["fill"] == "#999999"]
    assert grey == ["UPPERRIGHT", "UPPERLEFT", "LOWERLEFT", "LOWERRIGHT"]
    room = ol.room("CC4", layout="trial7")
    before = levers(playable_html(room))
    room.step("LOWERLEFT")
    after = levers(playable_html(room))
    assert [place for place in POSITIONS if before[place] != after[place]] == ["LOWERLEFT"]


def test_opened_room_shows_its_link():
    with ol.play_room("CC3", browser=False) as opened:
        page = read(opened_html(opened))
    assert ("a", {"href": opened.url, "target": "_blank"}) in page.tags


@pytest.mark.parametrize(("learner", "attempts"), [("bayes", 10), ("random", 30)])
def test_watched_trial_is_a_strip_without_scripts(learner, attempts):
    watched = ol.watch(learner, "CC4", attempts=attempts)
    html = watched_html(watched)
    page = read(html)
    assert len(html) < 1_000_000
    assert not {"script", "style", "img", "link"} & {tag for tag, _ in page.tags}
    assert not [name for _, pairs in page.tags for name in pairs if name.startswith("on")]
    moments = 1 + sum(len(attempt.actions) for attempt in watched.trial.attempts[:attempts])
    assert figures(page) == moments
    assert page.text.count(" bits left, ") == (moments if learner == "bayes" else 0)


def test_long_strip_is_cut_and_says_so():
    watched = ol.watch("random", "seven", attempts=30)
    page = read(html := watched_html(watched))
    actions = sum(len(attempt.actions) for attempt in watched.trial.attempts)
    left = int(re.search(r"and (\d+) more actions", page.text)[1])
    assert figures(page) + left == 1 + actions
    assert 600_000 < len(html) < 1_000_000


def test_a_moment_is_drawn_in_less_than_50_milliseconds():
    watched = ol.watch("bayes", "CC4")
    watched_html(watched)
    seconds = []
    for _ in range(3):
        began = time.process_time()
        watched_html(watched)
        seconds.append(time.process_time() - began)
    assert min(seconds) < 0.05 * len(watched.shots)


def test_slider_goes_over_all_moments_in_the_browser(monkeypatch):
    links = []
    monkeypatch.setattr("ipywidgets.jslink", lambda *ends: links.append(ends))
    monkeypatch.setattr("IPython.core.getipython.get_ipython", lambda: SimpleNamespace(kernel=None))
    watched = ol.watch("oracle", "CC3")
    assert watched_widgets(watched)
    ((player, _), (slider, _)), ((_, moment), (stack, index)) = links
    assert (moment, index) == ("value", "selected_index")
    assert (slider.min, slider.max) == (player.min, player.max) == (0, len(watched.shots) - 1)
    assert stack.selected_index == slider.value == 0
    for shot, shown in zip(watched.shots, stack.children, strict=True):
        text = read(shown.value).text
        assert f"Attempt {shot.attempt} of at most 30" in text
        assert f"Actions left: {shot.panel.actions_left}" in text


IN_A_SHELL = """
import sys
from unittest.mock import patch
from IPython.core.interactiveshell import InteractiveShell
shell = InteractiveShell.instance()
import pyarrow as pa
import causal_openlock as ol
print("text/html" in shell.display_formatter.format(pa.table({"a": [1]}))[0])
watched = ol.watch("oracle", "CC3")
for kernel, there in ((False, True), (True, False), (True, True)):
    if kernel:
        shell.kernel = None
    with patch.dict(sys.modules, {} if there else {"ipywidgets": None}):
        shown = shell.display_formatter.format(watched)[0]
    widgets = "application/vnd.jupyter.widget-view+json" in shown
    print(widgets, shown["text/html"].count("<figure"), shown["text/plain"][:13])
"""
ELSEWHERE = """
import sys
import causal_openlock, causal_openlock.experiment.session, causal_openlock.storage.store
print({"IPython", "matplotlib", "pandas", "pyarrow", "torch"} & set(sys.modules))
"""


@pytest.mark.parametrize(
    ("program", "printed"),
    [
        (
            IN_A_SHELL,
            "False\nFalse 7 oracle in CC3\nFalse 7 oracle in CC3\nTrue 7 oracle in CC3\n",
        ),
        (ELSEWHERE, "set()\n"),
    ],
)
def test_sliders_in_a_kernel_a_strip_everywhere_and_nothing_loaded_elsewhere(program, printed):
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, printed), done.stderr


def test_short_record_is_shown_whole_and_what_moved_something_is_bold():
    protocol = ol.Protocol("short", attempt_limit=4, stop_when_solved=True, baseline_trials=2)
    condition = ol.Condition.named("CC3", ol.find_schema)
    record = ol.Session(condition, protocol, 1, seed=1).play(ol.create("oracle"))
    html = record_html(record)
    assert len(read(html).tables[0]) == 1 + record.num_rows
    rows = record.to_pylist()
    moved = [a for row in rows for a, m in zip(row["actions"], row["moved"], strict=True) if m]
    assert sorted(re.findall("<b>(.*?)</b>", html)[1:]) == sorted(map(str, moved))
    assert "0 attempts" in read(record_html(record.slice(0, 0))).text
    assert record_html(record.drop_columns(["actions"])) is None
    assert record_html(pa.table({"a": [1]})) is None


def test_learner_of_ones_own_shows_its_parameters_as_text(tmp_path, monkeypatch):
    (tmp_path / "shown_here.py").write_text(
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
    monkeypatch.syspath_prepend(tmp_path)
    page = read(learner_html(ol.create("shown_here:Shown", {"zeal": 0.7})))
    assert page.tables[0][1] == ["zeal", "0.7", "a < b"]
    assert "ShownLike Other." in page.text

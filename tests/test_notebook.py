"""What notebooks show as HTML; the words of it stand in tests/golden/notebook."""

import re
import subprocess
import sys
import warnings

import matplotlib as mpl
import pytest

import causal_openlock as ol
from causal_openlock.notebook import learner_html, schema_html, watched_html
from support.html_page import Page


def read(html):
    """A piece of HTML in which every element is closed."""
    page = Page(html)
    assert page.open == []
    return page


def figures(page):
    return [tag for tag, _ in page.tags].count("figure")


def test_schema_is_shown_as_in_any_notebook_and_its_title_is_no_markup():
    edges = {"left": ["door"], "right": {"door": 0.8}}
    title = "<i>two & two</i>"
    schema = ol.schema({"name": "pair", "title": title, "levers": [*edges], "edges": edges})
    usual = schema_html(schema)
    assert "<style" not in usual  # which would hold for the whole page
    assert "pair: <i>two & two</i>" in read(usual).text
    with mpl.rc_context(), warnings.catch_warnings():
        warnings.simplefilter("error")
        mpl.rcParams.update({"figure.constrained_layout.use": True, "font.size": 30})
        assert schema_html(schema) == usual
        assert mpl.rcParams["font.size"] == 30


@pytest.mark.parametrize(("learner", "attempts"), [("bayes", 10), ("random", 30)])
def test_watched_trial_is_a_strip_without_scripts(learner, attempts):
    watched = ol.watch(learner, "CC4", attempts=attempts)
    html = watched_html(watched)
    page = read(html)
    assert len(html) < 1_000_000
    assert not {"script", "style", "img", "link"} & {tag for tag, _ in page.tags}
    assert not [name for _, pairs in page.tags for name in pairs if name.startswith("on")]
    moments = 1 + sum(len(attempt["actions"]) for attempt in watched.trial.attempts[:attempts])
    assert figures(page) == moments
    assert page.text.count(" bits left, ") == (moments if learner == "bayes" else 0)


def test_long_strip_is_cut_and_says_so():
    watched = ol.watch("random", "seven", attempts=30)
    page = read(watched_html(watched))
    actions = sum(len(attempt["actions"]) for attempt in watched.trial.attempts)
    left = int(re.search(r"and (\d+) more actions", page.text)[1])
    assert figures(page) + left == 1 + actions


IN_A_SHELL = """
from IPython.core.interactiveshell import InteractiveShell
shell = InteractiveShell.instance()
import causal_openlock as ol
shown = shell.display_formatter.format(ol.watch("oracle", "CC3"))[0]
print(shown["text/html"].count("<figure"), shown["text/plain"][:13])
"""


def test_a_strip_in_a_shell():
    done = subprocess.run([sys.executable, "-c", IN_A_SHELL], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "7 oracle in CC3\n"), done.stderr


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
    assert page.tables[0][1] == ["zeal", "0.7 (default 0.5)", "a < b"]
    assert "ShownLike Other." in page.text

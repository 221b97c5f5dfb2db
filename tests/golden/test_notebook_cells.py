"""What a notebook shows, as text: the README's lines, and an object of each kind."""

import html
import re
from functools import partial

import pytest
from IPython.core.interactiveshell import InteractiveShell

import causal_openlock as ol
from causal_openlock.notebook import register_formatters
from support.documents import ROOT, code
from support.masks import masked

README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture
def shown():
    """What IPython shows of an object: its HTML as text, a line for each row or picture's word."""
    shell = InteractiveShell.instance()
    register_formatters()

    def text(thing):
        page = shell.display_formatter.format(thing)[0]["text/html"]
        page = re.sub(r"<(td|th)\b", r" | <\1", page)
        page = re.sub(r"<br>|<(?:div|table|svg)\b|</(?:tr|div|figcaption|text)>", r"\n\g<0>", page)
        page = re.sub(r"</?b>", "*", page)
        lines = html.unescape(re.sub(r"<[^>]+>", "", page)).splitlines()
        return "\n".join(line.strip() for line in lines if line.strip())

    yield text
    InteractiveShell.clear_instance()


def test_readme_lines_show_their_results(shown, golden, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    (tmp_path / "vault.yaml").write_text(code(README, "yaml")[0], encoding="utf-8")
    monkeypatch.setattr(ol, "compare", partial(ol.compare, workers=0))  # two subjects: at once
    names = {}
    exec(code(README, "python")[-1].replace("subjects=20", "subjects=2"), names)
    results = names["results"]
    golden("notebook/results.txt", masked(f"{results!r}\n\n{shown(results)}"))


def test_objects_show_themselves(shown, golden):
    room = ol.room("CC4", layout="trial7")
    room.step("LOWERLEFT")
    experiment = ol.make_experiment(
        ["CC3", "CC3-CE3"], ["oracle", ol.learner("bayes", lapse=0.25)], subjects=2
    )
    things = {
        "schema": ol.schema("vault: key & second -> door; dial (0.5) -> second"),
        "room of a schema": ol.Room.of(ol.find_schema("CC4"), "trial7"),
        "room": room,
        "what an action did": room.step("UPPERRIGHT"),
        "experiment": experiment,
        "learner": ol.create("bayes", {"lapse": 0.25}),
        "trial with beliefs": ol.watch("bayes", "CC3", attempts=2),
        "trial": ol.watch("oracle", "CC3"),
    }
    texts = [f"## {name}\n{shown(thing)}" for name, thing in things.items()]
    golden("notebook/objects.txt", "\n\n".join(texts))

"""One attempt, two attempts: what is counted is told in English."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.report.difference_page import sentence_on_changes
from causal_openlock.analysis.report.what_was_run import budgets
from causal_openlock.analysis.report.writing import write_report
from causal_openlock.contract.registry import create
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.schema import Schema
from causal_openlock.wording import counted, first_line, nearest
from support.html_page import Page
from support.made_up_experiments import stored


def test_digits_that_are_no_numbers_are_letters() -> None:
    assert nearest("₁", ["₂", "x²", "x10", "x2"]).endswith("known: x2, x10, x², ₂")


@pytest.mark.parametrize(
    ("docstring", "line"),
    [
        ("A learner (extra ``llm``).\n\nMore.", "A learner (extra llm)."),
        ("Draws as :class:`~openlock_learners.random.RandomLearner`.", "Draws as RandomLearner."),
        ("See :py:func:`a.b` and `the paper <https://x.org>`_.", "See a.b and the paper."),
        ("\n   Plays\t``a < b``, \x1b[1mbold\u202e. \n", "Plays a < b, [1mbold."),
        (None, ""),
    ],
)
def test_the_first_line_of_a_docstring_is_plain_text(docstring: object, line: str) -> None:
    assert first_line(docstring) == line


def test_one_is_one() -> None:
    assert [counted(number, "attempt") for number in (0, 1, 2, 2000)] == [
        *("0 attempts", "1 attempt", "2 attempts", "2,000 attempts")
    ]
    assert counted(1, "person", "people") == "1 person"
    assert counted(3, "person has", "people have") == "3 people have"


def test_sentences_with_numbers_are_right_for_one(tmp_path: Path) -> None:
    once = replace(PROTOCOLS["human"], attempt_limit=1, action_limit=1)
    assert budgets(once).startswith("At most 1 attempt in a trial")
    assert "An attempt has at most 1 action." in budgets(once)
    going_on = replace(once, stop_when_solved=False)
    assert budgets(going_on).startswith("1 attempt in every trial")
    text = Prose("causal_openlock.analysis.topics.leaderboard").sentence(
        "few", few={"a": 1}, all=True, sizes=[1], least=20
    )
    assert text.startswith("Only 1 subject in a condition")
    assert sentence_on_changes(pd.DataFrame({"what": ["seed"]})).startswith("1 thing differs in")
    assert repr(Schema("x", ["A"], {"A": ["door"]})) == "<Schema x: 1 lever, 1 solution>"
    path = tmp_path / "e.yaml"
    path.write_text(
        "name: e\nprotocol: one\nprotocols: {one: {attempt_limit: 1, baseline_trials: 1}}\n"
        "conditions: [CC3]\nlearners: [random]\nsubjects: 1\n",
        encoding="utf-8",
    )
    experiment = read_experiment(path)
    (caution,) = experiment.warnings()
    assert "gives 1 attempt, so" in caution
    (cell,) = experiment.cells()
    record = Session(cell.condition, cell.spec.protocol, 1).play(create("random"))
    page = write_report(record, tmp_path, stored(replace(experiment, title="One")))
    assert "1 attempt in 1 trial." in Page(page.read_text(encoding="utf-8")).text

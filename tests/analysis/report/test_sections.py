"""Sections of the report: a provider of one's own on the page, and its tables as files."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from causal_openlock.analysis.measures import attempts_to_solve
from causal_openlock.analysis.report.writing import make_report, write_report
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.table import Table, printed
from causal_openlock.analysis.topic import all_topics, columns_of, sections_of
from causal_openlock.version import RESULTS_VERSION
from support.fabricated_records import random_cells, table, trial_rows
from support.html_page import Page
from support.made_up_experiments import NOBODY, experiment_of, material_of, stored
from support.section_of_ours import TOPIC as OURS
from support.topics import section_on


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    import pyarrow as pa

    folder = tmp_path_factory.mktemp("report")
    record = pa.concat_tables(random_cells(3, conditions=("CC4",), subjects=2))
    write_report(record, folder, experiment_of(record), [OURS], figures=True)
    return folder


def test_a_section_of_ones_own_is_on_the_page_and_in_the_contents(folder: Path) -> None:
    text = (folder / "report.html").read_text("utf-8")
    page = Page(text)
    assert page.open == []
    assert "2 learners & one < two." in page.text
    assert '<section id="paid"' in text
    assert '<a href="#paid">What was paid</a>' in text
    shown = next(rows for rows in page.tables if "reward" in rows[0])
    assert shown[0] == ["learner", "reward", "share", "better", "per 1000", "nothing"]
    assert shown[1] == ["a", "+0.000", "12.5%", "yes", "1,234,567", "–"]


def test_sections_stand_between_the_results_and_the_learners(folder: Path) -> None:
    text = (folder / "report.html").read_text("utf-8")
    marks = [f'<section id="{name}"' for name in ("results", "paid", "figures", "learners", "run")]
    places = [text.index(mark) for mark in marks]
    assert places == sorted(places)


def test_tables_and_plots_lie_beside_the_page(folder: Path) -> None:
    with (folder / "tables" / "paid.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["learner"] for row in rows] == ["a", "b"]
    assert (rows[0]["share"], rows[0]["per_1000"], rows[0]["nothing"]) == (
        "0.125",
        "1.23457e+06",
        "",
    )
    assert {path.name for path in (folder / "figures").glob("paid.*")} == {
        "paid.pdf",
        "paid.png",
        "paid.svg",
    }


def test_latex_of_a_table_has_rules_and_no_sign_that_latex_trips_over(folder: Path) -> None:
    text = (folder / "tables" / "paid.tex").read_text("utf-8")
    for rule in (r"\toprule", r"\midrule", r"\bottomrule", r"\label{tab:paid}"):
        assert rule in text
    assert r"\begin{tabular}{lrrlrr}" in text
    assert (
        r"Pay \& \textless{}reward\textgreater{}. Means over attempts $\pm$ nothing, 100\%" in text
    )
    assert r"a & +0.000 & 12.5\% & yes & 1,234,567 & -- \\" in text
    assert not re.search(r"(?<!\\)[%#_]", text.replace(r"\label{tab:paid}", ""))


def test_each_step_is_named_when_it_begins(tmp_path: Path) -> None:
    record = table(trial_rows([1, 2, 3]))
    steps: list[str] = []
    make_report(material_of(record, experiment_of(record)), tmp_path, [OURS], steps.append)
    paid = ["computing paid", "describing paid", "drawing paid"]
    assert [step for step in steps if step.endswith(" paid")] == paid
    assert {step.partition(" ")[0] for step in steps} == {"computing", "describing", "drawing"}


def test_what_a_later_report_does_not_have_is_removed(tmp_path: Path) -> None:
    record = table(trial_rows([1, 2, 3]))
    write_report(record, tmp_path, experiment_of(record), [OURS], figures=True)
    (tmp_path / "tables" / "mine.csv").write_text("kept")
    write_report(record, tmp_path, experiment_of(record), [], figures=True)
    assert not (tmp_path / "tables" / "paid.csv").exists()
    assert not (tmp_path / "figures" / "paid.svg").exists()
    assert (tmp_path / "tables" / "mine.csv").exists()
    assert (tmp_path / "tables" / "learner_a.tex").exists()


def test_a_page_of_strange_file_names_removes_nothing_outside(tmp_path: Path) -> None:
    outside = tmp_path / "outside.csv"
    outside.write_text("kept")
    folder = tmp_path / "report"
    folder.mkdir()
    names = f"tables/../../outside.csv {outside} figures/../../outside.csv"
    (folder / "report.html").write_text(f'<meta name="files" content="{names}">')
    record = table(trial_rows([1, 2, 3]))
    write_report(record, folder, experiment_of(record), [])
    assert outside.exists()


def test_two_sections_of_one_name_are_refused() -> None:
    record = table(trial_rows([1, 2, 3]))
    material = material_of(record, experiment_of(record))
    with pytest.raises(ValueError, match="two sections of the report are called paid"):
        sections_of(material, [OURS, OURS])


def test_columns_that_sections_ask_for_are_told() -> None:
    assert columns_of([OURS]) == ["reward"]


def test_every_section_is_there_and_says_nothing_of_an_empty_record() -> None:
    record = table([])
    assert sections_of(material_of(record, NOBODY), all_topics()) == []


@pytest.mark.parametrize(
    ("value", "form", "text"),
    [
        (-0.0004, "+.2f", "0.00"),
        (-0.0, ".2f", "0.00"),
        (-1.5, "+.1f", "−1.5"),
        (0.5, "+.1f", "+0.5"),
        (1e-9, ".2g", "1e−09"),
        (float("nan"), ".2f", "–"),
        (None, None, "–"),
        (np.True_, None, "yes"),
        (np.int64(3), None, "3"),
        ("x-y", None, "x-y"),
        (-0.001, ".0%", "0%"),
    ],
)
def test_values_are_printed_as_a_reader_expects(value: object, form: str | None, text: str) -> None:
    assert printed(value, form) == text


@pytest.mark.parametrize(
    ("name", "html"),
    [
        ("theory_based", "theory_based"),
        ("semi_markov_ddqn", "semi_markov_<wbr>ddqn"),
        ("participants_of_spring_2026", "participants_<wbr>of_spring_<wbr>2026"),
        ("a <b_ccccccccccccccccc", "a &lt;b_<wbr>ccccccccccccccccc"),
    ],
)
def test_long_names_break_after_an_underscore_and_not_within_a_word(name: str, html: str) -> None:
    table = Table("a", "A", pd.DataFrame({"learner": [name]}), {})
    assert f">{html}</th>" in table.html()


def test_long_tables_are_closed_on_the_page() -> None:
    from causal_openlock.analysis.prose import LONG
    from causal_openlock.analysis.report.page import render

    frame = pd.DataFrame({"name": [f"n{i}" for i in range(LONG + 1)], "value": 1.0})
    told = [Table("t", "T", part) for part in (frame, frame.head(LONG))]
    pages = [
        render(
            "difference.html.j2",
            title="t",
            names=("a", "b"),
            results=[{"attempts": 1, "trials": 1, "seed": 1, "missing": 0}] * 2,
            files=[],
            sections=[{"name": "s", "title": "S", "text": (), "tables": [one], "figures": []}],
        )
        for one in told
    ]
    assert '<details class="table"><summary>T (25 rows)' in pages[0]
    assert "<details" not in pages[1]


def test_beliefs_are_shown_of_rooms_and_results_of_this_version(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import pyarrow.compute as pc

    from causal_openlock.analysis.topics.belief_traces import TOPIC
    from causal_openlock.contract.registry import create
    from causal_openlock.experiment.building import Changes
    from causal_openlock.experiment.experiment import Experiment
    from causal_openlock.experiment.file import find_experiment, read_experiment
    from causal_openlock.experiment.session import Session

    experiment = read_experiment(
        find_experiment("default"), Changes(["CC3"], ["bayes", "random"], None, 2, 6)
    )
    (entry, other), (condition,) = experiment.learners, experiment.conditions
    session = Session(condition, entry.protocol, [3, 4], seed=6, learner="bayes")
    record = session.play(create("bayes"))

    def made(seed: int, experiment: Experiment = experiment, **versions: str) -> object:
        trials = attempts_to_solve(record).assign(seed=seed)
        kept = stored(experiment, versions={"causal-openlock": RESULTS_VERSION, **versions})
        return section_on(TOPIC, Material(record, kept, trials, ("bayes",), frozenset(), {}))

    shown = made(6)
    assert shown is not None
    assert [plot.name for plot in shown.plots] == ["belief_bayes"]
    (told,) = shown.tables
    played = record.filter(pc.and_(pc.equal(record["subject"], 3), pc.equal(record["trial"], 1)))
    many = [len(actions) for actions in played.sort_by("attempt")["actions"].to_pylist()]
    assert told.frame["actions"].tolist() == many
    assert (told.frame["learner"] == "bayes").all()
    assert (told.frame["obtained"] * told.frame["actions"]).sum() > 1
    assert told.frame["obtained"].notna().all()
    assert made(8) is None  # with this seed it is in another room
    assert made(6, **{"causal-openlock": "1"}) is None
    # A package of somebody else may change its learner, and the version of results stays.
    monkeypatch.setattr("causal_openlock.contract.registry.is_ours", lambda _: False)
    assert made(6) is not None
    changed = replace(entry, recorded=replace(entry.origin, package="theirs 2"))
    assert made(6, replace(experiment, learners=(changed, other))) is None

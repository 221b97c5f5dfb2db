"""The report: its text compared whole, its page and its files, and sections of one's own."""

import csv
import errno
import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from matplotlib.figure import Figure

import causal_openlock as ol
from causal_openlock.analysis.report.writing import make_report
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.table import Table, printed
from causal_openlock.analysis.topic import Section, SectionPlot, Topic, all_topics, sections_of
from causal_openlock.analysis.topics.belief_traces import TOPIC as BELIEFS
from causal_openlock.errors import OpenLockError
from causal_openlock.version import RESULTS_VERSION
from support.fabricated_records import random_cells, table, trial_rows
from support.html_page import Page
from support.made_up_experiments import NOBODY, experiment_of, material_of, stored
from support.topics import section_on, topics_called
from support.whole_report import lines_of, whole_material

pytestmark = pytest.mark.slow


def paid_section(material):
    """How much each learner was paid: a section as somebody might add it."""
    if not material.record.num_rows:
        return None
    names = sorted(material.trials["learner"].astype(str).unique())
    values = {"share": 0.125, "better": True, "per_1000": 1234567.0, "nothing": float("nan")}
    paid = pd.DataFrame({"learner": names, "reward": 0.0}).assign(**values)
    figure = Figure(figsize=(3, 2))
    figure.subplots().plot([0, 1], [0, 1])
    formats = {"reward": "+.3f", "share": ".1%", "per_1000": ",.0f", "nothing": ".2f"}
    about = "Means over attempts ± nothing, 100% of them."
    table = Table("paid", "Pay & <reward>", paid, formats, about)
    plot = SectionPlot("paid", "Pay", "A line.", figure)
    text = f"{len(paid)} learners & one < two."
    return Section("paid", "What was paid", (text,), (table,), (plot,))


OURS = Topic("paid", 1, paid_section)
SOLVED = trial_rows([1, 2, 3])


def written(record, folder, topics=(OURS,), figures=False, **known):
    """The report on few topics, which is quick."""
    record = table(record) if isinstance(record, list) else record
    experiment = experiment_of(record, **known)
    return make_report(Material.of(record, experiment), folder, topics, figures=figures).path


# -- what is on the page --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def whole():
    return whole_material()


@pytest.fixture(scope="module")
def report(whole, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return make_report(whole, folder)


@pytest.fixture(scope="module")
def html(report):
    return report.path.read_text(encoding="utf-8")


def test_report_on_a_made_up_experiment_of_every_case(html, golden):
    golden("report.txt", lines_of(html))


def test_page_fetches_nothing_and_refers_only_to_what_it_has(html):
    page = Page(html)
    assert page.open == []  # every tag is closed
    assert {tag for tag, _ in page.tags}.isdisjoint(
        {"script", "link", "img", "iframe", "object", "b", "u", "i", "purpose"}
    )
    names = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(names) == len(set(names))
    for _, attributes in page.tags:
        assert not any(name.startswith("on") for name in attributes)
        for name in {"href", "xlink:href", "src", "srcset", "data", "action"} & {*attributes}:
            value = attributes[name]
            assert value.startswith("data:image/png;base64,") or value[1:] in names
    assert all(address.startswith("#") for address in re.findall(r"url\(([^)]*)\)", html))
    assert "@import" not in html
    assert "http" not in re.sub(r'xmlns(:\w+)?="[^"]*"', "", html)
    assert "<script" not in html


def test_details_are_closed_on_the_screen_and_not_printed(html):
    details = [attributes for tag, attributes in Page(html).tags if tag == "details"]
    assert len(details) > 10
    assert not any("open" in attributes for attributes in details)
    assert "details:not([open]), nav" in html[html.index("@media print") :]


def test_report_on_nothing_and_report_without_warnings(tmp_path):
    assert "The record holds no attempts." in written([], tmp_path / "a").read_text("utf-8")
    enough = [row for s in range(20) for row in trial_rows([1, 2, 3], subject=s)]
    text = lines_of(written(enough, tmp_path / "b").read_text("utf-8"))
    assert text.endswith("h2: Warnings\nNone.")
    uneven = [*enough, *trial_rows([1, 2, 3], trial=2)]
    text = lines_of(written(uneven, tmp_path / "c").read_text("utf-8"))
    assert "Not every subject played every trial" in text
    assert "This comparison is unfinished" not in text


def test_many_missing_cells_are_counted_and_not_all_listed(tmp_path):
    path = written(SOLVED, tmp_path, missing=tuple(f"cell{i}" for i in range(30)))
    text = lines_of(path.read_text("utf-8"))
    assert "30 of its cells are missing" in text
    assert re.search(r"^cell23: .*\nand 6 more$", text, re.M)


@pytest.mark.parametrize(
    ("value", "form", "text"),
    [
        (-0.0004, "+.2f", "0.00"),
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
def test_values_of_tables_as_they_are_printed(value, form, text):
    assert printed(value, form) == text


def test_names_are_escaped_and_break_after_an_underscore():
    page = Table("a", "A", pd.DataFrame({"learner": ["a <b_ccccccccccccccccc"]})).html()
    assert ">a &lt;b_<wbr>ccccccccccccccccc</th>" in page


# -- its files ------------------------------------------------------------------------------------


def files_in(folder, *parts):
    return {path.name for part in parts for path in (folder / part).iterdir()}


def test_figures_and_tables_are_files_only_where_asked_and_the_page_is_the_same(tmp_path):
    record = pa.concat_tables(random_cells(3, conditions=("CC4", "CC3-CC4"), subjects=2))
    topics = [OURS, *topics_called("survival")]
    whole = written(record, tmp_path / "whole", topics, figures=True).read_text("utf-8")
    # Of rows in another order, the page with its figures is the same.
    rows = np.random.default_rng(0).permutation(record.num_rows)
    assert written(record.take(rows), tmp_path / "alone", topics).read_text("utf-8") == whole
    assert files_in(tmp_path / "alone", ".") == {"report.html", "summary.csv"}
    plots = {
        "paid",
        "survival_human",
        "survival_loops",
        "baseline_categories",
        "transfer_categories",
    }
    plots |= {"attempts_by_trial_human", "attempts_by_trial_loops", "learner_a", "learner_b"}
    tables = {f"learner_{name}_human.{kind}" for name in "ab" for kind in ("csv", "tex")}
    assert files_in(tmp_path / "whole", "figures") == {f"{stem}.pdf" for stem in plots}
    assert files_in(tmp_path / "whole", "tables") > {"leaderboard.csv", "paid.tex"} | tables


def test_a_path_that_cannot_be_written_is_named(tmp_path):
    for name in ("figures", "report.html"):
        folder = tmp_path / name
        folder.mkdir()
        if name == "figures":
            (folder / name).write_text("in the way")
        else:
            (folder / name).mkdir()
        with pytest.raises(OpenLockError, match=name):
            written(SOLVED, folder, figures=name == "figures")


def test_a_full_disk_leaves_the_earlier_report_whole(tmp_path, monkeypatch):
    written(SOLVED, tmp_path, title="earlier")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.*")}

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OpenLockError, match="No space left on device"):
        written(trial_rows([0, 1, 2, 3]), tmp_path, title="later")
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.*")} == before


# -- topics ---------------------------------------------------------------------------------------


def test_a_topic_of_ones_own_is_on_the_page_and_in_files(tmp_path):
    record = pa.concat_tables(random_cells(3, conditions=("CC4",), protocols=("human",)))
    html = written(record, tmp_path, figures=True).read_text("utf-8")
    names = ("results", "paid", "figures", "learners", "run")
    places = [html.index(f'<section id="{name}"') for name in names]
    assert places == sorted(places)
    assert '<a href="#paid">What was paid</a>' in html
    page = Page(html)
    assert "2 learners & one < two." in page.text
    shown = next(rows for rows in page.tables if "reward" in rows[0])
    assert shown[:2] == [
        ["learner", "reward", "share", "better", "per 1000", "nothing"],
        ["a", "+0.000", "12.5%", "yes", "1,234,567", "–"],
    ]
    with (tmp_path / "tables" / "paid.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["learner"] for row in rows] == ["a", "b"]
    assert (rows[0]["share"], rows[0]["per_1000"]) == ("0.125", "1.23457e+06")
    assert rows[0]["nothing"] == ""
    latex = (tmp_path / "tables" / "paid.tex").read_text("utf-8")
    for part in (
        *(
            r"\toprule",
            r"\midrule",
            r"\bottomrule",
            r"\label{tab:paid}",
            r"\begin{tabular}{lrrlrr}",
        ),
        r"Pay \& <reward>. Means over attempts ± nothing, 100\%",
        r"a & +0.000 & 12.5\% & yes & 1,234,567 & – \\",
    ):
        assert part in latex
    assert not re.search(r"(?<!\\)[%#_]", latex.replace(r"\label{tab:paid}", ""))


def test_each_step_of_a_report_is_named_when_it_begins(tmp_path):
    record, steps = table(SOLVED), []
    make_report(material_of(record, experiment_of(record)), tmp_path, [OURS], steps.append)
    assert steps == ["computing leaderboard", "describing paid", "drawing"]


def test_topics_of_an_empty_record_and_two_of_one_name():
    assert sections_of(material_of(table([]), NOBODY), all_topics()) == []
    record = table(SOLVED)
    with pytest.raises(ValueError, match="paid"):
        sections_of(material_of(record, experiment_of(record)), [OURS, OURS])


def test_beliefs_are_shown_only_of_the_same_rooms_and_the_same_version(whole, monkeypatch):
    def names(held):
        found = section_on(BELIEFS, held)
        return found and [plot.name for plot in found.plots]

    def changed(**values):
        return replace(whole, experiment=replace(whole.experiment, **values))

    assert names(whole) == ["belief_bayes"]
    (shown,) = section_on(BELIEFS, whole).tables
    first = whole.record.to_pandas().query("learner == 'bayes' and subject == 0 and trial == 1")
    assert shown.frame["actions"].tolist() == [len(one) for one in first["actions"]]
    # The room has a structure of log2(n) bits; in the end nearly all are obtained.
    assert (shown.frame["obtained"] * shown.frame["actions"]).sum() > 1
    assert names(replace(whole, all_trials=whole.trials.assign(seed=8))) is None  # another room
    assert names(changed(versions={"causal-openlock": "1"})) is None
    # Somebody else's package may change its learner, though the version of results stays.
    monkeypatch.setattr("causal_openlock.analysis.results.traces.is_ours", lambda _: False)
    (bayes,) = (one for one in whole.experiment.learners if one.name == "bayes")
    here, theirs = {"causal-openlock": RESULTS_VERSION}, replace(bayes, recorded=None)
    assert names(changed(versions=here, learners=(theirs,))) == ["belief_bayes"]
    theirs = replace(bayes, recorded=replace(bayes.origin, package="theirs 2"))
    assert names(changed(versions=here, learners=(theirs,))) is None


def test_trials_are_told_as_they_were_played(tmp_path):
    protocol = ol.Protocol("quick", attempt_limit=7, stop_when_solved=False, train_loops=4)
    experiment = ol.make_experiment(["CC4", "CC3-CE4"], ["random"], protocol=protocol)
    record = table(trial_rows([0] * 7, learner="random", protocol="quick"))
    page = make_report(Material.of(record, stored(experiment)), tmp_path, [OURS]).path
    text = lines_of(page.read_text("utf-8"))
    assert "7 attempts in every trial, also after it is solved." in text
    assert "6 training trials, gone through 4 times, then 1 test trial" in text
    assert "| CC3-CE4 | CC3 | CE4 | –" in text
    assert "| CC4 | CC4 | – | 1 trial" in text

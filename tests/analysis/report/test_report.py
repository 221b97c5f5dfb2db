"""The page of a report: what it shows, and that it stands alone."""

from __future__ import annotations

import re
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

from causal_openlock.analysis.report.what_was_run import edges
from causal_openlock.analysis.report.writing import write_report
from causal_openlock.contract.registry import create
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.schema_file import schema_from_dict
from causal_openlock.world import facts
from support.fabricated_records import record_of_every_figure, table, trial_rows
from support.figures import drawn
from support.html_page import Page
from support.made_up_experiments import condition_called, experiment_of, spec, stored

pytestmark = pytest.mark.slow


def written(record: pa.Table, folder: Path, **known: Any) -> Path:
    return write_report(record, folder, experiment_of(record, **known))


@pytest.fixture(scope="module")
def record() -> pa.Table:
    return record_of_every_figure()


@pytest.fixture(scope="module")
def report(record: pa.Table, tmp_path_factory: pytest.TempPathFactory) -> Path:
    with warnings.catch_warnings(), drawn():  # as SVG alone, which is what the page shows
        warnings.simplefilter("error")
        found = experiment_of(record)
        b = spec("b", parameters={"learning_rate": 0.001, "hidden": [128, 64]})
        others = [one for one in found.learners if one.name != "b"]
        return written(
            record,
            tmp_path_factory.mktemp("report"),
            title="Transfer <script>alert(1)</script> & more",
            seed=17,
            learners=(b, replace(b, protocol=others[1].protocol), *others),
            conditions=(*found.conditions, condition_called("<b>own</b>")),
            versions={"numpy": "2.0", "causal-openlock": ["0.1.0", "0.2.0"]},
        )


@pytest.fixture(scope="module")
def page(report: Path) -> Page:
    return Page(report.read_text(encoding="utf-8"))


def test_page_fetches_nothing(report: Path, page: Page) -> None:
    assert {tag for tag, _ in page.tags}.isdisjoint({"script", "link", "img", "iframe", "object"})
    assert page.open == []  # every tag is closed
    for _, attributes in page.tags:
        for name, value in attributes.items():
            if name in ("href", "xlink:href", "src", "srcset", "data", "action"):
                assert value is not None
                assert value.startswith(("#", "data:image/png;base64,"))
            assert not name.startswith("on")
    text = report.read_text(encoding="utf-8")
    assert all(address.startswith("#") for address in re.findall(r"url\(([^)]*)\)", text))
    assert "@import" not in text
    assert "http" not in re.sub(r'xmlns(:\w+)?="[^"]*"', "", text)


def test_page_refers_to_what_it_has(page: Page) -> None:
    names = [str(attributes["id"]) for _, attributes in page.tags if "id" in attributes]
    assert len(names) == len(set(names))
    for _, attributes in page.tags:
        for name in ("href", "xlink:href"):
            if str(attributes.get(name)).startswith("#"):
                assert str(attributes[name])[1:] in names
    figures = 6  # of the record; a learner has one on its page
    assert sum(tag == "svg" for tag, _ in page.tags) >= figures + len({"a", "b", "c", "five"})


def test_what_users_wrote_is_escaped(report: Path, page: Page) -> None:
    assert "Transfer <script>alert(1)</script> & more" in page.text
    assert {"script", "b", "u", "i"}.isdisjoint(tag for tag, _ in page.tags)
    assert "<script" not in report.read_text(encoding="utf-8")
    for text in ("<b>own</b>", "c <u> & d", "own <i>$x$", "learning_rate", "128, 64", "seed 17"):
        assert text in page.text


def test_headline_puts_people_first_and_the_published_model_next(page: Page) -> None:
    human, loops = page.tables[2], page.tables[3]
    assert human[0] == [
        "Learner",
        "CC3-CC4 | test",  # in the experiment's order
        "CC4 | trial 3 or trial 5",
        "CE3-CE4 | test",
        "CE4 | trial 3",
        "own <i>$x$ | trial 3",
    ]
    assert human[1] == [
        "People | published, n = 40",
        "5.53 | ± 0.49",
        "–",  # its learners ended with different trials
        "7.72 | ± 0.77",
        "12.18 | ± 1.31",
        "–",
    ]
    assert human[2] == [
        "Published model | theory-based, n = 40",
        "7.06 | ± 0.33",
        "–",
        "9.16 | ± 0.48",
        "11.38 | ± 0.61",
        "–",
    ]
    # The experiment's order, then the alphabet.
    names = ["b | n = 3", "a | n = 3", "c <u> & d | n = 3"]
    assert human[3][:3] == ["Ideal observer | schema known", "3.75", "3.75"]
    assert [row[0] for row in human[4:]] == [*names, "five | n = 1"]
    assert human[7][2] == "3.00"  # one subject has no interval
    assert [row[0] for row in loops] == ["Learner", human[3][0], *names]
    assert not re.search("people|model", str(loops).lower())


def test_headline_shows_intervals_and_shares_where_there_is_something_to_show(
    tmp_path: Path,
) -> None:
    rows = [
        *trial_rows([1, 2, 3], learner="alike"),
        *trial_rows([1, 2, 3], learner="alike", subject=1),
        *trial_rows([0, 0, 0, 0], learner="never"),
        *trial_rows([0, 0, 0, 0], learner="never", subject=1),
        *trial_rows([1, 2, 3], learner="mixed"),
        *trial_rows([0, 0, 0, 0], learner="mixed", subject=1),
    ]
    shown = Page(written(table(rows), tmp_path).read_text("utf-8")).tables[1]
    cells = {row[0].split(" | ")[0]: row[1] for row in shown[4:]}
    assert cells == {
        "alike": "3.00",
        "never": "not within 4",
        "mixed": "≥ 3.50 | 3.00–4.00",
    }


def test_full_tables_have_the_published_numbers_in_place(page: Page) -> None:
    heads = re.findall(r"(\S.*), protocol (\w+), n = \d", page.text)
    tables = [rows for rows in page.tables if rows[0][:2] == ["Condition", "Phase"]]
    assert len(heads) == len(tables) == 7
    by_trial = {}
    for (learner, protocol), (header, *rows) in zip(heads, tables, strict=True):
        for row in rows:
            cells = dict(zip(header, row, strict=True))  # of two columns SE the last
            key = (learner, cells["Condition"], protocol, cells["Trial"], cells["Phase"])
            assert key not in by_trial
            by_trial[key] = cells
    results = facts.results()
    sources = {
        "People": results["cogsci2018"]["human"],
        "Published model": results["aaai2020"]["model"],
    }
    for column, source in sources.items():
        shown = [by_trial["five", "CC4", "human", str(t), "train"][column] for t in range(1, 6)]
        assert shown == [f"{mean:.2f}" for mean in source["baseline"]["CC4"]["mean"]]
    first = by_trial["five", "CC4", "human", "1", "train"]
    assert (first["People"], first["Published model"], first["SE"]) == ("19.38", "11.44", "0.34")
    assert by_trial["five", "CC4", "human", "1", "train"]["Difference"] == "−16.38"
    for column, test in (("People", "5.53"), ("Published model", "7.06")):
        assert column not in by_trial["a", "CC4", "loops", "1", "train"]
        assert by_trial["a", "CC3-CC4", "human", "1", "train"][column] == "–"
        assert by_trial["a", "CC3-CC4", "human", "1", "test"][column] == test


def test_tables_of_details_are_closed_on_the_screen_and_not_printed(
    report: Path, page: Page
) -> None:
    details = [attributes for tag, attributes in page.tags if tag == "details"]
    assert len(details) > 10
    assert not any("open" in attributes for attributes in details)
    text = report.read_text(encoding="utf-8")
    assert "details:not([open]), nav" in text[text.index("@media print") :]


def test_warnings_say_what_to_doubt(page: Page, tmp_path: Path) -> None:
    text = page.text[page.text.rindex("Warnings") :]
    assert "Fewer than 20 subjects" in text
    assert "five (human): 1" in text
    assert "Some trials were not solved" in text
    assert "different versions of causal-openlock (0.1.0, 0.2.0)" in text
    assert "versions of numpy" not in text
    good = table([row for s in range(20) for row in trial_rows([1, 2, 3], subject=s)])
    quiet = Page(written(good, tmp_path).read_text(encoding="utf-8"))
    assert quiet.text.rstrip().endswith("None.")


def test_uneven_subjects_are_warned_about(tmp_path: Path) -> None:
    rows = [row for s in range(20) for row in trial_rows([1, 2, 3], subject=s)]
    rows += trial_rows([1, 2, 3], trial=2)
    text = Page(written(table(rows), tmp_path).read_text(encoding="utf-8")).text
    assert "Not every subject played every trial" in text


def test_versions_are_warned_about_where_there_are_several(tmp_path: Path) -> None:
    rows = [row for s in range(20) for row in trial_rows([1, 2, 3], subject=s)]
    versions = {"Python": "3.13.1", "numpy": ["2.1", "2.0"], "torch": ["2.13"]}
    path = written(table(rows), tmp_path, versions=versions)
    text = Page(path.read_text(encoding="utf-8")).text
    assert text.count("different versions") == 1
    assert "Cells were run with different versions of numpy (2.0, 2.1)." in text
    assert "Python 3.13.1; numpy 2.1, 2.0; torch 2.13." in text


def test_an_unfinished_comparison_opens_with_what_is_missing(tmp_path: Path) -> None:
    record = table(trial_rows([1, 2, 3]))
    caution = "This comparison is unfinished"
    assert caution not in written(record, tmp_path).read_text(encoding="utf-8")
    names = ("ddqn_CC4_0-39", "<b>_CE4_0-39")
    half = written(record, tmp_path, title="half", missing=names)
    text = Page(half.read_text(encoding="utf-8")).text
    assert text.index("half") < text.index(caution) < text.index("Results", text.index(caution))
    assert "unfinished: 2 of its cells are missing" in text
    assert all(f"{name}: not played yet" in text for name in names)
    assert "missing cells" not in text[text.rindex("What was run") :]
    many = written(record, tmp_path, missing=tuple(f"cell{i}" for i in range(30)))
    text = Page(many.read_text(encoding="utf-8")).text
    assert "30 of its cells are missing" in text
    assert "cell23: not played yet" in text
    assert "and 6 more" in text


def test_trials_are_told_as_they_were_played(tmp_path: Path) -> None:
    declared = tmp_path / "own.yaml"
    declared.write_text(
        "name: own\nsubjects: 2\nconditions: [CC4-CC3, CE4]\n"
        "learners: [{learner: random, name: a}]\n"
    )
    experiment = read_experiment(declared)
    (entry,), found = experiment.learners, []
    for condition in experiment.conditions:
        session = Session(condition, entry.protocol, 2, learner="a")
        found.append(session.play(create("random")))
    page = Page(
        write_report(pa.concat_tables(found), tmp_path, stored(experiment)).read_text("utf-8")
    )
    cells = [row for rows in page.tables for row in rows]
    assert ["CC4-CC3", "CC4", "CC3", "5 training trials, then 1 test trial"] in cells
    assert ["CE4", "CE4", "–", "5 trials"] in cells
    assert "Fewer where fewer layouts are published; a condition may say otherwise." in page.text


def test_what_was_run_is_told_in_words(tmp_path: Path) -> None:
    declared = tmp_path / "own.yaml"
    declared.write_text(
        "name: own\ntitle: One learner\nseed: 3\nsubjects: 2\n"
        "conditions: [CC4, CC3-CE4]\nlearners: [{learner: random, name: me, protocol: quick}]\n"
        "protocols: {quick: {based_on: rl, attempt_limit: 7, train_loops: 4}}\n"
    )
    versions = {"causal-openlock": "0.1.0", "numpy": ["2.0", "2.1"]}
    experiment = stored(read_experiment(declared), versions=versions)
    rows = trial_rows([0] * 7, learner="me", protocol="quick")
    page = Page(write_report(table(rows), tmp_path, experiment).read_text("utf-8"))
    text = page.text[page.text.rindex("What was run") :]
    assert "7 attempts in every trial, also after it is solved." in text
    assert "6 training trials, gone through 4 times, then 5 test trials" in text
    assert "L0 → L1, L2, L3; L1, L2, L3 → door" in text
    assert "causal-openlock 0.1.0; numpy 2.0, 2.1." in text
    assert f"causal-openlock compare {declared}" in text
    assert "negative_immovable" in text
    assert not re.search(r"[{}\[\]]|None|True|False", text)
    cells = [row for rows in page.tables for row in rows]
    assert ["CC3-CE4", "CC3", "CE4", "–"] in cells
    assert ["CC4", "CC4", "–", "1 trial"] in cells


def test_edges_in_a_line_tell_what_is_out_of_the_ordinary() -> None:
    noisy = {
        "name": "noisy",
        "levers": ["L0", "L1", "L2", "L3"],
        "edges": {"L0": {"L1": {"strength": 0.8}, "door": {}}, "L1": ["door"], "L2": ["door"]},
        "gates": {"door": {"at_least": 2}, "L1": "all"},
        "inert": ["L3"],
    }
    assert edges(schema_from_dict(noisy)) == (
        "L0 → L1 (0.8), door; L1, L2 → door; L1 needs all of its causes; "
        "door needs at least 2 of its causes; without effect: L3"
    )


def test_empty_record_makes_a_report(tmp_path: Path) -> None:
    page = Page(written(table([]), tmp_path).read_text("utf-8"))
    assert "The record holds no attempts." in page.text

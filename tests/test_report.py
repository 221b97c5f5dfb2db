"""Figures and the report: what they show, and that they stand alone."""

from __future__ import annotations

import re
import warnings
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from matplotlib.colors import to_hex
from test_measures import random_cells, table, trial_rows

from causal_openlock import reference
from causal_openlock.analysis import style
from causal_openlock.analysis.categories import baseline_categories, transfer_categories
from causal_openlock.analysis.figures import (
    attempts_by_trial,
    baseline_attempts,
    draw_all,
    transfer_attempts,
)
from causal_openlock.analysis.measures import attempts_to_solve, category_counts
from causal_openlock.analysis.report import write_report
from causal_openlock.record import CATEGORIES

VOID = {"meta", "link", "img", "br", "hr", "input"}


class Page(HTMLParser):
    """Reads a page: its tags, its text, and the cells of its tables."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.text = ""
        self.tables: list[list[list[str]]] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")
        elif tag == "small" and self.tables:
            self.tables[-1][-1][-1] += " | "

    def handle_startendtag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attributes)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("script", "style"):
            return
        self.text += data
        if "td" in self.open or "th" in self.open:
            self.tables[-1][-1][-1] += data


EXPERIMENT: dict[str, Any] = {
    "name": "paper",
    "title": "Transfer <script>alert(1)</script> & more",
    "seed": 17,
    "protocols": {"human": {"attempts": 30}},
    "learners": {"b": {"learning_rate": 0.001, "hidden": [128, 64]}, "a": None},
    "conditions": ["CC4", "<b>own</b>"],
    "versions": {"numpy": "2.0", "causal-openlock": ["0.1.0", "0.2.0"]},
}


@pytest.fixture(scope="module")
def record() -> pa.Table:
    conditions = ("CC4", "CE4", "CC3-CC4", "CE3-CE4", "own <i>$x$")
    cells = random_cells(2, learners=("a", "b", "c <u> & d"), conditions=conditions)
    rows = []
    for trial in range(1, 6):
        rows += trial_rows([1, 2, 3], trial=trial, learner="five", condition="CC4")
    return pa.concat_tables([*cells, table(rows)])


@pytest.fixture(scope="module")
def report(record: pa.Table, tmp_path_factory: pytest.TempPathFactory) -> Path:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return write_report(record, tmp_path_factory.mktemp("report"), EXPERIMENT)


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
                assert value.startswith("#")
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
            if name in attributes:
                assert str(attributes[name])[1:] in names
    assert sum(tag == "svg" for tag, _ in page.tags) == 6


def test_what_users_wrote_is_escaped(report: Path, page: Page) -> None:
    assert "Transfer <script>alert(1)</script> & more" in page.text
    assert {"script", "b", "u", "i"}.isdisjoint(tag for tag, _ in page.tags)
    assert "<script" not in report.read_text(encoding="utf-8")
    for text in ("<b>own</b>", "c <u> & d", "own <i>$x$", "learning_rate", "128, 64", "seed 17"):
        assert text in page.text


def test_headline_puts_people_first(page: Page) -> None:
    human, loops = page.tables[0], page.tables[1]
    assert human[0] == [
        "Learner",
        "CC4 | trial 3 or trial 5",
        "CE4 | trial 3",
        "CC3-CC4 | test",
        "CE3-CE4 | test",
        "own <i>$x$ | trial 3",
    ]
    assert human[1] == [
        "People | published, n = 40",
        "–",  # its learners ended with different trials
        "12.175 | SE 1.306",
        "5.525 | SE 0.490",
        "7.725 | SE 0.769",
        "–",
    ]
    # The experiment's order, then the alphabet.
    assert [row[0] for row in human[2:]] == ["b", "a", "c <u> & d", "five"]
    assert human[5][1] == "3.000 | – | −3.450 vs. people"  # one subject has no interval
    assert [row[0] for row in loops] == ["Learner", "b", "a", "c <u> & d"]
    assert "people" not in str(loops).lower()


def test_full_table_has_the_published_numbers_in_place(page: Page) -> None:
    header, *rows = page.tables[-1]
    place = {name: index for index, name in enumerate(header) if name != "SE"}
    key = [place[name] for name in ("Learner", "Condition", "Protocol", "Trial", "Phase")]
    by_trial = {tuple(row[index] for index in key): row for row in rows}
    means = reference.results()["cogsci2018"]["human"]["baseline"]["CC4"]["mean"]
    people = [
        by_trial["five", "CC4", "human", str(t), "train"][place["People"]] for t in range(1, 6)
    ]
    assert people == [f"{mean:.3f}" for mean in means]
    assert people[0] == "19.375"
    assert by_trial["five", "CC4", "human", "1", "train"][place["Difference"]] == "−16.375"
    assert by_trial["a", "CC4", "loops", "1", "train"][place["People"]] == "–"
    assert by_trial["a", "CC3-CC4", "human", "1", "train"][place["People"]] == "–"
    assert by_trial["a", "CC3-CC4", "human", "1", "test"][place["People"]] == "5.525"
    assert len(rows) == len(by_trial)


def test_warnings_say_what_to_doubt(page: Page, tmp_path: Path) -> None:
    text = page.text[page.text.rindex("Warnings") :]
    assert "Fewer than 20 subjects" in text
    assert "five, CC4, human: 1" in text
    assert "were not solved and count as the limit" in text
    assert "different versions of causal-openlock (0.1.0, 0.2.0)" in text
    assert "versions of numpy" not in text
    good = table([row for s in range(20) for row in trial_rows([1, 2, 3], subject=s)])
    quiet = Page(write_report(good, tmp_path, {}).read_text(encoding="utf-8"))
    assert quiet.text.rstrip().endswith("None.")


def test_uneven_subjects_are_warned_about(tmp_path: Path) -> None:
    rows = [row for s in range(20) for row in trial_rows([1, 2, 3], subject=s)]
    rows += trial_rows([1, 2, 3], trial=2)
    text = Page(write_report(table(rows), tmp_path, {}).read_text(encoding="utf-8")).text
    assert "Not every subject played every trial" in text


def test_files_beside_the_page(report: Path) -> None:
    names = {path.name for path in (report.parent / "figures").iterdir()}
    stems = {
        "baseline_attempts",
        "transfer_attempts",
        "baseline_categories",
        "transfer_categories",
        "attempts_by_trial_human",
        "attempts_by_trial_loops",
    }
    assert names == {f"{stem}.{kind}" for stem in stems for kind in ("png", "svg")}
    assert (report.parent / "summary.csv").read_text().startswith("learner,condition,protocol,")


def test_writing_again_writes_the_same(report: Path, record: pa.Table, tmp_path: Path) -> None:
    rows = np.random.default_rng(0).permutation(record.num_rows)
    write_report(record.take(rows), tmp_path, EXPERIMENT)
    for path in report.parent.rglob("*.*"):
        assert (tmp_path / path.relative_to(report.parent)).read_bytes() == path.read_bytes()


def test_empty_record_makes_a_report(tmp_path: Path) -> None:
    page = Page(write_report(table([]), tmp_path, {"title": "nothing"}).read_text("utf-8"))
    assert "The record holds no attempts." in page.text


# -- figures ------------------------------------------------------------------------------------


def test_first_panel_of_figure_3_is_people(record: pa.Table) -> None:
    drawing = baseline_attempts(attempts_to_solve(record), ["b"])
    assert drawing is not None
    titles = [axes.get_title(loc="left") for axes in drawing.figure.axes]
    assert titles == ["People", "b", "a", "c <u> & d", "five"]
    human = reference.results()["cogsci2018"]["human"]["baseline"]
    heights = [bar.get_height() for bar in drawing.figure.axes[0].patches]
    assert heights == [*human["CC4"]["mean"], *human["CE4"]["mean"]]
    colours = {to_hex(bar.get_facecolor()).upper() for bar in drawing.figure.axes[0].patches[:5]}
    assert colours == {style.COMMON_CAUSE}
    (segments,) = [line.get_segments() for line in drawing.figure.axes[0].collections[:1]]
    spans = [(end[1] - start[1]) / 2 for start, end in segments]
    assert spans == pytest.approx(human["CC4"]["se"])


def test_figure_4_shows_the_test_by_what_was_trained(record: pa.Table) -> None:
    drawing = transfer_attempts(attempts_to_solve(record))
    assert drawing is not None
    people = drawing.figure.axes[0].patches
    assert [bar.get_height() for bar in people] == [5.525, 8.175, 13.75, 7.725]
    assert [to_hex(bar.get_facecolor()).upper() for bar in people] == [
        style.COMMON_CAUSE,
        style.COMMON_EFFECT,
    ] * 2
    assert len(drawing.figure.axes[1].patches) == 2  # conditions that were not run are left out


def test_figure_6_segments_are_logarithms_of_counts(record: pa.Table) -> None:
    counts = category_counts(record)
    drawing = baseline_categories(counts)
    assert drawing is not None
    published = reference.results()["cogsci2018"]["ddqn"]["baseline_counts"]
    first = drawing.figure.axes[0].patches
    block = published["CE4"]["0-30k"]
    assert [bar.get_height() for bar in first[:5]] == pytest.approx(np.log10(list(block.values())))
    assert {bar.get_linestyle() for bar in first[:5]} == {":"}
    assert first[4].get_y() + first[4].get_height() == pytest.approx(15.55, abs=0.01)
    # Fifty segments, less the one that the paper's last bar lacks.
    assert len(first) == 49
    mine = counts[
        (counts["learner"] == "a")
        & (counts["protocol"] == "loops")
        & (counts["condition"] == "CC4")
        & (counts["block"] == 1)
    ]
    solid = [bar for bar in drawing.figure.axes[1].patches if bar.get_linestyle() == "-"]
    heights = [np.log10(count) for count in mine["count"] if count > 1]
    assert [bar.get_height() for bar in solid[: len(heights)]] == pytest.approx(heights)


def test_figure_7_first_panel_is_published(record: pa.Table) -> None:
    drawing = transfer_categories(category_counts(record, 1))
    assert drawing is not None
    published = reference.results()["cogsci2018"]["ddqn"]["transfer_counts"]
    heights = [bar.get_height() for bar in drawing.figure.axes[0].patches]
    expected = [np.log10(published[c][k]) for c in published for k in CATEGORIES]
    assert heights == pytest.approx(expected)


def test_only_what_there_are_data_for_is_drawn() -> None:
    def names(**values: Any) -> list[str]:
        return [d.name for d in draw_all(table(trial_rows([1, 2, 3], **values)))]

    assert names() == ["baseline_attempts", "attempts_by_trial_human"]
    assert names(condition="mine") == ["attempts_by_trial_human"]
    assert names(protocol="My RL!") == ["baseline_categories", "attempts_by_trial_my_rl_"]
    assert names(condition="CC3-CC4", phase="test") == [
        "transfer_attempts",
        "attempts_by_trial_human",
    ]


def test_a_long_course_is_drawn_in_few_points() -> None:
    rows = []
    for loop in range(1, 131):
        rows += trial_rows([0] * (loop % 2) + [1, 2, 3], loop=loop, protocol="rl")
    drawing = attempts_by_trial(attempts_to_solve(table(rows)), "rl")
    assert drawing is not None
    x, y = drawing.figure.axes[0].lines[0].get_data()
    assert len(x) == 44  # 130 trials by threes, the last one alone
    assert list(x[:2]) == [2, 5]
    assert x[-1] == 130
    assert y[:2] == pytest.approx([11 / 3, 10 / 3])
    assert "a point averages up to 3 trials" in drawing.caption


def test_many_learners_wrap() -> None:
    rows = [row for i in range(11) for row in trial_rows([1, 2, 3], learner=f"learner {i:02}")]
    drawing = baseline_attempts(attempts_to_solve(table(rows)))
    assert drawing is not None
    assert len(drawing.figure.axes) == 12
    assert drawing.figure.get_figwidth() == style.WIDTH

"""Figures and the report: what they show, and that they stand alone."""

from __future__ import annotations

import errno
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
from causal_openlock.analysis.course import attempts_by_trial
from causal_openlock.analysis.description import edges
from causal_openlock.analysis.figures import baseline_attempts, draw_all, transfer_attempts
from causal_openlock.analysis.measures import (
    PAPER_CONDITIONS,
    attempts_to_solve,
    category_counts,
)
from causal_openlock.analysis.report import FIGURE_NAME, write_report
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment_file import read_experiment
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
        "12.18 | ± 1.31",
        "5.53 | ± 0.49",
        "7.72 | ± 0.77",
        "–",
    ]
    # The experiment's order, then the alphabet.
    names = ["b | n = 3", "a | n = 3", "c <u> & d | n = 3"]
    assert [row[0] for row in human[2:]] == [*names, "five | n = 1"]
    assert human[5][1] == "3.00"  # one subject has no interval
    assert [row[0] for row in loops] == ["Learner", *names]
    assert "people" not in str(loops).lower()


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
    shown = Page(write_report(table(rows), tmp_path, {}).read_text("utf-8")).tables[0]
    cells = {row[0].split(" | ")[0]: row[1] for row in shown[2:]}
    assert cells == {
        "alike": "3.00",
        "never": "4.00 | none solved",
        "mixed": "3.50 | 3.00–4.00 | 50.0% solved",
    }


def test_full_tables_have_the_published_numbers_in_place(page: Page) -> None:
    heads = re.findall(r"(\S.*), protocol (\w+), n = \d", page.text)
    tables = [rows for rows in page.tables if rows[0][0] == "Condition"]
    assert len(heads) == len(tables) == 7
    by_trial = {}
    for (learner, protocol), (header, *rows) in zip(heads, tables, strict=True):
        for row in rows:
            cells = dict(zip(header, row, strict=True))  # of two columns SE the last
            key = (learner, cells["Condition"], protocol, cells["Trial"], cells["Phase"])
            assert key not in by_trial
            by_trial[key] = cells
    means = reference.results()["cogsci2018"]["human"]["baseline"]["CC4"]["mean"]
    people = [by_trial["five", "CC4", "human", str(t), "train"]["People"] for t in range(1, 6)]
    assert people == [f"{mean:.2f}" for mean in means]
    assert people[0] == "19.38"
    assert by_trial["five", "CC4", "human", "1", "train"]["Difference"] == "−16.38"
    assert "People" not in by_trial["a", "CC4", "loops", "1", "train"]
    assert by_trial["a", "CC3-CC4", "human", "1", "train"]["People"] == "–"
    assert by_trial["a", "CC3-CC4", "human", "1", "test"]["People"] == "5.53"


def test_full_tables_are_closed_on_the_screen_and_open_in_print(report: Path, page: Page) -> None:
    details = [attributes for tag, attributes in page.tags if tag == "details"]
    assert details == [{}] * 7
    text = report.read_text(encoding="utf-8")
    assert "details-content { content-visibility: visible" in text[text.index("@media print") :]


def test_warnings_say_what_to_doubt(page: Page, tmp_path: Path) -> None:
    text = page.text[page.text.rindex("Warnings") :]
    assert "Fewer than 20 subjects" in text
    assert "five (human): 1" in text
    assert "Some trials were not solved" in text
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


def test_figures_of_an_earlier_report_are_removed_and_nothing_else(tmp_path: Path) -> None:
    rows = trial_rows([1, 2, 3])
    both = [*rows, *trial_rows([1, 2, 3], protocol="rl"), *trial_rows([1, 2, 3], condition="x-y")]
    write_report(table(both), tmp_path, {})
    figures = tmp_path / "figures"
    (figures / "mine.png").write_text("")
    (figures / "baseline_attempts_mine.svg").write_text("")
    (figures / "attempts_by_trial_rl.txt").write_text("")
    assert (figures / "attempts_by_trial_rl.svg").exists()
    write_report(table(rows), tmp_path, {})
    assert {path.name for path in figures.iterdir()} == {
        *(f"{stem}.{kind}" for stem in ("baseline_attempts", "attempts_by_trial_human")
          for kind in ("png", "svg")),
        "mine.png",
        "baseline_attempts_mine.svg",
        "attempts_by_trial_rl.txt",
    }  # fmt: skip


def test_names_of_all_figures_are_known(record: pa.Table) -> None:
    assert all(FIGURE_NAME.fullmatch(drawing.name) for drawing in draw_all(record))


def test_protocols_of_similar_names_have_files_of_their_own() -> None:
    rows = [row for name in ("a-b", "a_b") for row in trial_rows([1], protocol=name)]
    names = [drawing.name for drawing in draw_all(table(rows))]
    assert names[-2:] == ["attempts_by_trial_a_b", "attempts_by_trial_a_b_2"]


def test_a_folder_that_cannot_be_written_to_is_told_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "figures").write_text("in the way")
    with pytest.raises(OpenLockError, match=r"figures.*cannot be written"):
        write_report(table(trial_rows([1, 2, 3])), tmp_path, {})
    (tmp_path / "figures").unlink()
    (tmp_path / "report.html").mkdir()
    with pytest.raises(OpenLockError, match=r"report.html.*cannot be written"):
        write_report(table(trial_rows([1, 2, 3])), tmp_path, {})


def test_a_full_disk_leaves_the_earlier_report_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_report(table(trial_rows([1, 2, 3])), tmp_path, {"title": "earlier"})
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.*")}

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OpenLockError, match="No space left on device"):
        write_report(table(trial_rows([0, 1, 2, 3])), tmp_path, {"title": "later"})
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.*")} == before


def test_what_was_run_is_told_in_words(tmp_path: Path) -> None:
    declared = tmp_path / "own.yaml"
    declared.write_text(
        "name: own\ntitle: One learner\nseed: 3\nsubjects: 2\n"
        "conditions: [CC4, CC3-CE4]\nlearners: [{learner: random, name: me, protocol: quick}]\n"
        "protocols: {quick: {based_on: rl, attempt_limit: 7, train_loops: 4}}\n"
    )
    experiment = {
        **read_experiment(declared).as_dict(),
        "versions": {"causal-openlock": "0.1.0", "numpy": ["2.0", "2.1"]},
    }
    rows = trial_rows([0] * 7, learner="me", protocol="quick")
    page = Page(write_report(table(rows), tmp_path, experiment).read_text("utf-8"))
    text = page.text[page.text.index("What was run", 200) :]
    assert "7 attempts in every trial, also after it is solved." in text
    assert "6 training trials, gone through 4 times, then 5 test trials" in text
    assert "L0 → L1, L2, L3; L1, L2, L3 → door" in text
    assert "causal-openlock 0.1.0; numpy 2.0, 2.1." in text
    assert "causal-openlock compare EXPERIMENT.yaml --out DIR" in text
    assert "negative_immovable" in text
    assert not re.search(r"[{}\[\]]|None|True|False", text)
    assert ["CC3-CE4", "CC3", "CE4"] in [row for rows in page.tables for row in rows]


def test_edges_in_a_line_tell_what_is_out_of_the_ordinary() -> None:
    noisy = {
        "name": "noisy",
        "levers": ["L0", "L1", "L2", "L3"],
        "edges": {"L0": {"L1": {"strength": 0.8}, "door": {}}, "L1": ["door"], "L2": ["door"]},
        "gates": {"door": {"at_least": 2}, "L1": "all"},
        "inert": ["L3"],
    }
    assert edges(noisy) == (
        "L0 → L1 (0.8), door; L1, L2 → door; door needs at least 2 of its causes; "
        "L1 needs all of its causes; without effect: L3"
    )


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
    x, y = drawing.figure.axes[1].lines[0].get_data()  # the first axes hold the key
    assert len(x) == 44  # 130 trials by threes, the last one alone
    assert list(x[:2]) == [2, 5]
    assert x[-1] == 130
    assert y[:2] == pytest.approx([11 / 3, 10 / 3])
    assert "a point averages up to 3 trials" in drawing.caption


LONG = "a_learner_with_a_name_that_no_panel_can_hold"
OWN = ("chain3", "noisy_CC3", "my_condition-with_a_name_that_is_long", "d", "e", "f", "g", "h")


@pytest.mark.parametrize(
    ("learners", "conditions"),
    [
        (1, OWN[:1]),
        (1, OWN),
        (3, PAPER_CONDITIONS),
        (4, ("CE3-CC4",)),
        (12, (*PAPER_CONDITIONS, *OWN[:2])),
    ],
)
def test_every_line_by_trial_lies_in_its_panel(learners: int, conditions: tuple[str, ...]) -> None:
    names = tuple(f"{LONG if i % 3 == 2 else 'learner'} {i:02}" for i in range(learners))
    cells = random_cells(5, learners=names, conditions=conditions, protocols=("human",), subjects=1)
    # The first learner solves everything at once, which must not set the scale for the others.
    quick = [row for name in conditions
             for row in trial_rows([1], 1, learner="0", condition=name)]  # fmt: skip
    drawing = attempts_by_trial(
        attempts_to_solve(pa.concat_tables([table(quick), *cells])), "human"
    )
    assert drawing is not None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        style.svg_text(drawing.figure)
    panels = [axes for axes in drawing.figure.axes if axes.axison]
    drawn = 0
    for axes in panels:
        lines = [line for line in axes.lines if str(line.get_marker()) in "os^D"]
        drawn += len({line.get_color() for line in lines})
        for line in lines:
            low, high = axes.get_ylim()
            assert all(low <= y <= high for y in line.get_ydata())
            assert all(axes.get_xlim()[0] <= x <= axes.get_xlim()[1] for x in line.get_xdata())
        width, height = axes.get_window_extent().size / drawing.figure.dpi
        assert width > 1
        assert height > 0.7
    assert drawn == (learners + 1) * len(conditions)
    columns = {1: 1, 6: 3, 8: 4}[len(conditions)]
    assert len(panels) == (learners + 1) * columns


def test_the_test_and_the_limit_are_marked() -> None:
    rows = [
        row for trial in (1, 2) for row in trial_rows([0, 0, 0], trial=trial, condition="CC3-CC4")
    ]
    rows += trial_rows([1, 2, 3], condition="CC3-CC4", phase="test")
    drawing = attempts_by_trial(attempts_to_solve(table(rows)), "human")
    assert drawing is not None
    panel = drawing.figure.axes[1]
    assert [text.get_text() for text in panel.texts] == ["test", "n = 1"]
    thin = [line for line in panel.lines if line.get_linewidth() < 1]
    limit, test = thin
    assert set(limit.get_ydata()) == {3}
    assert set(test.get_xdata()) == {2.5}


def test_blocks_are_named_like_the_papers() -> None:
    def names(attempts: int, loops: int) -> list[str]:
        rows = [
            row
            for loop in range(1, loops + 1)
            for row in trial_rows([0] * attempts, loop=loop, protocol="rl")
        ]
        drawing = baseline_categories(category_counts(table(rows)))
        assert drawing is not None
        return [label.get_text() for label in drawing.figure.axes[1].get_xticklabels()]

    assert names(30, 5) == ["0–30", "30–60", "60–90", "90–120", "120–150"]
    assert names(300, 10) == ["0–0.6k", "0.6–1.2k", "1.2–1.8k", "1.8–2.4k", "2.4–3k"]


def test_many_learners_wrap() -> None:
    rows = [row for i in range(11) for row in trial_rows([1, 2, 3], learner=f"learner {i:02}")]
    drawing = baseline_attempts(attempts_to_solve(table(rows)))
    assert drawing is not None
    assert len(drawing.figure.axes) == 12
    assert drawing.figure.get_figwidth() == style.WIDTH

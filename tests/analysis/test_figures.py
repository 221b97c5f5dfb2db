"""What the figures of results show, and that it lies where it should."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pyarrow as pa
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from causal_openlock.analysis.measures import category_counts
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.attempts import plot_attempts, plot_transfer
from causal_openlock.analysis.plots.categories import plot_categories
from causal_openlock.analysis.plots.course import plot_course
from causal_openlock.analysis.plots.style import WIDTH
from causal_openlock.analysis.report.all_figures import figures_of
from causal_openlock.analysis.results.material import Material
from causal_openlock.experiment.protocol import PAPER_CONDITIONS
from causal_openlock.experiment.record import CATEGORIES
from causal_openlock.world import facts
from support.fabricated_records import random_cells, record_of_every_figure, table, trial_rows
from support.made_up_experiments import experiment_of

pytestmark = pytest.mark.slow

STYLE = style.PlotStyle()


def made(record: pa.Table | list[Any], **known: Any) -> Material:
    record = table(record) if isinstance(record, list) else record
    return Material.of(record, experiment_of(record, **known))


@pytest.fixture(scope="module")
def results() -> Material:
    return made(record_of_every_figure())


@pytest.fixture(autouse=True)
def _figures_are_closed() -> Iterator[None]:
    yield
    plt.close("all")


def test_names_of_all_figures_are_known(results: Material) -> None:
    assert all(re.fullmatch("[a-z0-9_]+", plot.name) for plot in figures_of(results))


def test_protocols_of_similar_names_have_files_of_their_own() -> None:
    rows = [row for name in ("a-b", "a_b") for row in trial_rows([1], protocol=name)]
    names = [plot.name for plot in figures_of(made(rows))]
    assert names[-2:] == ["attempts_by_trial_a_b", "attempts_by_trial_a_b_2"]


PUBLISHED = (
    facts.results()["cogsci2018"]["human"],
    facts.results()["aaai2020"]["model"],
)


def test_the_first_panels_of_figure_3_are_people_and_the_published_model(results: Material) -> None:
    panels = plot_attempts(results)
    titles = [axes.get_title(loc="left") for axes in panels]
    assert titles == ["People", "Published model", "a", "b", "c <u> & d", "five"]
    details = [axes.texts[0].get_text() for axes in panels]
    assert details == ["published, n = 40", "theory-based, n = 40", *["n = 3"] * 3, "n = 1"]
    for axes, source in zip(panels, PUBLISHED, strict=False):
        means = source["baseline"]
        heights = [bar.get_height() for bar in axes.patches]
        assert heights == [*means["CC4"]["mean"], *means["CE4"]["mean"]]
        colours = [to_hex(bar.get_facecolor()).upper() for bar in axes.patches]
        assert colours == [STYLE.common_cause] * 5 + [STYLE.common_effect] * 5
        for bars, condition in zip(axes.collections, ("CC4", "CE4"), strict=True):
            spans = [(end[1] - start[1]) / 2 for start, end in bars.get_segments()]
            assert spans == pytest.approx(means[condition]["se"])


def test_figure_4_shows_the_test_by_what_was_trained(results: Material) -> None:
    people, model, first, *_ = plot_transfer(results)
    assert [bar.get_height() for bar in people.patches] == [5.525, 8.175, 13.75, 7.725]
    assert [bar.get_height() for bar in model.patches] == [7.06, 6.7, 11.44, 9.16]
    for published in (people, model):
        assert [to_hex(bar.get_facecolor()).upper() for bar in published.patches] == [
            STYLE.common_cause,
            STYLE.common_effect,
        ] * 2
    assert len(first.patches) == 2  # conditions that were not run are left out


def test_figure_6_segments_are_logarithms_of_counts(results: Material) -> None:
    counts = category_counts(results.record)
    panels = plot_categories(results)
    published = facts.results()["cogsci2018"]["ddqn"]["baseline_counts"]
    first = panels[0].patches
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
    solid = [bar for bar in panels[1].patches if bar.get_linestyle() == "-"]
    heights = [np.log10(count) for count in mine["count"] if count > 1]
    assert [bar.get_height() for bar in solid[: len(heights)]] == pytest.approx(heights)


def test_figure_7_first_panel_is_published(results: Material) -> None:
    panels = plot_categories(results, "transfer")
    published = facts.results()["cogsci2018"]["ddqn"]["transfer_counts"]
    heights = [bar.get_height() for bar in panels[0].patches]
    expected = [np.log10(published[c][k]) for c in published for k in CATEGORIES]
    assert heights == pytest.approx(expected)


def test_only_what_there_are_data_for_is_drawn() -> None:
    def names(**values: Any) -> list[str]:
        return [one.name for one in figures_of(made(trial_rows([1, 2, 3], **values)))]

    assert names() == ["attempts_by_trial_human"]
    assert names(condition="mine") == ["attempts_by_trial_human"]
    assert names(protocol="My RL!") == ["baseline_categories", "attempts_by_trial_my_rl_"]
    assert names(condition="CC3-CC4", phase="test") == ["attempts_by_trial_human"]


def test_a_long_course_is_drawn_in_few_points() -> None:
    rows = []
    for loop in range(1, 131):
        rows += trial_rows([0] * (loop % 2) + [1, 2, 3], loop=loop, protocol="rl")
    (plot,) = [one for one in figures_of(made(rows)) if one.name == "attempts_by_trial_rl"]
    x, y = plot.figure.axes[1].lines[0].get_data()  # the first axes hold the key
    assert len(x) == 44  # 130 trials by threes, the last one alone
    assert list(x[:2]) == [2, 5]
    assert x[-1] == 130
    assert y[:2] == pytest.approx([11 / 3, 10 / 3])
    assert "up to 3 trials in a row" in plot.caption


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
    figure = Figure()
    panels = np.ravel(plot_course(made(pa.concat_tables([table(quick), *cells])), ax=figure))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        style.image(figure, "svg")
    drawn = 0
    for axes in panels:
        lines = [line for line in axes.lines if str(line.get_marker()) in "os^D"]
        drawn += len({line.get_color() for line in lines})
        for line in lines:
            low, high = axes.get_ylim()
            assert all(low <= y <= high for y in line.get_ydata())
            assert all(axes.get_xlim()[0] <= x <= axes.get_xlim()[1] for x in line.get_xdata())
        width, height = axes.get_window_extent().size / figure.dpi
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
    panel = plot_course(made(rows))
    assert [text.get_text() for text in panel.texts] == ["test", "n = 1"]
    thin = [line for line in panel.lines if line.get_linewidth() < 1]
    limit, test = thin
    assert set(limit.get_ydata()) == {3}
    assert set(test.get_xdata()) == {2.5}
    (key,) = panel.figure.legends
    assert "limit of attempts" in [text.get_text() for text in key.get_texts()]
    (key,) = plot_course(made(trial_rows([1, 2, 3]))).figure.legends
    assert "limit of attempts" not in [text.get_text() for text in key.get_texts()]


def test_blocks_are_named_like_the_papers() -> None:
    def names(attempts: int, loops: int) -> list[str]:
        rows = [
            row
            for loop in range(1, loops + 1)
            for row in trial_rows([0] * attempts, loop=loop, protocol="rl")
        ]
        panel = plot_categories(made(rows), published=False)
        return [label.get_text() for label in panel.get_xticklabels()]

    assert names(30, 5) == ["0–30", "30–60", "60–90", "90–120", "120–150"]
    assert names(300, 10) == ["0–0.6k", "0.6–1.2k", "1.2–1.8k", "1.8–2.4k", "2.4–3k"]


@pytest.mark.parametrize(("learners", "columns"), [(1, 3), (2, 2), (12, 3)])
def test_panels_are_wide_enough_for_their_titles(learners: int, columns: int) -> None:
    names = [f"{LONG if i % 3 == 2 else 'learner'} {i:02}" for i in range(learners)]
    rows = [row for name in names for row in trial_rows([1, 2, 3], learner=name)]
    rows += [
        row
        for name in names
        for row in trial_rows([1, 2, 3], learner=name, condition="CC3-CC4", phase="test")
    ]
    for plot in (plot_attempts, plot_transfer):
        figure = Figure()
        assert len(plot(made(rows), ax=figure)) == len(figure.axes) == 2 + learners
        assert figure.get_figwidth() == WIDTH
        with style.settings():
            figure.draw_without_rendering()
        for place, axes in enumerate(figure.axes):
            box = axes.get_window_extent()
            last = place % columns == columns - 1 or place == len(figure.axes) - 1
            edge = figure.bbox.x1 if last else figure.axes[place + 1].get_window_extent().x0
            assert box.height / figure.dpi > 1.2
            title, detail = axes._left_title, axes.texts[0]  # type: ignore[attr-defined]
            assert title.get_window_extent().x1 < edge
            assert detail.get_window_extent().x1 < edge
            assert title.get_window_extent().y0 >= detail.get_window_extent().y1

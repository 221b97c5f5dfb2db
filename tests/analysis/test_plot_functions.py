"""What every plot function keeps to, whatever it draws; and the style that all share."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from itertools import combinations, pairwise
from types import SimpleNamespace
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

import causal_openlock as ol
from causal_openlock.analysis.measures import TRANSFERS
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.sweep import plot_sweep, sweep_table
from causal_openlock.analysis.report.all_figures import figures_of
from causal_openlock.analysis.report.learner_pages import learner_pages
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.topic import all_topics, sections_of
from causal_openlock.comparison.plotting import Plots
from causal_openlock.errors import NothingToDrawError, OpenLockError
from causal_openlock.experiment.building import sweep
from causal_openlock.experiment.record import CATEGORIES
from support import played_results

pytestmark = pytest.mark.slow

PLOTS: dict[str, tuple[Callable[[], Material], dict[str, Any]]] = {
    "plot_attempts": (played_results.results, {}),
    "plot_transfer": (played_results.results, {}),
    "plot_course": (played_results.results, {}),
    "plot_categories": (played_results.trained, {}),
    "plot_survival": (played_results.results, {}),
    "plot_cost": (played_results.results, {}),
    "plot_likeness": (played_results.results, {}),
    "plot_pairs": (played_results.results, {}),
    "plot_congruency": (played_results.results, {}),
    "plot_savings": (played_results.results, {}),
    "plot_subjects": (played_results.results, {}),
    "plot_beliefs": (played_results.believed, {}),
    "plot_structure_recovery": (played_results.asked, {}),
    "plot_sweep": (played_results.swept, {}),
}
EVERY = pytest.mark.parametrize("name", PLOTS)


@pytest.fixture(autouse=True)
def _figures_are_closed() -> Iterator[None]:
    yield
    plt.close("all")


def draw(name: str, **options: Any) -> list[Axes]:
    results, given = PLOTS[name]
    return list(np.ravel(getattr(ol, name)(results(), **given, **options)))


@cache
def panels_of(name: str) -> int:
    """Number of panels that a plot has in a figure of its own."""
    return len(draw(name, ax=Figure()))


def test_all_plot_functions_are_kept_to_it() -> None:
    public = {name for name in dir(ol) if name.startswith("plot_")}
    assert public - set(PLOTS) == {
        "plot_knowledge_steps",
        "plot_style",
        "plot_trace",
        "plot_understanding",
    }


@EVERY
def test_it_makes_a_figure_of_pyplot_or_fills_one_that_is_empty(name: str) -> None:
    axes = draw(name)
    assert plt.get_fignums() == [1]
    assert {one.figure.number for one in axes} == {1}
    assert panels_of(name) == len(axes)
    assert set(draw(name, ax=(other := Figure()))) <= set(other.axes)
    assert plt.get_fignums() == [1]


@EVERY
def test_it_fills_a_part_of_a_figure(name: str) -> None:
    count = panels_of(name)
    figure = Figure(layout="constrained", figsize=(9, 11))
    aside, part = figure.subfigures(2)
    axes = draw(name, ax=part)
    assert len(axes) == count
    assert set(axes) <= set(part.axes)
    assert (aside.axes, aside.legends, figure.legends, figure.texts) == ([], [], [], [])
    assert figure.get_size_inches().tolist() == [9, 11]
    figure.draw_without_rendering()


@EVERY
def test_it_draws_in_axes_that_are_given_and_nowhere_else(name: str) -> None:
    count = panels_of(name)
    figure = Figure(layout="constrained", figsize=(8, 4 * count))
    aside, *rows = figure.subplots(count + 1, 1)
    before = figure.get_size_inches().tolist()
    axes = draw(name, ax=[rows[:1], rows[1:]] if count > 1 else rows[0])
    assert axes == rows
    assert figure.axes == [aside, *rows]
    drawn_aside = [*aside.get_children()[:-11], *aside.texts, *figure.texts, *figure.legends]
    assert drawn_aside == []
    assert figure.get_size_inches().tolist() == before
    assert all(one.has_data() or one.patches for one in rows)
    figure.draw_without_rendering()


@EVERY
def test_too_few_or_too_many_axes_are_refused_with_what_would_do(name: str) -> None:
    count = panels_of(name)
    one_more = plt.subplots(1, count + 1)[1]
    with pytest.raises(
        OpenLockError, match=rf"{count} panels?, and ax holds {count + 1} axes"
    ) as e:
        draw(name, ax=one_more)
    shown = str(e.value)
    call = shown[shown.index("plt.subplots(") : shown.index("[1]") + 3]
    draw(name, ax=eval(call, {"plt": plt}))
    with pytest.raises(OpenLockError, match="and not str"):
        draw(name, ax="axes")


@EVERY
def test_it_leaves_settings_alone_and_needs_no_argument_but_results(name: str) -> None:
    with mpl.rc_context({"font.size": 31, "axes.grid": False}):
        before = dict(mpl.rcParams)
        draw(name)
        assert dict(mpl.rcParams) == before
    first, *others = inspect.signature(getattr(ol, name)).parameters.values()
    assert first.name == "results"
    assert all(one.default is not inspect.Parameter.empty for one in others)
    assert others[-1].name == "ax"


@EVERY
def test_results_that_hold_nothing_for_it_are_named_in_a_sentence(name: str) -> None:
    nothing = played_results.empty()
    with pytest.raises(NothingToDrawError):
        getattr(ol, name)(nothing)
    assert plt.get_fignums() == []


@pytest.mark.parametrize(
    "name",
    [name for name in PLOTS if "learners" in inspect.signature(getattr(ol, name)).parameters],
)
def test_a_learner_that_is_not_there_has_a_nearest_name(name: str) -> None:
    with pytest.raises(OpenLockError, match="did you mean random"):
        draw(name, learners=["randm"])


ORDER = ["random", "oracle"]  # of the experiment, not of the alphabet


def test_learners_are_in_the_order_of_the_tables() -> None:
    results = played_results.results()
    assert list(results.learners) == ORDER

    def titles(name: str) -> list[str]:
        found = (axes.get_title(loc="left") for axes in draw(name))
        return [title for title in found if title in ORDER]

    for name in ("plot_attempts", "plot_transfer", "plot_course", "plot_subjects"):
        assert titles(name) == ORDER, name
    for name in ("plot_congruency", "plot_savings", "plot_cost"):
        drawn = draw(name, **({} if name == "plot_cost" else {"learners": ORDER}))
        rows = [label.get_text() for label in drawn[0].get_yticklabels()]
        assert [row for row in rows if row in ORDER] == ORDER
    assert [line.get_label() for line in draw("plot_survival")[0].lines] == ORDER
    (both,) = draw("plot_subjects", learners=["oracle"])
    assert len(draw("plot_subjects", learners=["oracle", "random"])) == 2
    assert both.get_ylim()[1] > 30  # the scale is that of all


# -- values ---------------------------------------------------------------------------------------


def test_attempts_are_drawn_of_any_condition() -> None:
    results = played_results.results()
    summary = results.summary.set_index(["learner", "condition", "phase", "trial"])["attempts"]
    (axes,) = draw("plot_attempts", learners="random", conditions=["CC4", "CC3-CE4"])
    assert axes.get_title(loc="left") == "random"
    assert [label.get_text() for label in axes.get_xticklabels()] == [*"123456", "test"]
    rows = [("CC4", "train", trial) for trial in range(1, 6)]
    rows += [("CC3-CE4", "train", trial) for trial in range(1, 7)] + [("CC3-CE4", "test", 1)]
    assert [bar.get_height() for bar in axes.patches] == [summary["random", *row] for row in rows]
    assert len({bar.get_x() for bar in axes.patches}) == len(rows)  # none covers another
    mine = played_results.swept()  # rooms that people did not play: everything, without people
    panels = np.ravel(ol.plot_attempts(mine))
    assert [len(one.patches) for one in panels] == [10, 10, 10]
    other = played_results.trained()  # and another protocol than people's
    assert [one.get_title(loc="left") for one in [ol.plot_attempts(other)]] == ["random"]


def test_points_of_a_sweep_are_the_numbers_of_its_table() -> None:
    results = played_results.swept()
    table = sweep_table(results)
    assert table["value"].tolist() == [True, False] * 2  # in the order of the experiment
    assert set(table["parameter"]) == {"grey_only"}
    assert set(table["series"]) == {"win_stay"}
    headline = results.headline.set_index(["learner", "condition"])["attempts"]
    by = zip(table["learner"], table["condition"], strict=True)
    assert table["attempts"].tolist() == [headline[key] for key in by]
    for axes, condition in zip(draw("plot_sweep"), ("CC3", "CE3"), strict=True):
        own = table[table["condition"] == condition]
        assert axes.lines[0].get_ydata().tolist() == own["attempts"].tolist()
        assert [label.get_text() for label in axes.get_xticklabels()] == ["True", "False"]
        bar = axes.collections[0].get_segments()
        assert [[end[1] for end in one] for one in bar] == own[
            ["ci_low", "ci_high"]
        ].values.tolist()


def test_a_sweep_of_numbers_has_them_as_its_axis_and_a_line_for_whatever_else_differs() -> None:
    grid = sweep("bayes", lapse=[0.3, 0.0], policy=["thompson", "solve_and_learn"])
    results = played_results.played([*grid, "bayes", "random"], ["CC3"], 2)
    table = sweep_table(results, "lapse")
    assert table["value"].tolist() == [0.0, 0.0, 0.3, 0.0, 0.3]  # bayes itself has the default
    assert table["series"].tolist() == [
        *["bayes, policy solve_and_learn"] * 3,
        *["bayes, policy thompson"] * 2,
    ]
    axes = plot_sweep(results, "lapse")
    assert [label.get_text() for label in axes.get_xticklabels()] == ["0", "0.3"]
    assert {*axes.lines[0].get_xdata()} == {0.0, 0.3}
    with pytest.raises(NothingToDrawError, match=r"lapse and policy differ .* name one"):
        sweep_table(results)
    with pytest.raises(OpenLockError, match=r"has a parameter laps; did you mean lapse\?"):
        plot_sweep(results, "laps")
    with pytest.raises(NothingToDrawError, match="no such learner has the parameter lapse"):
        plot_sweep(results, "lapse", learners="random")


POLICIES = [
    *("solve_and_learn", "solve", "learn_attempt", "learn_action", "thompson"),
    "random_consistent",
]


@pytest.mark.parametrize(
    ("parameter", "values"),
    [("policy", POLICIES), ("lapse", [0.0001, 0.05, 0.1, 0.123456, 0.5])],
)
def test_names_at_the_axis_of_a_sweep_never_touch(parameter: str, values: list[Any]) -> None:
    results = played_results.played(sweep("bayes", **{parameter: values}), ["CC3", "CE3", "CC4"], 1)
    panels = plot_sweep(results)
    panels[0].figure.canvas.draw()
    for axes in panels:
        labels = [one for one in axes.get_xticklabels() if one.get_text()]
        assert len(labels) >= 2
        if parameter == "policy":
            assert [one.get_text() for one in labels] == values
        for one, other in pairwise(labels):
            gap = other.get_window_extent().x1 - one.get_window_extent().x1
            high = one.get_fontsize() * axes.figure.dpi / 72
            slope = np.sin(np.radians(one.get_rotation()))
            beside = one.get_window_extent().x1 < other.get_window_extent().x0
            assert gap * slope > high or beside


@pytest.mark.parametrize(
    ("plot", "argument", "said"),
    [
        ("congruency", "conditions", "known: ax, learners, protocol"),
        ("attempts", "learner", "did you mean learners?"),
        ("likeness", "axes", "plot.likeness has no argument axes"),  # a plot of another package
    ],
)
def test_an_argument_that_a_plot_lacks_is_told_in_a_sentence(
    plot: str, argument: str, said: str
) -> None:
    with pytest.raises(OpenLockError, match=f"plot.{plot} has no argument {argument}") as caught:
        getattr(Plots(played_results.results()), plot)(**{argument: ["CC4"]})
    assert said in str(caught.value)


def test_bars_and_dots_are_the_numbers_of_the_tables() -> None:
    results = played_results.results()
    summary = results.summary.set_index(["learner", "condition", "phase", "trial"])["attempts"]
    (axes,) = draw("plot_attempts", learners=["random"], conditions="CE4", published=False)
    assert [bar.get_height() for bar in axes.patches] == [
        summary["random", "CE4", "train", trial] for trial in range(1, 6)
    ]
    (axes,) = draw("plot_transfer", learners=["oracle"], published=False)
    assert sorted(bar.get_height() for bar in axes.patches) == sorted(
        summary["oracle", name, "test", 1] for name in TRANSFERS
    )
    (axes,) = draw("plot_course", learners=["random"], conditions=["CC3-CE4"])
    train, test = (line.get_ydata().tolist() for line in axes.lines if line.get_zorder() == 3)
    assert train == [summary["random", "CC3-CE4", "train", trial] for trial in range(1, 7)]
    assert test == [summary["random", "CC3-CE4", "test", 1]]


def test_the_line_of_survival_falls_where_trials_are_solved() -> None:
    axes = draw("plot_survival", conditions=["CE3-CC4"])[0]
    lines = {line.get_label(): line for line in axes.lines}
    assert set(lines["random"].get_ydata()) == {1.0}  # censored, all of them
    oracle = dict(zip(*lines["oracle"].get_data(), strict=True))
    assert (oracle[2], oracle[3]) == (1.0, 0.0)


def test_dots_of_cost_are_the_subjects_and_those_that_never_came_so_far_are_counted() -> None:
    axes = draw("plot_cost", conditions=["CC4"])[0]
    dots = [x for line in axes.lines if line.get_marker() == "o" for x in line.get_xdata()]
    assert dots == [3, 3, 3]  # the oracle's; the random learner's are not within its five trials
    (text,) = axes.texts
    assert text.get_text().split() == ["3", "of", "3", "not", "within", "150"]
    assert text.get_position()[1] == ORDER.index("random")


def test_ticks_of_cost_end_before_the_part_of_those_that_never_came_so_far() -> None:
    for axes in np.ravel(ol.plot_cost(played_results.fabricated())):
        start = axes.patches[0].get_x()
        ticks = [*axes.get_xticks(), *axes.get_xticks(minor=True)]
        assert 1 < max(ticks) <= start < axes.get_xlim()[1]


def test_a_matrix_says_what_its_numbers_are_in_a_figure_and_in_axes() -> None:
    draw("plot_pairs", ax=(figure := Figure()))
    axes = draw("plot_pairs", ax=plt.subplots()[1])[0]
    for title, note in (
        (figure.get_suptitle(), figure.get_supxlabel()),
        (axes.get_title(), axes.get_xlabel()),
    ):
        assert title == "P(row needs fewer attempts than column)"
        assert note.split("; ")[0] == "mean over 6 conditions"
        assert "ties count half" in note
    with style.settings():
        figure.draw_without_rendering()
    for text in figure.texts:  # two learners are the narrowest figure
        assert text.get_window_extent().x1 <= figure.bbox.x1


def test_tests_that_nobody_played_have_no_place_and_gaps_are_named() -> None:
    whole = played_results.results()
    only = {"CC3-CC4": ["random", "oracle"], "CE3-CC4": ["random"]}
    keep = [
        row["learner"] in only.get(row["condition"], ()) for row in whole.trials.to_dict("records")
    ]
    panels = ol.plot_transfer(replace(whole, trials=whole.trials[keep]))
    assert [[label.get_text() for label in axes.get_xticklabels()] for axes in panels] == [
        ["CC4"]
    ] * 4
    assert [len(axes.patches) for axes in panels] == [2, 2, 2, 1]
    said = [[text.get_text() for text in axes.texts].count("not played") for axes in panels]
    assert said == [0, 0, 0, 1]
    (asked, _) = draw("plot_transfer", published=False, conditions=["CC3-CC4"])
    assert "not played" not in [text.get_text() for text in asked.texts]  # it was, elsewhere


@pytest.mark.parametrize("conditions", [["CC4"], None])
def test_circles_cover_neither_one_another_nor_what_is_around_them(
    conditions: list[str] | None,
) -> None:
    figure = Figure()
    panels = draw("plot_subjects", conditions=conditions, ax=figure)
    assert len({axes.get_position().y0 for axes in panels}) == 1  # side by side
    with style.settings():
        figure.draw_without_rendering()
    for axes in panels:
        box, scale = axes.get_window_extent(), figure.dpi / 72
        drawn = [one for one in axes.collections if isinstance(one, PathCollection)]
        assert len(drawn) == len(axes.get_xticks())
        for place, circles in enumerate(drawn):
            offsets = axes.transData.transform(circles.get_offsets())
            radius = circles.get_sizes().max() ** 0.5 / 2 * scale
            assert offsets[:, 1].min() - radius >= box.y0
            assert offsets[:, 1].max() + radius <= box.y1
            means = axes.transData.transform((place + 0.08, 0))[0]
            assert offsets[0, 0] + radius < means


def test_subjects_have_the_scale_of_all_that_is_drawn_of_the_results() -> None:
    quick = ol.plot_subjects(played_results.played(["oracle"]), ax=Figure())
    assert 13 < quick.get_ylim()[1] < 20  # people's 13.75; no subject came near the limit
    scales = [draw("plot_subjects", learners=[name], ax=Figure())[0].get_ylim() for name in ORDER]
    assert scales[0] == scales[1]


# -- the report -----------------------------------------------------------------------------------


def shown_in(axes: list[Axes]) -> list[str]:
    """What is drawn in axes, in numbers and words; as text, in which NaN is equal to NaN."""
    return [
        repr(
            (
                [one.get_title(loc=side) for side in ("left", "center")],
                [np.asarray(line.get_xydata()).tolist() for line in one.lines],
                [patch.get_path().vertices.tolist() for patch in one.patches],
                [text.get_text() for text in one.texts],
                (one.get_xlim(), one.get_ylim()),
            )
        )
        for one in axes
    ]


@pytest.mark.parametrize("made", ["results", "trained", "believed", "fabricated"])
def test_the_line_under_a_figure_of_the_report_makes_it_again(made: str) -> None:
    results = getattr(played_results, made)()
    sections = [*sections_of(results, all_topics()), *learner_pages(results)]
    plots = [*figures_of(results), *(plot for section in sections for plot in section.plots)]
    assert plt.get_fignums() == []  # the report leaves no figure behind
    assert len({plot.call for plot in plots}) == len(plots)
    kinds = set()
    for plot in plots:
        again = eval(plot.call, {"results": SimpleNamespace(plot=Plots(results))})
        drawn = shown_in(list(np.ravel(again)))
        assert all(one in shown_in(plot.figure.axes) for one in drawn), plot.call
        kinds.add(plot.call.split("(")[0].removeprefix("results.plot."))
    assert kinds >= REPORTED[made]


REPORTED = {
    "results": {"cost", "survival", "course", "likeness", "congruency", "savings",
                "subjects"},
    "trained": {"categories"},
    "believed": {"beliefs", "structure_recovery"},
    "fabricated": {"course", "pairs"},
}  # fmt: skip


# -- the style ------------------------------------------------------------------------------------


def test_a_style_holds_for_a_while_or_from_now_on() -> None:
    with ol.plot_style(common_cause="#010203", rc={"font.size": 17}):
        (axes,) = draw("plot_attempts", learners=["random"], conditions=["CC4"], published=False)
        assert to_rgb(axes.patches[0].get_facecolor()) == to_rgb("#010203")
        assert axes.xaxis.label.get_fontsize() == 17
        assert style.current().rc["axes.grid"]  # what is not changed stays
    assert style.current() == ol.PlotStyle()
    try:
        ol.plot_style(others=("#111111",))
        assert style.current().others == ("#111111",)
    finally:
        ol.plot_style(ol.PlotStyle())
    assert style.current() == ol.PlotStyle()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"common_caus": "red"}, "no common_caus; did you mean common_cause"),
        ({"common_cause": "reddish"}, "'reddish' is not a colour"),
        ({"rc": {"font.sise": 3}}, "no setting font.sise; did you mean font.size"),
        ({"categories": ("red",)}, "5 in categories"),
    ],
)
def test_a_style_that_cannot_be_is_refused_and_changes_nothing(
    changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(OpenLockError, match=message):
        ol.plot_style(**changes)
    assert style.current() == ol.PlotStyle()


# Machado, Oliveira & Fernandes (2009), severity 1: linear RGB as it is seen without one kind of
# cone.
SEEN = {
    "all": np.eye(3),
    "protanopia": np.array([[0.152286, 1.052583, -0.204868],
                            [0.114503, 0.786281, 0.099216],
                            [-0.003882, -0.048116, 1.051998]]),
    "deuteranopia": np.array([[0.367322, 0.860646, -0.227968],
                              [0.280085, 0.672501, 0.047413],
                              [-0.011820, 0.042940, 0.968881]]),
    "tritanopia": np.array([[1.255528, -0.076749, -0.178779],
                            [-0.078411, 0.930809, 0.147602],
                            [0.004733, 0.691367, 0.303900]]),
}  # fmt: skip
XYZ = np.array([[0.4124564, 0.3575761, 0.1804375],
                [0.2126729, 0.7151522, 0.0721750],
                [0.0193339, 0.1191920, 0.9503041]])  # fmt: skip


def lab(colour: str, seen: str) -> np.ndarray:
    """A colour in CIELAB (D65), as somebody sees it."""
    rgb = np.array(to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    t = XYZ @ np.clip(SEEN[seen] @ linear, 0, 1) / XYZ.sum(axis=1)
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t * (29 / 6) ** 2 / 3 + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def test_white_and_red_have_the_coordinates_of_the_textbook() -> None:
    assert lab("white", "all") == pytest.approx([100, 0, 0], abs=0.01)
    assert lab("#FF0000", "all") == pytest.approx([53.24, 80.09, 67.20], abs=0.02)


@pytest.mark.parametrize("seen", SEEN)
def test_colours_are_told_apart_without_one_kind_of_cone(seen: str) -> None:
    own = ol.PlotStyle()

    def least(*colours: str) -> float:
        places = [lab(colour, seen) for colour in colours]
        return min(float(np.linalg.norm(a - b)) for a, b in combinations(places, 2))

    assert least(own.common_cause, own.common_effect) > 50
    assert least(*own.others) > 15
    assert least(*own.categories) > 8
    lightness = [lab(colour, seen)[0] for colour in own.categories]
    assert lightness == sorted(lightness, reverse=True)  # on a black-and-white printer, too
    assert len(own.categories) == len(CATEGORIES)

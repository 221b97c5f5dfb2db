"""Plots: what every one keeps to, whatever it draws, what they show, and the style they share."""

import inspect
import warnings
from dataclasses import replace
from types import SimpleNamespace

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pyarrow as pa
import pytest
from matplotlib.collections import PathCollection
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text

import causal_openlock as ol
from causal_openlock.analysis.measures import TRANSFERS
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.style import WIDTH, PlotStyle
from causal_openlock.analysis.plots.sweep import plot_sweep, sweep_table
from causal_openlock.analysis.report.writing import figures_of, learner_pages
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.topic import all_topics, sections_of
from causal_openlock.comparison.plotting import Plots
from causal_openlock.errors import NothingToDrawError, OpenLockError
from causal_openlock.experiment.condition import PAPER_CONDITIONS
from causal_openlock.experiment.making import sweep
from causal_openlock.experiment.record import CATEGORIES
from causal_openlock.world import facts
from support import played_results
from support.fabricated_records import random_cells, table, trial_rows
from support.made_up_experiments import experiment_of

pytestmark = pytest.mark.slow

PLOTS = {
    **dict.fromkeys(("attempts", "transfer", "course", "survival", "cost"), "results"),
    **dict.fromkeys(("likeness", "pairs", "savings", "subjects"), "results"),
    **{"categories": "trained", "beliefs": "believed", "structure_recovery": "believed"},
    "sweep": "swept",
}
"""By plot, the results of `support.played_results` that it is drawn of here."""
ONE_PANEL = {
    **{name: {"learners": "random", "published": False} for name in ("attempts", "transfer")},
    "course": {"learners": "random", "conditions": "CC4"}, "survival": {"conditions": "CC4"},
    "categories": {"published": False}, "subjects": {"learners": "random"},
    "sweep": {"conditions": "CC3"}, "cost": {}, "pairs": {}, "structure_recovery": {},
}  # fmt: skip
"""What makes a plot one of a single panel."""
EVERY = pytest.mark.parametrize("name", PLOTS)
ORDER = ["random", "oracle"]  # of the experiment, not of the alphabet
STYLE = PlotStyle()
RESULTS = facts.results()
PUBLISHED = (RESULTS["cogsci2018"]["human"], RESULTS["aaai2020"]["model"])


@pytest.fixture(autouse=True)
def _figures_are_closed():
    yield
    plt.close("all")


def plot_of(name, results=None):
    return getattr(Plots(results or getattr(played_results, PLOTS[name])()), name)


def draw(name, results=None, **options):
    """The panels of a plot, as a list."""
    return list(np.ravel(plot_of(name, results)(**options)))


def made(record, **known):
    record = table(record) if isinstance(record, list) else record
    return Material.of(record, experiment_of(record, **known))


def titles(panels):
    return [axes.get_title(loc="left") for axes in panels]


def heights(axes):
    return [bar.get_height() for bar in axes.patches]


def texts(axes):
    return [text.get_text() for text in axes.texts]


def names_at(axis):
    return [label.get_text() for label in axis.get_ticklabels()]


# -- what every plot keeps to ---------------------------------------------------------------------


def test_all_plots_are_kept_to_it():
    assert {*dir(Plots(None))} == {*PLOTS}


@EVERY
def test_it_draws_in_pyplot_or_in_an_empty_figure(name):
    settings = {"font.size": 31, "axes.grid": False}
    with mpl.rc_context(settings):
        before = dict(mpl.rcParams)
        axes = draw(name)
        assert dict(mpl.rcParams) == before
    assert plt.get_fignums() == [1]
    assert {one.figure.number for one in axes} == {1}
    other = Figure()
    assert {*draw(name, ax=other)} <= {*other.axes}
    other.draw_without_rendering()
    assert plt.get_fignums() == [1]


@EVERY
def test_it_draws_in_axes_if_it_has_a_single_panel_and_nowhere_else(name):
    figure = Figure(layout="constrained", figsize=(8, 8))
    aside, own = figure.subplots(2, 1)
    if name not in ONE_PANEL:
        with pytest.raises(OpenLockError, match=r"pass ax=plt.figure\(\), as this plot has"):
            draw(name, ax=own)
        return
    assert draw(name, **ONE_PANEL[name], ax=own) == [own]
    assert own.has_data() or own.patches
    assert (figure.axes, figure.texts, figure.legends) == ([aside, own], [], [])
    assert figure.get_size_inches().tolist() == [8, 8]
    figure.draw_without_rendering()


@EVERY
def test_it_refuses_what_it_cannot_draw_and_where_it_cannot_draw(name):
    with pytest.raises(NothingToDrawError):
        draw(name, played_results.empty())
    for options, named in (
        ({"ax": "axes"}, r"ax=plt.figure\(\).* not str"),
        ({"axes": None}, f"plot.{name} has no argument axes"),
    ):
        with pytest.raises(OpenLockError, match=named):
            draw(name, **options)
    function = plot_of(name).__wrapped__
    if "learners" in inspect.signature(function).parameters:
        with pytest.raises(OpenLockError, match="no learner randm"):
            draw(name, learners=["randm"])
    assert plt.get_fignums() == []
    first, *others = inspect.signature(function).parameters.values()
    assert first.name == "results"
    assert all(one.default is not inspect.Parameter.empty for one in others)
    assert others[-1].name == "ax"


def test_learners_are_in_the_order_of_the_tables():
    assert list(played_results.results().learners) == ORDER
    for name in ("attempts", "transfer", "course", "subjects"):
        assert [title for title in titles(draw(name)) if title in ORDER] == ORDER, name
    for name in ("savings", "cost"):
        drawn = draw(name, **({} if name == "cost" else {"learners": ORDER}))
        assert [row for row in names_at(drawn[0].yaxis) if row in ORDER] == ORDER, name
    assert [line.get_label() for line in draw("survival")[0].lines] == ORDER


# -- values ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def summary():
    found = played_results.results().summary
    return found.set_index(["learner", "condition", "phase", "trial"])["attempts"]


def test_bars_and_dots_are_the_numbers_of_the_tables(summary):
    (axes,) = draw("attempts", learners="random", conditions=["CC4", "CC3-CE4"])
    assert titles([axes]) == ["random"]
    assert names_at(axes.xaxis) == [*"123456", "test"]
    rows = [("CC4", "train", trial) for trial in range(1, 6)]
    rows += [("CC3-CE4", "train", trial) for trial in range(1, 7)] + [("CC3-CE4", "test", 1)]
    assert heights(axes) == [summary["random", *row] for row in rows]
    assert len({bar.get_x() for bar in axes.patches}) == len(rows)  # none covers another
    (axes,) = draw("transfer", learners=["oracle"], published=False)
    assert sorted(heights(axes)) == sorted(summary["oracle", name, "test", 1] for name in TRANSFERS)
    (axes,) = draw("course", learners=["random"], conditions=["CC3-CE4"])
    train, test = (line.get_ydata().tolist() for line in axes.lines if line.get_zorder() == 3)
    assert train == [summary["random", "CC3-CE4", "train", trial] for trial in range(1, 7)]
    assert test == [summary["random", "CC3-CE4", "test", 1]]
    # Rooms that people did not play, and another protocol: everything, without people.
    assert [len(one.patches) for one in draw("attempts", played_results.swept())] == [10] * 3
    assert titles(draw("attempts", played_results.trained())) == ["random"]


def test_figures_3_and_4_begin_with_people_and_the_published_model():
    results = played_results.fabricated()
    panels = draw("attempts", results)
    assert titles(panels) == ["People", "Published model", "a", "b", "c <u> & d", "five"]
    details = ["published, n = 40", "theory-based, n = 40", *["n = 3"] * 3, "n = 1"]
    assert [texts(axes)[0] for axes in panels] == details
    for axes, source in zip(panels, PUBLISHED, strict=False):
        means = source["baseline"]
        assert heights(axes) == [*means["CC4"]["mean"], *means["CE4"]["mean"]]
        colours = [to_hex(bar.get_facecolor()).upper() for bar in axes.patches]
        assert colours == [STYLE.common_cause] * 5 + [STYLE.common_effect] * 5
        for bars, condition in zip(axes.collections, ("CC4", "CE4"), strict=True):
            spans = [(end[1] - start[1]) / 2 for start, end in bars.get_segments()]
            assert spans == pytest.approx(means[condition]["se"])
    people, model, first, *_ = draw("transfer", results)
    assert heights(people) == [5.525, 8.175, 13.75, 7.725]
    assert heights(model) == [7.06, 6.7, 11.44, 9.16]
    colours = [to_hex(bar.get_facecolor()).upper() for bar in people.patches]
    assert colours == [STYLE.common_cause, STYLE.common_effect] * 2
    assert len(first.patches) == 2  # conditions that were not run are left out


def test_figures_6_and_7_are_logarithms_of_counts():
    results = played_results.fabricated()
    counts = results.blocks
    published = RESULTS["cogsci2018"]["ddqn"]
    panels = draw("categories", results)
    first = panels[0].patches
    block = published["baseline_counts"]["CE4"]["0-30k"]
    assert heights(panels[0])[:5] == pytest.approx(np.log10(list(block.values())))
    assert {bar.get_linestyle() for bar in first[:5]} == {":"}
    assert first[4].get_y() + first[4].get_height() == pytest.approx(15.55, abs=0.01)
    assert len(first) == 49  # fifty, less the one that the paper's last bar lacks
    mine = counts.query("learner == 'a' and protocol == 'loops' and condition == 'CC4'")
    known = [np.log10(count) for count in mine[mine["block"] == 1]["count"] if count > 1]
    solid = [bar.get_height() for bar in panels[1].patches if bar.get_linestyle() == "-"]
    assert solid[: len(known)] == pytest.approx(known)
    transfer = published["transfer_counts"]
    expected = [np.log10(transfer[c][k]) for c in transfer for k in CATEGORIES]
    assert heights(draw("categories", results, kind="transfer")[0]) == pytest.approx(expected)


def test_blocks_are_named_like_the_papers():
    for attempts, loops, names in (
        (30, 5, ["0–30", "30–60", "60–90", "90–120", "120–150"]),
        (300, 10, ["0–0.6k", "0.6–1.2k", "1.2–1.8k", "1.8–2.4k", "2.4–3k"]),
    ):
        rows = [
            row
            for loop in range(1, loops + 1)
            for row in trial_rows([0] * attempts, loop=loop, protocol="rl")
        ]
        (panel,) = draw("categories", made(rows), published=False)
        assert names_at(panel.xaxis) == names


def test_survival_falls_where_trials_are_solved_and_cost_counts_who_never_came_so_far():
    axes = draw("survival", conditions=["CE3-CC4"])[0]
    lines = {line.get_label(): line for line in axes.lines}
    assert set(lines["random"].get_ydata()) == {1.0}  # censored, all of them
    oracle = dict(zip(*lines["oracle"].get_data(), strict=True))
    assert (oracle[2], oracle[3]) == (1.0, 0.0)
    axes = draw("cost", conditions=["CC4"])[0]
    dots = [x for line in axes.lines if line.get_marker() == "o" for x in line.get_xdata()]
    assert dots == [3, 3, 3]  # the oracle's; the random learner's are not within its five trials
    assert texts(axes)[0].split() == ["3", "of", "3", "not", "within", "150"]
    assert axes.texts[0].get_position()[1] == ORDER.index("random")


def test_tests_that_nobody_played_have_no_place_and_gaps_are_named():
    whole = played_results.results()
    only = {"CC3-CC4": ORDER, "CE3-CC4": ["random"]}
    rows = whole.trials.to_dict("records")
    keep = [row["learner"] in only.get(row["condition"], ()) for row in rows]
    panels = draw("transfer", replace(whole, all_trials=whole.trials[keep]))
    assert [names_at(axes.xaxis) for axes in panels] == [["CC4"]] * 4
    assert [len(axes.patches) for axes in panels] == [2, 2, 2, 1]
    assert [texts(axes).count("not played") for axes in panels] == [0, 0, 0, 1]
    (asked, _) = draw("transfer", published=False, conditions=["CC3-CC4"])
    assert "not played" not in texts(asked)  # it was, elsewhere


def test_subjects_have_the_scale_of_all_that_is_drawn_of_the_results():
    (quick,) = draw("subjects", played_results.played(["oracle"]), ax=Figure())
    assert 13 < quick.get_ylim()[1] < 20  # people's 13.75; no subject came near the limit
    scales = [draw("subjects", learners=[name], ax=Figure())[0].get_ylim() for name in ORDER]
    assert scales[0] == scales[1]
    assert scales[0][1] > 30


# -- sweeps ---------------------------------------------------------------------------------------


def test_points_of_a_sweep_are_the_numbers_of_its_table():
    results = played_results.swept()
    points = sweep_table(results)
    assert points["value"].tolist() == [True, False] * 2  # in the order of the experiment
    assert set(points["parameter"]) == {"top_down"}
    assert set(points["series"]) == {"theory_based"}
    headline = results.headline.set_index(["learner", "condition"])["attempts"]
    by = zip(points["learner"], points["condition"], strict=True)
    assert points["attempts"].tolist() == [headline[key] for key in by]
    for axes, condition in zip(draw("sweep"), ("CC3", "CE3"), strict=True):
        own = points[points["condition"] == condition]
        assert axes.lines[0].get_ydata().tolist() == own["attempts"].tolist()
        assert names_at(axes.xaxis) == ["True", "False"]
        ends = [[end[1] for end in one] for one in axes.collections[0].get_segments()]
        known = own[["ci_low", "ci_high"]].T.fillna(own["attempts"]).T  # of few subjects, none
        assert ends == known.values.tolist()


def test_a_sweep_of_numbers_has_them_as_its_axis_and_a_line_for_whatever_else_differs():
    grid = sweep("bayes", lapse=[0.3, 0.0], policy=["thompson", "solve_and_learn"])
    results = played_results.played([*grid, "bayes", "random"], ["CC3"], 2)
    points = sweep_table(results, "lapse")
    assert points["value"].tolist() == [0.0, 0.0, 0.3, 0.0, 0.3]  # bayes itself has the default
    series = ["bayes, policy solve_and_learn", "bayes, policy thompson"]
    assert points["series"].tolist() == [series[0]] * 3 + [series[1]] * 2
    axes = plot_sweep(results, "lapse")
    assert names_at(axes.xaxis) == ["0", "0.3"]
    assert {*axes.lines[0].get_xdata()} == {0.0, 0.3}
    for named, ask in (
        ("lapse and policy differ .* name one", lambda: sweep_table(results)),
        (r"laps; did you mean lapse\?", lambda: plot_sweep(results, "laps")),
        ("parameter lapse", lambda: plot_sweep(results, "lapse", learners="random")),
    ):
        with pytest.raises(OpenLockError, match=named):
            ask()


# -- where things lie -----------------------------------------------------------------------------

LONG = "a_learner_with_a_name_that_no_panel_can_hold"
OWN = ("chain3", "noisy_CC3", "my_condition-with_a_name_that_is_long", "d", "e", "f", "g", "h")


def test_a_long_course_is_drawn_in_few_points():
    rows = []
    for loop in range(1, 131):
        rows += trial_rows([0] * (loop % 2) + [1, 2, 3], loop=loop, protocol="rl")
    (plot,) = [one for one in figures_of(made(rows)) if one.name == "attempts_by_trial_rl"]
    x, y = plot.figure.axes[0].lines[0].get_data()
    assert len(x) == 44  # 130 trials by threes, the last one alone
    assert list(x[:2]) == [2, 5]
    assert x[-1] == 130
    assert y[:2] == pytest.approx([11 / 3, 10 / 3])
    assert "mean of several in a row" in plot.caption


@pytest.mark.parametrize(
    ("learners", "conditions", "columns"),
    [
        (1, OWN[:1], 1),
        (1, OWN, 2),
        (12, (*PAPER_CONDITIONS, *OWN[:2]), 4),
    ],
)
def test_every_line_by_trial_lies_in_its_panel(learners, conditions, columns):
    names = tuple(f"{LONG if i % 3 == 2 else 'learner'} {i:02}" for i in range(learners))
    cells = random_cells(5, learners=names, conditions=conditions, protocols=("human",), subjects=1)
    # The first learner solves everything at once, which must not set the scale for the others.
    quick = [row for name in conditions for row in trial_rows([1], 1, learner="0", condition=name)]
    panels = draw("course", made(pa.concat_tables([table(quick), *cells])), ax=(figure := Figure()))
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
    assert len(panels) == (learners + 1) * columns


def test_the_test_and_the_limit_are_marked():
    trained = {"condition": "CC3-CC4"}
    rows = [row for trial in (1, 2) for row in trial_rows([0, 0, 0], trial=trial, **trained)]
    (panel,) = draw("course", made(rows + trial_rows([1, 2, 3], phase="test", **trained)))
    assert texts(panel) == ["test", "n = 1"]
    limit, test = [line for line in panel.lines if line.get_linewidth() < 1]
    assert set(limit.get_ydata()) == {3}
    assert set(test.get_xdata()) == {2.5}
    (solved,) = draw("course", made(trial_rows([1, 2, 3])))
    for axes, marked in ((panel, True), (solved, False)):
        (key,) = axes.figure.legends
        assert ("limit of attempts" in [text.get_text() for text in key.get_texts()]) == marked


@pytest.mark.parametrize(("learners", "columns"), [(2, 2), (7, 3)])
def test_panels_are_wide_enough_for_their_titles(learners, columns):
    test = {"condition": "CC3-CC4", "phase": "test"}
    names = [f"{LONG if i % 3 == 2 else 'learner'} {i:02}" for i in range(learners)]
    rows = [
        row for name in names for more in ({}, test)
        for row in trial_rows([1, 2, 3], learner=name, **more)
    ]  # fmt: skip
    for plot in ("attempts", "transfer"):
        figure = Figure()
        assert len(draw(plot, made(rows), ax=figure)) == len(figure.axes) == 2 + learners
        assert figure.get_figwidth() == WIDTH
        with style.settings():
            figure.draw_without_rendering()
        for place, axes in enumerate(figure.axes):
            last = place % columns == columns - 1 or place == len(figure.axes) - 1
            edge = figure.bbox.x1 if last else figure.axes[place + 1].get_window_extent().x0
            assert axes.get_window_extent().height / figure.dpi > 1.2
            title, detail = axes._left_title, axes.texts[0]
            assert title.get_window_extent().x1 < edge
            assert detail.get_window_extent().x1 < edge
            assert title.get_window_extent().y0 >= detail.get_window_extent().y1


# -- the report's figures -------------------------------------------------------------------------


def test_only_what_there_are_data_for_is_drawn_each_with_a_name_of_its_own():
    def names(rows):
        return [one.name for one in figures_of(made(rows))]

    assert names(trial_rows([1, 2, 3], condition="mine")) == ["attempts_by_trial_human"]
    own = trial_rows([1, 2, 3], protocol="My RL!")
    assert names(own) == ["baseline_categories", "attempts_by_trial_my_rl_"]
    tested = trial_rows([1, 2, 3], condition="CC3-CC4", phase="test")
    assert names(tested) == ["attempts_by_trial_human"]
    alike = [row for name in ("a-b", "a_b") for row in trial_rows([1], protocol=name)]
    assert names(alike)[-2:] == ["attempts_by_trial_a_b", "attempts_by_trial_a_b_2"]


def shown_in(axes):
    """What is drawn in axes, in numbers and words; as text, in which NaN is equal to NaN."""
    return [
        repr(
            (
                [one.get_title(loc=side) for side in ("left", "center")],
                [np.asarray(line.get_xydata()).tolist() for line in one.lines],
                [patch.get_path().vertices.tolist() for patch in one.patches],
                texts(one),
                (one.get_xlim(), one.get_ylim()),
            )
        )
        for one in axes
    ]


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("results", "cost survival course likeness savings subjects"),
        ("trained", "categories"),
        ("believed", "beliefs structure_recovery"),
        ("swept", "course pairs"),
    ],
)
def test_the_line_under_a_figure_of_the_report_makes_it_again(name, kinds):
    results = getattr(played_results, name)()
    sections = [*sections_of(results, all_topics()), learner_pages(results)]
    plots = [*figures_of(results), *(plot for section in sections for plot in section.plots)]
    assert plt.get_fignums() == []  # the report leaves no figure behind
    assert len({plot.call for plot in plots}) == len(plots)
    for plot in plots:
        again = eval(plot.call, {"results": SimpleNamespace(plot=Plots(results))})
        drawn = shown_in(list(np.ravel(again)))
        assert all(one in shown_in(plot.figure.axes) for one in drawn), plot.call
    called = {plot.call.split("(")[0].removeprefix("results.plot.") for plot in plots}
    assert called >= {*kinds.split()}


# -- the style ------------------------------------------------------------------------------------


def seen(figure):
    """The words and the colours of a figure."""
    words = {text.get_text() for text in figure.findobj(Text)}
    lines = [*figure.findobj(Line2D), *figure.findobj(Text)]
    faces = [*figure.findobj(Patch), *figure.findobj(PathCollection)]
    colours = [one.get_color() for one in lines]
    colours += [face for one in faces for face in np.reshape(one.get_facecolor(), (-1, 4))]
    return words, {to_hex(colour) for colour in colours}


@EVERY
def test_learners_and_conditions_have_the_labels_and_colours_that_are_given(name):
    learners = {"results": "oracle", "trained": "random", "swept": "theory_based"}
    learner = learners.get(PLOTS[name], "bayes")
    figure = Figure()
    draw(name, ax=figure, labels={learner: "Mine"}, colors={learner: "#123456", "CC4": "#654321"})
    words, colours = seen(figure)
    assert any(word.split(" in ")[0] == "Mine" for word in words)
    assert learner not in words
    if name not in ("beliefs", "pairs"):
        assert "#123456" in colours
    if name in ("attempts", "course"):
        assert "#654321" in colours
    assert style.current() == STYLE


def test_a_style_holds_for_a_while_or_from_now_on():
    with ol.plot_style(common_cause="#010203", rc={"font.size": 17}):
        (axes,) = draw("attempts", learners=["random"], conditions=["CC4"], published=False)
        assert to_rgb(axes.patches[0].get_facecolor()) == to_rgb("#010203")
        assert axes.xaxis.label.get_fontsize() == 17
        assert style.current().rc["axes.grid"]  # what is not changed stays
    assert style.current() == STYLE
    for changes, named in (
        ({"others": ("#111111",), "common_caus": "red"}, "common_cause"),
        ({"common_cause": "reddish"}, "'reddish'"),
        ({"rc": {"font.sise": 3}}, "font.sise"),
    ):
        with pytest.raises((OpenLockError, ValueError, KeyError), match=named):
            ol.plot_style(**changes)
        assert style.current() == STYLE
    try:
        ol.plot_style(others=("#111111",))
        assert style.current().others == ("#111111",)
    finally:
        ol.plot_style(STYLE)
    assert style.current() == STYLE

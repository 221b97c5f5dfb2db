"""The ideal observer in the report: its numbers, its line, its row."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

import causal_openlock.analysis
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.attempts import plot_attempts, plot_transfer
from causal_openlock.analysis.plots.course import plot_course
from causal_openlock.analysis.report.all_figures import figures_of
from causal_openlock.analysis.report.writing import write_report
from causal_openlock.analysis.results import bounds
from causal_openlock.analysis.results.bounds import (
    Bound,
    bounds_in_words,
    ideal_attempts,
    ideal_bounds,
)
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.summary import headline_table, summary_table
from causal_openlock.analysis.section import SectionPlot
from causal_openlock.schemas.finding import find_schema
from causal_openlock.schemas.schema import Schema
from causal_openlock.storage.stored import StoredExperiment
from support.fabricated_records import table, trial_rows
from support.html_page import Page
from support.made_up_experiments import declared

ALL = "CC4, CE4, CC3-CC4, CE3-CC4, CC3-CE4, CE3-CE4"


def described(folder: Path, conditions: str = ALL, learners: str = "random") -> StoredExperiment:
    """An experiment, as its results folder holds it."""
    return declared(
        folder,
        f"conditions: [{conditions}]\nlearners: [{learners}]\n"
        "protocols:\n"
        "  roomy: {based_on: human, action_limit: 5}\n"
        "  short: {based_on: human, attempt_limit: 3}\n",
    )


def played(conditions: str = ALL, learner: str = "random", protocol: str = "human") -> pa.Table:
    rows = []
    for condition in conditions.split(", "):
        phases = {"train": 2, "test": 1} if "-" in condition else {"train": 2}
        for phase, trials in phases.items():
            for trial in range(1, trials + 1):
                named = {"condition": condition, "learner": learner, "protocol": protocol}
                rows += trial_rows([0, 0, 1, 2, 3], phase=phase, trial=trial, **named)
    return table(rows)


def lines(axes: Axes) -> list[tuple[float, float, float]]:
    """The ideal observer's lines in a panel: how high, from where, to where."""
    drawn = [line for line in axes.lines if line.get_zorder() == 1.5]
    for line in drawn:
        assert to_hex(line.get_color()) == "#333333"
        assert line.get_linewidth() <= 1
        assert line.get_linestyle() == "--"
    return sorted((float(y[0]), float(x[0]), float(x[1])) for x, y in (d.get_data() for d in drawn))


# -- the numbers ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("schema", "actions", "attempts"),
    [
        ("CC3", 3, 8 / 3),
        ("CE3", 3, 8 / 3),
        ("CC4", 3, 3.75),
        ("CE4", 3, 3.75),
        ("CC4", 5, 3.25),
        ("two_of_four", 3, 6),  # all placements alike: one attempt for each solution
        ("chain3", 3, None),  # its solution does not fit
        ("noisy_CC3", 3, None),
    ],
)
def test_it_needs(schema: str, actions: int, attempts: float | None) -> None:
    found = ideal_attempts(find_schema(schema), actions)
    assert found is None if attempts is None else found == pytest.approx(attempts)


def test_what_is_too_large_has_no_number() -> None:
    chain = {f"L{i}": [f"L{i + 1}"] for i in range(8)} | {"L8": ["door"]}
    assert ideal_attempts(Schema("long", [f"L{i}" for i in range(9)], chain), 10) is None


def test_bounds_follow_the_experiment(tmp_path: Path) -> None:
    learners = (
        "random, {learner: oracle, protocol: roomy}, {learner: oracle, name: b, protocol: short}"
    )
    found = ideal_bounds(described(tmp_path, "CC4, CC3-CE4, noisy_CC3", learners))
    assert found["CC4", "human", "train"] == Bound("CC4", pytest.approx(3.75))
    assert found["CC3-CE4", "human", "train"] == Bound("CC3", pytest.approx(8 / 3))
    assert found["CC3-CE4", "human", "test"] == Bound("CE4", pytest.approx(3.75))
    assert found["CC4", "roomy", "train"] == Bound("CC4", pytest.approx(3.25))
    # The ideal observer may need four attempts, of which three would be counted.
    assert {key for key in found if key[1] == "short"} == {("CC3-CE4", "short", "train")}
    assert not [key for key in found if key[0] == "noisy_CC3"]


def test_what_has_several_meanings_is_not_bounded(tmp_path: Path) -> None:
    experiment = described(tmp_path, "CC4, CE4")
    one, ce4 = experiment.conditions
    (spec,) = experiment.learners
    other = replace(spec, name="other", protocol=replace(spec.protocol, action_limit=5))
    assert ideal_bounds(replace(experiment, learners=(spec, other))) == {}
    mixed = replace(one, train=(*one.train, *ce4.train))
    assert ideal_bounds(replace(experiment, conditions=(mixed,))) == {}


def test_schemas_that_need_as_much_are_named_together() -> None:
    every = [Bound("CE4", 3.75), Bound("CC3", 8 / 3), Bound("CC4", 3.75), Bound("CC4", 3.75)]
    assert bounds_in_words(every) == "2.67 in rooms of CC3, 3.75 in rooms of CC4 and CE4"
    assert bounds_in_words([Bound(name, 2.0) for name in "cab"]) == "2.00 in rooms of a, b and c"


def test_a_number_is_worked_out_once(tmp_path: Path) -> None:
    bounds._solved.cache_clear()
    ideal_bounds(described(tmp_path))
    assert bounds._solved.cache_info().misses == 4  # CC3, CE3, CC4 and CE4


# -- the line -------------------------------------------------------------------------------------


def named(plots: list[SectionPlot], name: str) -> SectionPlot:
    (found,) = (plot for plot in plots if plot.name == name)
    return found


def keys(figure: Figure) -> list[str]:
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_figure_3_has_a_line_in_every_panel(tmp_path: Path) -> None:
    plot_attempts(Material.of(played(), described(tmp_path)), ax=(figure := Figure()))
    for axes in figure.axes:
        ((height, start, end),) = lines(axes)
        assert (height, (start, end)) == (pytest.approx(3.75), axes.get_xlim())
    assert keys(figure).count(style.IDEAL) == 1


def test_figure_4_has_a_line_for_each_test(tmp_path: Path) -> None:
    results = Material.of(played(), described(tmp_path))
    known = dict(results.bounds)
    for condition in ("CC3-CE4", "CE3-CE4"):
        known[condition, "human", "test"] = Bound("CE4", 5.0)
    for axes in plot_transfer(replace(results, bounds=known), ax=Figure()):
        assert lines(axes) == [(pytest.approx(3.75), -0.45, 0.45), (5.0, 0.55, 1.45)]


def test_the_course_has_a_line_over_each_phase(tmp_path: Path) -> None:
    results = Material.of(played(), described(tmp_path))
    baseline, *transfers = plot_course(results, ax=Figure())
    assert lines(baseline) == [(pytest.approx(3.75), 0.5, 2.5)]
    for axes in transfers:
        assert lines(axes) == [
            (pytest.approx(8 / 3), 0.5, 2.5),
            (pytest.approx(3.75), 2.5, 3.5),
        ]
    plot = named(figures_of(results), "attempts_by_trial_human")
    assert "2.67 in rooms of CC3 and CE3, 3.75 in rooms of CC4 and CE4" in plot.caption
    assert keys(plot.figure) == [style.IDEAL]


def test_a_line_above_all_data_lies_in_its_panel(tmp_path: Path) -> None:
    quick = table(trial_rows([1, 2, 3], learner="random"))
    axes = plot_course(Material.of(quick, described(tmp_path, "CC4")), ax=Figure())
    assert axes.get_ylim()[1] > 3.75


def test_without_a_number_there_is_no_line_and_no_word(tmp_path: Path) -> None:
    record = played("noisy_CC3")
    for plot in figures_of(Material.of(record, described(tmp_path, "noisy_CC3"))):
        assert not any(lines(axes) for axes in plot.figure.axes)
        assert "ideal" not in plot.caption
        assert style.IDEAL not in keys(plot.figure)


# -- the row --------------------------------------------------------------------------------------


def test_tables_have_the_number_of_each_phase(tmp_path: Path) -> None:
    experiment = described(tmp_path, "CC4, CC3-CE4, noisy_CC3")
    record = played("CC4, CC3-CE4, noisy_CC3")
    summary = summary_table(record, experiment).groupby(["condition", "phase"], observed=True)
    means = summary["ideal_attempts"].mean()
    assert means["CC4", "train"] == pytest.approx(3.75)
    assert means["CC3-CE4", "train"] == pytest.approx(8 / 3)
    assert means["CC3-CE4", "test"] == pytest.approx(3.75)
    assert means.isna()["noisy_CC3", "train"]
    headline = headline_table(record, experiment).set_index("condition")["ideal_attempts"]
    assert headline["CC4"] == headline["CC3-CE4"] == pytest.approx(3.75)
    assert summary_table(record)["ideal_attempts"].isna().all()


def test_the_report_states_it_below_what_is_published(tmp_path: Path) -> None:
    experiment = described(tmp_path, "CC4, noisy_CC3")
    page = Page(write_report(played("CC4, noisy_CC3"), tmp_path, experiment).read_text("utf-8"))
    head, _, _, ideal, *_ = page.tables[1]
    assert [row[0].split(" | ")[0] for row in page.tables[1][1:]] == [
        "People", "Published model", "Ideal observer", "random",
    ]  # fmt: skip
    assert dict(zip((cell.split(" | ")[0] for cell in head), ideal, strict=True)) == {
        "Learner": "Ideal observer | schema known",
        "CC4": "3.75",
        "noisy_CC3": "–",
    }
    every = next(rows for rows in page.tables if rows[0][0] == "Condition")
    assert every[0][-3:] == ["Published model", "SE", "Ideal"]
    column = every[0].index("Ideal")
    assert {row[0]: row[column] for row in every[1:]} == {"CC4": "3.75", "noisy_CC3": "–"}


def test_a_report_without_it_has_no_such_row(tmp_path: Path) -> None:
    experiment = described(tmp_path, "noisy_CC3")
    text = write_report(played("noisy_CC3"), tmp_path, experiment).read_text("utf-8")
    assert "Ideal observer" not in text
    assert '<th scope="col">Ideal</th>' not in text


def test_the_analysis_knows_no_learner() -> None:
    for path in Path(causal_openlock.analysis.__path__[0]).glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not [name for name in names if name.split(".")[0] == "learners"], path

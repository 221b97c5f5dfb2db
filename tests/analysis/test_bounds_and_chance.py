"""The ideal observer and random actions: their numbers, and where the report shows them."""

import math
from dataclasses import replace
from fractions import Fraction

import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.attempts import plot_attempts, plot_transfer
from causal_openlock.analysis.plots.course import plot_course
from causal_openlock.analysis.report.writing import figures_of
from causal_openlock.analysis.results.bounds import _solved, ideal_attempts, ideal_bounds
from causal_openlock.analysis.results.chance import chance_of_finding_all, chance_of_opening
from causal_openlock.analysis.results.material import Material
from causal_openlock.schemas.finding import find_schema
from causal_openlock.schemas.schema import Schema
from oracle import DOOR, NOTHING, Rules
from support.fabricated_records import table, trial_rows
from support.made_up_experiments import declared

ALL = "CC4, CE4, CC3-CC4, CE3-CC4, CC3-CE4, CE3-CE4"


def described(folder, conditions=ALL, learners="random"):
    return declared(
        folder,
        f"conditions: [{conditions}]\nlearners: [{learners}]\n"
        "protocols:\n"
        "  roomy: {based_on: human, action_limit: 5}\n"
        "  short: {based_on: human, attempt_limit: 3}\n",
    )


def played(conditions=ALL):
    rows = []
    for condition in conditions.split(", "):
        visits = [("train", 1), ("train", 2), *([("test", 1)] if "-" in condition else [])]
        for phase, trial in visits:
            named = {"condition": condition, "learner": "random", "phase": phase, "trial": trial}
            rows += trial_rows([0, 0, 1, 2, 3], **named)
    return table(rows)


@pytest.mark.parametrize(
    ("schema", "actions", "attempts"),
    [
        ("CE4", 3, 3.75),
        ("CC4", 5, 3.25),
        ("two_of_four", 3, 6),  # all placements alike: one attempt for each solution
        ("chain3", 3, None),  # its solution does not fit
        ("noisy_CC3", 3, None),
        ("long", 10, None),  # too large
    ],
)
def test_ideal_observer_needs(schema, actions, attempts):
    chain = {f"L{i}": [f"L{i + 1}"] for i in range(8)} | {"L8": ["door"]}
    long = Schema("long", [f"L{i}" for i in range(9)], chain)
    found = ideal_attempts(long if schema == "long" else find_schema(schema), actions)
    assert found is None if attempts is None else found == pytest.approx(attempts)


def test_bounds_follow_the_experiment(tmp_path):
    learners = (
        "random, {learner: oracle, protocol: roomy}, {learner: oracle, name: b, protocol: short}"
    )
    found = ideal_bounds(described(tmp_path, "CC4, CC3-CE4, noisy_CC3", learners))
    assert found["CC4", "human", "train"] == pytest.approx(3.75)
    assert found["CC3-CE4", "human", "train"] == pytest.approx(8 / 3)
    assert found["CC3-CE4", "human", "test"] == pytest.approx(3.75)
    assert found["CC4", "roomy", "train"] == pytest.approx(3.25)
    # The ideal observer may need four attempts, of which three would be counted.
    assert {key for key in found if key[1] == "short"} == {("CC3-CE4", "short", "train")}
    assert not [key for key in found if key[0] == "noisy_CC3"]


def test_what_has_several_meanings_is_not_bounded_and_a_number_is_worked_out_once(tmp_path):
    experiment = described(tmp_path, "CC4, CE4")
    one, ce4 = experiment.conditions
    (spec,) = experiment.learners
    other = replace(spec, name="other", protocol=replace(spec.protocol, action_limit=5))
    assert ideal_bounds(replace(experiment, learners=(spec, other))) == {}
    mixed = replace(one, train=(*one.train, *ce4.train))
    assert ideal_bounds(replace(experiment, conditions=(mixed,))) == {}
    _solved.cache_clear()
    ideal_bounds(described(tmp_path))
    assert _solved.cache_info().misses == 4  # CC3, CE3, CC4 and CE4


def lines(axes):
    """The ideal observer's lines in a panel: how high, from where, to where."""
    drawn = [line for line in axes.lines if line.get_zorder() == 1.5]
    assert {(to_hex(line.get_color()), line.get_linestyle()) for line in drawn} <= {
        ("#333333", "--")
    }
    data = [line.get_data() for line in drawn]
    return sorted((float(y[0]), float(x[0]), float(x[1])) for x, y in data)


def test_every_figure_has_its_line(tmp_path):
    results = Material.of(played(), described(tmp_path))
    plot_attempts(results, ax=(figure := Figure()))
    for axes in figure.axes:
        assert lines(axes) == [(pytest.approx(3.75), *axes.get_xlim())]
    keys = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert keys.count(style.ideal_key().get_label()) == 1
    known = dict(results.bounds)
    for condition in ("CC3-CE4", "CE3-CE4"):
        known[condition, "human", "test"] = 5.0
    for axes in plot_transfer(replace(results, bounds=known), ax=Figure()):
        assert lines(axes) == [(pytest.approx(3.75), -0.45, 0.45), (5.0, 0.55, 1.45)]
    baseline, *transfers = plot_course(results, ax=Figure())
    assert lines(baseline) == [(pytest.approx(3.75), 0.5, 2.5)]
    for axes in transfers:
        assert lines(axes) == [(pytest.approx(8 / 3), 0.5, 2.5), (pytest.approx(3.75), 2.5, 3.5)]


def test_a_line_above_all_data_lies_in_its_panel(tmp_path):
    quick = table(trial_rows([1, 2, 3], learner="random"))
    axes = plot_course(Material.of(quick, described(tmp_path, "CC4")), ax=Figure())
    assert axes.get_ylim()[1] > 3.75


def test_without_a_number_there_is_no_line_and_no_word(tmp_path):
    results = Material.of(played("noisy_CC3"), described(tmp_path, "noisy_CC3"))
    for plot in figures_of(results):
        assert not any(lines(axes) for axes in plot.figure.axes)
        assert "ideal" not in plot.caption
        assert not plot.figure.legends


def chance_by_hand(rules, positions, left, pushed=NOTHING):
    """How probable random actions open the door, by all that they may lead to."""
    if not left:
        return 0.0
    every, nodes, opens = 2 * positions + 1, [*rules.levers, DOOR], 0.0
    for node in nodes:
        for seen, chance in rules.outcomes(pushed, node).items():
            rest = 1.0 if seen.opened else chance_by_hand(rules, positions, left - 1, seen.pushed)
            opens += chance * rest
    idle = every - len(nodes)  # white levers, and those that are where the action would move them
    return (opens + idle * chance_by_hand(rules, positions, left - 1, pushed)) / every


@pytest.mark.parametrize(
    ("name", "limit", "positions"),
    [("CC3", 3, 7), ("CC4", 3, 7), ("two_of_four", 3, 7), ("CE4", 6, 8), ("noisy_CC3", 5, 7)],
)
def test_chance_is_that_of_all_sequences_of_actions(name, limit, positions):
    schema = find_schema(name)
    expected = chance_by_hand(Rules.of(schema), positions, limit)
    assert chance_of_opening(schema, limit, positions) == pytest.approx(expected, rel=1e-9)


def missing_none(each, number, attempts):
    """The coupon collector's probability, by inclusion and exclusion."""
    terms = (
        (-1) ** missed * math.comb(number, missed) * (1 - missed * each) ** attempts
        for missed in range(number + 1)
    )
    return float(sum(terms, Fraction(0)))


@pytest.mark.parametrize("attempts", [1, 2, 3, 30, 700])
@pytest.mark.parametrize("name", ["CC3", "CC4", "two_of_four"])
def test_finding_all_is_the_coupon_collectors_probability(name, attempts):
    schema = find_schema(name)
    number = len(schema.solutions)
    each = chance_of_opening(schema, 3, 7) / number  # solutions of a kind are equally likely
    exact = Fraction(round(each * 15**3), 15**3)  # rounded, the sum would cancel to noise
    found = chance_of_finding_all(schema, 3, 7, attempts)
    assert found == pytest.approx(missing_none(exact, number, attempts), rel=1e-9, abs=0)
    assert (found > 0) == (attempts >= number)


def test_what_opens_the_door_without_being_a_solution_counts_as_opening_alone():
    # With six actions a second effect may be pushed beside the first: open, and no solution.
    schema = find_schema("CC4")
    each = Fraction(chance_of_opening(schema, 6, 7)) / 3
    assert 0 < chance_of_finding_all(schema, 6, 7, 400) < missing_none(each, 3, 400)

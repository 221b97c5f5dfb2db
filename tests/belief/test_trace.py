"""A trial of belief, looked into: the data, the words, the picture, the command."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from causal_openlock.analysis.plots.belief import plot_trace
from causal_openlock.belief.structure_schemas import (
    behave_alike,
    by_position,
    in_words,
    same_structure,
)
from causal_openlock.belief.trace import shown_name, trace_text, trace_trial
from causal_openlock.contract.registry import create
from causal_openlock.experiment.condition import find_condition
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import find_schema
from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.testing import schemas
from causal_openlock.world.room import Layout, Room, action_names
from openlock_learners.bayes import Bayes
from oracle import Rules
from support.belief_arrays import key_of, seen_of
from support.command import at_once

pytestmark = pytest.mark.slow

SEED = 2018
HUMAN = PROTOCOLS["human"]
LEVERS = [f"L{index}" for index in range(8)]
EIGHT = Schema("eight", LEVERS, {"L0": LEVERS[1:], **{lever: [DOOR] for lever in LEVERS[1:]}})


def traced(name, trial=1, subject=0, learner=None, label="bayes", **more):
    condition = find_condition([EIGHT] if name == "eight" else name)
    learner = learner or create("openlock_learners.bayes:Bayes")
    return trace_trial(
        learner, condition, HUMAN, trial=trial, subject=subject, seed=SEED, label=label, **more
    )


@pytest.fixture(scope="module")
def cc4():
    return traced("CC4")


@pytest.fixture(scope="module")
def uncertain():
    """A trial in which everything is ruled out, and levers that may fail are thought of."""
    for subject in range(30):
        trace = traced("noisy_CC3", subject=subject)
        if any(action.renewed == "noise" for action in trace.actions):
            return trace
    raise AssertionError("nobody has concluded that levers may fail")


class Undoing(Bayes):
    """Pulls a lever back as soon as the door is unlocked."""

    def act(self, view):
        actions = super().act(view)
        positions = self.brief.positions
        for subject in np.flatnonzero(view.observation[:, -2] == 0):
            actions[subject] = positions + self.last
        self.last = int(actions[0]) % positions
        return actions


@pytest.mark.parametrize("name", ["CC4", "CE4", "noisy_CC3"])
def test_beliefs_follow_one_another(name):
    trace = traced(name)
    table = trace.table()
    assert (table["entropy_before"][1:].to_numpy() == table["entropy_after"][:-1].to_numpy()).all()
    obtained = table["entropy_before"] - table["entropy_after"]
    np.testing.assert_allclose(table["gain_obtained"], obtained)
    assert (table["gain_predicted"] >= 0).all()
    assert table["chance"].between(0, 1 + 1e-9).all()
    assert (table["number"] == table.groupby("attempt").cumcount() + 1).all()
    arrows = table.filter(like=" -> ").to_numpy()
    assert arrows.sum(axis=1) == pytest.approx(trace.edges[1:].sum(axis=(1, 2)))


def test_chances_and_snapshots_are_those_of_the_learner(cc4):
    session = Session(find_condition("CC4"), HUMAN, [0], seed=SEED, learner="bayes")
    learner = create("openlock_learners.bayes:Bayes")
    learner.begin(session.brief)
    for number, action in enumerate(cc4.actions[:-1]):
        chosen = learner.act(session.view)
        belief = learner.belief(0)
        assert cc4.entropies[number] == pytest.approx(belief.entropy)
        assert cc4.moments[number].hypotheses == len(belief.which)
        np.testing.assert_allclose(cc4.edges[number], learner.structure(0).edges)
        before = dict(zip(belief.which, belief.weight, strict=True))
        learner.learn(session.step(chosen))
        survived = sum(before[which] for which in learner.belief(0).which)
        assert action.chance == pytest.approx(survived)
        # Three outcomes at most, of which one was seen: without noise this bounds their entropy.
        shares = np.array([action.chance, 1 - action.chance]).clip(1e-300, 1)
        least = -(shares * np.log2(shares)).sum()
        assert least - 1e-6 < action.gain_predicted < least + (1 - action.chance) + 1e-6


@pytest.mark.parametrize(("name", "trial"), [("CC4", 3), ("CC3-CE4", 7), ("noisy_CC3", 2)])
def test_a_traced_subject_does_what_it_does_among_others(name, trial):
    session = Session(find_condition(name), HUMAN, 3, seed=SEED, learner="bayes")
    record = session.play(create("openlock_learners.bayes:Bayes")).to_pandas()
    trace, own = traced(name, trial, subject=2), record[record["subject"] == 2]
    played = own[(own["attempt"] == 1).cumsum() == trial]
    names = session.brief.action_names
    assert [[action.action for action in attempt] for attempt in trace.attempts] == [
        [names[action] for action in actions] for actions in played["actions"]
    ]
    assert trace.found == played["solutions_found"].max()
    assert trace.found == len(trace.truth.solutions)


def test_what_was_impossible_leads_to_other_hypotheses(uncertain):
    (row,) = [action for action in uncertain.actions if action.renewed == "noise"]
    assert row.chance == pytest.approx(0)
    assert all(action.chance > 0 for action in uncertain.actions if action is not row)
    whole = " ".join(line.strip() for line in trace_text(uncertain))
    assert whole.count("from here on levers may fail to move") == 1
    legend = [text.get_text() for text in drawn(uncertain).legends[0].get_texts()]
    assert "other hypotheses" in legend


@pytest.mark.parametrize("name", ["bayes", "bayes_net_ddqn"])
def test_beliefs_follow_from_what_was_done_alone(name):
    schema = "noisy_CC3" if name == "bayes" else "CC3"
    played = traced(schema, learner=create(name), label=name)
    names = action_names(len(played.nodes) - 1)
    done = [names.index(action.action) for action in played.actions]
    seen = traced(schema, learner=create(name), label=name, recorded=done)
    pd.testing.assert_frame_equal(seen.table(), played.table(), check_exact=True)


@settings(max_examples=40, deadline=None)
@given(schemas(max_levers=4), schemas(max_levers=4))
def test_structures_are_alike_exactly_if_no_attempt_tells_them_apart(first, second):
    layout = Layout.random(first, np.random.default_rng(1))
    moved = by_position(Room.of(first, layout))
    assert Rules.of(moved).key == Rules.of(first).at(layout.as_mapping(first)).key
    assert behave_alike(moved, moved, first.least_action_limit)
    assert same_structure(moved, moved)
    if first.levers == second.levers:
        keys = key_of(first), key_of(second)
        assert same_structure(first, second) == (keys[0] == keys[1])
        for limit in (2, 3, 4):
            alike = seen_of(keys[0], limit) == seen_of(keys[1], limit)
            assert behave_alike(first, second, limit) == alike


def test_structures_in_words():
    assert in_words(find_schema("CE3")) == "L1 or L2 enables L0; L0 unlocks the door"
    two = find_schema("two_of_four")
    assert in_words(two) == "any 2 of L0, L1, L2 and L3 unlock the door"
    edges = {"A": {"C": 0.5}, "B": {"C": 0.5}, "C": {DOOR: 0.5}}
    schema = Schema("s", ["C", "B", "A", "D"], edges, gates={"C": Gate("all")}, inert=["D"])
    assert in_words(schema) == (
        "B and A together enable C; C unlocks the door; D does nothing for the door; strength 0.50"
    )


PANELS = ("timeline", "entropy", "gains", "arrows", "most probable", "truth")


def drawn(trace, **most):
    figure = Figure()
    plot_trace(trace, ax=figure, **most)
    return figure


def visible_texts(figure):
    hidden = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
            hidden |= {
                tick.label1
                for tick in ticks
                if not low - 1e-9 <= tick.get_loc() <= high + 1e-9
                or not (tick.label1.get_visible() and axes.axison)
            }
    for text in figure.findobj(Text):
        if text.get_text().strip() and text.get_visible() and text not in hidden:
            yield text


def check_texts(figure):
    """No text is clipped by the page, and none lies over another."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    boxes = [(text.get_text(), text.get_window_extent(renderer)) for text in visible_texts(figure)]
    page = figure.bbox
    for name, box in boxes:
        assert page.x0 <= box.x0 <= box.x1 <= page.x1, name
        assert page.y0 <= box.y0 <= box.y1 <= page.y1, name
    for (first, a), (second, b) in combinations(boxes, 2):
        apart = a.x1 <= b.x0 or b.x1 <= a.x0 or a.y1 <= b.y0 or b.y1 <= a.y0
        assert apart, (first, second)


@pytest.mark.parametrize(
    ("name", "trial", "actions"), [("CC4", 1, 36), ("eight", 1, 36), ("CC3-CC4", 7, 4)]
)
def test_nothing_is_clipped_and_nothing_overlaps(name, trial, actions):
    check_texts(drawn(traced(name, trial), actions=actions))


def test_a_lever_pulled_back_locks_the_door_and_long_names_fit():
    trace = traced("CC4", learner=Undoing())
    assert {"unlocked", "locked"} <= {action.outcome for action in trace.actions}
    assert trace.found == 0
    assert "0 of 3 solutions in 30 attempts" in " ".join(trace_text(trace))
    name = "a_name_of_sixty_four_letters_".ljust(64, "x")
    figure = drawn(replace(trace, learner=name, condition=name), actions=75)
    check_texts(figure)
    assert "locked" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_panels_show_the_trace(cc4):
    figure = drawn(cc4)
    panels = dict(zip(PANELS, figure.axes, strict=False))  # then the scale
    names = [label.get_text() for label in panels["timeline"].get_xticklabels()]
    assert names == ["at first", *map(shown_name, cc4.actions)]
    entropies = panels["entropy"].lines[0].get_ydata()
    np.testing.assert_allclose(entropies, cc4.entropies)
    heights = [bar.get_height() for bar in panels["gains"].patches]
    gains = cc4.table()[["gain_predicted", "gain_obtained"]].to_numpy().T.ravel()
    np.testing.assert_allclose(heights, gains[np.abs(gains) > 0.005])
    (mesh,) = panels["arrows"].collections
    rows = [label.get_text().split(" → ") for label in panels["arrows"].get_yticklabels()]
    for row, (cause, effect) in zip(np.asarray(mesh.get_array()), rows, strict=True):
        at = cc4.nodes.index(cause), cc4.nodes.index(effect)
        np.testing.assert_allclose(row, cc4.edges[:, *at])
    assert {tuple(row) for row in rows[:6]} == set(cc4.truth.graph.edges)  # the true ones first
    assert {text.get_text() for text in panels["truth"].texts} == {*cc4.truth.levers, DOOR}


def test_a_long_trial_is_cut_at_an_attempt_and_the_picture_says_so(cc4):
    first = len(cc4.attempts[0])
    actions = first + len(cc4.attempts[1])
    # One action short of the second attempt's end, the first alone is shown; then both.
    for most, shown in ((actions - 1, first), (actions, actions)):
        panels = dict(zip(PANELS, drawn(cc4, actions=most).axes, strict=False))
        said = f"Shown are the first {shown} of {len(cc4.actions)} actions"
        assert panels["arrows"].get_xlabel().startswith(said)
        assert len(panels["timeline"].get_xticklabels()) == 1 + shown


def test_the_command_tells_the_trial_of_an_experiment_that_was_asked_for(tmp_path):
    (tmp_path / "few.yaml").write_text(
        "name: few\nseed: 5\nconditions: [CC3]\nlearners:\n"
        "  - {learner: bayes, name: sampler, parameters: {policy: thompson}}\n"
        "protocols:\n  brief: {attempt_limit: 2}\n",
        encoding="utf-8",
    )
    words = "trace chain3 -e few.yaml -l sampler --protocol brief --trial 2 -o mine.png"
    stories = []
    for more in ("--subject 3 --table mine.csv", "--subject 2", "--subject 3 --seed 6"):
        done = at_once(*words.split(), *more.split(), cwd=tmp_path)
        assert done.status == 0, done.stderr
        stories.append(done.stdout.split("\n", 1))
    assert stories[0][0] == "sampler in chain3 under protocol brief, subject 3, trial 2 of 5"
    assert "2 attempts of 4 actions" in stories[0][1]
    assert len({story for _, story in stories}) == 3
    assert (tmp_path / "mine.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "mine.csv").read_text().startswith("trial,attempt,number,action,outcome,")

"""A trial of belief, looked into: the data, the words, the picture, the command."""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from causal_openlock.analysis.plots.belief import Part, plot_trace, save_trace_figure
from causal_openlock.belief.belief_learner import BeliefLearner, Onlooker
from causal_openlock.belief.structure_schemas import (
    behave_alike,
    by_position,
    in_words,
    same_structure,
)
from causal_openlock.belief.trace import Trace, percent, shown_name, trace_text, trace_trial
from causal_openlock.cli import main
from causal_openlock.contract.learner import Learner, View
from causal_openlock.contract.registry import create
from causal_openlock.errors import LearnerError, OpenLockError, ProtocolError
from causal_openlock.experiment.protocol import PROTOCOLS, Condition
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import bundled_schemas, find_schema
from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.world.room import Layout, Room, action_names
from openlock_learners.bayes import Bayes
from support.waiting import HANGS

pytestmark = pytest.mark.slow

SEED = 2018
HUMAN = PROTOCOLS["human"]
LEVERS = [f"L{index}" for index in range(8)]
EIGHT = Schema("eight", LEVERS, {"L0": LEVERS[1:], **{lever: [DOOR] for lever in LEVERS[1:]}})


def traced(
    name: str, trial: int = 1, subject: int = 0, learner: Any = None, protocol: Any = HUMAN
) -> Trace:
    condition = Condition.named(name, lambda of: EIGHT if of == "eight" else find_schema(of))
    return trace_trial(
        learner or create("openlock_learners.bayes:Bayes"), condition, protocol,
        trial=trial, subject=subject, seed=SEED, label="bayes",
    )  # fmt: skip


@pytest.fixture(scope="module")
def cc4() -> Trace:
    return traced("CC4")


@pytest.fixture(scope="module")
def uncertain() -> Trace:
    """A trial in which everything is ruled out, and levers that may fail are thought of."""
    for subject in range(30):
        trace = traced("noisy_CC3", subject=subject)
        if any(action.renewed == "noise" for action in trace.actions):
            return trace
    raise AssertionError("nobody has concluded that levers may fail")


class Undoing(Bayes):
    """Pulls a lever back as soon as the door is unlocked."""

    def act(self, view: View) -> Any:
        actions = super().act(view)
        positions = self.brief.positions
        for subject in np.flatnonzero(view.observation[:, -2] == 0):
            actions[subject] = positions + self.last
        self.last = int(actions[0]) % positions
        return actions


# -- the data -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["CC4", "CE4", "noisy_CC3"])
def test_beliefs_follow_one_another(name: str) -> None:
    trace = traced(name)
    table = trace.table()
    assert (table["entropy_before"][1:].to_numpy() == table["entropy_after"][:-1].to_numpy()).all()
    obtained = table["entropy_before"] - table["entropy_after"]
    np.testing.assert_allclose(table["gain_obtained"], obtained)
    assert (table["gain_predicted"] >= 0).all()
    assert table["chance"].between(0, 1 + 1e-9).all()
    assert len(trace.entropies) == len(table) + 1
    for one, other in pairwise(trace.actions):
        expected = (one.attempt, one.number + 1)
        assert (other.attempt, other.number) in (expected, (one.attempt + 1, 1))


def test_the_first_belief_is_the_prior(cc4: Trace) -> None:
    session = Session(Condition.named("CC4", find_schema), HUMAN, [0], seed=SEED, learner="bayes")
    learner = create("openlock_learners.bayes:Bayes")
    assert isinstance(learner, BeliefLearner)
    learner.begin(session.brief)
    learner.act(session.view)
    prior = learner.belief(0)
    assert cc4.entropies[0] == pytest.approx(prior.entropy)
    assert cc4.snapshots[0].hypotheses == len(prior.which)
    np.testing.assert_allclose(cc4.edges[0], learner.edges(0))


def test_the_chance_of_what_was_seen_is_what_the_surviving_hypotheses_held(cc4: Trace) -> None:
    session = Session(Condition.named("CC4", find_schema), HUMAN, [0], seed=SEED, learner="bayes")
    learner = create("openlock_learners.bayes:Bayes")
    assert isinstance(learner, BeliefLearner)
    learner.begin(session.brief)
    for action in cc4.actions[:-1]:
        chosen = learner.act(session.view)
        before = dict(zip(learner.belief(0).which, learner.belief(0).weight, strict=True))
        learner.learn(session.step(chosen))
        survived = sum(before[which] for which in learner.belief(0).which)
        assert action.chance == pytest.approx(survived)


@pytest.mark.parametrize("name", ["CC4", "CE4", "chain3"])
def test_the_gain_expected_is_the_entropy_of_what_could_be_seen(name: str) -> None:
    for action in traced(name).actions:
        # Three outcomes at most, of which one was seen: without noise this bounds their entropy.
        shares = np.array([action.chance, 1 - action.chance]).clip(1e-300, 1)
        least = -(shares * np.log2(shares)).sum()
        assert least - 1e-6 < action.predicted < least + (1 - action.chance) + 1e-6


@pytest.mark.parametrize(("name", "trial"), [("CC4", 3), ("CC3-CE4", 7), ("noisy_CC3", 2)])
def test_a_traced_subject_does_what_it_does_among_others(name: str, trial: int) -> None:
    condition = Condition.named(name, find_schema)
    session = Session(condition, HUMAN, 3, seed=SEED, learner="bayes")
    record = session.play(create("openlock_learners.bayes:Bayes")).to_pandas()
    trace = traced(name, trial, subject=2)
    own = record[record["subject"] == 2]
    visits = (own["attempt"] == 1).cumsum()
    played = own[visits == trial]
    names = session.brief.action_names
    assert [[action.name for action in attempt] for attempt in trace.attempts] == [
        [names[action] for action in actions] for actions in played["actions"]
    ]
    assert trace.found == played["solutions_found"].max()
    assert trace.solved


@pytest.mark.parametrize("name", ["CC4", "CE4"])
@pytest.mark.parametrize("subject", [0, 1, 2])
def test_a_solved_room_is_understood(name: str, subject: int) -> None:
    trace = traced(name, subject=subject)
    assert trace.solved
    final = trace.snapshots[-1]
    assert behave_alike(final.structure, trace.truth, trace.action_limit)
    assert trace.entropies[-1] < trace.entropies[0] / 3
    for cause, effect in trace.truth.graph.edges:
        at = trace.nodes.index(cause), trace.nodes.index(effect)
        assert trace.edges[-1][at] > trace.edges[0][at]


def test_what_was_impossible_leads_to_other_hypotheses(uncertain: Trace) -> None:
    (row,) = [action for action in uncertain.actions if action.renewed == "noise"]
    assert row.chance == pytest.approx(0)
    assert all(action.chance > 0 for action in uncertain.actions if action is not row)


def test_a_lever_pulled_back_locks_the_door_again() -> None:
    trace = traced("CC4", learner=Undoing())
    assert {"unlocked", "locked"} <= {action.outcome for action in trace.actions}
    assert not trace.solved
    assert "Not solved: 0 of 3 solutions in 30 attempts" in " ".join(trace_text(trace))
    figure = drawn(trace)
    assert "locked again" in [text.get_text() for text in figure.legends[0].get_texts()]
    check_texts(figure)


def test_the_table_has_a_column_for_each_arrow_that_was_ever_possible(cc4: Trace) -> None:
    table = cc4.table()
    arrows = [column for column in table if " -> " in column]
    assert len(arrows) == (cc4.edges.max(axis=0) > 0).sum()
    for cause, effect in cc4.truth.graph.edges:
        at = cc4.nodes.index(cause), cc4.nodes.index(effect)
        np.testing.assert_array_equal(table[f"{cause} -> {effect}"], cc4.edges[1:, *at])


@pytest.mark.parametrize("name", ["bayes", "bayes_net_ddqn"])
def test_beliefs_follow_from_what_was_done_alone(name: str) -> None:
    condition = Condition.named("noisy_CC3" if name == "bayes" else "CC3", find_schema)

    def trace_of(learner: Learner) -> Trace:
        return trace_trial(learner, condition, HUMAN, seed=SEED, label=name)

    played = trace_of(create(name))
    learner = create(name)
    assert isinstance(learner, BeliefLearner)
    names = action_names(len(played.nodes) - 1)
    seen = trace_of(Onlooker(learner, [names.index(action.name) for action in played.actions]))
    assert not hasattr(learner, "q")  # no network was made
    pd.testing.assert_frame_equal(seen.table(), played.table(), check_exact=True)


def test_what_cannot_be_traced() -> None:
    with pytest.raises(LearnerError, match="has no beliefs to trace"):
        traced("CC4", learner=create("random"))
    for trial in (0, 6):
        with pytest.raises(ProtocolError, match=f"no trial {trial}; choose one from 1 to 5"):
            traced("CC4", trial)


# -- structures compared --------------------------------------------------------------------------


@pytest.mark.parametrize("schema", bundled_schemas().values(), ids=lambda schema: schema.name)
def test_levers_renamed_by_position_act_as_before(schema: Schema) -> None:
    generator = np.random.default_rng(1)
    layout = Layout.random(schema, generator)
    moved = by_position(Room.of(schema, layout))
    where = layout.as_mapping(schema)
    assert {frozenset(levers) for levers in moved.solutions} == {
        frozenset(where[lever] for lever in levers) for levers in schema.solutions
    }
    assert behave_alike(moved, moved, schema.least_action_limit)
    assert same_structure(moved, moved)


def test_structures_are_alike_as_long_as_no_attempt_tells_them_apart() -> None:
    chain = Schema("a", ["A", "B", "C"], {"A": ["B"], "B": ["C"], "C": [DOOR]})
    both = Schema(
        "b", ["A", "B", "C"], {"A": ["B", "C"], "B": ["C"], "C": [DOOR]}, gates={"C": Gate("all")}
    )
    assert not same_structure(chain, both)
    assert behave_alike(chain, both, 3)
    assert not behave_alike(chain, both, 4)  # push A, push B, pull A, push C
    fork = Schema("c", ["A", "B", "C"], {"A": ["B", "C"], "B": [DOOR], "C": [DOOR]})
    assert not behave_alike(chain, fork, 2)
    idle = Schema("d", ["A", "B"], {"A": [DOOR]}, inert=["B"])
    alone = Schema("e", ["A"], {"A": [DOOR]})
    assert not behave_alike(idle, alone, 2)  # B moves in one, and not in the other


# -- the words ------------------------------------------------------------------------------------


def test_the_story_tells_every_action_and_every_solution_once(cc4: Trace) -> None:
    lines = list(trace_text(cc4))
    actions = [line for line in lines if line.startswith(("  push", "  pull"))]
    assert len(actions) == len(cc4.actions)
    for line, action in zip(actions, cc4.actions, strict=True):
        assert line.startswith(f"  {shown_name(action)} ")
        assert ("new solution" in line) == (action.outcome == "new solution")
    for number in (1, 2, 3):
        assert sum(f"({number} of 3)" in line for line in lines) == 1
    assert sum(line.startswith("Attempt ") for line in lines) == len(cc4.attempts)
    whole = " ".join(line.strip() for line in lines)
    verdict = "What it believes most probable is the same structure."
    assert f"In truth, {in_words(cc4.truth)}. {verdict}" in whole
    assert max(map(len, lines)) <= 100


def test_a_long_story_is_cut_and_says_so(cc4: Trace) -> None:
    lines = list(trace_text(cc4, most=1))
    assert "Attempt 2" not in lines
    rest = cc4.attempts[1:]
    found = sum(action.outcome == "new solution" for attempt in rest for action in attempt)
    assert f"and {len(rest)} more attempts, with {found} new solutions" in lines
    whole = " ".join(line.strip() for line in lines)
    assert f"In the end {cc4.snapshots[-1].entropy:.2f} bits left" in whole


def test_the_story_says_when_nothing_was_possible_any_more(uncertain: Trace) -> None:
    whole = " ".join(line.strip() for line in trace_text(uncertain))
    assert whole.count("From here on levers may fail to move") == 1
    assert "the difference of entropies is not information" in whole


@pytest.mark.parametrize(
    ("schema", "words"),
    [
        ("CC3", "L0 enables L1 and L2; L1 or L2 unlocks the door"),
        ("CE3", "L1 or L2 enables L0; L0 unlocks the door"),
        ("two_of_four", "any 2 of L0, L1, L2 and L3 unlock the door"),
        ("chain3", "L0 enables L1; L1 enables L2; L2 unlocks the door"),
    ],
)
def test_structures_in_words(schema: str, words: str) -> None:
    assert in_words(find_schema(schema)) == words


def test_gates_idle_levers_and_strengths_in_words() -> None:
    edges = {"A": {"C": 0.5}, "B": {"C": 0.5}, "C": {DOOR: 0.5}}
    schema = Schema("s", ["C", "B", "A", "D"], edges, gates={"C": Gate("all")}, inert=["D"])
    assert in_words(schema) == (
        "B and A together enable C; C unlocks the door; D does nothing for the door; strength 0.50"
    )


def test_only_certainty_is_a_hundred_percent() -> None:
    shown = [percent(p) for p in (0.001, 0.014, 0.994, 0.9999, 1.0)]
    assert shown == ["under 1%", "1%", "99%", "over 99%", "100%"]


# -- the picture ----------------------------------------------------------------------------------


def drawn(trace: Trace, **most: int) -> Figure:
    figure = Figure()
    plot_trace(trace, ax=figure, **most)
    return figure


def visible_texts(figure: Figure) -> Iterator[Text]:
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


def check_texts(figure: Figure) -> None:
    """No text is clipped by the page, and none lies over another."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    boxes = [(text.get_text(), text.get_window_extent(renderer)) for text in visible_texts(figure)]
    page = figure.bbox
    for name, box in boxes:
        assert box.x0 >= page.x0, name
        assert box.y0 >= page.y0, name
        assert box.x1 <= page.x1, name
        assert box.y1 <= page.y1, name
    for (one, a), (other, b) in combinations(boxes, 2):
        apart = a.x1 <= b.x0 or b.x1 <= a.x0 or a.y1 <= b.y0 or b.y1 <= a.y0
        assert apart, (one, other)


@pytest.mark.parametrize(
    ("name", "trial", "actions"),
    [("CC4", 1, 36), ("CE4", 2, 36), ("noisy_CC3", 1, 36), ("eight", 1, 36), ("CC3-CC4", 7, 4)],
)
def test_nothing_is_clipped_and_nothing_overlaps(name: str, trial: int, actions: int) -> None:
    check_texts(drawn(traced(name, trial), actions=actions))


def test_long_names_and_many_columns_fit() -> None:
    trace = traced("CC4", learner=Undoing())
    name = "a_name_of_sixty_four_letters_".ljust(64, "x")
    trace = replace(trace, learner=name, condition=name)
    check_texts(drawn(trace, actions=75))
    assert "the first 75 of 90 actions" in Part.of(trace, 75).cut


def test_panels_show_the_trace(cc4: Trace) -> None:
    figure = drawn(cc4)
    panels = {axes.get_label(): axes for axes in figure.axes}
    assert {"timeline", "entropy", "gains", "arrows", "most probable", "truth"} <= set(panels)
    names = [label.get_text() for label in panels["timeline"].get_xticklabels()]
    assert names == ["at first", *map(shown_name, cc4.actions)]
    entropies = panels["entropy"].lines[len(cc4.attempts)].get_ydata()
    np.testing.assert_allclose(entropies, cc4.entropies)
    heights = [bar.get_height() for bar in panels["gains"].patches]
    gains = cc4.table()[["gain_predicted", "gain_obtained"]].to_numpy().T.ravel()
    np.testing.assert_allclose(heights, gains[np.abs(gains) > 0.005])
    (mesh,) = panels["arrows"].collections
    rows = [label.get_text().split(" → ") for label in panels["arrows"].get_yticklabels()]
    for row, (cause, effect) in zip(np.asarray(mesh.get_array()), rows, strict=True):
        at = cc4.nodes.index(cause), cc4.nodes.index(effect)
        np.testing.assert_allclose(row, cc4.edges[:, *at])
    arrows = {tuple(row) for row in rows[:6]}
    assert arrows == set(cc4.truth.graph.edges)  # the true ones come first
    named = {text.get_text() for text in panels["truth"].texts}
    assert named == {*cc4.truth.levers, DOOR}


def test_no_information_is_drawn_where_hypotheses_were_replaced(uncertain: Trace) -> None:
    gains = next(axes for axes in drawn(uncertain).axes if axes.get_label() == "gains")
    (column,) = [i for i, a in enumerate(uncertain.actions, 1) if a.renewed == "noise"]
    obtained = [bar.get_x() + bar.get_width() / 2 for bar in gains.patches if not bar.get_hatch()]
    assert all(abs(x - (column + 0.2)) > 0.1 for x in obtained)
    assert Part.of(uncertain).renewed


def test_a_long_trial_is_cut_at_an_attempt_and_the_picture_says_so(cc4: Trace) -> None:
    first = len(cc4.attempts[0])
    actions = first + len(cc4.attempts[1])
    assert actions < len(cc4.actions)
    # One action short of the second attempt's end, the first alone is shown; then both.
    for most, shown in ((actions - 1, first), (actions, actions)):
        figure = drawn(cc4, actions=most, arrows=8)
        texts = [text.get_text() for text in figure.texts]
        said = f"Shown are the first {shown} of {len(cc4.actions)} actions and 8 of"
        assert any(text.startswith(said) for text in texts)
        panels = {axes.get_label(): axes for axes in figure.axes}
        assert len(panels["timeline"].get_xticklabels()) == 1 + shown
        assert len(panels["arrows"].get_yticklabels()) == 8


def test_equal_traces_give_equal_files(cc4: Trace, tmp_path: Path) -> None:
    for suffix in ("svg", "png", "pdf"):
        for name in ("a", "b"):
            save_trace_figure(cc4, tmp_path / f"{name}.{suffix}")
        assert (tmp_path / f"a.{suffix}").read_bytes() == (tmp_path / f"b.{suffix}").read_bytes()
    with pytest.raises(OpenLockError, match=r"cannot be saved as '\.html'"):
        save_trace_figure(cc4, tmp_path / "a.html")


# -- the command ----------------------------------------------------------------------------------


def openlock(*words: object, cwd: Path, expect: int = 0) -> tuple[str, str]:
    out, err = io.StringIO(), io.StringIO()
    argv, before = sys.argv, Path.cwd()
    sys.argv = ["causal-openlock", *map(str, words)]
    os.chdir(cwd)
    status = 0
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            main()
    except SystemExit as end:
        status = int(end.code or 0)
    finally:
        os.chdir(before)
        sys.argv = argv
    assert status == expect, out.getvalue() + err.getvalue()
    return out.getvalue(), err.getvalue()


def test_trace_tells_the_story_and_writes_the_picture(tmp_path: Path) -> None:
    said, _ = openlock("trace", "CC4", "--learner", "bayes", cwd=tmp_path)
    assert "trial 1 of 5" in said
    assert "a new solution (3 of 3)" in said
    assert said.endswith("trace_CC4.svg written\n")
    assert "<svg" in (tmp_path / "trace_CC4.svg").read_text(encoding="utf-8")


def test_trace_takes_a_schema_of_ones_own_and_a_learner_of_an_experiment(tmp_path: Path) -> None:
    openlock("schema", "new", "mine", "--like", "chain3", cwd=tmp_path)
    (tmp_path / "few.yaml").write_text(
        "name: few\nseed: 5\nconditions: [CC3]\nlearners:\n"
        "  - {learner: bayes, name: sampler, parameters: {policy: thompson}}\n"
        "protocols:\n  brief: {attempt_limit: 2}\n",
        encoding="utf-8",
    )
    said, _ = openlock(
        *("trace", "mine.yaml", "-e", "few.yaml", "-l", "sampler", "--protocol", "brief"),
        *("--trial", 2, "--subject", 3, "-o", "mine.png", "--table", "mine.csv"),
        cwd=tmp_path,
    )
    assert said.startswith("sampler in mine under protocol brief, subject 3, trial 2 of 5\n")
    assert "2 attempts of 4 actions" in said
    assert (tmp_path / "mine.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "mine.csv").read_text().startswith("trial,attempt,number,action,outcome,")


def test_seed_and_subject_change_the_trial(tmp_path: Path) -> None:
    words = ("trace", "CE4", "-o", "x.svg")
    said = {
        openlock(*words, *more, cwd=tmp_path)[0].split("\n", 1)[1]
        for more in ((), ("--subject", 1), ("--seed", 6))
    }
    assert len(said) == 3


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["CC4", "--learner", "bayse"], "did you mean bayes?"),
        (["CC4", "--learner", "random"], "random has no beliefs to trace"),
        (["CC44"], "did you mean CC4?"),
        (["CC3-CC4-CC3"], "is not a condition"),
        (["nowhere.yaml"], "cannot be read"),
        (["CC4", "--trial", "6"], "no trial 6; choose one from 1 to 5"),
        (["CC4", "--protocol", "robot"], "no protocol 'robot'"),
        (["CC4", "-e", "defualt"], "did you mean default?"),
        (["CC4", "-o", "picture.html"], "cannot be saved as '.html'"),
        (["CC4", "-o", "taken/trace.svg"], "cannot be written"),
        (["CC4", "--table", "taken/trace.csv"], "cannot be written"),
    ],
)
def test_mistakes_are_answered_with_one_sentence(
    words: list[str], sentence: str, tmp_path: Path
) -> None:
    (tmp_path / "taken").write_text("no folder", encoding="utf-8")
    _, said = openlock("trace", *words, cwd=tmp_path, expect=2)
    assert said.startswith("error: ")
    assert len(said.splitlines()) == 1
    assert sentence in said


def test_the_help_loads_nothing_heavy(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "causal_openlock", "trace", "--help"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        timeout=HANGS,
    )
    loaded = {line.rsplit("|", 1)[-1].strip().split(".")[0] for line in done.stderr.splitlines()}
    assert "causal_openlock" in loaded
    heavy = {"torch", "pgmpy", "matplotlib", "pandas", "scipy", "networkx", "pyarrow"}
    assert not loaded & heavy

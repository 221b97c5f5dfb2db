"""The progress of a comparison: by work and not by cells, on a terminal and in a file."""

import itertools
import re
import time

import pytest

from causal_openlock.comparison import progress_bar
from causal_openlock.comparison.progress_bar import LINE_EVERY, Lines, duration, shown_steps
from causal_openlock.experiment.file import read_experiment
from causal_openlock.running.progress import Playing, ProgressEstimator, RunProgress, work

TEXT = """\
name: e
subjects: 4
cell_size: 2
conditions: [CC3]
learners: [random, {learner: oracle, name: slow, protocol: long}]
protocols: {long: {attempt_limit: 300, baseline_trials: 5}}
"""


@pytest.fixture
def cells(tmp_path):
    path = tmp_path / "e.yaml"
    path.write_text(TEXT, encoding="utf-8")
    return list(read_experiment(path).cells())


def test_time_left_follows_from_attempts_and_from_what_each_learner_takes(cells):
    assert [work(cell) for cell in cells] == [2 * 5 * 30] * 2 + [2 * 5 * 300] * 2
    course = ProgressEstimator(cells, workers=1)
    before = course.standing(0.0, cells)
    assert (before.share, before.left, before.done) == (0, None, 0)
    course.began(cells[0], 0.0)
    course.ended(cells[0], 3.0)  # 100 attempts a second
    known = course.standing(3.0, cells[1:])
    assert known.done == 1
    assert known.share == pytest.approx(300 / 6600)
    assert known.left == pytest.approx(63)  # as fast as the only one that is known
    course.began(cells[2], 3.0)
    course.heard(cells[2], 1, 0.4, 5.0)  # it may have been a checkpoint's
    course.heard(cells[2], 2, 0.5, 35.0)  # 300 attempts in 30 seconds
    inside = course.standing(35.0, [cells[1], cells[3]])
    assert inside.share == pytest.approx((300 + 1500) / 6600)
    assert inside.left == pytest.approx(3 + 150 + 300)
    two = ProgressEstimator(cells, workers=2)
    two.began(cells[0], 0.0)
    two.ended(cells[0], 3.0)
    assert two.standing(3.0, cells[1:]).left == pytest.approx(63 / 2)
    for cell in cells[1:]:
        two.ended(cell, 9.0, failed=cell is cells[3])
    over = two.standing(9.0)
    assert (over.done, over.failed, over.share, over.left) == (3, 1, 1, 0)


def test_a_cell_that_is_silent_is_known(cells):
    course = ProgressEstimator(cells, 1)
    course.began(cells[0], 10.0)
    course.heard(cells[0], 1, 0.1, 20.0)
    course.heard(cells[0], 1, 0.1, 90.0)  # the same as before: nothing was heard
    (one,) = course.playing(100.0)
    assert (one.still, one.seconds, one.share) == (80.0, 90.0, 0.1)
    course.heard(cells[0], 2, 0.1, 101.0)
    assert course.playing(101.0)[0].still == 0


def test_lines_are_regular_and_name_what_hangs(cells):
    now, said = [0.0], []
    lines = Lines("e", lambda line: said.append((now[0], line)), clock=lambda: now[0])
    while now[0] < 400:
        playing = (Playing(cells[2], 0.25, now[0], now[0]),)
        lines(RunProgress(4, 1, 0, playing, 0.3, 90.0))
        now[0] += 1.0
    times = [at for at, line in said if line.startswith("e:")]
    assert times[0] == 0
    assert max(later - at for at, later in itertools.pairwise(times)) <= LINE_EVERY + 1 <= 30
    assert "1 of 4 cells done, 30% of the work, about 2 min left" in said[0][1]
    assert "slow in CC3, subjects 0-1 (25%)" in said[0][1]
    hanging = [line for _, line in said if line.startswith("no step")]
    assert [re.findall(r"\d+ s|\d+ min", line) for line in hanging] == [
        ["60 s"],
        ["2 min"],
        ["4 min"],
    ]
    assert all("slow in CC3, subjects 0-1" in line for line in hanging)
    for _ in range(3):
        lines(RunProgress(4, 3, 1, (), 1.0, 0.0))
    assert [line for _, line in said][-1] == "e: 3 of 4 cells done, 1 failed, in 7 min"
    assert sum("in 7 min" in line for _, line in said) == 1


@pytest.mark.parametrize(
    ("seconds", "words"), [(0.2, "0 s"), (89, "89 s"), (100, "2 min"), (7799, "2 h 10 min")]
)
def test_durations_are_told_in_words(seconds, words):
    assert duration(seconds) == words


def test_a_long_task_names_its_step_and_a_quick_one_says_nothing(monkeypatch, capsys):
    with shown_steps("report") as begin:
        begin("reading")
    assert capsys.readouterr() == ("", "")
    monkeypatch.setattr(progress_bar, "FIRST_AFTER", 0.05)
    for terminal in (False, True):
        if terminal:
            monkeypatch.setenv("FORCE_COLOR", "1")
            monkeypatch.setenv("TERM", "xterm")
        with shown_steps("report") as begin:
            begin("computing [transfer]")
            time.sleep(0.5)
        out, err = capsys.readouterr()
        assert out == ""
        assert "report: computing [transfer]" in re.sub(r"\x1b\[[\d;?]*\w", "", err)
        assert err.endswith("\x1b[2K" if terminal else "\n")  # there the line disappears

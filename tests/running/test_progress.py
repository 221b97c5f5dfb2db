"""The progress of a comparison: by work and not by cells, on a terminal and in a file."""

import itertools
from types import SimpleNamespace

from causal_openlock.comparison.progress_bar import LINE_EVERY, counting, lines, naming_still_cells
from causal_openlock.experiment.making import Changes, find_experiment, read_experiment
from causal_openlock.running.progress import Playing, RunProgress, progress_of, work

CELL = SimpleNamespace(file_name="a", in_words="slow in CC3, subjects 0-1")


def test_lines_are_regular_and_name_what_hangs():
    now, said = [0.0], []

    def say(line):
        said.append((now[0], line))

    show = naming_still_cells(lines("e", say, clock=lambda: now[0]), say)
    while now[0] < 400:
        playing = (Playing(CELL, 0.25, now[0], now[0]),)
        show(RunProgress(4, 1, 0, playing, 0.3, 90.0))
        now[0] += 1.0
    times = [at for at, line in said if line.startswith("e:")]
    assert times[0] == 0
    assert max(later - at for at, later in itertools.pairwise(times)) <= LINE_EVERY + 1 <= 30
    assert "1 of 4 cells done, 30% of the work, about 2 min left" in said[0][1]
    assert "slow in CC3, subjects 0-1 (25%)" in said[0][1]
    hanging = [line for _, line in said if line.startswith("no step")]
    assert hanging == ["no step for 60 s: learner slow in CC3, subjects 0-1"]
    for _ in range(3):
        show(RunProgress(4, 3, 1, (), 1.0, 0.0))
    assert [line for _, line in said][-1] == "e: 3 of 4 cells done, 1 failed, in 7 min"
    assert sum("in 7 min" in line for _, line in said) == 1


def test_the_time_left_goes_by_the_pace_of_each_learner():
    changes = Changes(["CC3", "CE3"], ["oracle", "bayes"], None, 40, 1)
    cells = read_experiment(find_experiment("default"), changes).cells()
    first, second = (cell for cell in cells if cell.spec.name == "bayes")
    paces = {"oracle": 0.0, "bayes": 20 / work(first)}
    half = [Playing(first, 0.5, 10.0, 0.0)]
    for left, seconds in ((cells, 30), ([first, second], 30), ([first], 10), ([], 0)):
        playing = half if first in left else []
        assert round(progress_of(cells, left, 0, playing, paces).left) == seconds
    assert (
        progress_of(cells, cells, 0, [], {"oracle": 0.0}).left is None
    )  # of the other nothing is known


def test_a_task_in_parts_says_how_long_the_rest_takes(monkeypatch):
    now, said = [0.0], []
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    report = counting(said.append, "parts are scored")
    for now[0], done in ((5.0, 1), (5.0, 2), (65.0, 4), (95.0, 5)):  # two are from an earlier run
        report(done, 8)
    rest = ("", "", ", about 2 min left", ", about 2 min left")
    assert said == [
        f"{done} of 8 parts are scored{more}" for done, more in zip((1, 2, 4, 5), rest, strict=True)
    ]

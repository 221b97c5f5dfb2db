"""The progress of a comparison: by work and not by cells, on a terminal and in a file."""

import itertools
import re

import pytest

from causal_openlock.comparison.progress_bar import LINE_EVERY, Lines
from causal_openlock.experiment.file import read_experiment
from causal_openlock.running.progress import Playing, RunProgress

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

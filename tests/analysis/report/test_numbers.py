"""Numbers of the page, recomputed from the record by other means: pandas by hand, and SciPy."""

import csv
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from causal_openlock.analysis.report.writing import make_report
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.reading import read_results
from causal_openlock.experiment.making import read_experiment
from causal_openlock.running.runner import run
from support.html_page import Page

pytestmark = pytest.mark.slow

DECLARED = """
name: numbers
seed: 11
subjects: 12
cell_size: 5
conditions: [CC4, CE4, CC3-CC4]
learners:
  - oracle
  - {learner: random, name: chance, protocol: quick}
  - {learner: random, name: lucky}
protocols: {quick: {based_on: rl, attempt_limit: 40, baseline_loops: 2, train_loops: 1,
  test_loops: 2}}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("numbers")
    (folder / "numbers.yaml").write_text(DECLARED)
    with ThreadPoolExecutor(1) as pool:
        store = run(read_experiment(folder / "numbers.yaml"), folder / "out", executor=pool)
        record, description = read_results(store)
        make_report(Material.of(record, description), store.folder, figures=True)
        yield store.folder


@pytest.fixture(scope="module")
def attempts(folder):
    """The record as pandas reads its files, with nothing of ours in between."""
    cells = [pd.read_parquet(path) for path in sorted((folder / "cells").glob("*.parquet"))]
    frame = pd.concat(cells, ignore_index=True)
    for name in frame.select_dtypes("category"):
        frame[name] = frame[name].astype(str)
    return frame


@pytest.fixture(scope="module")
def solved(attempts):
    """One row for each trial, by hand: attempts until the last solution, or to the end."""
    rows = []
    by = ["learner", "condition", "subject", "phase", "loop", "trial"]
    for key, trial in attempts.groupby(by):
        trial = trial.sort_values("attempt")
        done = trial[trial["solutions_found"] == trial["solutions"]]
        last = int(trial["attempt"].iloc[-1])
        needed = int(done["attempt"].iloc[0]) if len(done) else last
        rows.append((*key, needed, bool(len(done))))
    return pd.DataFrame(rows, columns=[*by, "needed", "solved"])


@pytest.fixture(scope="module")
def page(folder):
    return Page((folder / "report.html").read_text("utf-8"))


def judged(solved, learner, condition):
    """``[n]`` of each subject: its test, or the last trial of its last loop."""
    mine = solved[(solved["learner"] == learner) & (solved["condition"] == condition)]
    if (mine["phase"] == "test").any():
        mine = mine[mine["phase"] == "test"]
    else:
        mine = mine[mine["loop"] == mine["loop"].max()]
        mine = mine[mine["trial"] == mine["trial"].max()]
    return mine.groupby("subject")["needed"].mean().to_numpy()


def test_headline_means_intervals_and_shares(page, solved):
    human, quick = page.tables[2:4]
    rows = {row[0].split(" | ")[0]: row for row in [*human, *quick]}
    conditions = [head.split(" | ")[0] for head in human[0][1:]]
    assert conditions == ["CC4", "CE4", "CC3-CC4"]
    for learner in ("oracle", "chance", "lucky"):
        for condition, cell in zip(conditions, rows[learner][1:], strict=True):
            values = judged(solved, learner, condition)
            mean, *small = cell.split(" | ")
            if mean.startswith("not within"):
                assert set(values) == {float(mean.split()[-1])}
                continue
            assert mean.removeprefix("≥ ") == f"{values.mean():.2f}"
            assert mean.startswith("≥ ") == any("solved" in text for text in small)
            interval = [text for text in small if "–" in text]
            alike = np.unique(values, return_counts=True)[1].max()
            assert bool(interval) == (alike < 0.9 * len(values))
            if interval:
                told = stats.ttest_1samp(values, 0.0).confidence_interval()
                assert interval == [f"{told.low:.2f}–{told.high:.2f}"]
            else:
                assert small[0].startswith(f"{alike} of {len(values)} at ")


def test_every_trial_in_the_summary(folder, solved):
    with (folder / "summary.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * (5 + 5) + 2 * (6 + 1) + (6 + 5)
    for row in rows:
        mine = solved[
            (solved["learner"] == row["learner"])
            & (solved["condition"] == row["condition"])
            & (solved["phase"] == row["phase"])
            & (solved["trial"] == int(row["trial"]))
        ]
        values = mine.groupby("subject")["needed"].mean()
        assert float(row["attempts"]) == pytest.approx(values.mean(), rel=1e-5)
        assert float(row["se"]) == pytest.approx(values.std(ddof=0) / math.sqrt(12), rel=1e-5)
        shares = mine.groupby("subject")["solved"].mean().mean()
        assert float(row["share_solved"]) == pytest.approx(shares, rel=1e-5)
        assert int(row["loops"]) == mine["loop"].max()


def test_pages_of_learners_have_the_headline_and_what_is_published(folder, page, solved):
    with (folder / "tables" / "learner_oracle_human.csv").open(newline="") as file:
        rows = {row["condition"]: row for row in csv.DictReader(file)}  # the last trial of each
    for condition, people in (("CC4", 6.45), ("CE4", 9.425), ("CC3-CC4", 5.525)):
        mean = judged(solved, "oracle", condition).mean()
        assert float(rows[condition]["attempts"]) == pytest.approx(mean, rel=1e-5)
        assert float(rows[condition]["human_attempts"]) == pytest.approx(people, abs=0.006)
        away = float(rows[condition]["human_attempts"]) + float(rows[condition]["difference"])
        assert away == pytest.approx(mean, abs=1e-4)
    shown = next(rows for rows in page.tables if rows[0][:2] == ["condition", "phase"])
    assert [*{row[0]: row[5] for row in shown[1:]}.values()] == ["3.00"] * 3


def test_what_the_page_says_of_its_size(page, attempts):
    trials = 12 * (2 * (5 + 5 + 7) + (10 + 10 + 6 + 10))
    assert f"{len(attempts):,} attempts in {trials:,} trials." in page.text

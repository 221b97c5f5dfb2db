"""Data out: the record as CSV."""

import gzip
from concurrent.futures import ThreadPoolExecutor

import pandas as pd
import pytest

from causal_openlock.experiment.making import read_experiment
from causal_openlock.export.as_csv import write_csv
from causal_openlock.running.runner import run
from support.command import at_once

DECLARED = """
name: data.out
seed: 7
subjects: 3
cell_size: 2
conditions: [CC4, CC3-CE4]
learners: [oracle, {learner: random, protocol: quick}]
protocols: {quick: {based_on: rl, attempt_limit: 6, baseline_loops: 1, train_loops: 1}}
"""


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    folder = tmp_path_factory.mktemp("export")
    (folder / "declared.yaml").write_text(DECLARED)
    with ThreadPoolExecutor(1) as pool:
        return run(read_experiment(folder / "declared.yaml"), folder / "out", executor=pool)


def test_csv_has_every_attempt_and_every_column(store, tmp_path):
    record, _ = store.record()
    for name in ("record.csv", "record.csv.gz"):
        assert write_csv(store, tmp_path / name) == record.num_rows
    text = (tmp_path / "record.csv").read_bytes()
    assert gzip.decompress((tmp_path / "record.csv.gz").read_bytes()) == text
    read = pd.read_csv(tmp_path / "record.csv")
    assert list(read.columns) == record.column_names
    for name in ("learner", "condition", "layout", "category", "subject", "attempt", "solution"):
        assert read[name].tolist() == record[name].to_pylist()
    assert read["reward"].to_numpy() == pytest.approx(record["reward"].to_numpy())
    assert read["opened"].astype(bool).tolist() == record["opened"].to_pylist()
    for name, kind in (("actions", int), ("moved", "1".__eq__)):
        told = [[kind(part) for part in cell.split()] for cell in read[name]]
        assert told == record[name].to_pylist()
    done = at_once("export", store.folder, "-o", tmp_path / "x.csv")
    assert (done.status, f"{record.num_rows:,} attempts" in done.stdout) == (0, True)
    assert (tmp_path / "x.csv").read_bytes() == text

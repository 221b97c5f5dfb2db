"""The summary and the headline, against hand-worked examples and plain loops."""

import itertools
import math

import numpy as np
import pyarrow as pa
import pytest

from causal_openlock.analysis.results.material import SUMMARY_COLUMNS
from causal_openlock.analysis.table import write_table
from support.fabricated_records import random_cells, table, trial_rows
from support.made_up_experiments import headline_table, summary_table

PUBLISHED = [*("human_attempts", "human_se", "difference", "model_attempts", "model_se")]


def test_summary_beside_what_is_published_worked_by_hand():
    rows = []
    for subject, length in enumerate([4, 6]):
        rows += trial_rows([0] * (length - 3) + [1, 2, 3], subject=subject)
        rows += trial_rows([1] * 30, subject=subject, trial=2)
        for phase in ("train", "test"):
            rows += trial_rows([1, 2, 3], subject=subject, condition="CE3-CC4", phase=phase)
        rows += trial_rows([1, 2, 3], subject=subject, protocol="rl")
        rows += trial_rows([1, 2, 3], subject=subject, condition="mine")
    summary = summary_table(table(rows)).set_index(["condition", "protocol", "phase", "trial"])
    assert len(summary) == 6
    first = summary.loc[("CC4", "human", "train", 1)]
    assert (first["attempts"], first["se"]) == (5.0, pytest.approx(1 / math.sqrt(2)))
    assert (first["mode"], first["at_mode"], first["share_solved"]) == (6.0, 1, 1.0)
    assert np.isnan(first["ci_low"])  # of two subjects
    assert first[PUBLISHED].tolist() == [19.375, 1.509, -14.375, 11.44, 0.34]
    second = summary.loc[("CC4", "human", "train", 2)]
    assert (second["attempts"], second["share_solved"]) == (30.0, 0.0)
    assert second[["human_attempts", "model_attempts"]].tolist() == [12.825, 7.72]
    test = summary.loc[("CE3-CC4", "human", "test", 1)]
    assert test[["human_attempts", "model_attempts"]].tolist() == [8.175, 6.7]
    for incomparable in (
        ("CE3-CC4", "human", "train", 1),
        ("CC4", "rl", "train", 1),
        ("mine", "human", "train", 1),
    ):
        assert summary.loc[[incomparable], PUBLISHED].isna().all(axis=None)


def test_headline_takes_the_last_trial_or_the_test():
    rows = []
    for loop, trial in itertools.product([1, 2], [1, 2]):
        found = [0] * (2 * loop + trial) + [1, 2, 3]
        for condition in ("CE4", "CC3-CC4"):
            rows += trial_rows(found, loop=loop, trial=trial, protocol="rl", condition=condition)
    for loop, length in ((1, 3), (2, 4)):
        test = {"loop": loop, "phase": "test", "protocol": "rl", "condition": "CC3-CC4"}
        rows += trial_rows([0] * (length - 3) + [1, 2, 3], **test)
    rows += trial_rows([1, 2, 3], trial=1, condition="CE4")
    rows += trial_rows([0, 1, 2, 3], trial=2, condition="CE4")
    headline = headline_table(table(rows))
    values = headline[["protocol", "condition", "measured", "attempts"]].to_numpy().tolist()
    assert values == [
        ["human", "CE4", "trial 2", 4.0],
        ["rl", "CE4", "trial 2", 9.0],
        ["rl", "CC3-CC4", "test", 3.5],
    ]
    assert headline[["human_attempts", "model_attempts"]].iloc[0].tolist() == [14.875, 12.64]
    assert headline[PUBLISHED].iloc[1:].isna().all(axis=None)


def test_summary_files_of_equal_data_are_equal(tmp_path):
    cells = random_cells(11)
    record = pa.concat_tables(cells)
    later = pa.array(np.random.default_rng(0).random(record.num_rows), pa.float32())
    index = record.schema.get_field_index("wall_time")
    variants = {
        "record": record,
        "reversed": pa.concat_tables(cells[::-1]),
        "shuffled": record.take(np.random.default_rng(1).permutation(record.num_rows)),
        "rechunked": record.unify_dictionaries().combine_chunks(),
        "slower": record.set_column(index, record.schema.field(index), later),
        "other": pa.concat_tables(random_cells(12)),
    }
    for name, variant in variants.items():
        write_table(summary_table(variant), tmp_path / name)
    first = (tmp_path / "record").read_bytes()
    same = [name for name in variants if (tmp_path / name).read_bytes() == first]
    assert same == [*variants][:-1]
    lines = first.decode().splitlines()
    assert lines[0] == ",".join([*SUMMARY_COLUMNS, *PUBLISHED, "ideal_attempts"])
    assert len(lines) == 1 + len(summary_table(record))
    assert b"\r" not in first
    assert b"nan" not in first

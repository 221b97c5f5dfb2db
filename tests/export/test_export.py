"""Data out: the record as CSV and as a Minari data set, and what the steps of a record come to."""

import gzip
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from causal_openlock import Session
from causal_openlock.contract.registry import create
from causal_openlock.envs import OpenLockEnv
from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.declare import PROTOCOLS, find_condition
from causal_openlock.experiment.file import read_experiment
from causal_openlock.export.as_csv import write_csv
from causal_openlock.export.as_minari import write_minari
from causal_openlock.export.replay import replay, trial_numbers
from causal_openlock.running.runner import run
from causal_openlock.storage.store import Store
from causal_openlock.world.rewards import PRESETS, find_reward
from support.command import at_once

HUMAN = PROTOCOLS["human"]
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


# -- replay ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("schema", "reward"), [("CC4", "paper"), ("CE3", "negative_repeat")])
def test_steps_of_a_record_are_those_of_the_environment(schema, reward):
    condition = find_condition(schema)
    for learner in ("oracle", "random"):
        session = Session(condition, HUMAN, 2, seed=3, reward=reward, learner=learner)
        record = session.play(create(learner))
        steps = replay(record, condition, HUMAN, find_reward(reward))
        layouts, trials, env = record["layout"].to_pylist(), trial_numbers(record), None
        for row, actions in enumerate(record["actions"].to_pylist()):
            if row == 0 or trials[row] != trials[row - 1]:
                env = OpenLockEnv(schema, layouts[row], reward, "attempt", attempt_limit=30)
            seen, _ = env.reset()
            assert (seen == steps.begins[row]).all()
            for number, action in enumerate(actions):
                seen, paid, over, _, _ = env.step(action)
                assert (seen == steps.seen[row, number]).all()
                assert paid == pytest.approx(steps.rewards[row, number])
            assert over
            assert len(actions) == steps.used[row]


@pytest.mark.parametrize("reward", sorted(PRESETS))
def test_every_reward_adds_up_to_what_is_on_record(reward):
    """Also where luck decides, in a transfer, and in trials that go on when they are solved."""
    condition = find_condition("noisy_CC3-CC4")
    protocol = replace(PROTOCOLS["rl"], attempt_limit=9, train_loops=1, test_loops=1)
    for learner in ("oracle", "random"):
        session = Session(condition, protocol, 2, seed=4, reward=reward, learner=learner)
        record = session.play(create(learner))
        steps = replay(record, condition, protocol, find_reward(reward))
        assert steps.rewards.sum(axis=1) == pytest.approx(record["reward"].to_numpy())


CHANGED = {
    "moved": lambda old: [not one for one in old],
    "reward": lambda old: old + 1,
    "solution": lambda old: (old + 1) % 3,
    "actions": lambda old: [0] * len(old),
}


@pytest.mark.parametrize("column", CHANGED)
def test_a_record_that_does_not_come_true_is_refused_with_its_place(column):
    condition = find_condition("CC4")
    record = Session(condition, HUMAN, 2, learner="me").play(create("oracle"))
    values = record[column].to_pylist()
    values[4] = CHANGED[column](values[4])
    where = record.schema.get_field_index(column)
    wrong = record.set_column(where, column, pa.array(values, record.schema.field(column).type))
    place = r"attempt \d of subject 0 of me in CC4 \(train 2, loop 1\)"
    with pytest.raises(StoreError, match=place):
        replay(wrong, condition, HUMAN, find_reward("paper"))


# -- Minari ---------------------------------------------------------------------------------------


def test_a_minari_data_set_has_the_trials_of_the_record_and_their_room(
    store, tmp_path, monkeypatch
):
    minari = pytest.importorskip("minari")
    folder, count = write_minari(store, tmp_path)
    assert folder.name == "data-out-trial-v0"
    data = minari.MinariDataset(folder / "data")
    frame = store.record()[0].to_pandas()
    for name in frame.select_dtypes("category"):
        frame[name] = frame[name].astype(str)
    by = ["learner", "condition", "subject", "phase", "loop", "trial"]
    trials = dict(list(frame.groupby(by)))
    assert (data.total_episodes, count) == (len(trials), len(trials))
    about = data.storage.get_episode_metadata(range(count))
    for known, episode in zip(about, data.iterate_episodes(), strict=True):
        trial = trials[tuple(known[name] for name in by)].sort_values("attempt")
        assert episode.actions.tolist() == np.concatenate(trial["actions"].to_list()).tolist()
        assert episode.rewards.sum() == pytest.approx(trial["reward"].sum())
        assert episode.observations.shape == (len(episode.actions) + 1, 16)
        solved = bool(trial["solutions_found"].max() == trial["solutions"].max())
        assert known["solved"] == solved
        assert episode.terminations[-1] == (solved and known["protocol"] == "human")
        assert not episode.terminations[:-1].any()
    with pytest.raises(OpenLockError, match="is there already"):
        write_minari(store, tmp_path)
    few = {"learners": ["oracle"], "conditions": ["CC4"]}
    folder, count = write_minari(store, tmp_path, episodes="attempt", **few)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    data = minari.load_dataset(folder.name)
    assert count == data.total_episodes == 3 * 5 * 3
    env = data.recover_environment()
    assert env.observation_space == data.spec.observation_space
    assert data.spec.env_spec.kwargs["schema"] == "CC4"
    # No half of a data set is left where a cell cannot be read.
    empty = store.record()[0].slice(0, 0)
    monkeypatch.setattr(Store, "read", lambda *_: empty)
    with pytest.raises(StoreError, match="has no cells of this choice"):
        write_minari(store, tmp_path / "other")
    assert list((tmp_path / "other").iterdir()) == []

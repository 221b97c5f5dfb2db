"""Data out: the record as CSV and as a Minari data set, and what their steps come to."""

from __future__ import annotations

import gzip
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from typer.testing import CliRunner

from causal_openlock import Condition, Session, find_schema
from causal_openlock.cli import app
from causal_openlock.contract.registry import create
from causal_openlock.envs import OpenLockEnv
from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.export import as_minari
from causal_openlock.export.as_csv import write_csv
from causal_openlock.export.as_minari import write_minari
from causal_openlock.export.replay import replay, trial_numbers
from causal_openlock.running.runner import run
from causal_openlock.storage.store import Store
from causal_openlock.world.rewards import PRESETS, find_reward

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
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    folder = tmp_path_factory.mktemp("export")
    (folder / "declared.yaml").write_text(DECLARED)
    with ThreadPoolExecutor(1) as pool:
        return run(read_experiment(folder / "declared.yaml"), folder / "out", executor=pool)


def test_csv_has_every_attempt_and_every_column(store: Store, tmp_path: Path) -> None:
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
    told = [[int(action) for action in cell.split()] for cell in read["actions"]]
    assert told == record["actions"].to_pylist()
    told = [[flag == "1" for flag in cell.split()] for cell in read["moved"]]
    assert told == record["moved"].to_pylist()


def walked(record: pa.Table, schema: str, reward: str, steps: Any) -> None:
    """Carry the actions out in the environment, one by one, and compare what is seen and paid."""
    layouts = record["layout"].to_pylist()
    trials = trial_numbers(record)
    env = None
    for row, actions in enumerate(record["actions"].to_pylist()):
        if row == 0 or trials[row] != trials[row - 1]:
            env = OpenLockEnv(schema, layouts[row], reward, "attempt", attempt_limit=30)
        assert env is not None
        seen, _ = env.reset()
        assert (seen == steps.begins[row]).all()
        for number, action in enumerate(actions):
            seen, paid, over, _, _ = env.step(action)
            assert (seen == steps.seen[row, number]).all()
            assert paid == pytest.approx(steps.rewards[row, number])
        assert over
        assert len(actions) == steps.used[row]


@pytest.mark.parametrize("reward", ["paper", "authors_2018", "negative_repeat"])
@pytest.mark.parametrize("schema", ["CC4", "CE3"])
def test_steps_are_those_of_the_environment(schema: str, reward: str) -> None:
    condition, human = Condition.named(schema, find_schema), PROTOCOLS["human"]
    for learner in ("oracle", "random"):
        session = Session(condition, human, 2, seed=3, reward=reward, learner=learner)
        record = session.play(create(learner))
        walked(record, schema, reward, replay(record, condition, human, find_reward(reward)))


@pytest.mark.parametrize("reward", sorted(PRESETS))
def test_every_reward_adds_up_to_what_is_on_record(reward: str) -> None:
    """Also where luck decides, in a transfer, and in trials that go on when they are solved."""
    condition = Condition.named("noisy_CC3-CC4", find_schema)
    protocol = replace(PROTOCOLS["rl"], attempt_limit=9, train_loops=1, test_loops=1)
    for learner in ("oracle", "random"):
        session = Session(condition, protocol, 2, seed=4, reward=reward, learner=learner)
        record = session.play(create(learner))
        steps = replay(record, condition, protocol, find_reward(reward))
        assert steps.rewards.sum(axis=1) == pytest.approx(record["reward"].to_numpy())


@pytest.mark.parametrize("column", ["moved", "reward", "solution", "actions"])
def test_a_record_that_does_not_come_true_is_refused(column: str) -> None:
    condition, human = Condition.named("CC4", find_schema), PROTOCOLS["human"]
    record = Session(condition, human, 2, learner="me").play(create("oracle"))
    values = record[column].to_pylist()
    row = 4
    values[row] = {
        "moved": lambda old: [not one for one in old],
        "reward": lambda old: old + 1,
        "solution": lambda old: (old + 1) % 3,
        "actions": lambda old: [0] * len(old),
    }[column](values[row])
    where = record.schema.get_field_index(column)
    wrong = record.set_column(where, column, pa.array(values, record.schema.field(column).type))
    with pytest.raises(
        StoreError, match=r"attempt \d of subject 0 of me in CC4 \(train 2, loop 1\)"
    ):
        replay(wrong, condition, human, find_reward("paper"))


minari = pytest.importorskip("minari")


def test_a_minari_data_set_has_the_trials_of_the_record(store: Store, tmp_path: Path) -> None:
    folder, count = write_minari(store, tmp_path)
    assert folder.name == "data-out-trial-v0"
    data = minari.MinariDataset(folder / "data")
    frame = store.record()[0].to_pandas()
    for name in frame.select_dtypes("category"):
        frame[name] = frame[name].astype(str)
    by = ["learner", "condition", "subject", "phase", "loop", "trial"]
    trials = dict(list(frame.groupby(by)))
    assert (data.total_episodes, count) == (len(trials), len(trials))
    told = list(data.storage.get_episode_metadata(range(count)))
    ended = set()
    for about, episode in zip(told, data.iterate_episodes(), strict=True):
        trial = trials[tuple(about[name] for name in by)].sort_values("attempt")
        assert episode.actions.tolist() == np.concatenate(trial["actions"].to_list()).tolist()
        assert episode.rewards.sum() == pytest.approx(trial["reward"].sum())
        assert episode.observations.shape == (len(episode.actions) + 1, 16)
        assert (episode.observations[-1] == episode.observations[0]).all()  # put back
        solved = bool(trial["solutions_found"].max() == trial["solutions"].max())
        assert about["solved"] == solved
        over = solved and about["protocol"] == "human"
        ends = (episode.terminations, episode.truncations)
        assert [flags.tolist() for flags in ends] == [
            [False] * (len(episode) - 1) + [over],
            [False] * (len(episode) - 1) + [not over],
        ]
        ended.add(over)
    assert ended == {True, False}


def test_attempts_as_episodes_and_the_room_they_were_played_in(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, count = write_minari(
        store, tmp_path, episodes="attempt", learners=["oracle"], conditions=["CC4"]
    )
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    data = minari.load_dataset(folder.name)
    assert count == data.total_episodes == 3 * 5 * 3
    env = data.recover_environment()
    assert env.observation_space == data.spec.observation_space
    assert env.action_space == data.spec.action_space
    for episode in data.iterate_episodes():
        assert episode.terminations.tolist() == [False] * (len(episode) - 1) + [True]
        assert (episode.observations[-1] != episode.observations[0]).any()
    assert data.spec.env_spec.kwargs["schema"] == "CC4"
    assert [about["attempt"] for about in data.storage.get_episode_metadata(range(3))] == [1, 2, 3]


OWN = """
name: own
subjects: 2
conditions: [CC3-vault, vault]
learners: [random, {learner: random, name: long, protocol: rl, subjects: 1}]
reward: [basic, negative_repeat]
protocols: {rl2: {based_on: rl}}
"""
VAULT = "name: vault\nlevers: [key, dial]\nedges: {dial: [key], key: [door]}\n"


@pytest.mark.parametrize("episodes", ["trial", "attempt"])
def test_the_environment_of_a_data_set_is_recovered_and_does_what_the_data_say(
    episodes: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "own.yaml").write_text(OWN.replace("protocol: rl", "protocol: human"))
    (tmp_path / "vault.yaml").write_text(VAULT)
    with ThreadPoolExecutor(1) as pool:
        results = run(read_experiment(tmp_path / "own.yaml"), tmp_path / "out", executor=pool)
    folder, _ = write_minari(results, tmp_path / "sets", episodes=episodes)
    monkeypatch.chdir(tmp_path / "sets")  # no schema is found beside this
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "sets"))
    data = minari.load_dataset(folder.name)
    env = data.recover_environment(reveal=True)
    assert env.observation_space == data.spec.observation_space
    kinds = set()
    for seed in range(12):
        seen, info = env.reset(seed=seed)
        kinds.add(info["latent"]["schema"])
        assert info["console"]["attempts_left"] == 30
        assert seen in env.observation_space
        over = False
        while not over:
            *_, terminated, truncated, info = env.step(env.action_space.sample())
            over = terminated or truncated
    assert kinds == {"CC3", "vault"}
    # Attempt by attempt, another room comes when the trial is over, and not before.
    if episodes == "attempt":
        rooms = [info["latent"]]
        for _ in range(70):
            seen, info = env.reset()
            rooms.append(info["latent"])
            for _ in range(3):
                *_, over, _, info = env.step(7)
        assert len({str(sorted(room.items())) for room in rooms}) <= 5
    again = [env.reset(seed=3)[1]["latent"] for _ in range(2)]
    assert again[0] == again[1]


def test_where_no_environment_can_be_recovered_the_export_says_why(
    store: Store, tmp_path: Path
) -> None:
    words = ["export", str(store.folder), "-f", "minari", "-c", "CC4", "-o"]
    said = CliRunner().invoke(app, [*words, str(tmp_path / "all")]).output
    assert "recover_environment() finds none: trials of random continue after" in said
    said = CliRunner().invoke(app, [*words, str(tmp_path / "some"), "-l", "oracle"]).output
    assert "recover_environment" not in said


def test_what_cannot_be_exported_is_told_in_a_sentence(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_minari(store, tmp_path, learners=["oracle"], conditions=["CC4"])
    with pytest.raises(OpenLockError, match="is there already; remove it"):
        write_minari(store, tmp_path)
    with pytest.raises(OpenLockError, match="no learner 'orcale' here; did you mean oracle"):
        write_minari(store, tmp_path, learners=["orcale"])
    find = as_minari.importlib.util.find_spec
    monkeypatch.setattr(
        as_minari.importlib.util, "find_spec", lambda name: None if name == "h5py" else find(name)
    )
    with pytest.raises(OpenLockError, match=r"needs h5py; install .*causal-openlock\[minari\]"):
        write_minari(store, tmp_path / "other")


def test_half_a_data_set_is_not_left_behind(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any) -> None:
        raise StoreError("a damaged cell")

    monkeypatch.setattr(as_minari, "replay", fails)
    with pytest.raises(StoreError, match="a damaged cell"):
        write_minari(store, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_data_set_has_its_name_once_it_is_whole(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = tmp_path / ".data-out-trial-v0.unfinished" / "data"
    left.mkdir(parents=True)
    (left / "main_data.hdf5").write_text("of an export that was killed")
    there, environment = [], as_minari._environment

    def looking(*told: Any) -> Any:
        there.append([path.name for path in tmp_path.iterdir() if path.name[0] != "."])
        return environment(*told)

    monkeypatch.setattr(as_minari, "_environment", looking)
    folder, _ = write_minari(store, tmp_path, learners=["oracle"])
    assert there == [[]]
    assert list(tmp_path.iterdir()) == [folder]


def test_a_cell_without_rows_has_no_episodes(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    empty = store.record()[0].slice(0, 0)
    monkeypatch.setattr(Store, "read", lambda *_: empty)
    with pytest.raises(StoreError, match="has no cells of this choice"):
        write_minari(store, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_on_the_command_line(store: Store, tmp_path: Path) -> None:
    call, folder = CliRunner().invoke, str(store.folder)
    done = call(app, ["export", folder, "-o", str(tmp_path / "x.csv")])
    assert done.exit_code == 0, done.output
    assert f"{store.record()[0].num_rows:,} attempts" in done.output
    done = call(app, ["export", folder, "-f", "minari", "-o", str(tmp_path), "-l", "oracle"])
    assert done.exit_code == 0, done.output
    assert "load_dataset('data-out-trial-v0')" in done.output
    for wrong, said in (
        (["--format", "xml"], "there is no format 'xml'"),
        (["--learner", "oracle"], "are for --format minari"),
        (["-f", "minari", "--episodes", "day"], "an episode is a trial or an attempt"),
    ):
        failed = call(app, ["export", folder, *wrong])
        assert failed.exit_code
        assert said in str(failed.exception)

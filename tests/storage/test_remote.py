"""Results in an object store: played here, stored there, one place for machines without a disk."""

import fsspec
import pytest

import causal_openlock as ol
from causal_openlock.errors import Interrupted, StoreError
from causal_openlock.experiment.file import read_experiment
from causal_openlock.running.runner import run
from causal_openlock.storage.remote import downloaded, kept, local_folder
from causal_openlock.storage.shard import Shard
from causal_openlock.storage.store import Store
from support.command import at_once
from support.watching import look_often

FAR = """\
name: far
subjects: 4
cell_size: 2
conditions: [CC3]
protocol: short
protocols: {short: {attempt_limit: 3, baseline_trials: 1}}
learners: [random, oracle]
"""


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A store in this process's memory."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "far.yaml").write_text(FAR, encoding="utf-8")
    yield "memory://runs/far"
    fsspec.filesystem("memory").store.clear()


@pytest.fixture
def moved(tmp_path, monkeypatch):
    """Work on another machine, in a folder that has nothing yet."""

    def move(name):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)

    return move


def stored(part):
    return fsspec.filesystem("memory").find(f"/runs/far{part}")


def play(experiment, place, shard="1/1"):
    """Play a shard; returns of each of its cells whether it was there before."""
    before = []
    with kept(place) as (folder, send):
        note = lambda _, was_there: before.append(was_there)  # noqa: E731
        run(experiment, folder, workers=0, shard=Shard.parse(shard), done=note)
        send()
    return before


def test_shards_of_machines_that_share_no_disk_fill_one_place(place, tmp_path, moved):
    experiment = read_experiment(tmp_path / "far.yaml")
    run(experiment, "here", workers=0)
    expected = Store("here").record()[0].drop_columns(["wall_time"])
    for name, shard in {"one": "1/2", "two": "2/2"}.items():
        moved(name)
        assert play(experiment, place, shard) == [False, False]
    moved("three")
    found = Store(downloaded(place)).record()[0].drop_columns(["wall_time"])
    assert found.equals(expected)
    assert play(experiment, place) == [True] * 4
    assert not [path for path in stored("") if ".lock" in path or path.endswith(".checkpoint")]


def test_a_comparison_that_is_stopped_has_lost_no_cell(place, monkeypatch):
    def stop(*_):
        if len(stored("/cells")) == 2:
            raise KeyboardInterrupt

    with monkeypatch.context() as patches:
        look_often(patches, stop)
        with pytest.raises(Interrupted):
            ol.compare("far.yaml", out=place, workers=0)
    assert [len(part) for part in Store(downloaded(place)).files()] == [2, 2]
    done = at_once("compare", "far.yaml", "--out", place, "--shard", "1/1")
    assert done.status == 0, done.stderr
    assert f"causal-openlock report {place}" in done.stdout
    assert "4 of 4 cells done" in at_once("status", place).stdout


def test_a_store_reaches_no_file_but_those_of_results(place, tmp_path):
    files = fsspec.filesystem("memory")
    for name in ("cells/../../../evil.parquet", "code/../../evil.py", ".lock", "report.html"):
        files.pipe_file(f"/runs/far/{name}", b"evil")
    files.pipe_file("/runs/far/experiment.json", b"{}")
    assert [path.name for path in downloaded(place).rglob("*")] == ["experiment.json"]
    assert not list(tmp_path.rglob("evil*"))


def test_a_store_that_is_lost_keeps_what_was_played_here(place, tmp_path, monkeypatch):
    experiment = read_experiment(tmp_path / "far.yaml")

    def lost(*_):
        raise TimeoutError("no answer")

    with monkeypatch.context() as patch:
        patch.setattr(type(fsspec.filesystem("memory")), "pipe_file", lost)
        with pytest.raises(StoreError, match=r"cannot be reached .*no answer.* is in results/far-"):
            play(experiment, place)
    assert play(experiment, place) == [True] * 4
    assert len(stored("/cells")) == 4


def test_a_password_in_an_address_is_not_shown():
    for place in ("nosuch://me:secret@host/far", "nosuch://me:secret@host"):
        assert "secret" not in str(local_folder(place))
        with pytest.raises(StoreError, match="cannot be reached") as raised:
            downloaded(place)
        assert "secret" not in str(raised.value)


def test_a_store_of_s3_is_filled_and_read_elsewhere(tmp_path, monkeypatch, moved):
    """With the real client, and a server here that answers."""
    boto3 = pytest.importorskip("boto3")
    server = pytest.importorskip("moto.server").ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    server.start()
    address = "http://{}:{}".format(*server.get_host_and_port())
    for name, value in {
        "ENDPOINT_URL": address,
        "ACCESS_KEY_ID": "anybody",
        "SECRET_ACCESS_KEY": "anything",
        "DEFAULT_REGION": "us-east-1",
        "MAX_ATTEMPTS": "1",  # otherwise it asks a server that is gone for ten seconds
    }.items():
        monkeypatch.setenv(f"AWS_{name}", value)
    boto3.client("s3").create_bucket(Bucket="laboratory")
    (tmp_path / "far.yaml").write_text(FAR, encoding="utf-8")
    try:
        moved("here")
        assert play(read_experiment(tmp_path / "far.yaml"), "s3://laboratory/far") == [False] * 4
        moved("elsewhere")
        assert "4 of 4 cells done" in at_once("status", "s3://laboratory/far").stdout
        absent = at_once("status", "s3://another/far")
        assert absent.status == 2
        assert "s3://another/far cannot be reached" in absent.stderr
    finally:
        server.stop()

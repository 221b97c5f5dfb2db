"""Results in an object store: played here, kept there, one place for machines without a disk."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import fsspec
import pytest

import causal_openlock as ol
from causal_openlock.errors import Interrupted, StoreError
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.file import read_experiment
from causal_openlock.running.runner import run
from causal_openlock.storage.remote import downloaded, kept, local_folder
from causal_openlock.storage.shard import Shard
from causal_openlock.storage.store import Store
from support.command import at_once
from support.far_experiment import FAR
from support.watching import look_often


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A store in this process's memory."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "far.yaml").write_text(FAR, encoding="utf-8")
    yield "memory://runs/far"
    fsspec.filesystem("memory").store.clear()


def on_another_machine(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in a folder that has nothing yet."""
    folder = Path(name).resolve()
    folder.mkdir()
    monkeypatch.chdir(folder)


def play(experiment: Experiment, place: str, shard: str) -> list[bool]:
    """Play a shard; returns of each of its cells whether it was there before."""
    before: list[bool] = []
    with kept(place) as (folder, send):
        run(
            experiment,
            folder,
            workers=0,
            shard=Shard.parse(shard),
            done=lambda _, was_there: before.append(was_there),
        )
        send()
    return before


def test_shards_of_machines_that_share_no_disk_fill_one_place(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = read_experiment(tmp_path / "far.yaml")
    run(experiment, "here", workers=0)
    expected = ol.open_results("here").attempts
    for name, shard in {"one": "1/2", "two": "2/2"}.items():
        on_another_machine(str(tmp_path / name), monkeypatch)
        assert play(experiment, place, shard) == [False, False]
    on_another_machine(str(tmp_path / "three"), monkeypatch)
    found = ol.open_results(place)
    assert found.attempts.drop(columns="wall_time", errors="ignore").equals(
        expected.drop(columns="wall_time", errors="ignore")
    )
    assert play(experiment, place, "1/1") == [True] * 4
    stored = fsspec.filesystem("memory").find("/runs/far")
    assert not [path for path in stored if ".lock" in path or path.endswith(".checkpoint")]


def test_the_command_plays_into_a_store_and_others_read_it(place: str) -> None:
    said = at_once("compare", "far.yaml", "--out", place, "--shard", "1/1")
    assert said.status == 0, said.stderr
    assert f"causal-openlock report {place}" in said.stdout
    assert "4 of 4 cells done" in at_once("status", place).stdout


def test_a_cell_goes_there_as_soon_as_it_is_done(
    place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A comparison that is stopped has lost none."""
    files = fsspec.filesystem("memory")

    def stop(*_: object) -> None:
        if len(files.find("/runs/far/cells")) == 2:
            raise KeyboardInterrupt

    look_often(monkeypatch, stop)
    with pytest.raises(Interrupted):
        ol.compare("far.yaml", out=place, workers=0)
    store = Store(downloaded(place))
    assert [len(part) for part in store.files()] == [2, 2]


def test_a_store_reaches_no_file_but_those_of_results(place: str) -> None:
    files = fsspec.filesystem("memory")
    for name in ("cells/../../../evil.parquet", "code/../../evil.py", ".lock", "report.html"):
        files.pipe_file(f"/runs/far/{name}", b"evil")
    files.pipe_file("/runs/far/experiment.json", b"{}")
    folder = downloaded(place)
    assert [path.name for path in folder.rglob("*")] == ["experiment.json"]
    assert not list(Path().rglob("evil*"))


def test_a_store_that_is_not_known_is_one_sentence() -> None:
    with pytest.raises(StoreError, match=r"cannot be reached .*Protocol not known"):
        downloaded("nosuch://bucket/far")


def test_a_store_that_is_lost_keeps_what_was_played_here(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = read_experiment(tmp_path / "far.yaml")
    files = type(fsspec.filesystem("memory"))

    def lost(*_: object) -> None:
        raise TimeoutError("no answer")

    with monkeypatch.context() as patch:
        patch.setattr(files, "pipe_file", lost)
        with pytest.raises(StoreError, match=r"cannot be reached .*no answer.* is in results/far-"):
            play(experiment, place, "1/1")
    assert play(experiment, place, "1/1") == [True] * 4
    assert len(fsspec.filesystem("memory").find("/runs/far/cells")) == 4


def test_what_is_whole_here_stays_and_mends_what_is_cut_off_there(
    place: str, tmp_path: Path
) -> None:
    play(read_experiment(tmp_path / "far.yaml"), place, "1/1")
    files = fsspec.filesystem("memory")
    remote = files.find("/runs/far/cells")[0]
    here = local_folder(place) / "cells" / Path(remote).name
    whole = here.read_bytes()
    files.pipe_file(remote, whole[:100])
    with kept(place) as (_, send):
        assert here.read_bytes() == whole
        send()
    assert files.cat_file(remote) == whole
    here.write_bytes(whole[:100])  # and the other way round
    downloaded(place)
    assert here.read_bytes() == whole


def test_what_is_beside_cells_comes_with_them(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    play(read_experiment(tmp_path / "far.yaml"), place, "1/1")
    here = local_folder(place)
    stem = next((here / "cells").iterdir()).stem
    beside = {
        f"transcripts/{stem}.jsonl",
        f"reactions/{stem}.parquet",
        f"structures/{stem}.parquet",
    }
    for name in beside:
        (here / name).parent.mkdir()
        (here / name).write_bytes(b"said")
    with kept(place) as (_, send):
        send()
    on_another_machine(str(tmp_path / "two"), monkeypatch)
    folder = downloaded(place)
    assert all((folder / name).read_bytes() == b"said" for name in beside)


def test_a_password_in_an_address_is_not_shown() -> None:
    for place in ("nosuch://me:secret@host/far", "nosuch://me:secret@host"):
        assert "secret" not in str(local_folder(place))
        with pytest.raises(StoreError, match="cannot be reached") as raised:
            downloaded(place)
        assert "secret" not in str(raised.value)

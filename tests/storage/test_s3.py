"""Results in an object store: the real client of ``s3://``, and a server here that answers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import boto3
import pytest
from moto.s3.models import s3_backends
from moto.server import ThreadedMotoServer
from s3fs import S3FileSystem

import causal_openlock as ol
from causal_openlock.errors import Interrupted, StoreError
from causal_openlock.storage.remote import downloaded, local_folder
from support.command import at_once
from support.far_experiment import FAR
from support.watching import look_often

PLACE = "s3://laboratory/runs/far"


class Server(ThreadedMotoServer):
    """A store that keeps what it has, and its address, when it is stopped and started again."""

    def __init__(self) -> None:
        super().__init__("127.0.0.1", port=0, verbose=False)
        self.start()
        _, self._port = self.get_host_and_port()
        s3_backends.reset()  # what tests before this one have left in this process

    def client(self) -> Any:
        """Another client than ours."""
        return boto3.client("s3", endpoint_url=f"http://127.0.0.1:{self._port}")

    def objects(self, part: str) -> list[str]:
        """The keys that hold this."""
        found = self.client().list_objects_v2(Bucket="laboratory").get("Contents", [])
        return [one["Key"] for one in found if part in one["Key"]]


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    """A server with one empty bucket, and an environment in which ``s3://`` leads to it."""
    server = Server()
    for name, value in {
        "ENDPOINT_URL": f"http://127.0.0.1:{server._port}",
        "ACCESS_KEY_ID": "anybody",
        "SECRET_ACCESS_KEY": "anything",
        "DEFAULT_REGION": "us-east-1",
        "MAX_ATTEMPTS": "1",  # otherwise it asks a server that is gone for ten seconds
    }.items():
        monkeypatch.setenv(f"AWS_{name}", value)
    server.client().create_bucket(Bucket="laboratory")
    (tmp_path / "far.yaml").write_text(FAR, encoding="utf-8")
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    yield server
    server.stop()
    S3FileSystem.clear_instance_cache()


def test_an_interrupted_comparison_goes_on_elsewhere_and_equals_a_local_one(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object) -> None:
        if len(server.objects("/cells/")) == 1:
            raise KeyboardInterrupt

    with monkeypatch.context() as patches:
        look_often(patches, interrupt)
        with pytest.raises(Interrupted):
            ol.compare("../far.yaml", out=PLACE, workers=0)
    assert server.objects("/cells/")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    said = at_once("compare", "../far.yaml", "--out", PLACE, "--shard", "1/1")
    assert said.status == 0, said.stderr
    assert "1 of 4 cells" in said.stdout
    assert "4 of 4 cells done" in at_once("status", PLACE).stdout
    assert not [key for key in server.objects("") if ".lock" in key or "checkpoint" in key]

    (tmp_path / "reader").mkdir()
    monkeypatch.chdir(tmp_path / "reader")
    assert at_once("report", PLACE).status == 0
    assert at_once("compare", "../far.yaml", "--out", "local").status == 0
    read = (local_folder(PLACE) / "summary.csv").read_bytes()
    assert read == Path("local/summary.csv").read_bytes()


def test_what_others_add_is_seen_by_a_process_that_has_looked_before(server: Server) -> None:
    """No listing is kept: a notebook that reads the results again finds the new cells."""
    bucket = {"Bucket": "laboratory"}
    server.client().put_object(**bucket, Key="runs/far/experiment.json", Body=b"{}")
    assert not list(downloaded(PLACE).rglob("*.parquet"))
    server.client().put_object(**bucket, Key="runs/far/cells/one.parquet", Body=b"cells")
    assert (downloaded(PLACE) / "cells" / "one.parquet").read_bytes() == b"cells"


def test_a_server_that_ends_loses_nothing_and_is_one_sentence(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patches:
        look_often(patches, lambda *_: server.stop())
        with pytest.raises(StoreError, match="cannot be reached"):
            ol.compare("../far.yaml", out=PLACE, workers=0)
    said = at_once("status", PLACE)
    assert said.status == 2
    assert "Traceback" not in said.stderr
    assert said.stderr.startswith(f"error: {PLACE} cannot be reached (EndpointConnectionError: ")
    assert said.stderr.count("\n") <= 2
    assert str(local_folder(PLACE)) in said.stderr
    assert len(list(local_folder(PLACE).glob("cells/*.parquet"))) >= 1
    server.start()
    assert not server.objects("/cells/")
    assert at_once("compare", "../far.yaml", "--out", PLACE, "--shard", "1/1").status == 0
    assert len(server.objects("/cells/")) == 4


def test_a_bucket_that_does_not_exist_is_named(server: Server) -> None:
    said = at_once("status", "s3://another/far")
    assert said.status == 2
    assert "s3://another/far cannot be reached" in said.stderr
    assert "bucket does not exist" in said.stderr

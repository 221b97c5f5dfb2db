"""The scripts for clusters: what they call exists, and where that is possible they run."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from support.documents import unknown_options
from support.places import ROOT

pytestmark = pytest.mark.cluster

PLACE = ROOT / "examples" / "clusters"
SCRIPTS = sorted(PLACE.glob("*.sh"))
MANIFEST = PLACE / "kubernetes.yaml"

pytest.importorskip("distributed")


def commands(path: Path) -> list[list[str]]:
    """The commands of Dask and of this program in a script, as lists of words."""
    found = []
    for line in path.read_text(encoding="utf-8").replace("\\\n", " ").splitlines():
        called = re.match(r"(?:srun )?((?:dask|causal-openlock) .*?)( &)?$", line)
        if called:
            found.append(shlex.split(called[1]))
    return found


def check(words: list[str]) -> None:
    """Hold a command against the options that its program has."""
    program, *rest = words
    if program == "causal-openlock":
        assert not unknown_options(rest), words
        return
    from distributed.cli import dask_scheduler, dask_ssh, dask_worker

    command: Any = {
        "scheduler": dask_scheduler.main,
        "worker": dask_worker.main,
        "ssh": dask_ssh.main,
    }[rest[0]]
    known = {name for option in command.params for name in (*option.opts, *option.secondary_opts)}
    assert {word for word in rest if word.startswith("--")} <= known, words
    if rest[0] in ("worker", "ssh"):
        assert rest[rest.index("--nthreads") + 1] == "1"


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_what_a_script_calls_exists(path: Path) -> None:
    assert subprocess.run(["bash", "-n", path], check=False).returncode == 0
    assert os.access(path, os.X_OK)
    called = commands(path)
    assert called[-1][:2] == ["causal-openlock", "compare"]
    for words in called:
        check(words)


def test_the_manifest_fits_together() -> None:
    parts = list(YAML(typ="safe").load_all(MANIFEST.read_text(encoding="utf-8")))
    assert [one["kind"] for one in parts] == [
        "PersistentVolumeClaim",
        "Service",
        "Deployment",
        "Deployment",
        "Job",
    ]
    claim, service, *running = parts
    images = set()
    for one in running:
        template = one["spec"]["template"]
        if one["kind"] == "Deployment":
            assert one["spec"]["selector"]["matchLabels"] == template["metadata"]["labels"]
        (container,) = template["spec"]["containers"]
        check(container["command"])
        images.add(container["image"])
        for word in container["command"]:
            assert not word.startswith("tcp://") or word == (
                f"tcp://{service['metadata']['name']}:{service['spec']['ports'][0]['port']}"
            )
        for volume in template["spec"].get("volumes", ()):
            name = volume["persistentVolumeClaim"]["claimName"]
            assert name == claim["metadata"]["name"]
            (mount,) = container["volumeMounts"]
            assert mount["name"] == volume["name"]
    assert len(images) == 1
    assert service["spec"]["selector"] == running[0]["spec"]["template"]["metadata"]["labels"]


def run(tmp_path: Path, script: str, **variables: str) -> str:
    """Run a script as Slurm would; ``srun`` starts the command that follows."""
    programs = tmp_path / "bin"
    programs.mkdir()
    python = f"exec {shlex.quote(sys.executable)}"
    for name, text in {
        "srun": 'exec "$@"',
        "python": f'{python} "$@"',
        "dask": f'{python} -m dask "$@"',
        "causal-openlock": f'{python} -m causal_openlock "$@"',
    }.items():
        (programs / name).write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
        (programs / name).chmod(0o755)
    (tmp_path / "tiny.yaml").write_text(
        "name: tiny\nsubjects: 2\ncell_size: 1\nconditions: [CC3]\nlearners: [random]\n"
        "protocols: {short: {attempt_limit: 2, baseline_trials: 1}}\nprotocol: short\n"
    )
    path = f"{programs}:{os.environ['PATH']}"
    done = subprocess.run(
        [PLACE / script, "tiny.yaml", "out"],
        cwd=tmp_path,
        env={**os.environ, "PATH": path, "PYTHONPATH": str(ROOT), **variables},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_job_of_an_array_plays_its_shard(tmp_path: Path) -> None:
    variables = {"SLURM_ARRAY_TASK_ID": "2", "SLURM_CPUS_PER_TASK": "1"}
    assert "shard 2/16 is done" in run(tmp_path, "slurm_shards.sh", **variables)
    (path,) = (tmp_path / "out" / "cells").glob("*.parquet")
    assert path.name.startswith("random_CC3_1-1_")


def test_a_job_with_dask_compares(tmp_path: Path) -> None:
    assert "report: out/report.html" in run(tmp_path, "slurm_dask.sh", SLURM_JOB_ID="7")
    assert (tmp_path / "out" / "summary.csv").exists()

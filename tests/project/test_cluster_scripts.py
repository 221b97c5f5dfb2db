"""The scripts for Slurm, run as Slurm would: ``srun`` starts the command that follows."""

import os
import shlex
import sys
from subprocess import run

import pytest

from support.places import ROOT

pytestmark = pytest.mark.cluster

pytest.importorskip("distributed")


@pytest.mark.parametrize(
    ("script", "variables", "said", "left"),
    [
        (
            "slurm_shards.sh",
            {"SLURM_ARRAY_TASK_ID": "2", "SLURM_CPUS_PER_TASK": "1"},
            "shard 2/16 is done",
            "cells/random_CC3_1-1_*.parquet",
        ),
        ("slurm_dask.sh", {"SLURM_JOB_ID": "7"}, "report: out/report.html", "summary.csv"),
    ],
)
def test_a_job_plays_its_part(tmp_path, script, variables, said, left):
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
    done = run(
        [ROOT / "examples" / "clusters" / script, "tiny.yaml", "out"],
        cwd=tmp_path,
        env={**os.environ, "PATH": path, "PYTHONPATH": str(ROOT), **variables},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert said in done.stdout
    assert len([*(tmp_path / "out").glob(left)]) == 1

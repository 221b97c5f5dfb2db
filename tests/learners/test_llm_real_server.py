"""A language model on a real server: ``transformers serve``, where it is installed.

The model has random weights, so that all its answers are noise; nothing is downloaded.
"""

from __future__ import annotations

import shutil
import socket
import subprocess
import time
from pathlib import Path

import pytest

from causal_openlock.comparison.results import Results
from causal_openlock.experiment.file import read_experiment
from causal_openlock.running.runner import run
from openlock_learners.language.kept_replies import BUDGET, FOLDER
from support.places import ROOT

EXAMPLE = ROOT / "examples" / "llm"
PROGRAM = shutil.which("transformers")
PATIENCE = 120.0
"""Seconds until the server has to be there."""


@pytest.mark.skipif(PROGRAM is None, reason="needs pip install 'transformers[serving]' on the PATH")
def test_a_real_server_answers_and_a_repetition_needs_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert PROGRAM
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(FOLDER, str(tmp_path / "replay"))
    monkeypatch.setenv(BUDGET, "1000000")  # it counts tokens
    python = Path(PROGRAM).with_name("python")
    subprocess.run([python, EXAMPLE / "tiny_model.py", "tiny"], check=True, capture_output=True)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    declared = (EXAMPLE / "tiny_model.yaml").read_text().replace("8010", str(port))
    (tmp_path / "tiny_model.yaml").write_text(declared)
    experiment = read_experiment(tmp_path / "tiny_model.yaml")
    command = [PROGRAM, "serve", "./tiny", "--port", str(port), "--device", "cpu"]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        _await(port)
        warned: list[str] = []
        run(experiment, tmp_path / "out", workers=0, warn=warned.append)
    finally:
        server.terminate()
        server.wait()
    assert len(warned) == 1
    assert "18 actions stayed unanswered" in warned[0]  # two subjects, three attempts of three
    assert not Results.read(tmp_path / "out").trials["solved"].any()
    run(experiment, tmp_path / "again", workers=0, warn=warned.append)
    assert "36 answers had been given before" in warned[-1]  # each was asked for twice
    said, repeated = (
        [path.read_bytes() for path in sorted((tmp_path / name / "transcripts").iterdir())]
        for name in ("out", "again")
    )
    assert said == repeated


def _await(port: int) -> None:
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        with socket.socket() as client:
            if client.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.5)
    raise AssertionError("the server has not begun to listen")

"""A language model on a real server: ``transformers serve``, where it is installed.

The model has random weights, so that all its answers are noise; nothing is downloaded.
"""

import shutil
import socket
import subprocess
from pathlib import Path

import pytest

from causal_openlock.comparison.results import Results
from causal_openlock.experiment.making import read_experiment
from causal_openlock.running.runner import run
from openlock_learners.language.replies import FOLDER
from support.places import ROOT
from support.waiting import until

EXAMPLE = ROOT / "examples" / "llm"
PROGRAM = shutil.which("transformers")


@pytest.mark.skipif(PROGRAM is None, reason="needs pip install 'transformers[serving]' on the PATH")
def test_a_real_server_answers_and_a_repetition_needs_none(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(FOLDER, str(tmp_path / "replay"))
    python = Path(PROGRAM).with_name("python")
    subprocess.run([python, EXAMPLE / "tiny_model.py", "tiny"], check=True, capture_output=True)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    declared = (EXAMPLE / "tiny_model.yaml").read_text().replace("8010", str(port))
    Path("tiny_model.yaml").write_text(declared)
    experiment = read_experiment(Path("tiny_model.yaml"))

    def listens():
        with socket.socket() as client:
            return client.connect_ex(("127.0.0.1", port)) == 0

    command = [PROGRAM, "serve", "./tiny", "--port", str(port), "--device", "cpu"]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    warned = []
    try:
        until(listens, server)
        run(experiment, Path("out"), workers=0, warn=warned.append)
    finally:
        server.terminate()
        server.wait()
    assert "18 actions stayed unanswered" in warned[0]  # two subjects, three attempts of three
    assert not Results.read(Path("out")).trials["solved"].any()
    run(experiment, Path("again"), workers=0, warn=warned.append)
    assert "36 answers had been given before" in warned[-1]  # each was asked for twice
    said, repeated = (
        [path.read_bytes() for path in sorted(Path(name, "transcripts").iterdir())]
        for name in ("out", "again")
    )
    assert said == repeated

"""What every command prints: its help, and what an ordinary use of it says and writes.

Not used are ``check``, which takes a minute, and ``play``, which serves until it is stopped.
"""

import io
import re
import shlex

import pytest

from support.command import at_once
from support.masks import masked

FILES = {
    "small.yaml": """\
name: small
title: A small comparison
subjects: 3
protocol: short
conditions: [CC3, CC3-CE3]
learners: [oracle, win_stay, random]
protocols: {short: {based_on: human, attempt_limit: 8, baseline_trials: 2, training_trials: 2}}
""",
    "noise.yaml": """\
learner: associative
search: {lever: {low: 0.1, high: 0.9}}
fit: {candidates: 12, hold_out: none}
""",
    "vault.yaml": """\
name: vault
levers: [key, dial, second]
edges: {key: [door], dial: {second: {strength: 0.5}}, second: [door]}
gates: {door: all}
""",
    "tiny.yaml": """\
rooms: {schemas: {CC3: 1}, rewards: [paper]}
actions: 600
at_once: 10
steps: 30
network: {room: 8, reader: 8}
""",
    "schemas/own.yaml": "name: own\nlevers: [A, B]\nedges: {A: [B], B: [door]}\n",
    "schemas/broken.yaml": "name: broken\n",
}
SESSIONS = {
    "results": """
        compare small.yaml --out out --workers 1
        compare small.yaml --out out --workers 1
        status out
        report out
        report out --methods
        compare small.yaml --learner win_stay --learner random --seed 9 --out other
        report out other
        compare -c CC4 -c CC3-CC4 -l theory_based -l associative --subjects 3 --out people
        report out --beside people
        export out
        bundle out
        trace CC3 --attempts 2
        learners
        learners associative
        learners oracle
    """,
    "schemas": """
        schema list
        schema show CC4 --layout trial7
        schema show vault.yaml
        schema check vault.yaml seven
        schema draw vault.yaml
        schema draw seven --out seven.png
        schema export two_of_four
        schema export vault.yaml --format line
        schema new mine --like CE3
        schema worth CC3
        schema worth CC3 --among CC3=3 --among CE3
    """,
    "pictures": """
        room CC4 --layout trial7 --after push_LOWERLEFT -o room.svg
        film CC3 -l oracle --attempts 1 --speed 20 --fps 5 --size 120 -o film.gif
        trace CC3 --attempts 2 -o trace.svg --table trace.csv
        text CC3 --story levers
        notebook mine
        notebook lesson --lesson 1
    """,
    "people": """
        compare small.yaml -l win_stay -c CC3 -c CC3-CE3 --out out
        export out
        import out/record.csv --from small.yaml --protocol short -o people
        status people
        report people
        score people -l random -l win_stay --workers 1
        forget people 0 -c CC3
        status people
    """,
    "predictions": """
        compare -c CC3 -l win_stay --subjects 2 --out out
        score out -l random -l win_stay --workers 1
        fit associative --plan noise.yaml --to out -o fitted --workers 1
        design small.yaml --known --subjects 2 -c CC3 -o recovered --workers 1
        design small.yaml --subjects 2 -o designed --workers 1
        train tiny.yaml -o net.npz
        train tiny.yaml -o net.npz
    """,
}


@pytest.fixture(autouse=True)
def terminal(monkeypatch, tmp_path):
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)


def test_help_of_every_command(golden):
    text = "\n".join(helps())
    golden(
        "commands/help.txt", re.sub(r"Usage: .*?causal-openlock", "Usage: causal-openlock", text)
    )


def helps(*words):
    """The help of a command, and of those in it."""
    text = at_once(*words, "--help").stdout
    yield text
    if "COMMAND [ARGS]" in text:
        commands = text.split("ommands:\n")[-1] if words else text.split("Start here:\n")[1]
        for name in re.findall(r"^  ([a-z]+)  ", commands, re.MULTILINE):
            yield from helps(*words, name)


@pytest.mark.parametrize("session", SESSIONS)
def test_what_commands_print_and_write(session, golden, tmp_path, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO("push the door\nhm\nquit\n"))
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    printed = []
    for line in filter(None, map(str.strip, SESSIONS[session].splitlines())):
        before = {*tmp_path.rglob("*")}
        done = at_once(*shlex.split(line), reports="whole")
        printed += [f"\n$ causal-openlock {line}", done.stdout.strip("\n"), done.stderr.strip("\n")]
        new = [path for path in {*tmp_path.rglob("*")} - before if path.is_file()]
        names = [
            re.sub(r"[0-9a-f]{12,}", "DIGEST", str(path.relative_to(tmp_path))) for path in new
        ]
        printed += [f"[wrote {' '.join(sorted({*names}))}]" if names else ""]
        printed += [f"[status {done.status}]" if done.status else ""]
    golden(f"commands/{session}.txt", masked("\n".join(filter(None, printed)), tmp_path))
    if session == "results":
        golden("summary.csv", (tmp_path / "people" / "summary.csv").read_text(encoding="utf-8"))

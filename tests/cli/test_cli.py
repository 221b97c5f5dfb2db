"""The command line as a user drives it, mistakes included, in processes of its own."""

from __future__ import annotations

import io
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from causal_openlock.analysis.measures import count
from causal_openlock.analysis.results.reading import beside, read_results
from causal_openlock.cli.terminal import write_anything
from causal_openlock.comparison.console import Terminal
from causal_openlock.comparison.leaderboard_text import print_leaderboard
from causal_openlock.storage.store import Store
from support.command import at_once, modules_of
from support.places import ROOT
from support.processes import start_prepared
from support.undrawn import THEN
from support.waiting import HANGS, until

pytestmark = pytest.mark.slow

SLOW = """\
name: slow
seed: 11
subjects: 6
cell_size: 2
protocol: long
conditions: [CC3, noisy_CC3]
learners: [random, oracle]
protocols:
  long: {based_on: rl, baseline_loops: 1, attempt_limit: 100}
"""


def command(*words: object) -> list[str]:
    return [sys.executable, "-m", "causal_openlock", *map(str, words)]


def openlock(
    *words: object, cwd: Path, expect: int = 0, **options: object
) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        command(*words),
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
        timeout=HANGS,
        **options,  # type: ignore[call-overload]
    )
    assert "Traceback" not in done.stderr, done.stderr
    assert done.returncode == expect, done.stdout + done.stderr
    return done


def here(*words: object, cwd: Path, expect: int = 0, **options: Any) -> tuple[str, str]:
    """As :func:`openlock`, in this process, which is faster; returns what was printed."""
    done = at_once(*words, cwd=cwd, **options)
    assert done.status == expect, done.stdout + done.stderr
    return done.stdout, done.stderr


def sentence(stderr: str) -> str:
    """The only line of an error."""
    assert stderr.startswith("error: ")
    assert len(stderr.splitlines()) == 1, stderr
    return stderr


def fails(*words: object, cwd: Path) -> str:
    """The sentence with which a command fails."""
    return sentence(here(*words, cwd=cwd, expect=2)[1])


@pytest.fixture
def slow(tmp_path: Path) -> Path:
    path = tmp_path / "slow.yaml"
    path.write_text(SLOW, encoding="utf-8")
    return path


def test_a_comparison_killed_at_any_moment_goes_on_and_ends_the_same(
    slow: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And its workers end with it."""
    start_prepared(monkeypatch)
    here("compare", slow, "--out", "undisturbed", cwd=tmp_path)
    victim = subprocess.Popen(
        command("compare", slow, "--out", "killed", "--workers", "2"),
        cwd=tmp_path,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    cells = tmp_path / "killed" / "cells"
    until(lambda: len(list(cells.glob("*.parquet"))) >= 3, victim)
    workers = workers_of(victim)
    assert workers or not Path("/proc/self/task").exists()
    victim.kill()
    victim.wait()
    until(lambda: not any(_alive(pid) for pid in workers))
    done = {path.name: path.stat().st_mtime_ns for path in cells.glob("*.parquet")}
    total = len(list((tmp_path / "undisturbed" / "cells").glob("*.parquet")))
    assert len(done) < total, "killed too late to show anything"
    assert not (tmp_path / "killed" / "summary.csv").exists()

    said, _ = here("compare", slow, "--out", "killed", "--workers", 3, cwd=tmp_path, workers=True)
    assert "cells were there already" in said
    for name, changed in done.items():
        assert (cells / name).stat().st_mtime_ns == changed
    undisturbed = (tmp_path / "undisturbed" / "summary.csv").read_bytes()
    assert (tmp_path / "killed" / "summary.csv").read_bytes() == undisturbed


def workers_of(process: subprocess.Popen[Any]) -> list[int]:
    """The processes that a comparison plays in, where there is /proc to find them."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    return [int(pid) for pid in children.read_text().split()] if children.exists() else []


def _alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


@pytest.mark.parametrize(
    ("end", "all_of_them", "status", "playing"),
    [
        (signal.SIGINT, True, 130, 2),
        (signal.SIGTERM, False, 143, 1),
        (signal.SIGTERM, True, 143, 1),
    ],
)
def test_a_comparison_that_is_stopped_says_that_it_goes_on(
    slow: Path, tmp_path: Path, end: signal.Signals, all_of_them: bool, status: int, playing: int
) -> None:
    words = ("compare", slow, "--out", "out", "--workers", playing, "--subjects", "400")
    going = subprocess.Popen(
        command(*words, "--checkpoint-every", "0.01"),
        cwd=tmp_path,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # Where tests run in the background, a shell may have had SIGINT ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    cells = tmp_path / "out" / "cells"
    until(lambda: list(cells.glob("*.checkpoint")), going)
    workers = workers_of(going)
    # A terminal sends it to all processes, and so do batch systems.
    (os.killpg if all_of_them else os.kill)(going.pid, end)
    _, said = going.communicate(timeout=HANGS)
    assert said == "error: stopped; run the same command again to continue\n"
    assert going.returncode == status
    until(lambda: not any(_alive(pid) for pid in workers))  # none outlives its parent
    assert not (tmp_path / "out" / "errors").exists()


def test_output_that_is_no_terminal_is_lines_that_tell_how_far_it_is(tmp_path: Path) -> None:
    words = ("-c", "CC3", "-c", "CE3", "-l", "oracle", "--subjects", 1, "--workers", 1)
    said, _ = here("compare", *words, "--out", "out", cwd=tmp_path)
    lines = said.splitlines()
    assert lines[0] == "oracle_in_CC3_CE3: 0 of 2 cells done, 0% of the work"
    assert lines[1].startswith("oracle_in_CC3_CE3: 2 of 2 cells done, in ")
    assert all(ord(sign) >= 32 for line in lines for sign in line), "no signs that steer a terminal"
    again = here("compare", *words, "--out", "out", cwd=tmp_path, reports="whole")[0].splitlines()
    assert "2 of 2 cells were there already" in again
    page = (tmp_path / "out" / "report.html").read_bytes()
    here("report", "out", cwd=tmp_path, reports="whole")
    assert (tmp_path / "out" / "report.html").read_bytes() == page


ASCII = {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}


@pytest.mark.parametrize(
    ("environment", "folder"), [({"PYTHONIOENCODING": "ascii"}, "ä"), (ASCII, "a")]
)
def test_output_that_cannot_encode_a_sign_has_a_plainer_one(
    tmp_path: Path, environment: dict[str, str], folder: str
) -> None:
    compare = ("compare", "-c", "CC4", "-l", "random", "--subjects", "5", "--workers", "1")
    # Typer writes UTF-8 wherever the encoding is ASCII, which is no reason to end, either.
    show = ("schema", "show", "CC4")
    wrong = (("report", "nó"), ("schema", "show", "é→ß"))
    words = (*compare, "--protocol", "human", "--out", folder, THEN, *show, THEN, *wrong[0])
    done = subprocess.run(
        [sys.executable, "-m", "support.undrawn", *words, THEN, *wrong[1]],
        cwd=tmp_path,
        env={**os.environ, **environment, "PYTHONPATH": str(ROOT / "tests")},
        capture_output=True,
        text=True,
        check=False,
        timeout=HANGS,
    )
    assert "report: " in done.stdout
    assert done.stdout.isascii()
    assert done.stderr.isascii()
    assert "> L1, L2, L3" in done.stdout
    assert "\\u" not in done.stdout
    lines = [line for line in done.stderr.splitlines() if not line.startswith("report: ")]
    compared, shown, *refused = lines
    assert (compared, shown) == ("[0]", "[0]")
    assert [line[:7] for line in refused] == ["error: ", "[2]", "error: ", "[2]"]


def test_a_folder_whose_name_this_process_cannot_decode_is_refused_with_the_remedy(
    tmp_path: Path,
) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "causal_openlock", "compare", "-c", "CC4", "--out", "ä"],
        cwd=tmp_path,
        env={**os.environ, **ASCII},
        capture_output=True,
        text=True,
        check=False,
        timeout=HANGS,
    )
    assert done.returncode == 2
    assert "not valid ASCII" in done.stderr
    assert "set PYTHONUTF8=1" in done.stderr
    assert not list(tmp_path.iterdir())


def test_signs_that_cannot_be_encoded_have_plainer_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", stream)
    write_anything()
    print("3.2–4.1 → ddqn … é \udc80 ×", file=stream)
    stream.flush()
    assert stream.buffer.getvalue() == b"3.2-4.1 -> ddqn ... \\xe9 \\udc80 x\n"


def test_cells_of_many_and_of_few_layouts_are_compared(tmp_path: Path) -> None:
    (tmp_path / "wide.yaml").write_text(
        "name: wide\nsubjects: 40\ncell_size: 40\nlearners: [random]\nprotocol: short\n"
        "conditions: [CC4, {name: anywhere, train: [{schema: CC4, layouts: random, trials: 5}]}]\n"
        "protocols: {short: {attempt_limit: 2, baseline_trials: 2}}\n",
        encoding="utf-8",
    )
    here("compare", "wide.yaml", "--out", "wide", cwd=tmp_path)
    store = Store(tmp_path / "wide")
    layouts = [len(set(store.read(path)["layout"].to_pylist())) for path in store.files()[0]]
    assert min(layouts) < 10
    assert max(layouts) >= 128
    record, _ = beside([read_results(store)])
    assert len(set(record["layout"].to_pylist())) > 128
    assert record["layout"].combine_chunks().type.index_type == record["layout"].type.index_type
    assert len(count(record).trials) == 40 * 2 + 40 * 5
    here("export", "wide", cwd=tmp_path)


def test_a_flipped_bit_is_told_by_every_command_and_mended_by_compare(tmp_path: Path) -> None:
    words = ("compare", "-c", "CC3", "-l", "oracle", "-l", "random", "--subjects", 2)
    here(*words, "--out", "out", cwd=tmp_path)
    summary = (tmp_path / "out" / "summary.csv").read_bytes()
    cell = next((tmp_path / "out" / "cells").glob("random_*.parquet"))
    for path in (cell, tmp_path / "out" / "experiment.json"):
        says = str(path.relative_to(tmp_path))
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 4
        path.write_bytes(content)
        for more in (
            ("report", "out"),
            ("report", "out", "out"),
            ("report", "out", "--beside", "out"),
            ("bundle", "out"),
            ("export", "out"),
            ("film", "CC3", "-l", "random", "--from", "out", "-o", "film.gif"),
        ):
            assert f"{says} is damaged (" in fails(*more, cwd=tmp_path), more
    said, _ = here(*words, "--out", "out", cwd=tmp_path)
    assert "1 of 2 cells were there already" in said
    assert (tmp_path / "out" / "summary.csv").read_bytes() == summary


def test_results_of_ones_own_choice_get_a_folder_of_their_own(tmp_path: Path) -> None:
    words = ("compare", "-l", "oracle", "--subjects", 1)
    folders = []
    for condition in ("CC3", "CE3"):
        said, _ = here(*words, "-c", condition, cwd=tmp_path)
        assert f"oracle_in_{condition}" in said
        folders.append({path.name for path in (tmp_path / "results").iterdir()})
    assert len(folders[0]) == 1
    assert len(folders[1]) == 2
    assert sorted(name[:-9] for name in folders[1]) == ["oracle_in_CC3", "oracle_in_CE3"]


def test_an_export_does_not_replace_a_file_unasked(tmp_path: Path) -> None:
    here("schema", "new", "mine", cwd=tmp_path)
    text = (tmp_path / "mine.yaml").read_text(encoding="utf-8")
    words = ("schema", "export", "mine.yaml", "--format", "gml", "--out", "mine.yaml")
    assert "exists already" in fails(*words, cwd=tmp_path)
    assert (tmp_path / "mine.yaml").read_text(encoding="utf-8") == text
    here(*words, "--force", cwd=tmp_path)


def test_a_schema_of_ones_own_is_compared_the_same_minute(tmp_path: Path) -> None:
    said, _ = here("schema", "new", "vault", cwd=tmp_path)
    assert "schema check vault.yaml" in said
    text = (tmp_path / "vault.yaml").read_text(encoding="utf-8")
    (tmp_path / "vault.yaml").write_text(text + "gates: {door: all}\n", encoding="utf-8")
    said, _ = here("schema", "check", "vault.yaml", cwd=tmp_path)
    assert "good: 3 levers, 1 solution, attempts of at least 4 actions" in said
    said, _ = here("schema", "show", "vault.yaml", cwd=tmp_path)
    assert said.endswith("\n1 solution:\n  L0 L1 L2 door\n")
    said, _ = here("schema", "show", "vault.yaml", "--states", cwd=tmp_path)
    assert said.index("L0 L1 L2 door") < said.index("of 16 states can be reached in an attempt of")
    here(
        *("compare", "--condition", "vault.yaml", "--learner", "oracle", "--learner", "random"),
        *("--subjects", 4, "--out", "out"),
        cwd=tmp_path,
    )
    record = Store(tmp_path / "out").record()[0].to_pandas()
    oracle = record[record["learner"] == "oracle"]
    assert set(oracle["schema"]) == {"vault"}
    assert set(oracle["category"]) == {"open1"}
    assert (oracle["attempt"] == 1).all()


def test_schema_list_names_the_bundled_schemas_and_those_at_hand(tmp_path: Path) -> None:
    (tmp_path / "schemas").mkdir()
    here("schema", "new", "mine", "--like", "chain3", "-o", "schemas/mine.yaml", cwd=tmp_path)
    (tmp_path / "schemas" / "broken.yaml").write_text("name: broken\n", encoding="utf-8")
    said, _ = here("schema", "list", cwd=tmp_path)
    for name in ("CC3", "CE4", "chain3", "noisy_CC3", "seven", "two_keys", "two_of_four", "mine"):
        assert name in said
    assert "schemas/broken.yaml:1:1: levers: is missing" in said


@pytest.mark.parametrize("format", ["yaml", "node-link", "gml", "dot", "dagitty", "bif"])
def test_schemas_are_exported_and_read_again(tmp_path: Path, format: str) -> None:
    out, _ = here("schema", "export", "noisy_CC3", "--format", format, cwd=tmp_path)
    assert "L0" in out
    if format == "bif":
        return
    suffix = {"node-link": "json", "dagitty": "dagitty"}.get(format, format)
    name = f"copy.{suffix}"
    (tmp_path / name).write_text(out, encoding="utf-8")
    again = here("schema", "export", name, "--format", "yaml", cwd=tmp_path)
    assert again == here("schema", "export", "noisy_CC3", cwd=tmp_path)


def test_schema_draw_writes_a_figure(tmp_path: Path) -> None:
    here("schema", "draw", "seven", "--out", "seven.png", cwd=tmp_path)
    assert (tmp_path / "seven.png").read_bytes().startswith(b"\x89PNG")
    here("schema", "draw", "CC4", cwd=tmp_path)
    assert "<svg" in (tmp_path / "CC4.svg").read_text(encoding="utf-8")


def test_learners_lists_learners_and_their_parameters(tmp_path: Path) -> None:
    said, _ = here("learners", cwd=tmp_path)
    assert all(name in said for name in ("ddqn", "oracle", "random"))
    said, _ = here("learners", "ddqn", cwd=tmp_path)
    assert "gamma" in said
    assert "discount factor" in said


def test_mistakes_are_answered_with_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "broken.yaml").write_text(
        "name: broken\nlevers: [L0, L1]\nedges: {L0: [L1], L1: [L0, door]}\n", encoding="utf-8"
    )
    (tmp_path / "bad.yaml").write_text(
        "name: bad\nconditions: [CC3]\nlearners: [ramdom]\n", encoding="utf-8"
    )
    at = {"cwd": tmp_path}
    assert "did you mean CC3?" in fails("schema", "show", "CC33", **at)
    assert "broken.yaml:3:14: L0 -> L1 -> L0 is a cycle" in fails(
        "schema", "check", "broken.yaml", **at
    )
    assert "broken.yaml:3:14" in fails("compare", "-c", "broken.yaml", "-l", "random", **at)
    assert "cannot be read" in fails("schema", "check", "nowhere.yaml", **at)
    assert "no layout 'trial12'" in fails("schema", "show", "CC3", "--layout", "trial12", **at)
    assert "exists already" in fails("schema", "new", "broken", **at)
    assert "letters, digits and underscores" in fails("schema", "new", "3levers", **at)
    assert "did you mean gml?" in fails("schema", "export", "CC3", "--format", "gmll", **at)
    assert "bad.yaml:3:12" in fails("compare", "bad.yaml", **at)
    assert "did you mean default?" in fails("compare", "defualt", **at)
    assert "did you mean random?" in fails("compare", "-l", "rndom", **at)
    assert "no protocol 'robot'" in fails("compare", "--protocol", "robot", **at)
    assert "not a condition" in fails("compare", "-c", "CC3-CC4-CC3", **at)
    twice = fails("compare", "-c", "CC4", "-c", "CC4", "-l", "random", **at)
    assert twice.endswith("the condition CC4 is listed twice; remove one of them\n")
    assert "holds no results" in fails("report", "nowhere", **at)
    assert "no learner 'nobody'" in fails("learners", "nobody", **at)
    for words in (["compare", "--subjects", "0"], ["compare", "--nonsense"], ["nonsense"]):
        assert "Usage" in here(*words, cwd=tmp_path, expect=2)[1]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.yaml", "broken.yaml"]


def test_another_experiment_in_the_folder_is_refused(tmp_path: Path) -> None:
    words = ("compare", "-c", "CC3", "-l", "oracle", "--subjects", 1, "--out", "out")
    here(*words, cwd=tmp_path)
    assert "holds another experiment" in fails(*words, "--seed", 5, cwd=tmp_path)
    assert Store(tmp_path / "out").experiment().seed == 2018


def test_a_disk_that_fills_up_is_one_sentence_and_the_run_can_go_on(tmp_path: Path) -> None:
    words = ("compare", "-c", "CC3", "-l", "random", "--subjects", 60, "--out", "out")

    def little_room() -> None:
        # No file may grow beyond 12 kB: the writes of a cell's record fail as on a full disk.
        resource.setrlimit(resource.RLIMIT_FSIZE, (12_000, 12_000))

    said = sentence(openlock(*words, cwd=tmp_path, expect=2, preexec_fn=little_room).stderr)
    assert "cannot be written" in said
    assert "continues where it stopped" in said
    here(*words, cwd=tmp_path)
    record = Store(tmp_path / "out").record()[0]
    assert record["subject"].to_pylist()[-1] == 59


def test_the_reader_of_a_pipe_may_go_away(tmp_path: Path) -> None:
    shell = f"{' '.join(command('schema', 'list'))} | head -n 1"
    done = subprocess.run(
        shell, shell=True, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=HANGS
    )
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("statement", ["import causal_openlock", "--help"])
def test_starting_loads_nothing_heavy(statement: str, tmp_path: Path) -> None:
    words = (
        ["-c", statement]
        if statement.startswith("import")
        else ["-m", "causal_openlock", statement]
    )
    done = subprocess.run(
        [sys.executable, "-X", "importtime", *words],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        timeout=HANGS,
        env={**os.environ, "COLUMNS": "80"},
    )
    loaded = {line.rsplit("|", 1)[-1].strip().split(".")[0] for line in done.stderr.splitlines()}
    assert "causal_openlock" in loaded
    assert not loaded & {"torch", "pgmpy", "matplotlib", "pandas", "scipy", "networkx", "pyarrow"}


def test_no_column_of_the_headline_is_cut_off_however_narrow_the_terminal() -> None:
    names = [f"learner_{number}" for number in range(3)]
    row = {
        "protocol": "human", "conditions": 6, "subjects": 40, "limit": 30, "solved": 0.0,
        "informed": False, "reference": False, "found": 0.25, "solutions": 3.0,
        "median": float("nan"), "before": 0,
        "attempts": 30.0, "score": 0.5, "best": names[0], "to_best": 26.25, "to_best_low": 25.5,
        "to_best_high": 27.5, "to_people": 21.25, "to_people_low": 20.5,
        "to_people_high": 22.5,
        "to_people_p": 0.001,
    }  # fmt: skip
    console = Terminal(width=60, file=io.StringIO())
    rows = [{**row, "learner": name} for name in names]
    rows.append({**row, "learner": "people", "reference": True, "solved": float("nan")})
    print_leaderboard(pd.DataFrame(rows), console)
    printed = console.file.getvalue()
    shown = ("human", "at most 30", "together", "0.25 of 3", "> 30", "0.50", "− people")
    assert all(text in printed for text in [*names, *shown])
    assert "≥ 21.2 [20.5, 22.5]" in printed
    assert max(map(len, printed.splitlines())) <= 100


def test_what_a_learner_changes_in_its_process_stays_with_its_cell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    start_prepared(monkeypatch)
    (tmp_path / "leaks.py").write_text(
        "import numpy as np\n\nfrom causal_openlock import OneSubjectLearner\n\n\n"
        "class Leaks(OneSubjectLearner):\n"
        "    many = 0\n\n"
        "    def begin(self):\n"
        "        type(self).many += 1\n\n"
        "    def act(self, observation):\n"
        "        return type(self).many % 15\n",
        encoding="utf-8",
    )
    (tmp_path / "leaks.yaml").write_text(
        "name: leaks\nsubjects: 6\ncell_size: 2\nprotocol: short\nconditions: [CC3]\n"
        "learners: ['leaks:Leaks']\nprotocols: {short: {attempt_limit: 2, baseline_trials: 2}}\n",
        encoding="utf-8",
    )
    told = []
    for workers in (1, 3):
        words = ("compare", "leaks.yaml", "--out", f"out{workers}", "--workers", workers)
        with modules_of(tmp_path):
            said, _ = here(*words, cwd=tmp_path, workers=True)
        assert "report: " in said
        store = Store(tmp_path / f"out{workers}")
        told.append([store.read(path)["actions"].to_pylist() for path in store.files()[0]])
    assert told[0] == told[1]
    assert told[0][0] == told[0][1] == told[0][2]


def test_a_room_is_played_in_words(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    typed = io.StringIO("hello\npush the door\n\nquit\npush the door\n")
    monkeypatch.setattr(sys, "stdin", typed)
    done = at_once("text", "CC3", "--story", "levers", cwd=tmp_path)
    assert done.status == 0
    assert "You are in a room with 7 levers and a door" in done.stdout
    assert done.stdout.count("That is no action, and nothing was done.") == 2
    assert "> Nothing moved." in done.stdout
    assert "3 actions in this attempt" in done.stdout
    assert "2 actions in this attempt" in done.stdout
    assert typed.read() == "push the door\n"  # after quit
    monkeypatch.setattr(sys, "stdin", io.StringIO("quit\n"))
    done = at_once("text", "shown-CC3-CC4", "--story", "levers", cwd=tmp_path)
    assert done.stdout.count("(shown to you)") == 6 * 2 * 3
    assert done.stdout.count("> ") == 6 * 2 * 3 + 1
    done = at_once("text", "CC3", "--story", "cars", cwd=tmp_path)
    assert (done.status, done.stderr.count("\n")) == (2, 1)
    assert "there is no story 'cars'" in done.stderr

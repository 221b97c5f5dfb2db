"""The command line as a user drives it; what it prints stands in tests/golden/commands."""

import io
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest
import typer
from typer.testing import CliRunner

from causal_openlock.cli import GroupedCommands
from causal_openlock.storage.store import Store
from support.command import at_once, modules_of
from support.places import ROOT
from support.processes import start_prepared
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
SMALL = ("compare", "-c", "CC3", "-l", "oracle", "-l", "random", "--subjects", 2)
ASCII = {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("slow.yaml").write_text(SLOW, encoding="utf-8")
    return tmp_path


def command(*words):
    return [sys.executable, "-m", "causal_openlock", *map(str, words)]


def in_a_process(*words, expect=0, environment=None, **options):
    """Run a command in a process of its own; what it printed."""
    done = subprocess.run(
        command(*words),
        capture_output=True,
        text=True,
        check=False,
        timeout=HANGS,
        env={**os.environ, **(environment or {})},
        **options,
    )
    assert "Traceback" not in done.stderr, done.stderr
    assert done.returncode == expect, done.stdout + done.stderr
    return done


def here(*words, expect=0, **options):
    """Run a command in this process, which is faster; what it printed, or its error."""
    done = at_once(*words, **options)
    assert done.status == expect, done.stdout + done.stderr
    return done.stderr if expect else done.stdout


# -- stopping and going on -------------------------------------------------------------------------


def workers_of(process):
    """The processes that a comparison plays in, where there is /proc to find them."""
    threads = Path(f"/proc/{process.pid}/task").glob("*/children")
    return [int(pid) for children in threads for pid in children.read_text().split()]


def alive(pid):
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
    ],
)
def test_stopped_comparison_says_how_to_continue(end, all_of_them, status, playing):
    words = ("compare", "slow.yaml", "--out", "out", "--workers", playing, "--subjects", "400")
    going = subprocess.Popen(
        command(*words, "--checkpoint-every", "0.01"),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # Where tests run in the background, a shell may have had SIGINT ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    until(lambda: list(Path("out", "cells").glob("*.checkpoint")), going)
    workers = workers_of(going)
    # A terminal sends it to all processes, and so do batch systems.
    (os.killpg if all_of_them else os.kill)(going.pid, end)
    _, said = going.communicate(timeout=HANGS)
    assert said == "error: stopped; run the same command again to continue\n"
    assert going.returncode == status
    until(lambda: not any(map(alive, workers)))
    assert not Path("out", "errors").exists()


def test_full_disk_is_one_sentence_and_the_command_can_continue():
    words = ("compare", "-c", "CC3", "-l", "random", "--subjects", 60, "--out", "out")

    def little_room():  # the writes of a cell's record fail as on a full disk
        resource.setrlimit(resource.RLIMIT_FSIZE, (12_000, 12_000))

    said = in_a_process(*words, expect=2, preexec_fn=little_room).stderr
    assert said.startswith("error: ")
    assert said.count("\n") == 1
    here(*words)
    assert Store("out").record()[0]["subject"].to_pylist()[-1] == 59


# -- results folders -------------------------------------------------------------------------------


def test_flipped_bit_is_named_by_every_command_and_repaired_by_compare():
    here(*SMALL, "--out", "out")
    summary = Path("out", "summary.csv").read_bytes()
    for path in (next(Path("out", "cells").glob("random_*")), Path("out", "experiment.json")):
        content = bytearray(path.read_bytes())
        content[60] ^= 4  # in the first column
        path.write_bytes(content)
        for words in (
            ("report", "out"),
            ("report", "out", "out"),
            ("report", "out", "--beside", "out"),
            ("bundle", "out"),
            ("export", "out"),
            ("film", "CC3", "-l", "random", "--from", "out", "-o", "film.gif"),
        ):
            assert f"{path} is damaged (" in here(*words, expect=2), words
    assert "1 of 2 cells were there already" in here(*SMALL, "--out", "out")
    assert Path("out", "summary.csv").read_bytes() == summary


def test_comparison_that_options_change_gets_a_folder_of_its_own():
    for condition in ("CC3", "CE3"):
        here("compare", "-l", "oracle", "--subjects", 1, "-c", condition)
    names = sorted(path.name[:-9] for path in Path("results").iterdir())
    assert names == ["oracle_in_CC3", "oracle_in_CE3"]


def test_shards_play_parts_and_report_lists_what_is_missing():
    said = here(*SMALL, "--out", "out", "--shard", "1/2")
    assert "report:" not in said
    assert len(list(Path("out", "cells").glob("*.parquet"))) == 1
    assert not Path("out", "report.html").exists()
    said = here("report", "out")
    assert "random in CC3, subjects 0-1: not played yet" in said
    assert "1 waiting" in here("status", "out")
    done = at_once("export", "out")
    assert "warning: 1 cell not played yet" in done.stderr
    here(*SMALL, "--out", "out", "--shard", "2/2")
    assert "not played" not in here("report", "out")


def test_files_of_the_user_are_not_overwritten():
    here("schema", "new", "mine", "--like", "CE3")
    here("notebook", "mine")
    before = {path: path.read_text() for path in Path().glob("mine.*")}
    assert len(before) == 2
    for words in (
        ("schema", "new", "mine"),
        ("schema", "export", "CC3", "--out", "mine.yaml"),
        ("notebook", "mine", "--lesson", 1),
    ):
        here(*words, expect=2)
        assert {path: path.read_text() for path in Path().glob("mine.*")} == before
    here("schema", "export", "CC3", "--out", "mine.yaml", "--force")
    assert here("schema", "export", "mine.yaml") == here("schema", "export", "CC3")


def test_cells_of_many_layouts_and_of_few_are_reported_together():
    Path("wide.yaml").write_text(
        "name: wide\nsubjects: 40\ncell_size: 40\nlearners: [random]\nprotocol: short\n"
        "conditions: [CC4, {name: anywhere, train: [{schema: CC4, layouts: random, trials: 5}]}]\n"
        "protocols: {short: {attempt_limit: 2, baseline_trials: 2}}\n",
        encoding="utf-8",
    )
    here("compare", "wide.yaml", "--out", "wide")
    record = Store("wide").record()[0]
    assert len(set(record["layout"].to_pylist())) > 128  # more than one byte counts
    assert "wide/record.csv written, 560 attempts" in here("export", "wide")


# -- terminals and pipes ---------------------------------------------------------------------------


@pytest.mark.parametrize("environment", [{"PYTHONIOENCODING": "ascii"}, ASCII])
def test_output_that_cannot_encode_a_sign_has_a_question_mark(environment):
    done = in_a_process("schema", "show", "CC4", environment=environment)
    assert done.stdout.isascii()
    assert "? L1, L2, L3" in done.stdout
    done = in_a_process("schema", "show", "é→ß", expect=2, environment=environment)
    assert done.stderr.isascii()
    assert done.stderr.startswith("error: ")


def test_folder_name_that_cannot_be_decoded_is_refused_with_the_remedy(folder):
    words = ("compare", "-c", "CC4", "--out", "ä")
    said = in_a_process(*words, expect=2, environment=ASCII).stderr
    assert "PYTHONUTF8=1" in said
    assert [path.name for path in folder.iterdir()] == ["slow.yaml"]


def test_reader_of_a_pipe_may_go_away():
    shell = f"{' '.join(command('schema', 'list'))} | head -n 1"
    done = subprocess.run(shell, shell=True, capture_output=True, text=True, timeout=HANGS)
    assert "Traceback" not in done.stderr


def test_narrow_terminal_cuts_off_no_column_of_the_leaderboard(monkeypatch):
    here(*SMALL, "--out", "out")
    monkeypatch.setenv("COLUMNS", "200")
    wide = {line for line in here("report", "out").splitlines() if line.startswith("oracle  ")}
    assert len(wide) == 1
    monkeypatch.setenv("COLUMNS", "40")
    assert wide <= {*here("report", "out").splitlines()}


def test_commands_of_other_packages_come_last_and_hidden_ones_not_at_all():
    app = typer.Typer(cls=GroupedCommands, rich_markup_mode=None)
    app.callback()(lambda: None)
    for name in ("greet", "export"):
        app.command(name, help="Say something.")(lambda: None)
    app.command("secret", hidden=True)(lambda: None)
    text = CliRunner().invoke(app, ["--help"]).stdout
    assert "secret" not in text
    listed = text.split("Share:\n")[1].split()
    assert (listed[0], listed[3:5]) == ("export", ["More:", "greet"])


# -- single commands -------------------------------------------------------------------------------


def test_notebook_begins_as_the_template_or_as_a_lesson_that_was_never_run():
    lessons = sorted((ROOT / "notebooks").glob("0*.ipynb"))
    here("notebook", "my vault")
    template = (ROOT / "notebooks" / "template.ipynb").read_bytes()
    assert Path("my vault.ipynb").read_bytes() == template
    here("notebook", "mine.ipynb", "--lesson", len(lessons))
    mine = nbformat.read("mine.ipynb", as_version=4)
    lesson = nbformat.read(lessons[-1], as_version=4)
    assert [cell.source for cell in mine.cells] == [cell.source for cell in lesson.cells]
    code = [cell for cell in mine.cells if cell.cell_type == "code"]
    assert {(len(cell.outputs), cell.execution_count) for cell in code} == {(0, None)}


def test_rooms_that_are_shown_are_told_in_words(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO("quit\n"))
    said = here("text", "shown-CC3-CC4", "--story", "levers")
    assert said.count("(shown to you)") == 6 * 2 * 3
    assert said.count("> ") == 6 * 2 * 3 + 1


def test_what_a_learner_changes_in_its_process_stays_with_its_cell(folder, monkeypatch):
    start_prepared(monkeypatch)
    Path("counting.py").write_text(
        "from causal_openlock import OneSubjectLearner\n\n\n"
        "class Counting(OneSubjectLearner):\n"
        "    many = 0\n\n"
        "    def begin(self):\n"
        "        type(self).many += 1\n\n"
        "    def act(self, observation):\n"
        "        return type(self).many % 15\n",
        encoding="utf-8",
    )
    Path("counting.yaml").write_text(
        "name: counting\nsubjects: 6\ncell_size: 2\nprotocol: short\nconditions: [CC3]\n"
        "learners: ['counting:Counting']\n"
        "protocols: {short: {attempt_limit: 2, baseline_trials: 2}}\n",
        encoding="utf-8",
    )
    actions = []
    for workers in (1, 3):
        with modules_of(folder):
            here(
                "compare", "counting.yaml", "-o", f"o{workers}", "--workers", workers, workers=True
            )
        store = Store(f"o{workers}")
        actions.append([store.read(path)["actions"].to_pylist() for path in store.files()[0]])
    assert actions[0] == actions[1]
    assert actions[0][0] == actions[0][1] == actions[0][2]

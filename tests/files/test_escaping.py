"""Text of somebody else's on a terminal and in a spreadsheet: readable, and without power."""

import csv
import io
import re

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from rich.progress import Progress, TextColumn
from rich.table import Table

from causal_openlock import cli
from causal_openlock.analysis.table import write_table
from causal_openlock.cli.terminal import complain, say
from causal_openlock.comparison.console import Terminal
from causal_openlock.comparison.leaderboard_text import print_leaderboard
from causal_openlock.errors import LearnerError
from causal_openlock.export.as_csv import flat
from causal_openlock.files.escaping import cell, csv_of, printable
from support.fabricated_records import table as as_record
from support.fabricated_records import trial_rows

EVIL = (
    "a\x1b[31mb\x1b]0;title\x07c\x9b2J\r\bd\u202ee [bold]f[/] [link=http://x]g[/link] :bomb: \ud800"
)
SHOWN = (
    r"a\x1b[31mb\x1b]0;title\x07c\x9b2J\x0d\x08d\u202ee [bold]f[/] [link=http://x]g[/link] :bomb: "
    r"\ud800"
)


def test_control_characters_are_spelled_out_and_the_rest_stays():
    assert printable(EVIL) == SHOWN
    assert printable("tab\tline\nGröße 多 – ’ \r\n") == "tab\tline\nGröße 多 – ’ \n"


def test_a_console_prints_text_as_it_is_wherever_it_stands():
    out = io.StringIO()
    console = Terminal(file=out, width=400, force_terminal=True, color_system=None)
    console.print(EVIL, soft_wrap=True)
    table = Table(EVIL, title=EVIL, caption=EVIL)
    table.add_row(EVIL)
    table.add_column(EVIL)
    console.print(table)
    with Progress(TextColumn("{task.description}", markup=False), console=console) as bar:
        bar.add_task(printable(EVIL), total=1)
        bar.console.print(EVIL)
    said = out.getvalue()
    assert said.count(SHOWN) >= 7
    assert "\x07" not in said
    assert "\x9b" not in said
    assert not re.search("\x1b(?!\\[)|\x1b\\[31m|\x1b\\[1m", said)


def test_what_goes_wrong_is_printed_without_power(monkeypatch, capsys):
    def fail():
        raise LearnerError(f"{EVIL}\nand more")

    monkeypatch.setattr(cli, "app", fail)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    assert capsys.readouterr().err == f"error: {SHOWN}\nerror: and more\n"
    say(EVIL)
    complain("x\x1by")
    assert capsys.readouterr() == (f"{SHOWN}\n", "error: x\\x1by\n")


def test_the_headline_shows_labels_as_they_are():
    row = {
        **{"reference": False, "informed": False, "attempts": 4.0, "score": np.nan},
        **{"conditions": 1, "subjects": 3, "limit": 30, "solved": 1.0, "found": 3.0, "before": 0},
        **{"solutions": 3.0, "median": 4.0, "best": "[/]c"},
        **{"to_best": 1.0, "to_best_low": 0.5, "to_best_high": 1.5},
        "protocol": "[bold]p[/]",
        "learner": "[red]l\x1b[31m",
    }
    out = io.StringIO()
    console = Terminal(file=out, width=100)
    print_leaderboard(pd.DataFrame([row]), console)
    for said in ("[bold]p[/]", "− [/]c", r"[red]l\x1b[31m", "1.00 [0.50, 1.50]"):
        assert said in out.getvalue()
    assert "\x1b" not in out.getvalue()


@pytest.mark.parametrize("text", ["=1+1", "+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\t=1", "\r=1"])
def test_a_formula_is_text_in_every_table(text, tmp_path):
    table = pd.DataFrame({"learner": [text, "ddqn"], text: [-1.5, 2], "told": ["-0.5", "+3"]})
    write_table(table, tmp_path / "table.csv")
    for content in ((tmp_path / "table.csv").read_bytes().decode(), csv_of(table)):
        head, first, second = csv.reader(io.StringIO(content, newline=""))
        shown = "'" + text.replace("\r", "\n")
        assert head == ["learner", shown, "told"]
        assert first[0] == shown
        assert [float(value) for value in first[1:]] == [-1.5, -0.5]
        assert second[0] == "ddqn"
        assert [float(value) for value in second[1:]] == [2, 3]


def test_names_stay_names_and_numbers_numbers():
    for text in ("ddqn", "CC3-CC4", "a=b", "", "-1", "-1e-5", "+2", "3 = 3", "–"):
        assert cell(text) == text


def test_an_export_has_no_formula():
    rows = trial_rows([1, 2, 3], learner="=cmd()", condition="CC3")
    record = as_record([*rows, *trial_rows([1], learner="=cmd()", condition="CC3")])
    made = flat(record)
    assert made["learner"].unique().to_pylist() == ["'=cmd()"]
    assert made["condition"].unique().to_pylist() == ["CC3"]
    numbers = [name for name in made.column_names if pa.types.is_floating(made[name].type)]
    assert all(made[name].equals(record[name]) for name in numbers)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["report", "x\x1b]0;title\x07"], r"error: x\x1b]0;title\x07 holds no results"),
        (["import", "a\udcff.csv", "--out", "r"], "is not valid UTF-8"),
        (["play", "--out", "r\udcff"], "is not valid UTF-8"),
    ],
)
def test_the_command_line_names_files_without_power(words, named, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["causal-openlock", *words])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    assert named in capsys.readouterr().err

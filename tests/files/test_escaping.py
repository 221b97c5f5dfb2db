"""Text of somebody else's on a terminal and in a spreadsheet: readable, and without power."""

import csv
import io
import re

import pandas as pd
import pytest
from rich.progress import Progress, TextColumn
from rich.table import Table

from causal_openlock import cli
from causal_openlock.analysis.table import write_table
from causal_openlock.comparison.console import Terminal
from causal_openlock.files.escaping import cell, csv_of, printable

EVIL = (
    "a\x1b[31mb\x1b]0;title\x07c\x9b2J\r\bd\u202ee [bold]f[/] [link=http://x]g[/link] :bomb: \ud800"
)
SHOWN = (
    r"a\x1b[31mb\x1b]0;title\x07c\x9b2J\r\x08d\u202ee [bold]f[/] [link=http://x]g[/link] :bomb: "
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
    for name in ("ddqn", "CC3-CC4", "a=b", "", "-1", "-1e-5", "+2", "3 = 3", "–"):
        assert cell(name) == name


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

"""What ``causal-openlock --help`` lists: all commands, in groups, what a newcomer needs first."""

from __future__ import annotations

import re
from typing import Any

import pytest
from typer import Typer
from typer.testing import CliRunner

from causal_openlock.cli import app
from causal_openlock.cli.groups import GROUPS, GroupedCommands

HEADING = re.compile(r"^(\w[\w ]*):\n((?:  .*\n)+)", re.MULTILINE)


def listed(app: Any, columns: int) -> dict[str, list[str]]:
    """The names under each heading of the help."""
    text = CliRunner().invoke(app, ["--help"], terminal_width=columns, color=False).stdout
    assert max(map(len, text.splitlines())) <= columns
    groups = dict(HEADING.findall(text))
    del groups["Options"]
    assert "..." not in "".join(groups.values())
    return {title: [row.split()[0] for row in rows.splitlines()] for title, rows in groups.items()}


@pytest.mark.parametrize("columns", [80, 100])
def test_all_commands_are_listed_once_and_the_first_five_first(columns: int) -> None:
    groups = listed(app, columns)
    assert [*groups] == [*GROUPS]
    assert groups["Start here"] == ["compare", "report", "schema", "play", "notebook"]
    names = [name for names in groups.values() for name in names]
    registered = {command.name or command.callback.__name__ for command in app.registered_commands}
    assert sorted(names) == sorted(registered | {"schema"})


def test_what_no_group_names_comes_last_and_what_is_hidden_not_at_all() -> None:
    guest = Typer(cls=GroupedCommands, rich_markup_mode=None)
    guest.callback()(lambda: None)
    for name in ("greet", "export", "check"):
        guest.command(name, help="Say something.")(lambda: None)
    guest.command("secret", hidden=True)(lambda: None)
    assert listed(guest, 80) == {"Share": ["export", "check"], "More": ["greet"]}

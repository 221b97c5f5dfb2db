"""The groups in which ``causal-openlock --help`` lists commands: what a newcomer needs comes first.

A command is listed where its name stands below, whichever package registers it; all others come
last, so a package needs to say nothing to be listed.
"""

from __future__ import annotations

from typing import Any

from typer.core import TyperGroup

GROUPS = {
    "Start here": ("compare", "report", "schema", "play", "notebook"),
    "Declare": ("learners", "room", "train"),
    "Compare": ("status", "trace", "film"),
    "People": ("import", "forget", "text"),
    "Predict": ("score", "fit", "recover", "design"),
    "Share": ("export", "bundle", "evidence"),
}
OTHERS = "More"


class GroupedCommands(TyperGroup):
    """A command line whose help lists commands in groups."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a section for each group that has a command, in columns of one width."""
        listed = {name: command for name, command in self.commands.items() if not command.hidden}
        width = max(map(len, listed), default=0)
        texts = {
            name: command.get_short_help_str(formatter.width - width - 6)
            for name, command in listed.items()
        }
        named = {name for names in GROUPS.values() for name in names}
        others = tuple(name for name in texts if name not in named)
        for title, names in {**GROUPS, OTHERS: others}.items():
            rows = [(name.ljust(width), texts[name]) for name in names if name in texts]
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)

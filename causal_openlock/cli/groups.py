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
    "Predict": ("score", "fit", "design"),
    "Share": ("export", "bundle"),
}


class GroupedCommands(TyperGroup):
    """A command line whose help lists commands in groups."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a section for each group that has a command."""
        listed = {name: one for name, one in self.commands.items() if not one.hidden}
        others = listed.keys() - {name for names in GROUPS.values() for name in names}
        for title, names in {**GROUPS, "More": sorted(others)}.items():
            rows = [
                (name.ljust(8), listed[name].get_short_help_str(formatter.width - 14))
                for name in names
                if name in listed
            ]
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)

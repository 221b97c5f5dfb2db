"""Pages of documentation as tests: what they show is done, and what they say came out is compared.

A page is gone through from top to bottom in a folder of its own. Console blocks are typed, Python
blocks are executed one after the other with the same names, and whatever a comment names a file
for is written to it. Such comments stand before a block and are seen neither on a forge nor on the
site::

    <!-- test: file vault.yaml -->      the block is the content of this file
    <!-- test: printed -->              the block is what the last Python block printed
    <!-- test: add --subjects 2 -->     so many more words for every compare of the block
    <!-- test: refused -->              the commands of the block end with an error
    <!-- test: skip, a server -->       the block is not run, and why

Lines of a console block that do not begin with ``$`` are what the command printed, in order; a line
of three dots stands for any others.
"""

from __future__ import annotations

import contextlib
import io
import linecache
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from causal_openlock.cli import app
from support.command import at_once, modules_of, play_here, report_shortly
from support.places import ROOT

DOCS = ROOT / "docs"
FENCE = re.compile(
    r"(?:^<!-- test: (?P<note>[^\n]*?) -->\n\n?)?^```(?P<language>[^\n`]*)\n(?P<text>.*?)^```$",
    flags=re.DOTALL | re.MULTILINE,
)
LINK = re.compile(r'\]\((?P<target>[^)\s]+)(?:\s+"[^"]*")?\)')


@dataclass(frozen=True)
class Block:
    """A block of code on a page, and what a comment says of it."""

    language: str
    text: str
    note: str = ""


def blocks(text: str, language: str | None = None) -> list[Block]:
    """The blocks of a page, or those in one language."""
    found = (
        Block(match["language"], match["text"], match["note"] or "")
        for match in FENCE.finditer(text)
    )
    return [block for block in found if language in (None, block.language)]


def code(text: str, language: str) -> list[str]:
    """The texts of the blocks in one language."""
    return [block.text for block in blocks(text, language)]


def anchors(text: str) -> list[str]:
    """What headings are called in links."""
    prose = FENCE.sub("", text)
    return [
        re.sub(r"[^\w\- ]", "", line.lstrip("#").strip().lower()).replace(" ", "-")
        for line in prose.splitlines()
        if line.startswith("#")
    ]


def broken_links(path: Path) -> list[str]:
    """Links of a page to files or headings that are not there."""
    text = path.read_text(encoding="utf-8")
    broken = []
    for match in LINK.finditer(FENCE.sub("", text)):
        place, _, heading = match["target"].partition("#")
        if "//" in place:
            continue
        target = path.parent / place if place else path
        if not target.exists() or (
            heading and heading not in anchors(target.read_text(encoding="utf-8"))
        ):
            broken.append(match["target"])
    return broken


@dataclass(frozen=True)
class Typed:
    """A command of a console block, and what the block says that it printed."""

    words: list[str]
    shown: list[str] = field(default_factory=list)


def typed(text: str) -> list[Typed]:
    """The commands of a console block."""
    found: list[Typed] = []
    for line in text.replace("\\\n", " ").splitlines():
        if line.startswith("$ "):
            found.append(Typed(shlex.split(line[2:], comments=True)))
        elif found:
            found[-1].shown.append(line.rstrip())
    return found


def unknown_options(words: list[str]) -> list[str]:
    """The options of a command that it does not have, or the command if there is none."""
    import typer

    command: Any = typer.main.get_command(app)
    rest = list(words)
    while rest and rest[0] in getattr(command, "commands", {}):
        command = command.commands[rest.pop(0)]
    if getattr(command, "commands", {}) and rest and not rest[0].startswith("-"):
        return rest[:1]
    known = {name for option in command.params for name in (*option.opts, *option.secondary_opts)}
    known |= {"--help", "-h"}
    options = [word.partition("=")[0] for word in rest if re.match(r"--?[a-z]", word)]
    return [option for option in options if option not in known]


class Reader:
    """Somebody who does in a folder what a page tells them to do."""

    def __init__(self, folder: Path, patches: pytest.MonkeyPatch) -> None:
        self.folder = folder
        page = ModuleType("__main__")  # as a notebook's: learners may be defined on a page
        patches.setitem(sys.modules, "__main__", page)
        self.names: dict[str, Any] = vars(page)
        self.printed = ""
        self.done: list[str] = []
        patches.chdir(folder)
        patches.syspath_prepend(folder)
        patches.setenv("COLUMNS", "100")
        play_here(patches)
        report_shortly(patches)

    def go_through(self, text: str) -> None:
        """Do all that a page says, and compare what comes out."""
        with modules_of(self.folder):
            for block in blocks(text):
                self._do(block)

    def _do(self, block: Block) -> None:
        what, _, how = block.note.partition(" ")
        if what == "skip,":
            assert how, "say why a block is not run"
        elif what == "file":
            path = self.folder / how
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
        elif what == "printed":
            same(block.text.splitlines(), self.printed, "the Python block")
        elif block.language == "console":
            more = shlex.split(how) if what == "add" else []
            for command in typed(block.text):
                self._type(command, more, refused=what == "refused")
        elif block.language == "python":
            output, place = io.StringIO(), f"<page, {len(self.done)}>"
            self.done.append(place)
            linecache.cache[place] = (len(block.text), None, block.text.splitlines(True), place)
            with contextlib.redirect_stdout(output):
                exec(compile(block.text, place, "exec"), self.names)
            self.printed = output.getvalue()
        else:
            # What has no language is to be looked at; {toctree} and the like are the site's.
            known = not block.language or block.language.startswith("{")
            assert known, f"say what to do with this block:\n{block.text}"

    def _type(self, command: Typed, more: list[str], refused: bool) -> None:
        program, *words = command.words
        if program == "causal-openlock":
            words += more if words[0] == "compare" else []
            ended = at_once(*words)
            status, said = ended.status, ended.stdout + ended.stderr
        elif program in ("python", "pytest"):
            words = (
                words if program == "python" else ["-m", "pytest", "-p", "no:cacheprovider", *words]
            )
            done = subprocess.run(
                [sys.executable, *words], capture_output=True, text=True, check=False, timeout=400
            )
            status, said = done.returncode, done.stdout + done.stderr
        else:
            raise AssertionError(f"{program} cannot be run here; mark the block as skipped")
        assert (status != 0) == refused, said
        self.done.append(shlex.join(command.words))
        same(command.shown, said, shlex.join(command.words))


def same(shown: list[str], said: str, who: str) -> None:
    """Hold what a page shows against what was said, in the same order."""
    lines = iter([line.rstrip() for line in said.splitlines()])
    for line in shown:
        if line.strip() and line.strip() != "...":
            assert line in lines, f"{who} did not print {line!r} there; it printed\n{said}"


def words_of(text: str) -> list[list[str]]:
    """What follows ``causal-openlock`` in every command of a page."""
    return [
        command.words[1:]
        for block in blocks(text, "console")
        for command in typed(block.text)
        if command.words[0] == "causal-openlock"
    ]

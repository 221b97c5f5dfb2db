"""The documentation: the site builds without a warning, and what its pages show is so."""

from __future__ import annotations

import pkgutil
import re
import subprocess
import sys
import zlib
from pathlib import Path

import pytest

import causal_openlock
import learners
from support.documents import DOCS, ROOT, Reader, broken_links, unknown_options, words_of

PAGES = sorted(
    path
    for path in DOCS.rglob("*.md")
    if not {"_build", "figures", "example_play"} & {*path.relative_to(DOCS).parts}
)
RUN = [
    path
    for path in PAGES
    if path.parent.name == "howto" or path.stem in ("index", "tutorial", "reproduction")
]
"""Pages whose every block is run here; what the others show, tests of their own hold them to."""

called = {"ids": lambda path: path.relative_to(DOCS).as_posix()}


def test_the_site_builds_without_a_warning_and_is_whole(tmp_path: Path) -> None:
    """One test, so that the site is built once: that takes up to a minute of a core."""
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", str(DOCS), str(tmp_path)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    assert (done.returncode, done.stderr) == (0, "")
    every_page_is_there(tmp_path)
    every_module_is_in_the_reference(tmp_path)
    the_program_speaks_for_itself(tmp_path)
    nothing_is_loaded_from_elsewhere(tmp_path)


def every_page_is_there(site: Path) -> None:
    for path in PAGES:
        assert (site / path.relative_to(DOCS).with_suffix(".html")).is_file(), path


def every_module_is_in_the_reference(site: Path) -> None:
    text = zlib.decompress((site / "objects.inv").read_bytes().split(b"\n", 4)[4]).decode()
    shown = set(re.findall(r"^(\S+) py:module", text, flags=re.MULTILINE))
    there = {
        module.name
        for package in (causal_openlock, learners)
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
        if not module.name.endswith("__main__")
    }
    assert there - shown == set()


def the_program_speaks_for_itself(site: Path) -> None:
    commands = (site / "api" / "command_line.html").read_text(encoding="utf-8")
    assert "causal-openlock schema export" in commands
    assert "Seconds between checkpoints inside a cell" in commands
    formats = (site / "api" / "file_formats.html").read_text(encoding="utf-8")
    assert "train_loops" in formats
    assert "Probability that an enabled push takes effect." in formats
    assert "replay_size" in (site / "api" / "learners.html").read_text(encoding="utf-8")


def nothing_is_loaded_from_elsewhere(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r"<(?:script|link|img)\b[^>]*\b(?:src|href)=\"(https?:[^\"]+)", text)
        assert loaded == [], page


@pytest.mark.parametrize("path", PAGES, **called)
def test_whatever_a_page_points_to_is_there(path: Path) -> None:
    assert broken_links(path) == []


@pytest.mark.parametrize("path", PAGES, **called)
def test_every_option_that_a_page_names_exists(path: Path) -> None:
    for words in words_of(path.read_text(encoding="utf-8")):
        assert unknown_options(words) == [], words


@pytest.mark.parametrize("path", RUN, **called)
def test_what_a_page_shows_is_what_happens(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Over ten seconds where a page compares learners several times, or trains networks."""
    reader = Reader(tmp_path, monkeypatch, reports=path.stem == "tutorial")
    reader.go_through(path.read_text(encoding="utf-8"))


def test_make_docs_treats_warnings_as_errors() -> None:
    (line,) = re.findall(r"^docs:.*\n\t(.*)$", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
    assert "sphinx" in line
    assert "-W" in line

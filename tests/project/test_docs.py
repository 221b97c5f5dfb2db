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
import openlock_learners
from support.command import Reports
from support.documents import DOCS, ROOT, Reader, broken_links, unknown_options, words_of

pytestmark = pytest.mark.slow

PAGES = sorted(
    path
    for path in DOCS.rglob("*.md")
    if not {"_build", "figures", "example_play"} & {*path.relative_to(DOCS).parts}
)
LESSONS = sorted((ROOT / "notebooks").glob("0*.ipynb"))
RUN = [
    path
    for path in PAGES
    if path.parent.name == "howto"
    or path.stem in ("index", "notebooks", "tutorial", "reproduction", "what_is_a_schema_worth")
]
"""Pages whose every block is run here; what the others show, tests of their own hold them to."""

called = {"ids": lambda path: path.relative_to(DOCS).as_posix()}


def build(site: Path, *options: str) -> None:
    words = ["-W", "--keep-going", "-q", *options, DOCS, site]
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", *map(str, words)],
        cwd=site.parent,
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_the_site_builds_without_a_warning_and_is_whole(tmp_path: Path) -> None:
    """One test, so that the site is built once: that takes up to a minute of a core.

    Typographic quotes take a twentieth of the time.
    """
    site = tmp_path / "site"
    played = tmp_path / "small.yaml"  # instead of what takes two minutes
    played.write_text("name: small\nsubjects: 1\nconditions: [CC4]\nlearners: [oracle]\n")
    build(site, "-Dsmartquotes=0", f"-Dexample_report={played}")
    played.unlink()
    every_page_is_there(site)
    the_example_report_is_there(site)
    every_study_is_there(site)
    every_module_is_in_the_reference(site)
    the_program_speaks_for_itself(site)
    nothing_is_loaded_from_elsewhere(site)
    assert [*tmp_path.iterdir()] == [site]


def every_page_is_there(site: Path) -> None:
    for path in PAGES:
        assert (site / path.relative_to(DOCS).with_suffix(".html")).is_file(), path
    listed = (site / "notebooks.html").read_text(encoding="utf-8")
    for path in LESSONS:
        lesson = (site / "lessons" / f"{path.stem}.html").read_text(encoding="utf-8")
        assert lesson.count('src="../_images/') == path.read_text().count('"image/png"'), path
        assert f'href="lessons/{path.stem}.html"' in listed


def the_example_report_is_there(site: Path) -> None:
    page = (site / "example_report.html").read_text(encoding="utf-8")
    (link,) = re.findall(r'href="([^"]+)"><strong>Read the whole report', page)
    report = (site / link).read_text(encoding="utf-8")
    assert "oracle" in report
    assert "</html>" in report


def every_study_is_there(site: Path) -> None:
    """And a number on a page of results leads to it, with what it is as the link's title."""
    listed = (site / "evidence" / "README.html").read_text(encoding="utf-8")
    for path in (ROOT / "evidence").glob("*/study.yaml"):
        study = path.parent.name
        assert f'href="{study}/README.html"' in listed
        page = (site / "evidence" / study / "README.html").read_text(encoding="utf-8")
        has_claims = "\nclaims:" in path.read_text(encoding="utf-8")
        assert ('href="../README.html#verdicts"' in page) == has_claims
    results = (site / "reproduction.html").read_text(encoding="utf-8")
    title = 'title="claim levels_rate_001 verdict"'
    assert re.search(rf'href="evidence/figure7/README.html"[^>]*{title}', results)


def every_module_is_in_the_reference(site: Path) -> None:
    text = zlib.decompress((site / "objects.inv").read_bytes().split(b"\n", 4)[4]).decode()
    shown = set(re.findall(r"^(\S+) py:module", text, flags=re.MULTILINE))
    there = {
        module.name
        for package in (causal_openlock, openlock_learners)
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
        loaded = re.findall(
            r"<(?:script|link|img|iframe)\b[^>]*\b(?:src|href)=\"(https?:[^\"]+)", text
        )
        assert loaded == [], page
        assert "object at 0x" not in text, page


def test_tables_of_results_have_the_columns_that_the_reference_lists() -> None:
    results = causal_openlock.compare("CC4", ["oracle", "random"], subjects=2, workers=0)
    text = (DOCS / "api" / "results.md").read_text(encoding="utf-8")
    first, shared, *tables = re.split(r"^## ", text, flags=re.MULTILINE)

    def listed(part: str) -> list[str]:
        cells = re.findall(r"^\| (.*?) \|", part, flags=re.MULTILINE)
        return [name for cell in cells for name in re.findall(r"`(.+?)`", cell)]

    of_a_trial = listed(shared)
    for part in tables:
        name = re.match(r"`results\.(\w+)`", part)[1]  # type: ignore[index]
        own = listed(part) + of_a_trial * (name in ("trials", "attempts", "actions"))
        assert sorted(own) == sorted(getattr(results, name).columns), name
    public = {name for name in dir(results) if not name.startswith("_")}
    assert {name.rstrip("()") for name in listed(first)} == public | {"+"}


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
    reports: Reports = "decided" if path.stem == "tutorial" else "short"
    reader = Reader(tmp_path, monkeypatch, reports=reports)
    reader.go_through(path.read_text(encoding="utf-8"))


def test_the_example_report_is_of_an_experiment_that_can_be_played() -> None:
    experiment = causal_openlock.read_experiment(DOCS / "example_report.yaml")
    assert len(experiment.conditions) == 6
    assert "bayes" in [spec.name for spec in experiment.learners]


def test_make_docs_treats_warnings_as_errors() -> None:
    (line,) = re.findall(r"^docs:.*\n\t(.*)$", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
    assert "sphinx" in line
    assert "-W" in line

"""The documentation: the site builds without a warning, and what its pages show is so."""

import re
import subprocess
import sys

import pytest

import causal_openlock as ol
from support.documents import DOCS, ROOT, Reader, broken_links, unknown_options, words_of

pytestmark = pytest.mark.slow

PAGES = sorted({*DOCS.glob("*.md"), *DOCS.glob("howto/*.md"), *DOCS.glob("api/*.md")})
RUN = [
    path
    for path in PAGES
    if path.parent.name == "howto"
    or path.stem in ("index", "notebooks", "tutorial", "reproduction", "what_is_a_schema_worth")
]
"""Pages whose every block is run here."""

called = {"ids": lambda path: path.relative_to(DOCS).as_posix()}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site as ``make docs`` builds it, but for what takes half of its time.

    That is to look for cycles in memory, and of the reference the types in signatures, defaults as
    the code writes them, and typographic quotes.
    """
    site = tmp_path_factory.mktemp("site")
    (line,) = re.findall(r"^docs:.*\n\t(.*)$", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
    _, _, words = line.partition("$(RUN) sphinx ")
    start = "import gc, runpy; gc.disable(); runpy.run_module('sphinx', run_name='__main__')"
    fewer = ("smartquotes=0", "autodoc_typehints=none", "autodoc_preserve_defaults=0")
    done = subprocess.run(
        [sys.executable, "-c", start, *words.replace("docs/_build", str(site)).split()]
        + [f"-D{setting}" for setting in fewer],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert (done.returncode, done.stderr) == (0, ""), "the site has warnings"
    return site


def test_every_page_lesson_and_study_is_on_the_site(site):
    kept = [*PAGES, *ROOT.glob("notebooks/0*.ipynb"), *ROOT.glob("evidence/*/README.md")]
    assert len(kept) > 60
    for path in kept:
        assert (site / path.relative_to(ROOT).with_suffix(".html")).is_file(), path
    assert "docs/index.html" in (site / "index.html").read_text()
    listed = (site / "docs" / "notebooks.html").read_text(encoding="utf-8")
    assert listed.count('href="../notebooks/0') >= 9


def test_the_program_speaks_for_itself_on_the_site(site):
    reference = site / "docs" / "api"
    shown = {
        "command_line": ("causal-openlock schema export", "Seconds between checkpoints"),
        "file_formats": ("train_loops", "Probability that an enabled push takes effect."),
        "learners": ("replay_size", "openlock_learners.theory_based"),
        "public": ("open_results", "OneSubjectLearner"),
        "world": ("causal_openlock.world.room", "Layout"),
    }
    for page, texts in shown.items():
        text = (reference / f"{page}.html").read_text(encoding="utf-8")
        assert [one for one in texts if one not in text] == [], page


def test_the_site_loads_nothing_from_elsewhere(site):
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(
            r"<(?:script|link|img|iframe)\b[^>]*\b(?:src|href)=\"(https?:[^\"]+)", text
        )
        assert loaded == [], page
        assert "object at 0x" not in text, page


def test_tables_of_results_have_the_columns_that_the_reference_lists():
    results = ol.compare("CC4", ["oracle", "random"], subjects=2, workers=0)
    text = (DOCS / "api" / "results.md").read_text(encoding="utf-8")
    first, shared, *tables = re.split(r"^## ", text, flags=re.MULTILINE)

    def listed(part):
        cells = re.findall(r"^\| (.*?) \|", part, flags=re.MULTILINE)
        return [name for cell in cells for name in re.findall(r"`(.+?)`", cell)]

    of_a_trial = listed(shared)
    for part in tables:
        name = re.match(r"`results\.(\w+)`", part)[1]
        own = listed(part) + of_a_trial * (name in ("trials", "attempts", "actions"))
        assert sorted(own) == sorted(getattr(results, name).columns), name
    public = {name for name in dir(results) if not name.startswith("_")}
    assert {name.rstrip("()") for name in listed(first)} == public | {"+"}


@pytest.mark.parametrize("path", PAGES, **called)
def test_whatever_a_page_points_to_is_there(path):
    assert broken_links(path) == []
    for words in words_of(path.read_text(encoding="utf-8")):
        assert unknown_options(words) == [], words


@pytest.mark.parametrize("path", RUN, **called)
def test_what_a_page_shows_is_what_happens(path, tmp_path, monkeypatch):
    """Over ten seconds where a page compares learners several times, or trains networks."""
    reader = Reader(tmp_path, monkeypatch)
    reader.go_through(path.read_text(encoding="utf-8"))

"""The README's examples, run as they stand, and its first screen."""

import hashlib
import re
import shlex
import sys

import gymnasium
import pytest

import causal_openlock as ol
from causal_openlock.analysis.measures import TRANSFERS
from causal_openlock.comparison.plotting import Plots
from support.command import at_once, modules_of
from support.documents import DOCS, ROOT, broken_links, code, unknown_options, words_of

sys.path.append(str(DOCS / "figures"))
import first_page

pytestmark = pytest.mark.slow

README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What a reader saves who follows the README, and what the commands shown leave there."""
    folder = tmp_path_factory.mktemp("readme")
    for name, text in zip(("vault.yaml", "first_look.yaml"), code(README, "yaml"), strict=True):
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "my_learners.py").write_text(code(README, "python")[0], encoding="utf-8")
    return folder


def test_both_commands_stand_on_the_first_screen_and_the_page_is_short():
    assert len(README.splitlines()) <= 90
    first = README.splitlines()[:12]
    for command in ("make compare", "make test"):
        assert any(command in line for line in first)
    after_the_table = README.partition("<!-- end of evidence -->")[2]
    assert re.search(r"\]\((.+?)\)", after_the_table)[1] == "examples/openlock_in_one_file.py"


def test_the_learner_of_ones_own_learns(folder):
    compared = [words for words in words_of(README) if words[0] == "compare"]
    (line,) = (words for words in compared if "first" in words[1])
    with modules_of(folder):
        done = at_once(*line, "--subjects", 4, "--out", "results/first_look", cwd=folder)
    assert done.status == 0, done.stdout + done.stderr
    trials = ol.open_results(folder / "results" / "first_look").trials
    assert set(trials["condition"]) == {"CC4", "CC3-CE4", "vault"}
    attempts = trials[trials["schema"] != "CC3"].groupby("learner")["attempts"].mean()
    assert set(attempts.index) == {"oracle", "bayes", "random", "Curious"}
    assert attempts["Curious"] < 0.5 * attempts["random"]


def test_the_vault_has_one_solution_and_a_trial_is_traced_as_shown(folder):
    (solution,) = ol.find_schema(str(folder / "vault.yaml")).solutions
    assert set(solution) == {"dial", "key", "second_key"}
    (line,) = (words for words in words_of(README) if words[:1] == ["trace"])
    assert "bits learned" in at_once(*line, cwd=folder).stdout


def test_plots_and_rooms_that_it_names_are_there():
    for named in re.findall(r"(?<= )\.(\w+)\(", code(README, "python")[1]):  # in the comment
        assert hasattr(Plots(None), named), named
    (line,) = (line for line in README.split("`") if line.startswith("gymnasium.make"))
    assert eval(line, {"gymnasium": gymnasium}).reset(seed=0)[0].shape == (16,)


def test_the_interval_of_what_transfer_saves_people_is_the_one_that_is_computed():
    results = ol.compare(TRANSFERS, "oracle", subjects=1, workers=0)
    people = results.transfer.set_index(["learner", "condition"]).loc["people"]
    for test, condition in (("CC4", "CC3-CC4"), ("CE4", "CE3-CE4")):
        saved, low, high = people.loc[condition, ["saved", "low", "high"]]
        place = rf"{saved + 1e-9:.2f}\s(attempts )?in\s{test}"
        assert re.search(rf"{place}\s\((95%\sinterval )?{low:.2f}\sto\s{high:.2f}\)", README)


def test_what_it_points_to_exists():
    pictures = re.findall(r'(?:href|src)="([^"]+)"', README)
    assert len(pictures) == 4
    assert [path for path in pictures if not (ROOT / path).is_file()] == []
    assert broken_links(ROOT / "README.md") == []
    assert broken_links(ROOT / "CONTRIBUTING.md") == []
    for words in words_of(README):
        assert unknown_options(words) == [], shlex.join(words)


@pytest.mark.parametrize(("figure", "source"), first_page.SOURCES.items())
def test_figures_are_made_from_what_is_stored_now(figure, source):
    """Otherwise: ``python docs/figures/first_page.py``."""
    svg = (DOCS / "figures" / figure).read_text(encoding="utf-8")
    stored = (first_page.STUDY / source).read_bytes()
    assert first_page.made_from(svg) == hashlib.sha256(stored).hexdigest()

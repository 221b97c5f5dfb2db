"""Studies: what is kept of a run, what follows, and what no longer fits is found."""

import shutil

import pandas as pd
import pytest
from matplotlib.figure import Figure

from causal_openlock.errors import EvidenceError, FileError, StoreError
from causal_openlock.files.checksums import digest, json_bytes, read_json
from causal_openlock.version import RESULTS_VERSION
from evidence.__main__ import arguments, main
from evidence.figures import draw_course
from evidence.measured import Evidence
from evidence.pages import check
from evidence.run import read_units, run_study
from evidence.study import read_studies
from evidence.units import selected
from support.places import ROOT

pytestmark = pytest.mark.slow

EXPERIMENT = "name: small\nsubjects: 6\ncell_size: 6\nconditions: [CC3, CC3-CC4]\n"
STUDY = """
title: A small study
experiment: experiment.yaml
hours: 0.01
claims:
  faster:
    text: Random actions solve less than four fifths of the tests
    contrasts:
      CC3-CC4: {measure: solved, of: random CC3-CC4, minus: 0.8, expected: less}
  like_people:
    text: It is as fast as people
    contrasts:
      CC3-CC4:
        {measure: attempts, of: oracle CC3-CC4, minus: people CC3-CC4, expected: same, smallest: 1}
tables:
  attempts:
    measure: attempts
    columns: [CC3 trial 1, CC3, CC3-CC4]
    rows: {people: People, oracle: Oracle}
figures: [attempts]
"""
PAGE = """# Results

The oracle needs [?](evidence/small/README.md "attempts oracle CC3") attempts.

<!-- evidence: small attempts -->
<!-- end of evidence -->
"""


def made_in(folder):
    """A folder of one study, and a page that takes numbers from it."""
    small = folder / "evidence" / "small"
    small.mkdir(parents=True)
    (small / "study.yaml").write_text(STUDY)
    (small / "experiment.yaml").write_text(EXPERIMENT + "learners: [oracle, random]\n")
    (folder / "page.md").write_text(PAGE)
    return folder / "evidence"


def command(root, *words):
    return main(arguments().parse_args([*map(str, words)]), root, root.parent / "results")


def run(root):
    return command(root, "small", "--workers", 0)


def evidence(root):
    (study,) = read_studies(root)
    return Evidence(study)


def change(root, name, old, new):
    path = root / "small" / name
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def rewrite(root, **facts):
    """Write other facts about its run next to a study."""
    path = root / "small" / "run.json"
    path.write_bytes(json_bytes({**read_json(path.read_bytes()), **facts}))


@pytest.fixture
def root(tmp_path):
    """A study that was not run."""
    return made_in(tmp_path)


@pytest.fixture(scope="module")
def ran_once(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    assert run(made_in(folder)) == []
    return folder


@pytest.fixture
def ran(ran_once, tmp_path):
    """A study that was run and written, in a folder of its own."""
    return shutil.copytree(ran_once, tmp_path / "ran") / "evidence"


# -- what is written ------------------------------------------------------------------------------


def test_a_study_that_was_not_run_is_undecided(root):
    found = evidence(root)
    assert found.text("claim faster verdict") == "undecided"
    assert found.block("claims").count("| undecided | not run yet |") == 2
    with pytest.raises(EvidenceError, match="make evidence NAME=small"):
        found.text("attempts oracle CC3")


def test_pages_and_verdicts_follow_from_the_units(ran, capsys):
    assert command(ran, "--check") == check(ran) == []
    assert "1 study: played with these results." in capsys.readouterr().out
    page = (ran.parent / "page.md").read_text()
    assert '[2.00](evidence/small/README.md "attempts oracle CC3")' in page
    assert "| People | – | – | 5.53 | – |" in page
    assert "| Oracle | 2.00 | 2.00 | 3.00 | 6 |" in page
    verdicts = (ran / "small" / "verdicts.csv").read_text()
    assert "faster,CC3-CC4,solved,less,0.0,-0.8" in verdicts
    assert "like_people,CC3-CC4,attempts,same" in verdicts
    readme = (ran / "small" / "README.md").read_text()
    assert "| **holds** |" in readme
    assert "| holds | −.80 from .80 (−.80 to −.41), n = 6 |" in readme
    assert "; 90%: " in readme  # which decides a claim that two are the same
    assert evidence(ran).text("first_solution random CC3 interval") == "6 of 6 at 30 (61% to 100%)"
    command(ran)
    assert "small: A small study (0.01 core hours; run)" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("title", "named"),
    [
        ("attempts oracle CC9", "condition CC9"),
        ("attempts nobody CC3", "learner nobody"),
        ("atempts oracle CC3", "attempts"),
        ("claim fastr", "faster"),
        ("claim faster CC4 verdict", "CC3-CC4"),
        ("attempts oracle CC3 trial", "trial"),
        ("attempts oracle CC3 CC3-CC4", "CONDITION"),
        ("derived oracle rmse", "derives no"),
    ],
)
def test_a_title_of_no_number_is_refused(ran_once, title, named):
    with pytest.raises(EvidenceError, match=named):
        evidence(ran_once / "evidence").text(title)


def test_units_are_subjects_and_count_the_trials_behind_their_means(ran):
    units = evidence(ran).units
    assert len(units) == 2 * 6 * (5 + 7)  # learners, subjects, trials
    judged = units[units["judged"]]
    assert set(judged.loc[judged["condition"] == "CC3", "trial"]) == {5}
    assert set(judged.loc[judged["condition"] == "CC3-CC4", "phase"]) == {"test"}
    assert len(selected(units, "random CC3 train", "solved")) == 6


# -- what no longer fits --------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["small/README.md", "small/verdicts.csv", "../page.md"])
def test_a_written_file_that_was_changed_is_found_and_written_again(ran, name):
    path = ran / name
    first = path.read_bytes()
    path.write_bytes(first.replace(b"2.00", b"1.99", 1).replace(b"0.8", b"0.9", 1))
    assert [path.name in fault for fault in check(ran)] == [True]
    assert check(ran, write=True) == []
    assert path.read_bytes() == first


def test_damaged_units_are_found_and_nothing_is_written_from_them(ran):
    path = ran / "small" / "units.parquet"
    content = path.read_bytes()
    middle = len(content) // 2
    flipped = content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
    verdicts = (ran / "small" / "verdicts.csv").read_bytes()
    for damaged in (flipped, content + b"x"):
        path.write_bytes(damaged)
        assert any("units.parquet is damaged" in fault for fault in check(ran, write=True))
        assert (ran / "small" / "verdicts.csv").read_bytes() == verdicts
    path.write_bytes(content)
    rewrite(ran, files={"units.parquet": "0" * 64})
    assert any("run.json is of another run" in fault for fault in check(ran))
    path.unlink()
    path.mkdir()
    rewrite(ran, files={})
    assert any("units.parquet is damaged" in fault for fault in check(ran))


def test_facts_of_a_run_that_lack_a_key_are_refused(ran):
    path = ran / "small" / "run.json"
    facts = read_json(path.read_bytes())
    del facts["versions"]
    path.write_bytes(json_bytes(facts))
    with pytest.raises(EvidenceError, match=r"run.json has no versions; run the study again"):
        _ = evidence(ran).played_with


def test_an_experiment_that_changed_since_its_run_is_found(ran):
    change(ran, "experiment.yaml", "name:", "# A comment changes nothing.\nname:")
    assert not check(ran)
    before = (ran / "small" / "run.json").read_bytes()
    change(ran, "experiment.yaml", "subjects: 6", "subjects: 6\nseed: 7")
    assert any("has changed since it was run" in fault for fault in check(ran))
    with pytest.raises(StoreError, match="another experiment"):  # records are not mixed
        run(ran)
    assert (ran / "small" / "run.json").read_bytes() == before


def test_a_schema_that_changed_is_another_declaration(root):
    schema = root / "small" / "mine.yaml"
    schema.write_text("name: mine\nlevers: [a, b]\nedges: {a: [b], b: [door]}\n")
    change(root, "experiment.yaml", "CC3,", "mine.yaml,")
    before = evidence(root).study.declared
    schema.write_text("name: mine\nlevers: [a, b]\nedges: {a: [door], b: [door]}\n")
    assert evidence(root).study.declared != before


@pytest.mark.parametrize("kept", ["results", "run.json"])
def test_a_margin_that_was_changed_after_the_run_stays_marked(ran, kept):
    assert "after the run" not in evidence(ran).block("claims")
    change(ran, "study.yaml", "smallest: 1}", "smallest: 0.1}")
    change(ran, "study.yaml", "  faster:", "  late:")
    if kept == "results":
        (ran / "small" / "run.json").unlink()
    else:
        shutil.rmtree(ran.parent / "results")
    change(ran, "experiment.yaml", "subjects: 6", "subjects: 7")  # also when more is run
    run(ran)
    found = evidence(ran)
    assert "**does not hold**; changed after the run" in found.block("claims")
    assert (found.late("like_people"), found.late("late")) == ("changed", "stated")


def test_a_block_without_an_end_is_a_fault_and_loses_nothing(ran):
    page = ran.parent / "page.md"
    text = PAGE.replace("<!-- end of evidence -->", "Prose that stays.\n") + PAGE
    page.write_text(text)
    assert any("no end" in fault for fault in check(ran, write=True))
    assert page.read_text() == text


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("expected: less", "expected: fewer", "yaml:9.*fewer"),
        ("expected: same, smallest: 1", "expected: same", "yaml:13.*smallest"),
        ("measure: solved", "measure: sovled", "yaml:9.*sovled"),
        ("title:", "tilte:", "yaml:2.*tilte"),
    ],
)
def test_a_fault_of_a_study_file_has_its_line(root, old, new, named):
    change(root, "study.yaml", old, new)
    with pytest.raises(FileError, match=named):
        evidence(root)


def test_a_study_of_what_is_not_played_or_seen_before_is_refused(root):
    folder = root / "small"
    (folder / "fit.json").write_bytes(json_bytes({"plan": {"seed": 7}}))
    (folder / "study.yaml").write_text(f"{STUDY}fits: [fit.json]\nfitted: {{orcle: 1}}\n")
    for seed, fresh in ((6, True), (7, False), (9, False), (10, True)):
        declared = f"{EXPERIMENT}learners: [oracle, random]\nseed: {seed}\n"
        (folder / "experiment.yaml").write_text(declared)
        *same, wrong = evidence(root).study.faults()
        assert "'orcle' is not there; did you mean oracle?" in wrong
        assert bool(same) != fresh
        assert all(f"seed {seed}" in one for one in same)
    with pytest.raises(EvidenceError, match="'orcle'"):
        run(root)
    assert not (root.parent / "results").exists()
    change(root, "experiment.yaml", "[oracle, random]", "[oracle, 'mine:Spy']")
    with pytest.raises(EvidenceError, match="names code"):
        run(root)


# -- what outlives a change of the code ------------------------------------------------------------


def test_a_published_study_stands_without_its_experiment_and_cannot_be_run(ran, capsys):
    page = (ran / "small" / "README.md").read_text()
    (ran / "small" / "experiment.yaml").write_text("learners: [removed]\n")
    assert len(check(ran)) == 1
    change(ran, "study.yaml", "hours: 0.01", 'hours: 0.01\npublished: "0.2"')
    assert check(ran, write=True) == check(ran) == []
    kept = (ran / "small" / "README.md").read_text()
    assert kept.split("## How")[0] == page.split("## How")[0]
    assert "version 0.2" in kept
    with pytest.raises(EvidenceError, match="published with version 0"):
        run(ran)
    command(ran)
    assert "published with version 0.2" in capsys.readouterr().out


def test_a_study_says_which_results_it_was_played_with_if_others_are_given_now(ran, capsys):
    rewrite(ran, versions={"causal-openlock": "0.1.0+4"})
    command(ran, "--write")
    for page in (ran / "small" / "README.md", ran.parent / "page.md"):
        assert page.read_text().count("Played with results of 0.1.") == 1
    assert command(ran, "--check") == []
    assert "1 study: Played with results of 0.1." in capsys.readouterr().out


def test_a_stamped_study_says_why_its_declaration_is_another_than_at_its_run(ran):
    stamps = [{"was": "c8", "by": "f1", "results": RESULTS_VERSION, "reason": "It has a new word."}]
    rewrite(ran, stamps=stamps, versions={"causal-openlock": "0.1.0+4"})
    assert check(ran, write=True) == []
    page = (ran / "small" / "README.md").read_text()
    assert "otherwise since: It has a new word." in page
    assert "Played with results" not in page  # those of the stamp are these
    rewrite(ran, stamps=[{**stamps[0], "results": "0.1.0+5"}])
    assert evidence(ran).played_with == "Played with results of 0.1."


# -- runs -----------------------------------------------------------------------------------------


def test_a_run_plays_what_is_missing(ran):
    cells = {path: path.stat().st_mtime_ns for path in ran.parent.rglob("cells/*.parquet")}
    units = read_units(evidence(ran).study)
    (ran / "small" / "units.parquet").unlink()
    change(ran, "experiment.yaml", "[oracle, random]", "[oracle, random, ideal]")
    assert run(ran) == []
    assert all(path.stat().st_mtime_ns == written for path, written in cells.items())
    again = read_units(evidence(ran).study)
    assert set(again["learner"]) == {"oracle", "random", "ideal"}
    kept = again[again["learner"] != "ideal"].reset_index(drop=True)
    pd.testing.assert_frame_equal(kept, units.sort_values([*units], kind="stable"), check_like=True)


NETWORKS = """
title: Two kinds of networks
experiment: experiment.yaml
hours: 0.01
networks:
  files: {first: first.yaml, second: second.yaml}
  seeds: [1, 2]
  parameters: {variant: {reset: trial}}
"""
TRAINING = "rooms: {schemas: {CC3: 1}, rewards: [paper]}\nactions: 1\n"


def test_networks_are_trained_once_and_each_is_a_unit(root, capsys):
    (root / "small" / "study.yaml").write_text(NETWORKS)
    (root / "small" / "experiment.yaml").write_text(EXPERIMENT + "learners: [rl2]\n")
    for name in ("first", "second"):
        (root / "small" / f"{name}.yaml").write_text(TRAINING)
    (root.parent / "page.md").unlink()
    networks = root.parent / "results" / "networks"
    networks.mkdir(parents=True)
    shipped = ROOT / "learners" / "openlock_learners" / "checkpoints" / "rl2.npz"
    for name in ("first-1", "first-2", "second-1"):  # training takes a while
        shutil.copyfile(shipped, networks / f"{name}-{digest(TRAINING)[:8]}.npz")
    (study,) = read_studies(root)
    run_study(study, root.parent / "results", 0)
    assert capsys.readouterr().out == f"training second-2-{digest(TRAINING)[:8]}\n"
    units = read_units(study)
    labels = {(name, seed) for name in ("first", "second", "variant") for seed in (1, 2)}
    assert {*units[["learner", "unit"]].itertuples(index=False, name=None)} == labels
    assert set(units["trials"]) == {6}
    run_study(study, root.parent / "results", 0)
    assert "training" not in capsys.readouterr().out
    pd.testing.assert_frame_equal(read_units(study), units)
    change(root, "second.yaml", "actions: 1", "actions: 2")
    assert any("changed since it was run" in fault for fault in check(root))
    (root / "small" / "second.yaml").write_text("no such word: 1\n")
    (study,) = read_studies(root)
    with pytest.raises(EvidenceError, match=r"training of second-1-.* failed"):
        run_study(study, root.parent / "results", 0)


# -- figures --------------------------------------------------------------------------------------


def test_a_figure_is_drawn_and_missed(ran):
    figure = ran / "small" / "attempts.png"
    assert 1000 < figure.stat().st_size < 50_000
    assert "(./attempts.png)" in (ran / "small" / "README.md").read_text()
    figure.unlink()
    (fault,) = check(ran)
    assert fault.startswith(f"{figure} is missing")
    assert command(ran, "--write") == []
    assert figure.exists()


def test_a_curve_has_means_of_fifty_trials_and_the_published_curve_in_its_panel(root):
    (root / "small" / "experiment.yaml").write_text(
        "name: small\nsubjects: 3\nconditions: [CC4, CC3-CC4]\n"
        "learners: [{learner: oracle, name: a2c}]\nprotocol: short\nprotocols:\n"
        "  short: {based_on: rl_2020, baseline_loops: 21, train_loops: 1, test_loops: 20}\n"
    )
    (root / "small" / "study.yaml").write_text(
        "title: A curve\nexperiment: experiment.yaml\nmeasured: curve\nhours: 0.01\ntables:\n"
        "  CC4:\n    measure: attempts\n    columns: [part 1, part 2, part 3]\n"
        "    rows: {a2c CC4: A, a2c CC3-CC4 test: B, paper_a2c CC4: C, paper_a2c CC3-CC4 test: D}\n"
    )
    (root.parent / "page.md").unlink()
    assert run(root) == []
    found, figure = evidence(root), Figure()
    parts = read_units(found.study).groupby(["condition", "phase"])["part"].unique().map(list)
    assert parts.to_dict() == {
        ("CC4", "train"): [1, 2, 3],  # the last one of five trials
        ("CC3-CC4", "train"): [1],
        ("CC3-CC4", "test"): [1, 2],
    }
    table = found.study.file.tables["CC4"]
    draw_course(table, found.rows(table), True, figure)
    (axes,) = figure.axes
    own = [line for line in axes.lines if line.get_linestyle() == "-"]
    assert [line.get_xdata().tolist() for line in own] == [[25, 75, 125]] * 4 + [[25, 75]] * 4
    baseline, transfer = (line for line in axes.lines if line.get_linestyle() == "--")
    assert (baseline.get_xdata().tolist(), baseline.get_ydata().tolist()) == ([25, 125], [632, 307])
    assert transfer.get_ydata().tolist() == [120, 61]

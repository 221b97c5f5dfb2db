"""Studies: what is kept of a run, what follows, and what no longer fits is found."""

import shutil

import pandas as pd
import pytest
from matplotlib.figure import Figure

import causal_openlock.evidence.running as running
from causal_openlock.errors import EvidenceError, StoreError
from causal_openlock.evidence.checking import check, write
from causal_openlock.evidence.figures import draw_course
from causal_openlock.evidence.keeping import Watched
from causal_openlock.evidence.measured import Evidence
from causal_openlock.evidence.pages import unbound_numbers
from causal_openlock.evidence.running import run_study
from causal_openlock.evidence.study import Selection, read_studies, read_study
from causal_openlock.evidence.study_files import read_run, read_units
from causal_openlock.evidence.units import selected
from causal_openlock.files.checksums import json_bytes, read_json
from support.command import at_once
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
      CC3-CC4:
        {measure: solved, of: {learner: random, condition: CC3-CC4}, minus: 0.8, expected: less}
  like_people:
    text: It is as fast as people
    contrasts:
      CC3-CC4:
        {measure: attempts, of: {learner: oracle, condition: CC3-CC4},
         minus: {learner: people, condition: CC3-CC4}, expected: same, smallest: 1}
tables:
  attempts:
    measure: attempts
    columns: [CC3 trial 1, CC3, CC3-CC4]
    rows: {people: People, oracle: Oracle}
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
    (folder / "evidence" / "pages.yaml").write_text("results: [../page.md]\n")
    return folder / "evidence"


def run(root, **options):
    (study,) = read_studies(root)
    run_study(study, root.parent / "results", Watched(workers=0), **options)
    return read_study(root / "small")


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
    run(made_in(folder))
    write(folder / "evidence")
    return folder


@pytest.fixture
def ran(ran_once, tmp_path):
    """A study that was run and written, in a folder of its own."""
    return shutil.copytree(ran_once, tmp_path / "ran") / "evidence"


def played(root):
    """The cells in the results folder."""
    return sorted((root.parent / "results").rglob("*.parquet"))


# -- what is written ------------------------------------------------------------------------------


def test_a_study_that_was_not_run_is_undecided(root):
    found = Evidence(read_study(root / "small"))
    assert found.text("claim faster verdict") == "undecided"
    assert "**undecided** | not run yet |" in found.block("verdicts")
    with pytest.raises(EvidenceError, match="causal-openlock ev"):
        found.text("attempts oracle CC3")


def test_pages_and_verdicts_follow_from_the_units(ran):
    assert check(ran) == []
    assert write(ran) == ([], [])
    page = (ran.parent / "page.md").read_text()
    assert '[2.00](evidence/small/README.md "attempts oracle CC3")' in page
    assert "| People | – | – | 5.53 | – |" in page
    assert "| Oracle | 2.00 | 2.00 | 3.00 | 6 |" in page
    verdicts = (ran / "small" / "verdicts.csv").read_text()
    assert "faster,CC3-CC4,solved,less,0.0,-0.8" in verdicts
    assert "like_people,CC3-CC4,attempts,same" in verdicts
    assert "**holds**" in (ran / "small" / "README.md").read_text()


def test_verdicts_have_a_row_for_each_claim_or_for_those_named(ran):
    found = Evidence(read_study(ran / "small"))
    faster, like_people = found.block("verdicts").splitlines()[2:]
    assert "| **holds** | CC3-CC4: −.80 from .80 (−.80 to −.41), n = 6 |" in faster
    assert "; 90%: " in like_people  # which decides a claim that two are the same
    assert found.block("verdicts like_people").splitlines()[2:] == [like_people]
    with pytest.raises(EvidenceError, match="'fastest'; did you mean faster"):
        found.block("verdicts fastest")
    assert found.text("first_solution random CC3 interval") == "6 of 6 at 30 (61% to 100%)"


@pytest.mark.parametrize(
    ("title", "named"),
    [
        ("attempts oracle CC9", "condition CC9"),
        ("attempts nobody CC3", "learner nobody"),
        ("atempts oracle CC3", "attempts"),
        ("claim fastr", "faster"),
        ("attempts oracle CC3 trial", "trial"),
        ("attempts oracle parameter a<->b", "parameter"),
        ("attempts oracle CC3 CC3-CC4", "condition"),
        ("attempts people CC3-CC4 sd", "sd|not known"),
        ("derived", "derived"),
        ("attempts oracle CC3 verdict", "verdict"),
    ],
)
def test_a_title_of_no_number_is_refused(ran_once, title, named):
    with pytest.raises(EvidenceError, match=named):
        Evidence(read_study(ran_once / "evidence" / "small")).text(title)


def test_units_are_subjects_and_count_the_trials_behind_their_means(ran):
    units = read_units(read_study(ran / "small"))
    assert len(units) == 2 * 6 * (5 + 7)  # learners, subjects, trials
    judged = units[units["judged"]]
    assert set(judged.loc[judged["condition"] == "CC3", "trial"]) == {5}
    assert set(judged.loc[judged["condition"] == "CC3-CC4", "phase"]) == {"test"}
    whole = Selection(learner="random", condition="CC3", phase="train")
    found = selected(units, whole, "solved")
    assert len(found) == 6


def test_attempts_are_counted_up_to_the_first_solution_and_from_there():
    """Of a trial without a solution there is none to count from, and a unit is left out."""
    rows = {"unit": [0, 1, 2], "attempts": [9.0, 30.0, 30.0], "first_solution": [2.0, 5.0, 30.0]}
    same = {"learner": "x", "condition": "CC3", "protocol": "human", "judged": True, "trials": 1}
    units = pd.DataFrame(rows).assign(found=[1.0, 0.5, 0.0], **same)
    asked = Selection(learner="x", condition="CC3")
    after, saved = (selected(units, asked, f"{one}after_first") for one in ("", "saved_"))
    assert after.to_dict() == {0: 7.0, 1: 25.0}
    assert saved.values.tolist() == [-5.0, -20.0]
    with pytest.raises(EvidenceError, match="after_first"):
        selected(units.assign(found=0.0), asked, "after_first")


# -- what no longer fits --------------------------------------------------------------------------


def test_a_forged_number_of_a_page_is_found(ran):
    page = ran.parent / "page.md"
    page.write_text(page.read_text().replace("[2.00]", "[1.99]"))
    (fault,) = check(ran)
    assert str(page) in fault
    page.write_text(page.read_text() + "\nIt took 17 attempts.\n")
    write(ran)
    (fault,) = check(ran)
    line = page.read_text().split("It took")[0].count("\n") + 1
    assert fault.startswith(f"{page}:{line}: ")
    assert "17" in fault


@pytest.mark.parametrize("name", ["README.md", "verdicts.csv"])
def test_a_written_file_that_was_changed_is_found_and_written_again(ran, name):
    path = ran / "small" / name
    first = path.read_bytes()
    path.write_bytes(first.replace(b"0", b"1", 1))
    assert [str(path) in fault for fault in check(ran)] == [True]
    path.unlink()
    assert [str(path) in fault for fault in check(ran)] == [True]
    write(ran)
    assert path.read_bytes() == first


def test_damaged_units_are_found_and_nothing_is_written_from_them(ran):
    before = (ran / "small" / "verdicts.csv").read_bytes()
    path = ran / "small" / "units.parquet"
    content = path.read_bytes()
    middle = len(content) // 2
    flipped = content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
    for damaged in (flipped, content + b"x"):
        path.write_bytes(damaged)
        with pytest.raises(EvidenceError, match=r"units\.parquet is damaged"):
            read_units(read_study(ran / "small"))
        assert any("units.parquet is damaged" in fault for fault in check(ran))
        write(ran)
        assert (ran / "small" / "verdicts.csv").read_bytes() == before


def test_units_of_another_run_are_found(ran, tmp_path):
    other = shutil.copytree(ran.parent, tmp_path / "other") / "evidence"
    change(other, "experiment.yaml", "subjects: 6", "subjects: 5")
    shutil.rmtree(other.parent / "results")
    run(other)
    shutil.copyfile(other / "small" / "units.parquet", ran / "small" / "units.parquet")
    assert any("run.json is of another run" in fault for fault in check(ran))


def test_an_experiment_that_changed_since_its_run_is_found(ran):
    change(ran, "experiment.yaml", "name:", "# A comment changes nothing.\nname:")
    assert not check(ran)
    change(ran, "experiment.yaml", "subjects: 6", "subjects: 7")
    assert any("has changed since it was run" in fault for fault in check(ran))
    assert not Evidence(read_study(ran / "small")).complete


def test_a_run_under_another_seed_is_not_mixed_in(ran):
    before = (ran / "small" / "run.json").read_bytes()
    change(ran, "experiment.yaml", "subjects: 6", "subjects: 6\nseed: 7")
    with pytest.raises(StoreError, match="another experiment"):
        run(ran)
    assert (ran / "small" / "run.json").read_bytes() == before
    assert any("has changed since it was run" in fault for fault in check(ran))


def test_a_schema_that_changed_is_another_declaration(root):
    schema = root / "small" / "mine.yaml"
    schema.write_text("name: mine\nlevers: [a, b]\nedges: {a: [b], b: [door]}\n")
    change(root, "experiment.yaml", "CC3,", "mine.yaml,")
    before = read_study(root / "small").declared
    schema.write_text("name: mine\nlevers: [a, b]\nedges: {a: [door], b: [door]}\n")
    assert read_study(root / "small").declared != before


def test_a_margin_that_was_changed_after_the_run_stays_marked(ran):
    assert "after the run" not in Evidence(read_study(ran / "small")).block("claims")
    change(ran, "study.yaml", "smallest: 1}", "smallest: 0.1}")
    change(ran, "study.yaml", "  faster:", "  late:")
    for subjects in (6, 7):  # also when more is run
        change(ran, "experiment.yaml", "subjects: 6", f"subjects: {subjects}")
        found = Evidence(run(ran))
        assert "**does not hold**; changed after the run" in found.block("claims")
        assert (found.late("like_people"), found.late("late")) == ("changed", "stated")


def test_a_block_without_an_end_is_a_fault_and_loses_nothing(ran):
    page = ran.parent / "page.md"
    text = PAGE.replace("<!-- end of evidence -->", "Prose that stays.\n") + PAGE
    page.write_text(text)
    _, faults = write(ran)
    assert any("no end" in fault for fault in faults)
    assert page.read_text() == text


def test_numbers_that_no_evidence_gives_are_found():
    text = "It opens in .57 of `300` attempts of Figure 6 and CC4 (2018).\n| about 30% | 1,000 |\n"
    bound = '[3.75](../evidence/bayes/README.md "attempts bayes CC4") attempts\n'
    block = "<!-- evidence: a b -->\n| a | 3 |\n<!-- end of evidence -->\n"
    numbers = [number for _, number in unbound_numbers(text + bound + block)]
    assert numbers == [".57", "30%", "1,000"]


def test_a_study_with_the_seed_of_a_fit_is_at_fault(root):
    folder = root / "small"
    (folder / "fit.json").write_bytes(json_bytes({"plan": {"seed": 7}}))
    (folder / "study.yaml").write_text(f"{STUDY}fits: [fit.json]\nfitted: {{orcle: 1}}\n")
    for seed, fresh in ((6, True), (7, False), (9, False), (10, True)):
        declared = f"{EXPERIMENT}learners: [oracle, random]\nseed: {seed}\n"
        (folder / "experiment.yaml").write_text(declared)
        wrong, *same = read_study(folder).faults()
        assert "'orcle' is not played; did you mean oracle?" in wrong
        assert bool(same) != fresh
        assert all(f"seed {seed}" in one for one in same)
    (folder / "fit.json").write_text((folder / "fit.json").read_text().replace("7", "8"))
    assert any("fit.json" in fault for fault in check(root))


# -- what outlives a change of the code ------------------------------------------------------------


def test_a_published_study_stands_without_its_experiment_and_cannot_be_run(ran):
    page = (ran / "small" / "README.md").read_text()
    (ran / "small" / "experiment.yaml").write_text("learners: [removed]\n")
    assert len(check(ran)) == 1
    change(ran, "study.yaml", "hours: 0.01", 'hours: 0.01\npublished: "0.2"')
    assert write(ran) == ([ran / "small" / "README.md"], [])
    assert check(ran) == []
    kept = (ran / "small" / "README.md").read_text()
    assert kept.split("## How")[0] == page.split("## How")[0]
    assert "version 0.2" in kept
    with pytest.raises(EvidenceError, match="published with version 0"):
        run(ran)
    assert "published with version 0.2" in at_once("evidence", "--folder", ran).stdout


def test_a_study_says_which_results_it_was_played_with_if_others_are_given_now(ran):
    rewrite(ran, versions={"causal-openlock": "0.1.0+4"})
    write(ran)
    for page in (ran / "small" / "README.md", ran.parent / "page.md"):
        assert page.read_text().count("Played with results of 0.1.") == 1
    said = at_once("evidence", "--folder", ran, "--check")
    assert (said.status, said.stdout.splitlines()) == (0, [
        "1 study: Played with results of 0.1.",
        "all numbers and verdicts follow from the stored units",
    ])  # fmt: skip


def test_a_declaration_that_is_written_otherwise_is_stamped_if_records_are_equal(ran, tmp_path):
    before = tmp_path / "before"
    shutil.copytree(ran, before / "evidence")
    for code in ("causal_openlock", "learners", "schemas"):
        (before / code).symlink_to(ROOT / code)
    asked = ["evidence", "--stamp", "small", "--before", before, "--reason", "It has a new word."]
    assert "nothing to stamp" in at_once(*asked, cwd=ran.parent).stderr
    rewrite(ran, declared="written otherwise")
    changed = (ran / "small" / "run.json").read_bytes()
    change(before / "evidence", "experiment.yaml", "name:", "seed: 7\nname:")
    refused = at_once(*asked, cwd=ran.parent)
    assert "oracle acts otherwise" in refused.stderr
    assert (ran / "small" / "run.json").read_bytes() == changed
    change(before / "evidence", "experiment.yaml", "seed: 7\n", "")
    done = at_once(*asked, cwd=ran.parent)
    assert done.status == 0, done.stderr
    assert check(ran) == []
    assert "otherwise since: It has a new word." in (ran / "small" / "README.md").read_text()
    cells = played(ran)
    assert at_once("evidence", "small", cwd=ran.parent).status == 0
    assert played(ran) == cells


# -- runs -----------------------------------------------------------------------------------------


def stopped_run(root, monkeypatch):
    """A run that is stopped after its first cell."""
    play = running.play

    def stop(standing):
        if standing.done:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("causal_openlock.running.workers.LOOK_EVERY", 0.0)
        patched.setattr(
            running, "play", lambda *asked, **how: play(*asked, **{**how, "progress": stop})
        )
        with pytest.raises(KeyboardInterrupt):
            run(root)
    return read_study(root / "small")


def test_a_run_that_was_stopped_keeps_what_was_measured(root, monkeypatch):
    study = stopped_run(root, monkeypatch)
    assert not read_run(study)["complete"]
    assert read_run(study)["cells"] == "1 of 4"
    assert Evidence(study).text("claim faster verdict") == "undecided"
    run(root)
    assert read_run(study)["complete"]
    assert Evidence(study).text("claim faster verdict") == "holds"


@pytest.mark.parametrize("subjects_of_a_cell", [1, 40])
def test_a_run_is_completed_on_a_machine_without_its_results(root, monkeypatch, subjects_of_a_cell):
    change(root, "experiment.yaml", "cell_size: 6", f"cell_size: {subjects_of_a_cell}")
    study = stopped_run(root, monkeypatch)
    shutil.rmtree(root.parent / "results")
    run(root)
    (part,) = read_run(study)["parts"].values()
    assert len(played(root)) == len(part["cells"]) - 1
    completed = read_units(study)
    shutil.rmtree(root.parent / "results")
    run(root)  # has nothing to play
    assert not played(root)
    pd.testing.assert_frame_equal(read_units(study), completed)
    run(root, anew=True)
    by = ["learner", "condition", "phase", "trial", "unit"]
    ordered = [table.sort_values(by, ignore_index=True) for table in (read_units(study), completed)]
    pd.testing.assert_frame_equal(*ordered)
    assert len(played(root)) == len(part["cells"])


def test_a_learner_that_is_added_leaves_the_others_as_they_are(ran):
    before = read_units(read_study(ran / "small"))
    shutil.rmtree(ran.parent / "results")
    change(ran, "experiment.yaml", "[oracle, random]", "[oracle, ideal]")
    (ran / "small" / "study.yaml").write_text(
        "title: Small\nexperiment: experiment.yaml\nhours: 1\n"
    )
    units = read_units(run(ran))
    assert {path.name.split("_")[0] for path in played(ran)} == {"ideal"}
    assert set(units["learner"]) == {"oracle", "ideal"}
    kept, same = (table[table["learner"] == "oracle"] for table in (units, before))
    pd.testing.assert_frame_equal(kept.reset_index(drop=True), same.reset_index(drop=True))


NETWORKS = """
title: Two kinds of networks
experiment: experiment.yaml
hours: 0.01
networks:
  command: python {train} {{file}} {{seed}} {{out}}
  files: {{first: first.yaml, second: second.yaml}}
  seeds: [1, 2]
  learner: rl2
"""


@pytest.fixture
def networks(tmp_path):
    """A study of networks; a training copies the shipped one."""
    shipped = ROOT / "learners" / "openlock_learners" / "checkpoints" / "rl2.npz"
    train = tmp_path / "train.py"
    train.write_text(f"import shutil, sys\nshutil.copyfile({str(shipped)!r}, sys.argv[3])\n")
    folder = tmp_path / "evidence" / "small"
    folder.mkdir(parents=True)
    (folder / "study.yaml").write_text(NETWORKS.format(train=train))
    (folder / "experiment.yaml").write_text(EXPERIMENT + "learners: [rl2]\n")
    for name in ("first", "second"):
        (folder / f"{name}.yaml").write_text("actions: 1\n")
    (tmp_path / "evidence" / "pages.yaml").write_text("results: []\n")
    return tmp_path / "evidence"


def test_networks_are_trained_once_and_each_is_a_unit(networks):
    said = []

    def trainings():
        """Run it, and count what is trained."""
        said.clear()
        watched = Watched(said.append, workers=0)
        run_study(read_study(networks / "small"), networks.parent / "results", watched)
        return len([one for one in said if one.startswith("training")])

    assert trainings() == 4
    study = read_study(networks / "small")
    units = read_units(study)
    both = {(name, seed) for name in ("first", "second") for seed in (1, 2)}
    assert {*units[["learner", "unit"]].itertuples(index=False, name=None)} == both
    assert set(units["trials"]) == {6}
    shutil.rmtree(networks.parent / "results")
    assert trainings() == 0
    pd.testing.assert_frame_equal(read_units(study), units)
    change(networks, "study.yaml", "seeds: [1, 2]", "seeds: [1, 2, 3]")
    assert not Evidence(read_study(networks / "small")).complete
    change(networks, "study.yaml", "seeds: [1, 2, 3]", "seeds: [1, 2]")
    declared = (networks / "small" / "study.yaml").read_text()
    change(networks, "study.yaml", "rl2\n", "rl2\n  parameters: {variant: {reset: trial}}\n")
    assert trainings() == 2  # of the first kind, for its variant
    assert len(read_units(study)) == len(units) * 3 / 2  # the stored ones are still there
    assert set(read_units(study)["learner"]) == {"first", "second", "variant"}
    (networks / "small" / "study.yaml").write_text(declared)
    (networks / "small" / "second.yaml").write_text("actions: 2\n")
    (fault,) = (one for one in check(networks) if "changed" in one)
    assert "networks" in fault


def test_a_training_that_fails_is_refused_with_its_last_words(networks):
    (networks.parent / "train.py").write_text("raise SystemExit('no such schema')\n")
    with pytest.raises(EvidenceError, match="no such schema"):
        run(networks)


# -- figures --------------------------------------------------------------------------------------


def test_a_figure_is_drawn_of_the_stored_units(root):
    with (root / "small" / "study.yaml").open("a") as file:
        file.write("figures: [attempts]\n")
    run(root)
    write(root)
    figure = root / "small" / "attempts.svg"
    first = figure.read_text()
    assert "(evidence/small/attempts.svg)" in (root.parent / "page.md").read_text()
    assert not check(root)
    for spoiled in ("", first.replace("</svg>", "<text>forged</text></svg>")):
        figure.write_text(spoiled)
        (fault,) = check(root)
        assert fault.startswith(f"{figure} ")
        write(root)
        assert figure.read_text() == first
    change(root, "study.yaml", "columns: [CC3 trial 1, ", "columns: [")
    assert any(fault.startswith(f"{figure} ") for fault in check(root))
    write(root)
    assert figure.read_text() != first


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
    evidence, figure = Evidence(run(root)), Figure()
    units = evidence.own_units
    parts = units.groupby(["condition", "phase"])["part"].unique().map(list)
    assert parts.to_dict() == {
        ("CC4", "train"): [1, 2, 3],  # the last one of five trials
        ("CC3-CC4", "train"): [1],
        ("CC3-CC4", "test"): [1, 2],
    }
    assert (units.loc[units["phase"] == "test", "attempts"] == 3).all()
    draw_course(evidence, evidence.study.file.tables["CC4"], figure)
    (axes,) = figure.axes
    own = [line for line in axes.lines if line.get_linestyle() == "-"]
    assert [line.get_xdata().tolist() for line in own] == [[25, 75, 125]] * 4 + [[25, 75]] * 4
    baseline, transfer = (line for line in axes.lines if line.get_linestyle() == "--")
    assert (baseline.get_xdata().tolist(), baseline.get_ydata().tolist()) == ([25, 125], [632, 307])
    assert transfer.get_ydata().tolist() == [120, 61]


def test_a_table_has_the_attempts_of_training_before():
    evidence = Evidence(read_study(ROOT / "evidence" / "default"))
    head, _, *rows = evidence.block("in_short").splitlines()
    last = {row.split("|")[1].strip(): row.split("|")[-2].strip() for row in rows if "|" in row}
    assert "training before" in head.split("|")[-2]
    assert (last["`rl2`"], last["`bayes`"], last["*people*"]) == ("1,674,240", "0", "–")

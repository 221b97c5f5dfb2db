"""Studies: what is kept of a run, what follows, and what no longer fits is found."""

from __future__ import annotations

import shutil
from pathlib import Path

import pandas as pd
import pytest
from matplotlib.figure import Figure
from typer.testing import CliRunner

import causal_openlock.evidence.running as running
from causal_openlock.cli import app
from causal_openlock.errors import EvidenceError, FileError, StoreError
from causal_openlock.evidence.checking import check, write
from causal_openlock.evidence.figures import draw_course
from causal_openlock.evidence.keeping import Watched
from causal_openlock.evidence.measured import Evidence
from causal_openlock.evidence.pages import unbound_numbers
from causal_openlock.evidence.running import run_study
from causal_openlock.evidence.study import Selection, read_studies, read_study
from causal_openlock.evidence.study_files import read_run, read_units
from causal_openlock.evidence.units import selected
from causal_openlock.fitting.kept import keep_fit
from support.places import ROOT

pytestmark = pytest.mark.slow

EXPERIMENT = "name: small\nsubjects: 3\ncell_size: 3\nconditions: [CC3, CC3-CC4]\n"
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
def root(tmp_path: Path) -> Path:
    """A folder of one study, and a page that takes numbers from it."""
    folder = tmp_path / "evidence" / "small"
    folder.mkdir(parents=True)
    (folder / "study.yaml").write_text(STUDY)
    (folder / "experiment.yaml").write_text(EXPERIMENT + "learners: [oracle, random]\n")
    (tmp_path / "page.md").write_text(PAGE)
    (tmp_path / "evidence" / "pages.yaml").write_text("results: [../page.md]\n")
    return tmp_path / "evidence"


def run(root: Path) -> None:
    (study,) = read_studies(root)
    run_study(study, root.parent / "results", Watched(workers=0))


def test_a_study_that_was_not_run_is_undecided(root: Path) -> None:
    found = Evidence(read_study(root / "small"))
    assert found.text("claim faster verdict") == "undecided"
    assert "not run yet" in found.block("claims")
    assert "fifths of the tests | **undecided** | not run yet |" in found.block("verdicts")
    with pytest.raises(EvidenceError, match="has not been run; run it with: causal-openlock ev"):
        found.text("attempts oracle CC3")


def test_what_is_written_follows_from_what_was_measured(root: Path) -> None:
    run(root)
    changed, faults = write(root)
    assert changed
    assert not faults
    assert not check(root)
    page = (root.parent / "page.md").read_text()
    assert '[2.00](evidence/small/README.md "attempts oracle CC3")' in page
    assert "| People | – | – | 5.53 | – |" in page
    assert "| Oracle | 2.00 | 2.00 | 3.00 | 3 |" in page
    assert "[How it was measured](evidence/small/README.md)" in page
    verdicts = (root / "small" / "verdicts.csv").read_text()
    assert "faster,CC3-CC4,solved,less,0.0,-0.8" in verdicts
    assert "like_people,CC3-CC4,attempts,same" in verdicts
    readme = (root / "small" / "README.md").read_text()
    assert "**holds**" in readme
    assert "all of it was run" in readme
    assert write(root) == ([], [])


def test_a_study_says_from_how_many_units_on_it_can_decide(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = root / "small" / "study.yaml"
    assert not Evidence(read_study(study.parent)).too_few()  # nothing is known
    study.write_text(STUDY.replace("smallest: 1}", "smallest: 1, spread: 2.5}"))
    (line,) = Evidence(read_study(study.parent)).too_few()
    assert line == "like_people is open with 3 subjects; 134 can decide it"
    said = CliRunner().invoke(app, ["evidence", "--folder", str(root)]).stdout
    assert f"not run)\n  {line}\n" in said
    study.write_text(STUDY.replace("minus: 0.8", "minus: 0.2"))
    run(root)
    monkeypatch.setattr(Evidence, "verdict", lambda *_: "undecided")
    assert Evidence(read_study(study.parent)).too_few()[0].startswith("faster is open with 3 ")


def test_studies_with_a_misspelt_learner_are_listed_and_refused_in_a_sentence(root: Path) -> None:
    study = root / "small" / "study.yaml"
    study.write_text(STUDY.replace("learner: oracle, condition", "learner: orcale, condition"))
    done = CliRunner().invoke(app, ["evidence", "--folder", str(root)])
    assert (done.exit_code, done.exception) == (0, None)
    assert "not run)" in done.stdout
    with pytest.raises(EvidenceError, match="'orcale' is not played; did you mean oracle"):
        run(root)


def test_verdicts_have_a_row_for_each_claim_or_for_those_named(root: Path) -> None:
    run(root)
    found = Evidence(read_study(root / "small"))
    rows = found.block("verdicts").splitlines()[2:]
    faster, like_people = rows
    assert "| **holds** | CC3-CC4: −.80 from .80 (−.80 to −.09), n = 3 |" in faster
    assert "; 90%: " in like_people  # which decides a claim that two are the same
    assert found.block("verdicts like_people").splitlines()[2:] == [like_people]
    with pytest.raises(EvidenceError, match="has no claim 'fastest'; did you mean faster"):
        found.block("verdicts fastest")


def test_the_units_are_the_subjects(root: Path) -> None:
    run(root)
    units = read_units(read_study(root / "small"))
    assert len(units) == 2 * 3 * (5 + 7)  # learners, subjects, trials
    judged = units[units["judged"]]
    assert set(judged.loc[judged["condition"] == "CC3", "trial"]) == {5}
    assert set(judged.loc[judged["condition"] == "CC3-CC4", "phase"]) == {"test"}


def test_a_page_that_says_something_else_is_found(root: Path) -> None:
    run(root)
    write(root)
    page = root.parent / "page.md"
    page.write_text(page.read_text().replace("[2.00]", "[1.99]"))
    (fault,) = check(root)
    assert fault.endswith("write it again with: causal-openlock evidence --write")
    page.write_text(page.read_text() + "\nIt took 17 attempts.\n")
    write(root)
    (fault,) = check(root)
    line = page.read_text().split("It took")[0].count("\n") + 1
    assert fault.startswith(f"{page}:{line}: no evidence gives 17")


def test_an_experiment_that_changed_since_is_found(root: Path) -> None:
    run(root)
    write(root)
    experiment = root / "small" / "experiment.yaml"
    experiment.write_text("# A comment changes nothing.\n" + experiment.read_text())
    assert not check(root)
    experiment.write_text(experiment.read_text().replace("subjects: 3", "subjects: 4"))
    faults = check(root)
    assert any("or what it names, has changed since it was run" in fault for fault in faults)
    assert not Evidence(read_study(root / "small")).complete


def test_damaged_units_are_found(root: Path) -> None:
    run(root)
    path = root / "small" / "units.parquet"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(EvidenceError, match="damaged"):
        read_units(read_study(root / "small"))


def stopped_run(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that is stopped after its first cell."""
    play = running.play

    def stopped(experiment: object, *rest: object, **options: object) -> None:
        def done(*_: object) -> None:
            raise KeyboardInterrupt

        play(experiment, *rest, done=done, **options)  # type: ignore[arg-type]

    with monkeypatch.context() as patched:
        patched.setattr(running, "play", stopped)
        with pytest.raises(KeyboardInterrupt):
            run(root)


def test_a_run_that_was_stopped_keeps_what_was_measured(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped_run(root, monkeypatch)
    study = read_study(root / "small")
    assert not read_run(study)["complete"]
    assert read_run(study)["cells"] == "1 of 4"
    assert Evidence(study).text("claim faster verdict") == "undecided"
    run(root)
    assert read_run(study)["complete"]
    assert Evidence(study).text("claim faster verdict") == "holds"


@pytest.mark.parametrize("subjects_of_a_cell", [1, 40])
def test_what_was_measured_elsewhere_is_completed(
    root: Path, monkeypatch: pytest.MonkeyPatch, subjects_of_a_cell: int
) -> None:
    experiment = root / "small" / "experiment.yaml"
    text = experiment.read_text().replace("cell_size: 3", f"cell_size: {subjects_of_a_cell}")
    experiment.write_text(text)
    stopped_run(root, monkeypatch)
    shutil.rmtree(root.parent / "results")
    run(root)
    study = read_study(root / "small")
    (part,) = read_run(study)["parts"].values()
    played = list((root.parent / "results" / "cells" / "played" / "cells").glob("*.parquet"))
    assert len(played) == len(part["cells"]) - 1
    completed = read_units(study)
    shutil.rmtree(root.parent / "results")
    run(root)  # has nothing to play
    assert not list((root.parent / "results").rglob("*.parquet"))
    pd.testing.assert_frame_equal(read_units(study), completed)
    run_study(study, root.parent / "results", Watched(workers=0), anew=True)
    by = ["learner", "condition", "phase", "trial", "unit"]
    ordered = [table.sort_values(by, ignore_index=True) for table in (read_units(study), completed)]
    pd.testing.assert_frame_equal(*ordered)
    assert len(list((root.parent / "results").rglob("*.parquet"))) == len(part["cells"])


def test_a_learner_that_is_added_leaves_the_others_as_they_are(root: Path) -> None:
    run(root)
    before = read_units(read_study(root / "small"))
    shutil.rmtree(root.parent / "results")
    experiment = root / "small" / "experiment.yaml"
    experiment.write_text(experiment.read_text().replace("[oracle, random]", "[oracle, ideal]"))
    (root / "small" / "study.yaml").write_text(
        "title: Small\nexperiment: experiment.yaml\nhours: 1\n"
    )
    run(root)
    played = list((root.parent / "results").rglob("*.parquet"))
    assert {path.name.split("_")[0] for path in played} == {"ideal"}
    units = read_units(read_study(root / "small"))
    assert set(units["learner"]) == {"oracle", "ideal"}
    kept, same = (table[table["learner"] == "oracle"] for table in (units, before))
    pd.testing.assert_frame_equal(kept.reset_index(drop=True), same.reset_index(drop=True))


def test_networks_are_trained_and_each_is_a_unit(tmp_path: Path) -> None:
    shipped = (
        Path(running.__file__).parents[2]
        / "learners"
        / "openlock_learners"
        / "checkpoints"
        / "rl2.npz"
    )
    train = tmp_path / "train.py"
    train.write_text(f"import shutil, sys\nshutil.copyfile({str(shipped)!r}, sys.argv[3])\n")
    folder = tmp_path / "evidence" / "networks"
    folder.mkdir(parents=True)
    (folder / "study.yaml").write_text(NETWORKS.format(train=train))
    (folder / "experiment.yaml").write_text(EXPERIMENT + "learners: [rl2]\n")
    for name in ("first", "second"):
        (folder / f"{name}.yaml").write_text("actions: 1\n")
    said: list[str] = []
    run_study(read_study(folder), tmp_path / "results", Watched(said.append, workers=0))
    units = read_units(read_study(folder))
    assert {(*row,) for row in units[["learner", "unit"]].to_numpy().tolist()} == {
        ("first", 1),
        ("first", 2),
        ("second", 1),
        ("second", 2),
    }
    assert set(units["trials"]) == {3}
    assert said[0].startswith("training first, seed 1; its progress is in ")
    told = len(said)
    shutil.rmtree(tmp_path / "results")
    run_study(read_study(folder), tmp_path / "results", Watched(said.append, workers=0))
    assert len(said) == told  # nothing is trained again
    pd.testing.assert_frame_equal(read_units(read_study(folder)), units)
    study = folder / "study.yaml"
    declared = study.read_text()
    study.write_text(declared.replace("seeds: [1, 2]", "seeds: [1, 2, 3]"))
    assert not Evidence(read_study(folder)).complete
    study.write_text(declared + "  parameters: {variant: {reset: trial}}\n")
    run_study(read_study(folder), tmp_path / "results", Watched(said.append, workers=0))
    kept = read_units(read_study(folder))
    assert len(kept) == len(units) * 3 / 2  # and the networks that were stored are still there
    assert len(said) == told + 2 * 2  # the first kind is trained again, for its variant
    study.write_text(declared + "  parameters: {variant: {greedy: true}}\n")
    with pytest.raises(StoreError, match="holds another experiment"):
        run_study(read_study(folder), tmp_path / "results", Watched(said.append, workers=0))
    assert set(read_units(read_study(folder))["learner"]) == {"first", "second"}
    assert not Evidence(read_study(folder)).complete
    study.write_text(declared)
    (folder / "second.yaml").write_text("actions: 2\n")
    (tmp_path / "evidence" / "pages.yaml").write_text("results: []\n")
    (fault,) = (one for one in check(tmp_path / "evidence") if "changed" in one)
    assert "networks" in fault


def test_a_training_that_fails_is_one_sentence(tmp_path: Path) -> None:
    folder = tmp_path / "networks"
    folder.mkdir()
    train = tmp_path / "train.py"
    train.write_text("raise SystemExit('no such schema')\n")
    (folder / "study.yaml").write_text(NETWORKS.format(train=train))
    (folder / "experiment.yaml").write_text(EXPERIMENT + "learners: [rl2]\n")
    for name in ("first", "second"):
        (folder / f"{name}.yaml").write_text("actions: 1\n")
    with pytest.raises(EvidenceError, match=r"the training .* failed: no such schema"):
        run_study(read_study(folder), tmp_path / "results", Watched(workers=0))


def test_a_figure_is_of_what_is_stored(root: Path) -> None:
    study = root / "small" / "study.yaml"
    study.write_text(STUDY + "figures: [attempts]\n")
    run(root)
    write(root)
    figure = root / "small" / "attempts.svg"
    first = figure.read_text()
    page = (root.parent / "page.md").read_text()
    assert "![A small study: attempts, every subject](evidence/small/attempts.svg)" in page
    assert not check(root)
    figure.unlink()
    assert check(root) == [
        f"{figure} is not what was measured; write it again with: causal-openlock evidence --write"
    ]
    write(root)
    assert figure.read_text() == first
    figure.write_text(first.replace("</svg>", "<text>forged</text></svg>"))
    assert any(fault.startswith(f"{figure} is not what") for fault in check(root))
    write(root)
    assert figure.read_text() == first
    study.write_text(study.read_text().replace("columns: [CC3 trial 1, ", "columns: ["))
    assert any(fault.startswith(f"{figure} is not what") for fault in check(root))
    write(root)
    assert figure.read_text() != first


def test_a_figure_of_a_course_has_a_line_for_each_unit(root: Path) -> None:
    folder = root / "small"
    (folder / "experiment.yaml").write_text(
        "name: small\nsubjects: 3\nconditions: [CC4, CE4]\nlearners: [random]\nprotocol: short\n"
        "protocols: {short: {based_on: rl, baseline_loops: 2, attempt_limit: 10}}\n"
    )
    (folder / "study.yaml").write_text(
        "title: A course\nexperiment: experiment.yaml\nmeasured: course\nhours: 0.01\n"
        "tables:\n  opens:\n    measure: opens\n    columns: [part 1, part 2, part 5]\n"
        "    rows: {paper_ddqn CC4: Paper, random CC4: Random, random CE4: Random}\n"
        "figures: [opens]\n"
    )
    run(root)
    figure = Figure()
    evidence = Evidence(read_study(folder))
    draw_course(evidence, evidence.study.file.tables["opens"], figure)
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles == ["paper ddqn", "random"]
    published, own = ([line.get_xdata().tolist() for line in a.lines] for a in figure.axes)
    assert published == [[1, 2, 5]]
    assert own == [[1, 2, 5]] * 2 * (3 + 1)  # of each condition the subjects, and their mean


def test_a_curve_has_means_of_fifty_trials_and_the_published_curve_in_its_panel(root: Path) -> None:
    folder = root / "small"
    (folder / "experiment.yaml").write_text(
        "name: small\nsubjects: 3\nconditions: [CC4, CC3-CC4]\n"
        "learners: [{learner: oracle, name: a2c}]\n"
        "protocol: short\nprotocols:\n"
        "  short: {based_on: rl_2020, baseline_loops: 21, train_loops: 1, test_loops: 20}\n"
    )
    (folder / "study.yaml").write_text(
        "title: A curve\nexperiment: experiment.yaml\nmeasured: curve\nhours: 0.01\n"
        "tables:\n  CC4:\n    measure: attempts\n    columns: [part 1, part 2, part 3]\n"
        "    rows: {a2c CC4: A, a2c CC3-CC4 test: B, paper_a2c CC4: C, paper_a2c CC3-CC4 test: D}\n"
    )
    run(root)
    evidence = Evidence(read_study(folder))
    units = evidence.own_units
    parts = units.groupby(["condition", "phase"])["part"].unique().map(list)
    assert parts.to_dict() == {
        ("CC4", "train"): [1, 2, 3],  # the last one of five trials
        ("CC3-CC4", "train"): [1],
        ("CC3-CC4", "test"): [1, 2],
    }
    assert (units.loc[units["phase"] == "test", "attempts"] == 3).all()
    figure = Figure()
    draw_course(evidence, evidence.study.file.tables["CC4"], figure)
    (axes,) = figure.axes
    own = [line for line in axes.lines if line.get_linestyle() == "-"]
    assert [line.get_xdata().tolist() for line in own] == [[25, 75, 125]] * 4 + [[25, 75]] * 4
    baseline, transfer = (line for line in axes.lines if line.get_linestyle() == "--")
    assert (baseline.get_xdata().tolist(), baseline.get_ydata().tolist()) == ([25, 125], [632, 307])
    assert transfer.get_ydata().tolist() == [120, 61]
    assert baseline.get_color() != transfer.get_color()


def test_a_table_says_with_how_many_attempts_learners_were_trained_before(root: Path) -> None:
    evidence = Evidence(read_study(ROOT / "evidence" / "default"))
    head, _, *rows = evidence.block("in_short").splitlines()
    assert head.split(" | ")[-1] == "attempts of training before |"
    last = {row.split("|")[1].strip(): row.split("|")[-2].strip() for row in rows if "|" in row}
    assert (last["`rl2`"], last["`bayes`"], last["*people*"]) == ("1,674,240", "0", "–")

    (root / "small" / "study.yaml").write_text(STUDY + "    trained_before: true\n")
    with pytest.raises(FileError, match="attempts: trained_before needs derived: learning_costs"):
        read_study(root / "small")


def test_a_figure_of_no_table_is_refused(root: Path) -> None:
    (root / "small" / "study.yaml").write_text(STUDY + "figures: [attemps]\n")
    with pytest.raises(FileError, match="there is no table attemps; did you mean attempts"):
        read_study(root / "small")


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("It opens in .57 of `300` attempts of Figure 6 and CC4 (2018).", [".57"]),
        ("About 30% and 1,000 subjects.", ["30%", "1,000"]),
        ("```\n17\n```\n", []),
        ('[3.75](../evidence/bayes/README.md "attempts bayes CC4") attempts', []),
        ("| a | 3 |\n", ["3"]),
        ("<!-- evidence: a b -->\n| a | 3 |\n<!-- end of evidence -->", []),
        ("the four rooms of [a page](page2.md#part-3)", []),
    ],
)
def test_numbers_that_no_evidence_gives(text: str, found: list[str]) -> None:
    assert [number for _, number in unbound_numbers(text)] == found


@pytest.mark.parametrize(
    ("title", "sentence"),
    [
        ("attempts oracle CC9", "no unit has been run with condition CC9"),
        ("attempts nobody CC3", "no unit has been run with learner nobody"),
        ("atempts oracle CC3", "did you mean attempts"),
        ("claim fastr", "faster"),
        ("attempts oracle CC3 trial", "needs a number after it"),
        ("attempts oracle parameter a<->b", "needs a name after it"),
        ("attempts oracle CC3 CC3-CC4", "names two of condition"),
        ("attempts people CC3-CC4 sd", "not known"),
        ("claim", "does not begin with"),
        ("derived", "does not begin with"),
        (" ", "does not begin with"),
        ("attempts oracle CC3 verdict", "not a claim"),
    ],
)
def test_a_title_that_means_nothing_is_explained(root: Path, title: str, sentence: str) -> None:
    run(root)
    with pytest.raises(EvidenceError, match=sentence):
        Evidence(read_study(root / "small")).text(title)


def test_a_study_file_with_a_mistake_names_the_line(root: Path) -> None:
    study = root / "small" / "study.yaml"
    study.write_text(STUDY.replace("expected: less", "expected: fewer"))
    with pytest.raises(FileError, match=r"study.yaml:10"):
        read_study(root / "small")


def test_a_study_in_the_rooms_of_a_fit_is_refused(root: Path) -> None:
    folder = root / "small"
    keep_fit(folder / "fit.json", {"seed": 7})
    (folder / "study.yaml").write_text(f"{STUDY}fits: [fit.json]\nfitted: {{orcle: 1}}\n")
    for seed, fresh in ((6, True), (7, False), (9, False), (10, True)):
        declared = f"{EXPERIMENT}learners: [oracle, random]\nseed: {seed}\n"
        (folder / "experiment.yaml").write_text(declared)
        wrong, *same = read_study(folder).faults()
        assert wrong.startswith("fitted: 'orcle' is not played; did you mean oracle?")
        assert bool(same) != fresh
        assert all(f"fit.json played with the seed {seed} of this study" in one for one in same)
    (folder / "fit.json").write_text((folder / "fit.json").read_text().replace("7", "8"))
    assert any("this is not a fit" in fault for fault in check(root))


def test_no_folder_is_told_apart_from_one_without_studies(root: Path) -> None:
    with pytest.raises(EvidenceError, match=r"no folder .*nowhere here; run this in a checkout"):
        read_studies(root / "nowhere")
    with pytest.raises(EvidenceError, match="small holds no study; name the folder of evidence"):
        read_studies(root / "small")


def test_what_was_run_under_another_seed_is_not_kept(root: Path) -> None:
    run(root)
    before = (root / "small" / "run.json").read_bytes()
    experiment = root / "small" / "experiment.yaml"
    experiment.write_text(experiment.read_text() + "seed: 7\n")
    with pytest.raises(StoreError, match="holds another experiment"):
        run(root)
    assert (root / "small" / "run.json").read_bytes() == before
    assert any("has changed since it was run" in fault for fault in check(root))


def test_a_schema_that_changed_is_found(root: Path) -> None:
    schema = root / "small" / "mine.yaml"
    schema.write_text("name: mine\nlevers: [a, b]\nedges: {a: [b], b: [door]}\n")
    experiment = root / "small" / "experiment.yaml"
    experiment.write_text(experiment.read_text().replace("CC3,", "mine.yaml,"))
    (study,) = read_studies(root)
    before = study.declared
    schema.write_text("name: mine\nlevers: [a, b]\nedges: {a: [door], b: [door]}\n")
    (changed,) = read_studies(root)
    assert changed.declared != before


def test_less_does_not_replace_more(root: Path) -> None:
    run(root)
    before = (root / "small" / "run.json").read_bytes()
    for cell in (root.parent / "results" / "cells" / "played" / "cells").glob("*.parquet"):
        cell.unlink()
        break
    (study,) = read_studies(root)
    assert not running.keep(study, root.parent / "results", {})
    assert (root / "small" / "run.json").read_bytes() == before
    assert running.keep(study, root.parent / "results")  # with what is stored of that cell
    assert read_run(study)["complete"]
    assert len(read_units(study)) == 2 * 3 * (5 + 7)


def test_units_of_another_run_are_refused(root: Path) -> None:
    run(root)
    other = root.parent / "other"
    shutil.copytree(root, other)
    experiment = other / "small" / "experiment.yaml"
    experiment.write_text(experiment.read_text().replace("subjects: 3", "subjects: 2"))
    (study,) = read_studies(other)
    run_study(study, root.parent / "other_results", Watched(workers=0))
    shutil.copyfile(other / "small" / "units.parquet", root / "small" / "units.parquet")
    assert any("run.json is of another run" in fault for fault in check(root))


def test_a_margin_that_was_changed_after_the_run_is_marked(root: Path) -> None:
    run(root)
    assert "after the run" not in Evidence(read_study(root / "small")).block("claims")
    study = root / "small" / "study.yaml"
    study.write_text(study.read_text().replace("smallest: 1}", "smallest: 0.1}"))
    assert "**undecided**; changed after the run" in Evidence(read_study(root / "small")).block(
        "claims"
    )


def test_a_claim_that_was_stated_late_stays_marked_when_more_is_run(root: Path) -> None:
    run(root)
    study = root / "small" / "study.yaml"
    study.write_text(study.read_text().replace("  like_people:", "  late:"))
    experiment = root / "small" / "experiment.yaml"
    text = experiment.read_text().replace("subjects: 3", "subjects: 6")
    experiment.write_text(text)
    run(root)
    found = Evidence(read_study(root / "small"))
    assert (found.late("late"), found.late("faster")) == ("stated", "")


def test_attempts_to_the_first_solution_are_no_share(root: Path) -> None:
    run(root)
    written = Evidence(read_study(root / "small")).text("first_solution random CC3 interval")
    low, high = (float(end) for end in written.split(" to "))
    assert 1 < low <= 30 <= high


def test_attempts_are_counted_up_to_the_first_solution_and_from_there() -> None:
    """Of a trial without a solution there is none to count from, and a unit is left out."""
    rows = {"unit": [0, 1, 2], "attempts": [9.0, 30.0, 30.0], "first_solution": [2.0, 5.0, 30.0]}
    same = {"learner": "x", "condition": "CC3", "protocol": "human", "judged": True, "trials": 1}
    units = pd.DataFrame(rows).assign(found=[1.0, 0.5, 0.0], **same)
    asked = Selection(learner="x", condition="CC3")
    after, saved = (selected(units, asked, f"{one}after_first") for one in ("", "saved_"))
    assert (after.units.tolist(), after.values.tolist()) == ([0, 1], [7.0, 25.0])
    assert (after.least, after.most) == (0.0, 30.0)
    assert saved.values.tolist() == [-5.0, -20.0]
    assert (saved.least, saved.most) == (-30.0, 30.0)
    with pytest.raises(EvidenceError, match="after_first was not measured of x"):
        selected(units.assign(found=0.0), asked, "after_first")


def test_what_a_solution_cost_is_measured_where_a_claim_asks_for_it(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = root / "small"
    with monkeypatch.context() as before:  # as units were stored before there was this measure
        before.setattr("causal_openlock.evidence.units.SOLUTIONS", ())
        run(root)
    shutil.rmtree(root.parent / "results")
    units = read_units(read_study(study))
    assert read_study(study).stored() <= set(units)
    with pytest.raises(EvidenceError, match="second was not measured of oracle"):
        Evidence(read_study(study)).text("second oracle CC3")
    asks = "  later:\n    text: It pays later\n    contrasts:\n      CC3: {measure: second, "
    asks += "of: {learner: random, condition: CC3-CC4}, minus: 40.0, expected: less}\n"
    text = (study / "study.yaml").read_text().replace("tables:", f"{asks}tables:")
    (study / "study.yaml").write_text(text)
    assert not read_study(study).stored() <= set(units)
    run(root)
    found = Evidence(read_study(study))
    assert found.text("second oracle CC3") == "1.00"
    third = selected(
        read_units(read_study(study)), Selection(learner="oracle", condition="CC3-CC4"), "third"
    )
    assert (third.values.tolist(), third.least, third.most) == ([1.0] * 3, 1.0, 30.0)


def test_all_trials_behind_a_mean_are_counted(root: Path) -> None:
    run(root)
    units = read_units(read_study(root / "small"))
    whole = Selection(learner="random", condition="CC3", phase="train")
    found = selected(units, whole, "solved")
    assert (len(found.values), found.trials) == (3, 3 * 5)


@pytest.mark.parametrize(
    "text",
    [
        "- a\n    - 3.4 times",
        "## 30% solved",
        "```{note}\nIt solves 57%.\n```",
        "After 2000 attempts",
        "It falls by .1. Then",
        "Figure 6 and 30 others",
        "__57__ of them",
        "½ of them",
        "[3.75](../evidence/bayes/README.md 'attempts bayes CC4')",
        '[3.75](../evidence/bayes/README.md  "attempts bayes CC4")',
        '[3.75][r]\n\n[r]: ../evidence/bayes/README.md "attempts bayes CC4"',
        "<p>It opens in .99</p>",
    ],
)
def test_numbers_cannot_hide(text: str) -> None:
    assert unbound_numbers(text)


def test_a_block_without_an_end_is_a_fault_and_loses_nothing(root: Path) -> None:
    run(root)
    page = root.parent / "page.md"
    text = PAGE.replace("<!-- end of evidence -->", "Prose that stays.\n") + PAGE
    page.write_text(text)
    _, faults = write(root)
    assert any("a block of evidence has no end" in fault for fault in faults)
    assert page.read_text() == text


@pytest.mark.parametrize(
    ("before", "after", "sentence"),
    [
        ("learner: oracle, condition: CC3-CC4}", "learner: orcale, condition: CC3-CC4}", "oracle"),
        (
            "learner: oracle, condition: CC3-CC4}",
            "learner: oracle, condition: CC4}",
            "'CC4' is not",
        ),
        ("measure: attempts, of", "measure: opens, of", "'opens' is not played"),
    ],
)
def test_a_claim_about_what_is_not_played_is_found_before_anything_runs(
    root: Path, before: str, after: str, sentence: str
) -> None:
    study = root / "small" / "study.yaml"
    study.write_text(STUDY.replace(before, after, 1))
    assert any(sentence in fault for fault in check(root))
    with pytest.raises(EvidenceError, match=sentence):
        run(root)
    assert not (root.parent / "results").exists()


def test_a_damaged_file_is_a_fault_and_nothing_is_written_from_it(root: Path) -> None:
    run(root)
    write(root)
    before = (root / "small" / "verdicts.csv").read_bytes()
    with (root / "small" / "units.parquet").open("ab") as file:
        file.write(b"x")
    assert any("units.parquet is damaged" in fault for fault in check(root))
    write(root)
    assert (root / "small" / "verdicts.csv").read_bytes() == before


def test_a_mark_stays_when_more_is_run(root: Path) -> None:
    run(root)
    study, experiment = (root / "small" / name for name in ("study.yaml", "experiment.yaml"))
    study.write_text(study.read_text().replace("smallest: 1}", "smallest: 0.1}"))
    experiment.write_text(experiment.read_text().replace("subjects: 3", "subjects: 4"))
    run(root)
    assert "**undecided**; changed after the run" in Evidence(read_study(root / "small")).block(
        "claims"
    )

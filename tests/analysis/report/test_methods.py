"""The methods section of a paper: everything that a reader needs, from results alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from ruamel.yaml import YAML

import causal_openlock as ol
from causal_openlock.analysis.report.methods import Methods, _described, methods
from causal_openlock.analysis.results.material import Material
from causal_openlock.contract.registry import create, origin, registry
from causal_openlock.experiment.experiment import LearnerSpec, Origin, origin_of
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.world.rewards import find_reward
from support.command import at_once
from support.made_up_experiments import stored
from support.places import ROOT
from support.played_results import played

VAULT = ol.Schema(
    "vault", ["a", "b", "c", "d"], {"a": ["door"], "b": ["c"], "c": ["d"], "d": ["door"]},
    gates={"door": ol.Gate("all")},
)  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    slow = ol.learner("tabular_q", learning_rate=0.3, label="slow")
    where = tmp_path_factory.mktemp("methods") / "mine"
    ol.compare(["CC3-CC4", VAULT], ["oracle", "random", slow], subjects=2, seed=7, out=where,
               workers=0)  # fmt: skip
    return where


def test_a_folder_has_all_that_is_needed(folder: Path) -> None:
    results = ol.open_results(folder)
    text = results.methods()
    task, learners, measure, software, cite = text.split("\n\n")
    assert "conditions were CC3-CC4 (6 training trials, then 1 test trial) and vault" in task
    assert "Schemas other than that paper's: vault (a, d → door; b → c; c → d; door needs" in task
    assert "at most 3 actions in rooms of CC3 and CC4 and 5 actions in rooms of vault" in task
    assert "A trial had at most 30 attempts and ended when every solution was found" in task
    assert "There were n = 2 subjects of each learner in each condition." in learners
    assert "oracle and random had their default parameters." in learners
    assert "slow is tabular_q" in learners
    assert "default parameters except learning_rate 0.3." in learners
    assert "oracle was told what subjects cannot perceive" in learners
    assert "people (Edmonds et al., 2018; n = 40)" in measure
    assert "Holm" in measure
    assert "the seed 7, " in software
    for name, version in results.experiment.versions.items():
        assert f"{name} {version}" in software
    assert "Edmonds, M., Kubricht, J." in cite


def test_the_command_prints_the_same_and_writes_nothing(folder: Path) -> None:
    before = sorted(folder.rglob("*"))
    done = at_once("report", folder, "--methods")
    assert (done.status, done.stderr) == (0, "")
    assert done.stdout.strip() == ol.open_results(folder).methods()
    assert sorted(folder.rglob("*")) == before


def test_the_command_refuses_a_second_folder_with_it(folder: Path) -> None:
    done = at_once("report", folder, folder, "--methods")
    assert done.status == 2
    assert (
        "--methods is about one comparison; leave out the other, --out and --figures" in done.stderr
    )


def test_a_notebook_shows_paragraphs(folder: Path) -> None:
    text = ol.open_results(folder).methods()
    assert isinstance(text, Methods)
    assert text._repr_markdown_() == text


def changed(**of_first: object) -> Material:
    """Two learners in CC4, the first of them changed."""
    made = played(["random", "oracle"], ["CC4"], 2)
    first, *others = made.experiment.learners
    learners = (replace(first, **of_first), *others)
    return replace(made, experiment=stored(replace(made.experiment, learners=learners)))


def test_training_before_the_experiment_is_named_with_what_it_means() -> None:
    trained = Origin("openlock_learners.random:RandomLearner", origin("random"), "", 1200)
    text = methods(changed(recorded=trained))
    assert "random was trained for 1,200 attempts before the experiment" in text
    assert "its subjects share this training" in text
    assert "was trained" not in methods(changed())


def test_of_a_learner_that_is_not_here_all_parameters_are_given_and_no_code_is_run() -> None:
    text = methods(
        changed(
            learner="nowhere:Mine",
            parameters={"rate": 0.5, "sizes": [64, 64]},
            recorded=Origin("nowhere:Mine", "nowhere.py 0a1b2c"),
        )
    )
    words = "random is nowhere:Mine (nowhere.py 0a1b2c) with the parameters rate 0.5, sizes"
    assert words in text


def test_of_another_version_of_a_learner_all_parameters_are_given_too() -> None:
    one = spec("tabular_q", Origin("openlock_learners.tabular_q:TabularQ", "causal-openlock 0.1"))
    assert not _described(one)["knows_defaults"]
    assert "epsilon" in _described(one)["parameters"]


def test_budgets_are_told_by_learner_where_they_differ() -> None:
    text = methods(changed(protocol=PROTOCOLS["rl"]))
    assert "For random (protocol rl), a trial had 300 attempts, also after every" in text
    assert "For oracle (protocol human), a trial had at most 30 attempts" in text


def test_missing_cells_and_unequal_numbers_of_subjects_are_told() -> None:
    made = changed()
    experiment = stored(made.experiment, missing=("x",), files=("x", "y", "z"))
    fewer = made.trials[(made.trials["learner"] != "oracle") | (made.trials["subject"] == 0)]
    text = methods(replace(made, experiment=experiment, trials=fewer))
    assert "1 of 3 cells were not played and are missing from all results." in text
    assert "Subjects in each condition: n = 2 for random; n = 1 for oracle." in text


def test_what_to_cite_is_what_the_citation_file_says() -> None:
    held = YAML(typ="safe").load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    text = methods(changed())
    paper = held.get("preferred-citation") or held["references"][0]
    assert f"({paper['year']}). {paper['title']}." in text
    assert f"{held['title']} (version {held['version']}) [computer software]" in text


def spec(name: str, recorded: Origin | None = None) -> LearnerSpec:
    """A learner as an experiment with its defaults has it, read back."""
    made = ol.make_experiment(["CC4"], [name], subjects=1).learners[0]
    assert made.reward == find_reward("paper")
    known = recorded or origin_of(name, made.parameters)
    return replace(made, recorded=known)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted({*registry()} - {"llm", "sb3"}))
def test_defaults_count_as_defaults_after_they_were_written_and_read(name: str) -> None:
    create(name)
    made = replace(played(["random"], ["CC4"], 1).experiment, learners=(spec(name),))
    (read,) = stored(made).learners
    described = _described(read)
    assert described["knows_defaults"]
    assert described["parameters"] == ""

"""The methods section of a paper, from results alone."""

from dataclasses import replace

import pytest
from ruamel.yaml import YAML

import causal_openlock as ol
from causal_openlock.analysis.report.methods import methods
from causal_openlock.contract.registry import create, registry
from causal_openlock.experiment.origin import Origin
from support.made_up_experiments import stored
from support.masks import masked
from support.places import ROOT
from support.played_results import played
from support.whole_report import whole_material


def test_methods_of_a_made_up_experiment_of_every_case(golden):
    text = masked(methods(whole_material()), more={r"<version>\+\d+": "<version>"})
    golden("methods.txt", text)


def test_what_to_cite_is_in_the_citation_file():
    held = YAML(typ="safe").load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    paper = held["preferred-citation"]
    told = f"({paper['year']}), {paper['title'].rstrip('.')}, CogSci"
    assert told in methods(played(["oracle"], ["CC4"], 2))


def test_a_learner_of_another_version_has_all_its_parameters_named():
    results = played(["tabular_q"], ["CC4"], 2)
    here = "with default parameters"
    assert here in methods(results)
    (spec,) = results.experiment.learners
    old = replace(spec, recorded=replace(spec.origin, package="causal-openlock 0.1"))
    gone = replace(spec, learner="nowhere:Mine", recorded=Origin("nowhere:Mine", "nowhere.py 0a1"))
    for other, package in ((old, "causal-openlock 0.1"), (gone, "nowhere.py 0a1")):
        text = methods(replace(results, experiment=replace(results.experiment, learners=(other,))))
        assert here not in text
        assert f" of {package} with the parameters" in text
        assert "epsilon" in text


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted({*registry()} - {"llm", "sb3"}))
def test_defaults_count_as_defaults_after_they_were_written_and_read(name):
    create(name)
    results = played(["random"], ["CC4"], 1)
    made = ol.make_experiment(["CC4"], [ol.learner(name, label="random")], subjects=1)
    text = methods(replace(results, experiment=stored(made)))
    assert "with default parameters." in text
    assert "except" not in text

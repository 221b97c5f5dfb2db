"""Sweeps: a learner once for each value of a parameter, in files and in Python."""

import numpy as np

import causal_openlock as ol
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.making import Changes

GRID = "sweep: {lapse: [0.0, 0.1], policy: [thompson, solve_and_learn]}"
POLICIES = ("thompson", "solve_and_learn")
LABELS = [f"bayes-lapse-{lapse}-policy-{policy}" for lapse in ("0", "0.1") for policy in POLICIES]


def read(folder, learners, changes=None):
    path = folder / "e.yaml"
    path.write_text(f"name: e\nconditions: [CC3]\nlearners:\n  - random\n  - {learners}\n")
    return read_experiment(path, changes)


def names(parts):
    return [part.name for part in parts]


def test_a_file_and_a_program_declare_the_same_grid(tmp_path):
    entry = f"{{learner: bayes, parameters: {{noise: 0.2}}, subjects: 3, {GRID}}}"
    in_file = read(tmp_path, entry).learners
    swept = ol.sweep("bayes", lapse=[0.0, 0.1], policy=POLICIES, noise=0.2, subjects=3)
    for given in (["random", *swept], ["random", swept]):
        assert ol.make_experiment(["CC3"], given).learners == in_file
    assert names(in_file) == ["random", *LABELS]
    values = [(spec.parameters["lapse"], spec.parameters["policy"]) for spec in in_file[1:]]
    assert values == [(lapse, policy) for lapse in (0.0, 0.1) for policy in POLICIES]
    assert {(spec.parameters["noise"], spec.subjects) for spec in in_file[1:]} == {(0.2, 3)}


def test_labels_show_values_as_they_are_written():
    swept = ol.sweep("bayes", label="mine", lapse=np.linspace(0, 0.3, 4), strength_alpha=[1e-9])
    assert [entry["name"] for entry in swept][1::2] == [
        "mine-lapse-0.1-strength_alpha-1e-09",
        "mine-lapse-0.3-strength_alpha-1e-09",
    ]
    assert ol.sweep("win_stay", grey_only=[True])[0]["name"] == "win_stay-grey_only-True"
    (own,) = ol.sweep(ol.learner("bayes", noise=0.2), lapse=[0.1])
    assert own["parameters"] == {"noise": 0.2, "lapse": 0.1}


def test_a_sweep_or_one_of_its_learners_can_be_chosen_by_name(tmp_path):
    def chosen(entry, name):
        return read(tmp_path, entry, Changes(learners=[name]))

    entry, every = f"{{learner: bayes, name: b, {GRID}}}", [f"b{label[5:]}" for label in LABELS]
    assert names(chosen(entry, "b").learners) == every
    single = chosen(entry, every[2])
    assert names(single.learners) == [every[2]]
    assert single.command.endswith(f"e.yaml --learner {every[2]}")
    two = "{learner: bayes, sweep: {lapse: [0.1]}}\n  - {learner: bayes, sweep: {noise: [0.2]}}"
    assert names(chosen(two, "bayes").learners) == ["bayes-lapse-0.1", "bayes-noise-0.2"]

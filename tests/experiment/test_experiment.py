"""Experiment files: what they mean, how they are cut into cells, and how faults are told.

What faults there are stands in ``tests/refusals/experiment.txt``.
"""

import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from causal_openlock.contract.registry import learner_class, registry
from causal_openlock.errors import FileError
from causal_openlock.experiment.condition import PAPER_CONDITIONS, Condition, find_condition
from causal_openlock.experiment.making import (
    Changes,
    find_experiment,
    learner,
    make_experiment,
    read_experiment,
    sweep,
)
from causal_openlock.experiment.plan import forewarnings
from causal_openlock.files.yaml_file import dump_yaml
from causal_openlock.schemas.finding import find_schema
from causal_openlock.schemas.graphs import write_schema
from causal_openlock.storage.store import parse_experiment
from support.any_experiment import experiments

SMALL = """\
name: small
seed: 7
subjects: 5
cell_size: 2
conditions: [CC3, CC3-CE4]
learners:
  - random
  - {learner: ddqn, name: slow, parameters: {learning_rate: 0.0001}, subjects: 3}
"""


def written(folder, text, name="experiment.yaml"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def names(parts):
    return [part.name for part in parts]


@settings(max_examples=25, deadline=None)
@given(experiments())
def test_an_experiment_is_the_same_from_its_file_and_from_its_folder(drawn):
    with tempfile.TemporaryDirectory() as folder:
        for schema in drawn.schemas:
            write_schema(schema, Path(folder, "schemas", f"{schema.name}.yaml"))
        path = written(Path(folder), dump_yaml(drawn.as_file()))
        assert read_experiment(path).identity == drawn.identity
    kept = {"identity": drawn.identity, **drawn.as_dict(), "cells": []}
    assert parse_experiment(json.loads(json.dumps(kept))).as_dict() == drawn.as_dict()


def test_cells_cover_every_subject_of_every_learner_and_condition_once(tmp_path):
    cells = read_experiment(written(tmp_path, SMALL)).cells()
    assert [(c.spec.name, c.condition.name, c.first_subject, c.subjects) for c in cells] == [
        *(("random", "CC3", first, many) for first, many in [(0, 2), (2, 2), (4, 1)]),
        *(("random", "CC3-CE4", first, many) for first, many in [(0, 2), (2, 2), (4, 1)]),
        *(("slow", "CC3", first, many) for first, many in [(0, 2), (2, 1)]),
        *(("slow", "CC3-CE4", first, many) for first, many in [(0, 2), (2, 1)]),
    ]
    assert len({cell.file_name for cell in cells}) == 10


def test_a_cell_is_another_cell_as_soon_as_anything_that_matters_changes(tmp_path):
    def identities(text):
        return [cell.identity for cell in read_experiment(written(tmp_path, text)).cells()]

    before = identities(SMALL)
    assert identities(SMALL + "title: another title\n") == before
    # The seed, the reward and the protocol concern every cell; a parameter, its learner's.
    for text in ("reward: basic\n", "protocol: rl\n"):
        assert not {*identities(SMALL + text)} & {*before}
    assert not {*identities(SMALL.replace("seed: 7", "seed: 8"))} & {*before}
    slower = identities(SMALL.replace("0.0001", "0.0002"))
    assert [a == b for a, b in zip(before, slower, strict=True)] == [True] * 6 + [False] * 4
    # More subjects leave the full cells as they are.
    more = identities(SMALL.replace("subjects: 5", "subjects: 6"))
    assert {*before} - {*more} == {before[2], before[5]}
    # Nor does it matter whether the size of a cell is that of all or its learner's own.
    alone = SMALL.replace("subjects: 3", "subjects: 3, cell_size: 1")
    own = identities(alone)
    assert [own[:6], len(own)] == [before[:6], 12]
    assert own[6:] == identities(alone.replace("cell_size: 2", "cell_size: 1"))[-6:]


def test_a_condition_has_many_forms_and_the_name_of_its_schemas(tmp_path):
    cc3, folder = find_schema("CC3"), tmp_path / "my-own-schemas"
    folder.mkdir()
    path = written(folder, "name: one\nlevers: [A]\nedges: {A: [door]}\n", "with-dashes.yaml")
    written(folder, find_schema("CE4").to_yaml(), "CC3-CC4.yaml")
    made = make_experiment(cc3, learner("random"), subjects=np.int64(3))  # no lists
    assert (made.title, made.command) == ("random in CC3", "")
    (baseline,) = made.conditions
    assert find_condition("CC3") == baseline == Condition("", baseline.train)
    for name, train, test, *forms in (
        ("CC3", ["CC3"], [], "CC3", cc3, [cc3], {"train": "CC3"}),
        ("CC3-CC4", ["CC3"], ["CC4"], "CC3-CC4", [cc3, "CC4"], {"train": "CC3", "test": "CC4"}),
        ("CC3-CE3-CC4", ["CC3", "CE3"], ["CC4"], ["CC3", "CE3", "CC4"]),
        ("one", ["one"], [], path, str(path), "one: A -> door"),
        ("CC3-one", ["CC3"], ["one"], ("CC3", path)),
        ("one-CC3", ["one"], ["CC3"], (str(path), "CC3")),
        ("CE4", ["CE4"], [], f"{folder}/CC3-CC4.yaml"),  # a file of the whole name comes first
        ("own", ["CC3"], [], {"name": "own", "train": [{"schema": "CC3"}]}),
        ("shown-CC3-CC4", ["CC3"], ["CC4"], "shown-CC3-CC4"),
        ("shown-CC3-CC4", ["CC3"], ["CC4"], {"train": {"shown": "CC3"}, "test": "CC4"}),
        ("own", ["CC3"], ["CC4"], {"name": "own", "train": {"shown": "CC3"}, "test": "CC4"}),
    ):
        for form in forms:
            (condition,) = make_experiment([form], ["random"]).conditions
            assert condition.name == name, form
            assert names(group.schema for group in condition.train) == train
            assert names(group.schema for group in condition.test) == test
            assert condition.shown == ("shown" in str(form))


def test_faults_of_meaning_come_together_each_with_its_line(tmp_path):
    text = """\
name: e
protocol: humn
conditions:
  - CC44
  - {name: own, train: [{schema: CC9}, {schema: CC3, layouts: [trial7, trial99]}]}
learners:
  - bays
  - {learner: bayes, parameters: {lapse: 3, beta: x}, reward: papr}
  - learner: bayes
    name: swept
    sweep: {lapse: [0.1, 2.0], polcy: [a]}
  - random
  - random
protocols: {short: {based_on: rll}, shorter: {based_on: short}}
"""
    with pytest.raises(FileError) as caught:
        read_experiment(written(tmp_path, text))
    said = [
        *((2, "humn"), (4, "CC44"), (5, "CC9"), (5, "trial7"), (5, "trial99"), (7, "bays")),
        *((8, "lapse"), (8, "beta"), (8, "papr"), (11, "lapse"), (11, "polcy"), (13, "random")),
        (14, "rll"),
    ]
    for fault, (line, word) in zip(caught.value.faults, said, strict=True):
        assert fault.line == line
        assert word in fault.message


@pytest.mark.parametrize("line", ["", "name: 3\n"])
def test_a_file_with_no_name_has_no_other_fault(line, tmp_path):
    with pytest.raises(FileError) as caught:
        read_experiment(written(tmp_path, f"{line}conditions: [CC3]\nlearners: [random]\n"))
    (fault,) = caught.value.faults
    assert "name" in fault.message


def test_trials_with_more_solutions_than_attempts_are_warned_about():
    def warnings(attempt_limit):
        made = make_experiment(["two_of_four", "CC3"], "random", attempt_limit=attempt_limit)
        return forewarnings(made)

    (warning,) = warnings(5)
    for word in ("two_of_four", "6 solutions", "5 attempts"):
        assert word in warning
    assert not warnings(6)


def test_prompt_tokens_of_a_language_model_are_estimated_before_it_plays():
    def tokens(**parameters):
        asked = learner("llm", model="m", **parameters)
        made = make_experiment(["CC3-CC4"], [asked, "random"], subjects=10)
        (warning,) = forewarnings(made)
        return [number for number in warning.replace(",", "").split() if number.isdigit()]

    # Three actions in 6 * 2 + 3 attempts at least, in 7 * 30 at most.
    each = [1000 * actions + 40 * actions**2 for actions in (45, 630)]
    assert tokens() == [str(10 * number) for number in each]
    assert int(tokens(recent=20)[1]) < 10 * 2600 * 630


def test_the_command_line_changes_what_the_file_says(tmp_path):
    path = written(tmp_path, SMALL)
    changes = Changes(conditions=["CE4"], learners=["slow", "oracle"], subjects=2, seed=1)
    experiment = read_experiment(path, changes)
    assert (names(experiment.conditions), experiment.seed) == (["CE4"], 1)
    assert names(experiment.learners) == ["slow", "oracle"]
    assert experiment.learners[0].parameters["learning_rate"] == 0.0001
    assert {spec.subjects for spec in experiment.learners} == {2}
    zero = read_experiment(path, Changes(seed=0))
    assert (zero.seed, zero.cell_size, zero.learners[0].subjects) == (0, 2, 5)
    text = SMALL.replace("subjects: 3}", "protocol: human}").replace(
        "[CC3,", "[{name: mix, train: [{schema: CE3}]},"
    )
    chosen = read_experiment(written(tmp_path, text), Changes(conditions=["mix"], protocol="rl"))
    assert names(chosen.conditions) == ["mix"]
    assert {spec.protocol.name for spec in chosen.learners} == {"rl"}


def test_a_choice_of_ones_own_has_a_name_and_a_command_that_say_what_it_is(tmp_path):
    """What is not what the file declares does not go by the file's name."""
    text = "name: mine\nconditions: [CC3, CE3, CC4, CE4]\nlearners: [random, oracle, bayes]\n"
    path = written(tmp_path, text)
    transfers = ["CC3-CC4", "CC3-CE4", "CE3-CC4", "CE3-CE4"]
    crowd = ["random", "oracle", "ideal", "bayes", "ddqn"]
    for learners, conditions, name in (
        ([], [], "mine"),
        (["oracle", "random"], ["CC3-CC4"], "oracle_random_in_CC3-CC4"),
        ([], ["CC4"], "random_oracle_bayes_in_CC4"),
        (["oracle"], [], "oracle_in_CC3_CE3_CC4_CE4"),
        (crowd, transfers, "5_learners_in_4_conditions"),
    ):
        chosen = read_experiment(path, Changes(conditions or None, learners or None, "rl", seed=1))
        options = [f"--condition {condition}" for condition in conditions]
        options += [f"--learner {learner}" for learner in learners]
        words = ["causal-openlock compare", str(path), *options, "--protocol rl --seed 1"]
        assert (chosen.name, chosen.command) == (name, " ".join(words))
    assert chosen.title.startswith("random, oracle, ideal")
    assert read_experiment(path, Changes(conditions=[find_schema("CC4")])).command == ""


GRID = "sweep: {lapse: [0.0, 0.1], policy: [thompson, solve_and_learn]}"
POLICIES = ("thompson", "solve_and_learn")
LABELS = [f"bayes-lapse-{lapse}-policy-{policy}" for lapse in ("0", "0.1") for policy in POLICIES]


def swept_file(folder, entry):
    return written(folder, f"name: e\nconditions: [CC3]\nlearners:\n  - random\n  - {entry}\n")


def test_a_file_and_a_program_declare_the_same_grid(tmp_path):
    entry = f"{{learner: bayes, parameters: {{noise: 0.2}}, subjects: 3, {GRID}}}"
    in_file = read_experiment(swept_file(tmp_path, entry)).learners
    swept = sweep("bayes", lapse=[0.0, 0.1], policy=POLICIES, noise=0.2, subjects=3)
    for learners in (["random", *swept], ["random", swept]):
        assert make_experiment(["CC3"], learners).learners == in_file
    assert names(in_file) == ["random", *LABELS]
    values = [(spec.parameters["lapse"], spec.parameters["policy"]) for spec in in_file[1:]]
    assert values == [(lapse, policy) for lapse in (0.0, 0.1) for policy in POLICIES]
    assert {(spec.parameters["noise"], spec.subjects) for spec in in_file[1:]} == {(0.2, 3)}


def test_labels_show_values_as_they_are_written():
    swept = sweep("bayes", label="mine", lapse=np.linspace(0, 0.3, 4), noise=[1e-9])
    assert [entry["name"] for entry in swept][1::2] == [
        "mine-lapse-0.1-noise-1e-09",
        "mine-lapse-0.3-noise-1e-09",
    ]
    assert sweep("theory_based", top_down=[True])[0]["name"] == "theory_based-top_down-True"
    (own,) = sweep(learner("bayes", noise=0.2), lapse=[0.1])
    assert own["parameters"] == {"noise": 0.2, "lapse": 0.1}
    assert learner(learner_class("bayes"))["learner"] == "bayes"  # as a file names it


def test_a_sweep_or_one_of_its_learners_can_be_chosen_by_name(tmp_path):
    def chosen(entry, name):
        return read_experiment(swept_file(tmp_path, entry), Changes(learners=[name]))

    entry, every = f"{{learner: bayes, name: b, {GRID}}}", [f"b{label[5:]}" for label in LABELS]
    assert names(chosen(entry, "b").learners) == every
    single = chosen(entry, every[2])
    assert names(single.learners) == [every[2]]
    assert single.command.endswith(f"experiment.yaml --learner {every[2]}")
    for faulty in (
        "{sweep: {lapse: [0.1]}}",
        "{learner: bayes, name: 3, parameters: 3, sweep: {1: [2]}}",
    ):
        assert names(chosen(faulty, "random").learners) == ["random"]  # and the fault is no matter
    two = "{learner: bayes, sweep: {lapse: [0.1]}}\n  - {learner: bayes, sweep: {noise: [0.2]}}"
    assert names(chosen(two, "bayes").learners) == ["bayes-lapse-0.1", "bayes-noise-0.2"]


@pytest.mark.parametrize(
    ("name", "without"), [("default", {"sb3", "llm"}), ("paper_human", {"llm"})]
)
def test_every_learner_plays_where_people_were(name, without):
    experiment = read_experiment(find_experiment(name))
    ours = {name for name, entry in registry().items() if entry.module.startswith("openlock_")}
    # What is left out needs a server, or an extra.
    assert {spec.learner for spec in experiment.learners} == ours - without
    assert {spec.protocol.name for spec in experiment.learners} == {"human"}
    if name == "default":
        assert tuple(names(experiment.conditions)) == PAPER_CONDITIONS
        assert all(spec.subjects >= 10 for spec in experiment.learners)
    else:
        assert {spec.subjects for spec in experiment.learners} == {40}

"""Experiment files: what they mean, how they are cut into cells, and how faults are told.

What faults there are stands in ``tests/refusals/experiment.txt``.
"""

import numpy as np
import pytest

from causal_openlock.contract.registry import registry
from causal_openlock.errors import FileError
from causal_openlock.experiment.declare import (
    PAPER_CONDITIONS,
    find_condition,
)
from causal_openlock.experiment.file import find_experiment, read_experiment
from causal_openlock.experiment.making import Changes, learner, make_experiment
from causal_openlock.schemas.finding import find_schema

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
GATE = """\
name: gate
levers: [A, B]
edges: {A: [door], B: [door]}
gates: {door: all}
"""


def written(folder, text, name="experiment.yaml"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def identities(path):
    return [cell.identity for cell in read_experiment(path).cells()]


# -- cells -----------------------------------------------------------------------------------------


def test_cells_cover_every_subject_of_every_learner_and_condition_once(tmp_path):
    cells = [*read_experiment(written(tmp_path, SMALL)).cells()]
    assert [(c.spec.name, c.condition.name, c.first_subject, c.subjects) for c in cells] == [
        *(("random", "CC3", first, many) for first, many in [(0, 2), (2, 2), (4, 1)]),
        *(("random", "CC3-CE4", first, many) for first, many in [(0, 2), (2, 2), (4, 1)]),
        *(("slow", "CC3", first, many) for first, many in [(0, 2), (2, 1)]),
        *(("slow", "CC3-CE4", first, many) for first, many in [(0, 2), (2, 1)]),
    ]
    assert len({cell.file_name for cell in cells}) == 10


def test_a_cell_is_another_cell_as_soon_as_anything_that_matters_changes(tmp_path):
    def changed(text):
        return identities(written(tmp_path, text))

    before = changed(SMALL)
    assert changed(SMALL) == changed(SMALL + "title: another title\n") == before
    # The seed, the reward and the protocol concern every cell; a parameter, its learner's.
    for text in (
        *(SMALL + "reward: basic\n", SMALL + "protocol: rl\n"),
        SMALL.replace("seed: 7", "seed: 8"),
    ):
        assert not set(changed(text)) & set(before)
    slower = changed(SMALL.replace("0.0001", "0.0002"))
    assert [a == b for a, b in zip(before, slower, strict=True)] == [True] * 6 + [False] * 4
    # More subjects leave the full cells as they are.
    more = changed(SMALL.replace("subjects: 5", "subjects: 6"))
    assert set(before) - set(more) == {before[2], before[5]}
    # Nor does it matter whether the size of a cell is that of all or its learner's own.
    alone = SMALL.replace("subjects: 3", "subjects: 3, cell_size: 1")
    own = changed(alone)
    assert [own[:6], len(own)] == [before[:6], 12]
    assert own[6:] == changed(alone.replace("cell_size: 2", "cell_size: 1"))[-6:]


# -- conditions ------------------------------------------------------------------------------------


def test_schemas_are_found_beside_the_experiment_and_where_one_works(tmp_path, monkeypatch):
    text = "name: e\nconditions: [gate, gate-CC3]\nlearners: [random]\n"
    written(tmp_path, GATE, "gate.yaml")
    (tmp_path / "elsewhere").mkdir()
    for folder in (tmp_path, tmp_path / "elsewhere"):
        conditions = read_experiment(written(folder, text)).conditions
        assert [condition.name for condition in conditions] == ["gate", "gate-CC3"]
        assert conditions[0].train[0].schema.levers == ("A", "B")
        monkeypatch.chdir(tmp_path)


def test_a_condition_can_be_any_sequence_of_schemas_and_layouts(tmp_path):
    text = """\
name: own
conditions:
  - [CC3, CE3, CC4]
  - name: sequence
    train:
      - {schema: CC3, layouts: [trial2, {L0: LEFT, L1: UPPER, L2: LOWER}], shuffle: false}
      - {schema: two_keys, layouts: random, trials: 3}
    test:
      - {schema: CE4, layouts: published, trials: 2}
learners: [random]
protocols:
  long: {based_on: human, attempt_limit: 99}
protocol: long
"""
    experiment = read_experiment(written(tmp_path, text))
    listed, condition = experiment.conditions
    assert (listed.name, len(listed.train), len(listed.test)) == ("CC3-CE3-CC4", 2, 1)
    first, second = condition.train
    assert [layout.places for layout in first.layouts] == [(3, 5, 1), (3, 1, 5)]
    assert (first.shuffle, second.layouts, second.number) == (False, "random", 3)
    assert condition.test[0].number == 2
    assert experiment.learners[0].protocol.attempt_limit == 99
    assert experiment.learners[0].protocol.stop_when_solved


def test_a_condition_in_python_has_many_forms():
    cc3 = find_schema("CC3")
    forms = {
        "CC3": ["CC3", cc3, [cc3], {"train": "CC3"}],
        "CC3-CC4": ["CC3-CC4", ["CC3", "CC4"], [cc3, "CC4"], {"train": "CC3", "test": "CC4"}],
    }
    for name, every in forms.items():
        expected = find_condition(name)
        for form in every:
            assert make_experiment([form], ["random"]).conditions == (expected,), form
    single = make_experiment(cc3, learner("random"), subjects=np.int64(3))
    assert single.conditions == (find_condition("CC3"),)
    assert [one.name for one in single.learners] == ["random"]
    assert single.title == "random in CC3"
    assert single.command == ""
    three = make_experiment([["CC3", "CE3", "CC4"]], ["random"]).conditions[0]
    assert [len(three.train), len(three.test), three.name] == [2, 1, "CC3-CE3-CC4"]
    (line,) = make_experiment("A -> B -> door", ["random"]).conditions
    assert line.train[0].schema.levers == ("A", "B")
    spelled = {"name": "own", "train": [{"schema": "CC3"}]}
    assert make_experiment(spelled, ["random"]).conditions[0].name == "own"


# -- faults ----------------------------------------------------------------------------------------


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


def test_trials_with_more_solutions_than_attempts_are_warned_about(tmp_path):
    text = "name: e\nconditions: [two_of_four, CC3]\nlearners: [random]\nprotocol: tight\n"
    text += "protocols: {tight: {attempt_limit: 5}}\n"
    (caution,) = read_experiment(written(tmp_path, text)).warnings()
    for word in ("two_of_four", "6", "tight", "5"):
        assert word in caution
    assert not read_experiment(written(tmp_path, text.replace("5}", "6}"))).warnings()


# -- changes ---------------------------------------------------------------------------------------


def test_the_command_line_changes_what_the_file_says(tmp_path):
    path = written(tmp_path, SMALL)
    changes = Changes(conditions=["CE4"], learners=["slow", "oracle"], subjects=2, seed=1)
    experiment = read_experiment(path, changes)
    assert [condition.name for condition in experiment.conditions] == ["CE4"]
    assert [entry.name for entry in experiment.learners] == ["slow", "oracle"]
    assert experiment.learners[0].parameters["learning_rate"] == 0.0001
    assert {entry.subjects for entry in experiment.learners} == {2}
    assert experiment.seed == 1
    zero = read_experiment(path, Changes(seed=0))
    assert (zero.seed, zero.cell_size, zero.learners[0].subjects) == (0, 2, 5)
    text = SMALL.replace("subjects: 3}", "protocol: human}").replace(
        "[CC3,", "[{name: mix, train: [{schema: CE3}]},"
    )
    chosen = read_experiment(written(tmp_path, text), Changes(conditions=["mix"], protocol="rl"))
    assert [condition.name for condition in chosen.conditions] == ["mix"]
    assert {entry.protocol.name for entry in chosen.learners} == {"rl"}


def test_the_command_that_runs_it_again_says_what_was_changed(tmp_path):
    path = written(tmp_path, SMALL)
    assert read_experiment(path).command == f"causal-openlock compare {path}"
    changed = read_experiment(path, Changes(conditions=["CC4", "CE4"], learners=["slow"], seed=1))
    assert changed.command == (
        f"causal-openlock compare {path} --condition CC4 --condition CE4 --learner slow --seed 1"
    )
    assert changed.title == "slow in CC4 and CE4"
    assert read_experiment(path, Changes(conditions=[find_schema("CC4")])).command == ""


def test_a_choice_of_ones_own_has_a_name_that_says_what_it_is(tmp_path):
    """What is not what the file declares does not go by the file's name."""
    text = "name: mine\nconditions: [CC3, CE3, CC4, CE4]\nlearners: [random, oracle, bayes]\n"
    path = written(tmp_path, text)

    def name(**changes):
        return read_experiment(path, Changes(**changes)).name

    assert name() == name(subjects=3, seed=2, protocol="rl") == "mine"
    assert name(learners=["oracle", "random"], conditions=["CC3-CC4"]) == "oracle_random_in_CC3-CC4"
    assert name(conditions=["CC4"]) == "random_oracle_bayes_in_CC4"
    assert name(learners=["oracle"]) == "oracle_in_CC3_CE3_CC4_CE4"
    crowd = ["random", "oracle", "ideal", "bayes", "ddqn"]
    assert name(learners=crowd, conditions=["CC3-CC4", "CC3-CE4", "CE3-CC4", "CE3-CE4"]) == (
        "5_learners_in_4_conditions"
    )


# -- what comes with the package -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "without"), [("default", {"sb3", "llm"}), ("paper_human", {"llm"})]
)
def test_every_learner_plays_where_people_were(name, without):
    experiment = read_experiment(find_experiment(name))
    ours = {name for name, one in registry().items() if one.module.startswith("openlock_")}
    # What is left out needs a server, or an extra.
    assert {entry.learner for entry in experiment.learners} == ours - without
    assert {entry.protocol.name for entry in experiment.learners} == {"human"}
    if name == "default":
        assert tuple(condition.name for condition in experiment.conditions) == PAPER_CONDITIONS
        assert all(entry.subjects >= 10 for entry in experiment.learners)
    else:
        assert {entry.subjects for entry in experiment.learners} == {40}

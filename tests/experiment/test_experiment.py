"""Experiment files: what they mean, how they are cut into cells, and what is wrong with them."""

from __future__ import annotations

from pathlib import Path

import pytest

from causal_openlock.contract.registry import registry
from causal_openlock.errors import FileError, OpenLockError
from causal_openlock.experiment.building import Changes, learner, make_experiment
from causal_openlock.experiment.file import find_experiment, read_experiment
from causal_openlock.experiment.protocol import PAPER_CONDITIONS

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


def written(folder: Path, text: str, name: str = "experiment.yaml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_cells_cover_every_subject_of_every_learner_and_condition_once(tmp_path: Path) -> None:
    experiment = read_experiment(written(tmp_path, SMALL))
    cells = [
        (c.spec.name, c.condition.name, c.first_subject, c.subjects) for c in experiment.cells()
    ]
    assert cells == [
        ("random", "CC3", 0, 2),
        ("random", "CC3", 2, 2),
        ("random", "CC3", 4, 1),
        ("random", "CC3-CE4", 0, 2),
        ("random", "CC3-CE4", 2, 2),
        ("random", "CC3-CE4", 4, 1),
        ("slow", "CC3", 0, 2),
        ("slow", "CC3", 2, 1),
        ("slow", "CC3-CE4", 0, 2),
        ("slow", "CC3-CE4", 2, 1),
    ]
    names = {cell.file_name for cell in experiment.cells()}
    assert len(names) == 10


def test_a_cell_is_another_cell_as_soon_as_anything_that_matters_changes(tmp_path: Path) -> None:
    def identities(text: str) -> list[str]:
        return [cell.identity for cell in read_experiment(written(tmp_path, text)).cells()]

    before = identities(SMALL)
    assert identities(SMALL) == before
    assert identities(SMALL + "title: another title\n") == before
    # The seed, the reward and the protocol concern every cell; a parameter, its learner's.
    for change in ("reward: basic\n", "protocol: rl\n"):
        assert not set(identities(SMALL + change)) & set(before)
    assert not set(identities(SMALL.replace("seed: 7", "seed: 8"))) & set(before)
    slower = identities(SMALL.replace("0.0001", "0.0002"))
    assert [a == b for a, b in zip(before, slower, strict=True)] == [True] * 6 + [False] * 4
    # More subjects leave the full cells as they are.
    more = identities(SMALL.replace("subjects: 5", "subjects: 6"))
    assert set(before) - set(more) == {before[2], before[5]}
    # Nor does it matter whether the size of a cell is that of all or its learner's own.
    alone = SMALL.replace("subjects: 3", "subjects: 3, cell_size: 1")
    own = identities(alone)
    assert [own[:6], len(own)] == [before[:6], 12]
    assert own[6:] == identities(alone.replace("cell_size: 2", "cell_size: 1"))[-6:]
    assert read_experiment(written(tmp_path, alone)).learners[1].cell_size == 1


def test_a_changed_schema_file_changes_the_cell(tmp_path: Path) -> None:
    schema = written(tmp_path, GATE, "gate.yaml")
    path = written(tmp_path, "name: e\nconditions: [gate.yaml]\nlearners: [random]\n")
    before = next(iter(read_experiment(path).cells())).identity
    schema.write_text(GATE.replace("all", "any"), encoding="utf-8")
    assert next(iter(read_experiment(path).cells())).identity != before


def test_schemas_are_found_beside_the_experiment_by_name_too(tmp_path: Path) -> None:
    written(tmp_path, GATE, "gate.yaml")
    path = written(tmp_path, "name: e\nconditions: [gate, gate-CC3]\nlearners: [random]\n")
    conditions = read_experiment(path).conditions
    assert [condition.name for condition in conditions] == ["gate", "gate-CC3"]
    assert conditions[0].train[0].schema.levers == ("A", "B")


def test_a_condition_can_be_any_sequence_of_schemas_and_layouts(tmp_path: Path) -> None:
    text = """\
name: own
conditions:
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
    (condition,) = experiment.conditions
    first, second = condition.train
    assert [layout.places for layout in first.layouts] == [(3, 5, 1), (3, 1, 5)]
    assert (first.shuffle, second.layouts, second.number) == (False, "random", 3)
    assert condition.test[0].number == 2
    assert experiment.learners[0].protocol.attempt_limit == 99
    assert experiment.learners[0].protocol.stop_when_solved


FAULTS = [
    ("conditions: [CC5]\nlearners: [random]", 2, 14, "did you mean CC"),
    ("conditions: [CC3-CC4-CE4]\nlearners: [random]", 2, 14, "is not a condition"),
    ("conditions: [CC3]\nlearners: [randm]", 3, 12, "did you mean random?"),
    ("conditions: [CC3]\nlearners:\n  - {learner: ddqn, parameters: {gama: 1}}", 4, 34, "gamma"),
    (
        "conditions: [CC3]\nlearners:\n  - {learner: ddqn, parameters: {gamma: 1.5}}",
        4,
        34,
        "less than or equal to 1",
    ),
    (
        "conditions: [CC3]\nlearners:\n  - {learner: ddqn, parameters: {gamma: high}}",
        4,
        34,
        "valid number",
    ),
    ("conditions: [CC3]\nlearners: [random]\nprotocol: humn", 4, 1, "did you mean human?"),
    ("conditions: [CC3]\nlearners: [random]\nreward: basik", 4, 1, "did you mean basic?"),
    ("conditions: [CC3]\nlearners: [random]\nreward: [basic, basic]", 4, 1, "listed twice"),
    ("conditions: [CC3]\nlearners: [random]\nsubjects: 0", 4, 1, "greater than or equal to 1"),
    ("conditions: [CC3]\nlearners: [random]\nsubjects: many", 4, 1, "valid integer"),
    ("conditions: [CC3]\nlearners: [random]\nsubject: 3", 4, 1, "did you mean subjects?"),
    ("conditions: [CC3, CC3]\nlearners: [random]", 2, 19, "listed twice"),
    (
        "conditions: [CC3]\nlearners: [random, random]",
        3,
        20,
        "remove one of them, or give it another name with name:",
    ),
    ("conditions: []\nlearners: [random]", 2, 1, "at least 1"),
    ("learners: [random]", 1, 1, "conditions: is missing"),
    (
        "conditions: [CC3]\nlearners: [random]\nprotocols:\n  p: {based_on: rll}",
        5,
        3,
        "did you mean rl?",
    ),
    (
        "conditions: [CC3]\nlearners: [random]\nprotocols:\n  p: {atempt_limit: 3}",
        5,
        7,
        "did you mean attempt_limit?",
    ),
    (
        "conditions:\n  - name: own\n    tests: []\n    train: [{schema: CC3}]\nlearners: [random]",
        4,
        5,
        "did you mean test?",
    ),
    (
        "conditions:\n  - name: own\n    train: [{schema: CC3, layouts: rnd}]\nlearners: [random]",
        4,
        27,
        "'published' or 'random'",
    ),
    ("conditions: [[CC3]]\nlearners: [random]", 2, 14, "write a name such as CC4"),
    ("conditions: [CC3]\nlearners: [{name: x}]", 3, 12, "learner: is missing"),
    (
        "conditions: [CC3]\nlearners: [random]\nprotocols: {human: {attempt_limit: 3}}",
        4,
        13,
        "choose another name",
    ),
    (
        "conditions:\n  - name: own\n    train:\n"
        "      - {schema: CC3, layouts: [{L0: LEFT, L1: LEFT, L2: UPPER}]}\nlearners: [random]",
        5,
        33,
        "two levers are at LEFT",
    ),
    (
        "conditions:\n  - name: own\n    train: [{schema: CC3, layouts: [trial7]}]\n"
        "learners: [random]",
        4,
        37,
        "places 4 levers",
    ),
    (
        "conditions:\n  - name: own\n    train: [{schema: CC3, layouts: [trial1], trials: 2}]\n"
        "learners: [random]",
        4,
        46,
        "2 trials of CC3 need that number of layouts",
    ),
]


@pytest.mark.parametrize(("text", "line", "column", "says"), FAULTS, ids=[f[3] for f in FAULTS])
def test_a_fault_is_one_sentence_with_line_and_column(
    tmp_path: Path, text: str, line: int, column: int, says: str
) -> None:
    path = written(tmp_path, f"name: e\n{text}\n")
    with pytest.raises(FileError) as caught:
        read_experiment(path)
    (fault,) = caught.value.faults
    assert (fault.line, fault.column) == (line, column)
    assert says in fault.message
    assert str(caught.value) == f"{path}:{line}:{column}: {fault.message}"


def test_faults_of_meaning_come_together_each_with_its_line(tmp_path: Path) -> None:
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
        (2, "no protocol 'humn'"),
        (4, "no schema 'CC44'"),
        (5, "no schema 'CC9'"),
        (5, "layouts that fit"),
        (5, "no layout 'trial99'"),
        (7, "no learner 'bays'"),
        (8, "lapse of bayes should be less"),
        (8, "beta of bayes should be a valid"),
        (8, "no reward 'papr'"),
        (11, "lapse of bayes should be less"),
        (11, "no parameter 'polcy'"),
        (13, "random is listed twice"),
        (14, "no protocol 'rll'"),
    ]
    assert [fault.line for fault in caught.value.faults] == [line for line, _ in said]
    for fault, (_, words) in zip(caught.value.faults, said, strict=True):
        assert words in fault.message


def test_faults_of_several_files_and_of_a_program_come_together(tmp_path: Path) -> None:
    schema = written(tmp_path, GATE.replace("[door]}", "[dor]}"), "gate.yaml")
    path = written(tmp_path, "name: e\nconditions: [gate.yaml, CC3-gate.yaml]\nlearners: [bays]\n")
    with pytest.raises(OpenLockError) as caught:
        read_experiment(path)
    of_schema, of_learner = str(caught.value).splitlines()  # once, although it is named twice
    assert of_schema.startswith(f"{schema}:3:")
    assert of_learner.startswith(f"{path}:3:12: there is no learner 'bays'")
    with pytest.raises(OpenLockError) as caught:
        make_experiment(["CC44", "CC4"], ["bays", learner("random")], protocol="humn")
    assert [line[:25] for line in str(caught.value).splitlines()] == [
        "there is no schema 'CC44'",
        "there is no learner 'bays",
        "there is no protocol 'hum",
    ]


def test_a_fault_in_a_schema_file_names_that_file(tmp_path: Path) -> None:
    schema = written(tmp_path, GATE.replace("[door]}", "[dor]}"), "gate.yaml")
    path = written(tmp_path, "name: e\nconditions: [gate.yaml]\nlearners: [random]\n")
    with pytest.raises(FileError) as caught:
        read_experiment(path)
    assert str(caught.value).startswith(f"{schema}:3:")


def test_two_different_schemas_of_one_name_are_refused(tmp_path: Path) -> None:
    written(tmp_path, GATE.replace("name: gate", "name: CC3"), "gate.yaml")
    path = written(tmp_path, "name: e\nconditions: [gate.yaml, CC3-CC4]\nlearners: [random]\n")
    with pytest.raises(OpenLockError, match="two different schemas are called CC3"):
        read_experiment(path)


def test_a_schema_that_the_protocol_gives_too_few_actions_is_refused_at_once(
    tmp_path: Path,
) -> None:
    text = """\
name: e
conditions: [chain3]
learners: [random]
protocol: tight
protocols: {tight: {action_limit: 3}}
"""
    with pytest.raises(OpenLockError, match="chain3 needs attempts of 4 actions"):
        read_experiment(written(tmp_path, text))


def test_trials_with_more_solutions_than_attempts_are_warned_about(tmp_path: Path) -> None:
    text = "name: e\nconditions: [two_of_four, CC3]\nlearners: [random]\nprotocol: tight\n"
    text += "protocols: {tight: {attempt_limit: 5}}\n"
    (caution,) = read_experiment(written(tmp_path, text)).warnings()
    assert caution.startswith("two_of_four has 6 solutions and protocol tight gives 5 attempts")


def test_the_command_line_changes_what_the_file_says(tmp_path: Path) -> None:
    path = written(tmp_path, SMALL)
    changes = Changes(conditions=["CE4"], learners=["slow", "oracle"], subjects=2, seed=1)
    experiment = read_experiment(path, changes)
    assert [condition.name for condition in experiment.conditions] == ["CE4"]
    assert [entry.name for entry in experiment.learners] == ["slow", "oracle"]
    assert experiment.learners[0].parameters["learning_rate"] == 0.0001
    assert {entry.subjects for entry in experiment.learners} == {2}
    assert experiment.seed == 1
    with pytest.raises(OpenLockError, match="no learner 'nobody'"):
        read_experiment(path, Changes(learners=["nobody"]))


def test_the_default_experiment_plays_every_learner_in_the_six_conditions() -> None:
    experiment = read_experiment(find_experiment("default"))
    ours = {name for name, one in registry().items() if one.module.startswith("openlock_")}
    # These are extras, and the default comparison asks for nothing that is not there.
    assert {entry.learner for entry in experiment.learners} == ours - {"sb3", "llm"}
    assert tuple(condition.name for condition in experiment.conditions) == PAPER_CONDITIONS
    assert {entry.protocol.name for entry in experiment.learners} == {"human"}
    assert all(entry.subjects >= 10 for entry in experiment.learners)


def test_every_learner_plays_where_people_were() -> None:
    experiment = read_experiment(find_experiment("paper_human"))
    ours = {name for name, one in registry().items() if one.module.startswith("openlock_")}
    assert {entry.learner for entry in experiment.learners} == ours - {
        "llm"
    }  # which needs a server
    assert {(entry.protocol.name, entry.subjects) for entry in experiment.learners} == {
        ("human", 40)
    }


def test_an_unknown_experiment_is_answered_with_the_nearest() -> None:
    with pytest.raises(OpenLockError, match=r"did you mean default\?"):
        find_experiment("defalt")


def test_schemas_in_the_working_directory_are_found_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    path = written(folder, "name: e\nconditions: [CC3]\nlearners: [random]\n")
    written(tmp_path, GATE, "gate.yaml")
    monkeypatch.chdir(tmp_path)
    experiment = read_experiment(path, Changes(conditions=["CC3-gate"]))
    assert experiment.conditions[0].test[0].schema.name == "gate"


def test_an_edited_learner_is_another_learner(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = "from causal_openlock import OneSubjectLearner\nclass Mine(OneSubjectLearner):\n"
    module = written(tmp_path, code + "    def act(self, seen):\n        return 1\n", "edited.py")
    path = written(tmp_path, "name: e\nconditions: [CC3]\nlearners: ['edited:Mine']\n")
    monkeypatch.chdir(tmp_path)
    before = next(iter(read_experiment(path).cells()))
    assert before.identity == next(iter(read_experiment(path).cells())).identity
    module.write_text(module.read_text(encoding="utf-8").replace("1", "2"), encoding="utf-8")
    assert before.identity != next(iter(read_experiment(path).cells())).identity


def test_a_spelled_out_condition_is_chosen_by_its_name(tmp_path: Path) -> None:
    text = "name: e\nconditions: [CC4, {name: mix, train: [{schema: CE3}]}]\nlearners: [random]\n"
    experiment = read_experiment(written(tmp_path, text), Changes(conditions=["mix"]))
    assert [condition.name for condition in experiment.conditions] == ["mix"]


def test_the_command_that_runs_it_again_says_what_was_changed(tmp_path: Path) -> None:
    path = written(tmp_path, SMALL)
    assert read_experiment(path).command == f"causal-openlock compare {path}"
    changed = read_experiment(path, Changes(conditions=["CC4", "CE4"], learners=["slow"], seed=1))
    assert changed.command == (
        f"causal-openlock compare {path} --condition CC4 --condition CE4 --learner slow --seed 1"
    )
    assert changed.title == "slow in CC4 and CE4"


def test_the_protocol_of_the_command_line_is_every_learners(tmp_path: Path) -> None:
    text = SMALL.replace("subjects: 3}", "protocol: human}")
    experiment = read_experiment(written(tmp_path, text), Changes(protocol="rl"))
    assert {entry.protocol.name for entry in experiment.learners} == {"rl"}


def test_a_choice_of_ones_own_has_a_name_that_says_what_it_is(tmp_path: Path) -> None:
    """What is not what the file declares does not go by the file's name."""
    text = (
        "name: mine\nconditions: [CC3, CE3, CC4, CE4]\nlearners: [random, oracle, ideal, bayes]\n"
    )
    path = written(tmp_path, text)

    def name(**changes: object) -> str:
        return read_experiment(path, Changes(**changes)).name  # type: ignore[arg-type]

    assert name() == name(subjects=3, seed=2, protocol="rl") == "mine"
    assert name(learners=["oracle", "random"], conditions=["CC3-CC4"]) == "oracle_random_in_CC3-CC4"
    assert name(conditions=["CC4"]) == "random_oracle_ideal_bayes_in_CC4"
    assert name(learners=["oracle"]) == "oracle_in_CC3_CE3_CC4_CE4"
    crowd = ["random", "oracle", "ideal", "bayes", "ddqn"]
    assert name(learners=crowd, conditions=["CC3-CC4", "CC3-CE4", "CE3-CC4", "CE3-CE4"]) == (
        "5_learners_in_4_conditions"
    )

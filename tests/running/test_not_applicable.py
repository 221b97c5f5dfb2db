"""What a learner cannot play is left out, and is no failure: a dash, and the reason once."""

import pytest

import causal_openlock as ol
from causal_openlock.errors import LearnerError
from support.command import at_once, modules_of

pytestmark = pytest.mark.slow

WHY = "Limited cannot play in rooms of CC4: it has a table of 7"
FILE = """\
name: limited
seed: 1
subjects: 1
protocols: {quick: {based_on: human, baseline_trials: 1, attempt_limit: 2}}
protocol: quick
conditions: [CC4]
learners: [random, 'limited:Limited']
"""
LEARNER = """
from causal_openlock import OneSubjectLearner

class {name}(OneSubjectLearner):
    @classmethod
    def cannot_play(cls, parameters, schema, action_limit):
        return {answers}

    def act(self, observation):
        return 0
"""
ANSWERS = {
    "Limited": "'it has a table of 7' if schema.name == 'CC4' else ''",
    "Breaks": "1 / 0",
    "Says": "None",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with learners, which are searched for there."""
    folder = tmp_path_factory.mktemp("limited")
    code = [LEARNER.format(name=name, answers=answers) for name, answers in ANSWERS.items()]
    (folder / "limited.py").write_text("".join(code), encoding="utf-8")
    (folder / "limited.yaml").write_text(FILE, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patches, modules_of(folder):
        patches.chdir(folder)
        patches.syspath_prepend(folder)
        yield folder


def test_a_learner_is_left_out_with_the_reason_once_and_the_folder_is_complete(folder):
    played = at_once("compare", "limited.yaml", "--out", "out")
    assert played.status == 0, played.stderr
    said = " ".join((played.stdout + played.stderr).split())
    assert said.count("cannot play") == 1
    assert WHY in said
    assert "1 of 1 cells done" in said
    (row,) = [line for line in played.stdout.splitlines() if line.startswith("Limited")]
    assert {*row.split()[1:]} == {"–"}
    assert ol.open_results("out").warnings[0] == f"Not applicable (–): {WHY}."
    assert "over" in at_once("status", "out").stdout


def test_others_of_its_conditions_are_played(folder):
    conditions = ["CC4", "CC3", ["CC3", "CC4"]]
    made = ol.make_experiment(conditions, ["random", "limited:Limited"], subjects=1)
    assert [cell.in_words for cell in made.cells()] == [
        "random in CC4, subject 0",
        "random in CC3, subject 0",
        "random in CC3-CC4, subject 0",
        "Limited in CC3, subject 0",
    ]
    assert made.not_applicable == {"Limited": {"CC4": WHY, "CC3-CC4": WHY}}
    assert made.reasons == (WHY,)


@pytest.mark.parametrize(
    ("learner", "named"),
    [
        ("Limited", WHY),
        ("Breaks", "cannot_play of .*Breaks fails.*ZeroDivision"),
        ("Says", "cannot_play of .*Says has to return a text"),
    ],
)
def test_where_nothing_can_be_played_it_says_why(learner, named, folder):
    with pytest.raises(LearnerError, match=named):
        ol.compare("CC4", f"limited:{learner}", subjects=1, workers=0)

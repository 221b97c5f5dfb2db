"""Rewards of one's own: other weights, and functions in Python."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from causal_openlock.contract.registry import create
from causal_openlock.envs import OpenLockEnv, OpenLockVectorEnv
from causal_openlock.errors import FileError, OpenLockError, RewardError
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.file_format import json_schema
from causal_openlock.experiment.protocol import PROTOCOLS, Condition
from causal_openlock.experiment.session import Session
from causal_openlock.export.as_minari import write_minari
from causal_openlock.export.experiment_file import experiment_file
from causal_openlock.files.yaml_file import dump_yaml
from causal_openlock.running.runner import run
from causal_openlock.schemas.finding import find_schema
from causal_openlock.storage.store import Store
from causal_openlock.world.reward_code import OwnReward, _loaded, own_reward
from causal_openlock.world.reward_table import Events
from causal_openlock.world.rewards import PRESETS, TERMS, WEIGHTS, Reward, Weights, find_reward
from support.command import at_once, modules_of
from support.made_up_experiments import NOBODY, condition_called, spec, stored
from support.reward_play import Play

pytestmark = pytest.mark.slow

NO_FUNCTION = "a text"

# -- weights --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("reward", "attempts"),
    [
        # Of each attempt: the levers and the door, and what the three actions pay.
        ({}, [("L0 L1 door", [1, 10, 50]), ("L0 L2 door", [1, 15, 75])]),
        ({"solution_multiplier": 2.0}, [("L0 L1 door", [1, 10, 50]), ("L0 L2 door", [1, 20, 100])]),
        ({"preset": "basic", "open": 100}, [("L0 L1 door", [0, 10, 100])]),
        ({"preset": "basic", "unlock": 0}, [("L0 L1 door", [0, 0, 50])]),
        ({"preset": "basic", "negative_immovable": -2}, [("white L0 L1", [-2, 0, 10])]),
        ({"terms": ["basic", "state_change"], "state_change": 2}, [("L0 L1 L2", [2, 12, 2])]),
        ({"terms": ["negative_repeat"], "negative_repeat": -3}, [("L0 L0 L0", [0, -3, -3])]),
        ({"partial_sequence": 4}, [("L0 white L1", [4, -0.5, 10])]),
    ],
)  # fmt: skip
def test_a_weight_changes_what_its_term_pays(
    reward: dict[str, Any], attempts: list[tuple[str, list[float]]]
) -> None:
    play = Play(reward or "paper")
    for words, paid in attempts:
        assert play.attempt(words) == pytest.approx(paid)


NUMBERS = st.floats(-100, 100, allow_nan=False).map(lambda x: round(x, 6))
FORMS = st.builds(
    lambda base, weights: {**base, **weights},
    st.sampled_from([{}, *({"preset": name} for name in PRESETS if "authors" not in name)])
    | st.lists(st.sampled_from(sorted(TERMS)), min_size=1, unique=True).map(
        lambda terms: {"terms": terms}
    ),
    st.dictionaries(st.sampled_from(sorted(WEIGHTS)), NUMBERS),
)


@cache
def _validator() -> Any:
    """What checks experiment files by their JSON schema."""
    schema = json_schema()
    kind = jsonschema.validators.validator_for(schema)
    kind.check_schema(schema)
    return kind(schema)


@settings(max_examples=40, deadline=None)
@given(form=FORMS)
def test_a_reward_says_how_it_is_written_and_comes_back_from_its_description(
    form: dict[str, Any],
) -> None:
    reward = find_reward(form)
    assert find_reward(reward.written()) == reward
    experiment = replace(
        NOBODY, conditions=(condition_called("CC4"),), learners=(spec("a", reward=reward),)
    )
    assert stored(experiment).learners[0].reward == reward
    whole = {"name": "e", "conditions": ["CC3"], "learners": ["ddqn"], "reward": form}
    _validator().validate(whole)


def test_a_reward_without_changes_is_what_it_was() -> None:
    """So that what is on record of it stays valid."""
    assert find_reward({}) is find_reward({"preset": "paper", "open": 50}) is PRESETS["paper"]
    assert set(PRESETS["paper"].as_dict()) == {"name", "terms"}
    changed = find_reward({"solution_multiplier": 2.0, "state_change": 0.5})
    assert changed.name == "paper(state_change=0.5, solution_multiplier=2)"
    assert changed.as_dict()["weights"] == {"solution_multiplier": 2.0}
    assert isinstance(changed, Reward)
    assert changed.terms == (*PRESETS["paper"].as_dict()["terms"], "state_change")
    assert changed.weights == Weights(solution_multiplier=2.0)


@pytest.mark.parametrize(
    ("text", "place", "says"),
    [
        ("{solution_multiplyer: 2.0}", "3:10", "not a key here; did you mean solution_multiplier"),
        ("{open: much}", "3:10", "open must be a valid number, and this is the text 'much'"),
        ("{open: .inf}", "3:10", "should be a finite number"),
        ("{unique_solutions: 1.0}", "3:10", "'unique_solutions' is not a key here"),
        ("{preset: papers, open: 1}", "3:1", "no reward 'papers'; did you mean paper"),
        ("{preset: authors_2018, open: 1}", "3:1", "has no weights that could be changed"),
        ("{preset: basic, terms: [basic]}", "3:1", "a preset or on terms; leave one"),
        ("{terms: [basics]}", "3:1", "no reward term 'basics'; did you mean basic"),
        ("nowhere:pay", "3:1", "there is no module nowhere in "),
    ],
)
def test_a_fault_in_a_reward_is_told_with_its_place(
    text: str, place: str, says: str, tmp_path: Path
) -> None:
    path = tmp_path / "e.yaml"
    path.write_text(f"name: e\nconditions: [CC3]\nreward: {text}\nlearners: [random]\n")
    with pytest.raises(FileError) as caught:
        read_experiment(path)
    (line,) = str(caught.value).splitlines()
    assert line.startswith(f"{path}:{place}")
    assert says in line


# -- functions ------------------------------------------------------------------------------------


def eager(events: Events) -> Any:
    """Heeds all that there is to heed."""
    paid = 40.0 * events.opens / (1 + events.found) - 0.1 * events.found - 0.3 * events.repeated
    return paid + 2 * events.new + 0.01 * events.first


def test_a_function_pays_the_same_wherever_it_is_asked() -> None:
    """In a session, in one room and in many rooms, whatever was found and done before."""
    reward = find_reward(f"{__name__}:eager")
    condition, human = Condition.named("CC4", find_schema), PROTOCOLS["human"]
    short = replace(human, attempt_limit=8, baseline_trials=1)
    session = Session(condition, short, 6, seed=3, reward=reward, learner="random")
    rooms = session.truth
    learner = create("random")
    session.begin(learner)
    layouts = [rooms.rooms[index].layout for index in rooms.room]
    singles = [OpenLockEnv("CC4", layout, reward, "trial", attempt_limit=8) for layout in layouts]
    batches = [
        OpenLockVectorEnv(1, "CC4", layout, reward, "trial", attempt_limit=8) for layout in layouts
    ]
    for env in (*singles, *batches):
        env.reset(seed=0)
    good = [
        room.action_of(room.schema.solutions[0])
        for room in map(rooms.rooms.__getitem__, rooms.room)
    ]
    while not session.over:
        playing = session.view.playing
        moment = 3 - session.view.console.actions_left
        action = learner.act(session.view)
        # Every other subject opens the door in every attempt, the same way each time.
        for subject in range(0, 6, 2):
            action[subject] = good[subject][moment[subject]]
        step = session.step(action)
        for subject in np.flatnonzero(playing):
            _, paid, *_ = singles[subject].step(int(action[subject]))
            batch = batches[subject].step(action[subject : subject + 1])[1]
            assert paid == pytest.approx(step.reward[subject])
            assert batch[0] == pytest.approx(step.reward[subject])
    earned = session.record()["reward"].to_numpy()
    assert earned.max() > 40
    assert len(np.unique(earned.round(6))) > 3


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("return events.opens[0]", " actions, and returned bool of shape ()"),
        ("return ['a'] * len(events.opens)", "and returned <U1"),
        ("return 1 / events.opens", "pays inf; let it pay finite numbers"),
        (
            "return events.closes",
            "fails (AttributeError: 'Events' object has no attribute 'closes'",
        ),
        ("events.opens[:] = True; return events.opens", "read-only"),
        (
            "import random; return events.opens * random.random()",
            "differently when it is called again",
        ),
        ("return events.opens - events.opens.mean()", "differently among other actions"),
    ],
)
def test_a_function_is_tried_before_anything_is_played(
    body: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = f"tried_{abs(hash(body))}"
    (tmp_path / f"{name}.py").write_text(f"def pay(events):\n    {body}\n")
    monkeypatch.syspath_prepend(tmp_path)
    with np.errstate(all="ignore"), pytest.raises(RewardError) as caught:
        own_reward(f"{name}:pay")
    assert says in str(caught.value)


def test_what_is_no_function_is_told() -> None:
    for name, says in (
        ("a b:c", "names no reward; write it like my_module:my_function"),
        (f"{__name__}:NO_FUNCTION", "is not a function; a reward is a function of events"),
        (f"{__name__}:Weights", "is not a function; a reward is a function of events"),
        (f"{__name__}:own_rewad", "test_own_rewards.py has no function own_rewad; .*own_reward"),
    ):
        with pytest.raises(RewardError, match=says):
            find_reward(name)


CODE = "def pay(events):\n    return 7.0 * events.opens - 1.0 * events.repeated\n"
TEXT = """\
name: mine
subjects: 2
protocol: short
conditions: [CC3]
learners:
  - random
  - {learner: oracle, reward: "mine_pays:pay"}
  - {learner: bayes, reward: "mine_pays:pay", subjects: 1, parameters: {particles: 40}}
protocols: {short: {attempt_limit: 4, baseline_trials: 1}}
"""


def test_results_are_told_apart_by_the_code_and_read_without_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "study"
    folder.mkdir()
    (folder / "mine.yaml").write_text(TEXT)
    (folder / "mine_pays.py").write_text(CODE)
    monkeypatch.setattr(sys, "path", [*sys.path])
    with modules_of(folder):
        done = at_once("compare", "study/mine.yaml", "-o", "out", cwd=tmp_path)
    assert done.status == 0, done.stderr
    record, experiment = Store(tmp_path / "out").record()
    rewards = {
        name: record.filter(np.equal(record["learner"].to_pylist(), name))["reward"].to_pylist()
        for name in ("oracle", "random")
    }
    assert set(rewards["oracle"]) == {7.0}
    assert set(rewards["random"]) != {7.0}
    told = experiment.learners[1].reward
    assert isinstance(told, OwnReward)
    assert told.name == "mine_pays:pay"
    assert told.source.startswith("mine_pays.py ")
    assert experiment_file(experiment)["learners"][1]["reward"] == "mine_pays:pay"
    # Another code is another experiment, and other cells.
    said = []
    for code in (CODE, CODE.replace("7.0", "8.0")):
        (folder / "mine_pays.py").write_text(code)
        _loaded.cache_clear()
        with modules_of(folder):
            said.append([cell.identity for cell in read_experiment(folder / "mine.yaml").cells()])
    assert [one == other for one, other in zip(*said, strict=True)] == [True, False, False]
    # The report needs no code, and runs none.
    _loaded.cache_clear()
    sys.path.remove(str(folder))
    (folder / "mine_pays.py").unlink()
    (tmp_path / "mine_pays.py").write_text("raise SystemExit('this was run')\n")
    monkeypatch.syspath_prepend(tmp_path)
    done = at_once("report", "out", cwd=tmp_path, reports="whole")
    assert done.status == 0, done.stderr
    assert "this was run" not in done.stdout + done.stderr
    assert "mine_pays:pay" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    with pytest.raises(OpenLockError, match=r"mine_pays:pay, code that an export does not run"):
        write_minari(Store(tmp_path / "out"), tmp_path / "sets")


def test_code_that_has_changed_since_is_not_taken_for_what_it_was() -> None:
    reward = replace(own_reward(f"{__name__}:eager"), source="test_own_rewards.py 0123456789abcdef")
    condition = Condition.named("CC3", find_schema)
    with pytest.raises(RewardError, match=r"was test_own_rewards.py 0123.* and is .*bring back"):
        Session(condition, PROTOCOLS["human"], 1, reward=reward)


def test_weights_and_functions_are_played_in_a_comparison(tmp_path: Path) -> None:
    path = tmp_path / "e.yaml"
    reward = {"preset": "basic", "open": 5.0}
    path.write_text(
        dump_yaml(
            {
                "name": "e",
                "subjects": 1,
                "reward": reward,
                "conditions": ["CC3"],
                "learners": [
                    "oracle",
                    {"learner": "oracle", "name": "own", "reward": f"{__name__}:eager"},
                ],
            }
        )
    )
    experiment = read_experiment(path)
    assert [entry.reward.name for entry in experiment.learners] == [
        "basic(open=5)",
        f"{__name__}:eager",
    ]
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(1) as pool:
        record = run(experiment, tmp_path / "out", executor=pool).record()[0].to_pandas()
    paid = record.groupby("learner", observed=True)["reward"].max()
    assert paid["oracle"] == 15
    assert paid["own"] > 40

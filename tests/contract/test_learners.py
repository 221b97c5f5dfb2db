"""The simple learners, learners for one subject, and how learners are found by name."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field, make_dataclass, replace
from enum import Enum
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from pydantic import Field
from scipy import stats

from causal_openlock.contract.learner import Learner
from causal_openlock.contract.one_subject import Moment, OneSubjectLearner, PerSubjectAdapter
from causal_openlock.contract.registry import (
    changed_parameters,
    create,
    learner_class,
    parameter_table,
    parse_parameters,
    registry,
)
from causal_openlock.errors import LearnerError, OpenLockError
from causal_openlock.experiment.protocol import PROTOCOLS, Condition, Protocol, Trials
from causal_openlock.experiment.session import Session
from causal_openlock.files.plugins import LEARNERS
from causal_openlock.schemas.finding import bundled_schemas, find_schema
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.testing import LearnerContract
from causal_openlock.world.randomness import Streams, generators, unrelated_generators
from causal_openlock.world.room import Layout
from openlock_learners.oracle import Oracle
from openlock_learners.random import RandomLearner
from support.packages import register

HUMAN = PROTOCOLS["human"]
LONG = replace(HUMAN, attempt_limit=300, stop_when_solved=False, baseline_trials=3)
DETERMINISTIC = [name for name, schema in bundled_schemas().items() if schema.deterministic]


def session(condition: str, protocol: Protocol = HUMAN, subjects: int = 10) -> Session:
    return Session(Condition.named(condition, find_schema), protocol, subjects, seed=3)


# -- random ---------------------------------------------------------------------------------------


def test_the_random_learner_draws_every_action_equally_often() -> None:
    record = session("CC4", LONG, 6).play(RandomLearner()).to_pandas()
    for _, rows in record.groupby("subject"):
        counts = np.bincount(np.concatenate(rows["actions"].to_numpy()), minlength=15)
        assert len(counts) == 15
        assert counts.sum() > 2500
        assert stats.chisquare(counts).pvalue > 1e-3


def test_the_random_learner_s_actions_do_not_depend_on_each_other() -> None:
    record = session("CC4", LONG, 12).play(RandomLearner()).to_pandas()
    full = np.stack([row for row in record["actions"] if len(row) == 3])
    pairs = np.zeros((15, 15))
    np.add.at(pairs, (full[:, 0], full[:, 1]), 1)
    assert stats.chi2_contingency(pairs).pvalue > 1e-3
    # Nor those of two subjects on each other: they agree once in 15.
    of = [np.concatenate(rows["actions"].to_numpy()) for _, rows in record.groupby("subject")]
    shortest = min(map(len, of))
    for one, other in pairwise(of):
        assert (one[:shortest] == other[:shortest]).mean() == pytest.approx(1 / 15, abs=0.025)


# -- oracle ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", DETERMINISTIC)
def test_the_oracle_needs_as_many_attempts_as_there_are_solutions(name: str) -> None:
    solutions = len(find_schema(name).solutions)
    record = session(name, replace(HUMAN, layouts="random")).play(Oracle()).to_pandas()
    assert record["new_solution"].all()
    assert set(record.groupby(["subject", "trial"]).size()) == {solutions}
    assert record["solutions_found"].max() == record["solutions"].iloc[0] == solutions


def test_the_oracle_s_floors() -> None:
    floors = {"CC3": 2, "CE3": 2, "CC4": 3, "CE4": 3, "chain3": 1, "two_keys": 1}
    floors |= {"two_of_four": 6, "seven": 3, "same_keys": 2, "shared_key": 2, "own_keys": 2}
    assert {name: len(find_schema(name).solutions) for name in DETERMINISTIC} == floors


def test_the_oracle_is_told_of_every_room_that_it_enters() -> None:
    record = session("CE3-CC4").play(Oracle()).to_pandas()
    sizes = record.groupby(["phase", "subject", "trial"]).size()
    assert set(sizes["train"]) == {2}
    assert set(sizes["test"]) == {3}


@pytest.mark.parametrize(
    ("action_limit", "chance"),
    [
        # L0 is free and certain; L1 (or L2) and the door take effect four times in five.
        (3, 0.8**2),
        # Two of the four actions after L0 must take effect: it looks, and tries again.
        (5, 1 - 0.2**4 - 4 * 0.8 * 0.2**3),
    ],
)
def test_the_oracle_tries_again_where_a_noisy_room_does_not_obey(
    action_limit: int, chance: float
) -> None:
    protocol = replace(HUMAN, action_limit=action_limit, attempt_limit=60)
    record = session("noisy_CC3", protocol, 400).play(Oracle()).to_pandas()
    attempts = record.groupby(["subject", "trial"]).size()
    # Attempts to the second success: mean 2/p, variance 2(1 - p)/p².
    deviation = (2 * (1 - chance)) ** 0.5 / chance / len(attempts) ** 0.5
    assert attempts.mean() == pytest.approx(2 / chance, abs=4 * deviation)
    assert record.groupby(["subject", "trial"])["new_solution"].sum().eq(2).all()


# -- learners for one subject ---------------------------------------------------------------------


class Tally(OneSubjectLearner):
    """Does what it has done least, at random among equals."""

    def begin(self) -> None:
        self.done = np.zeros(self.brief.actions, dtype=int)

    def act(self, observation):
        least = np.flatnonzero(self.done == self.done.min())
        return int(self.generator.choice(least))

    def learn(self, moment) -> None:
        self.done[moment.action] += 1


class TestTally(LearnerContract):
    learner = f"{__name__}:Tally"


class Scripted(OneSubjectLearner):
    """Follows a script and writes down what it is told."""

    scripts = iter(())

    def begin(self) -> None:
        self.moments: list[Moment] = []
        self.script = next(self.scripts)

    def act(self, observation):
        return next(self.script)

    def learn(self, moment) -> None:
        self.moments.append(moment)


def test_a_player_is_told_what_its_own_action_led_to() -> None:
    cc3 = find_schema("CC3")
    layout = Layout.of(cc3, {"L0": "UPPER", "L1": "LEFT", "L2": "LOWER"})
    condition = Condition("room", (Trials(cc3, (layout,)),))
    # Positions: UPPER 1, LEFT 3, LOWER 5. The first subject solves it all, and is done.
    Scripted.scripts = map(iter, ([1, 3, 14, 1, 5, 14], [1, 8, 6, 14, 14, 3] + [0] * 6))
    play = Session(condition, replace(HUMAN, attempt_limit=4), 2)
    chorus = PerSubjectAdapter(Scripted)
    play.play(chorus)
    first, second = (player.moments for player in chorus._players)
    assert (len(first), len(second)) == (6, 12)
    assert [moment.action for moment in first] == [1, 3, 14, 1, 5, 14]
    assert all(type(moment.action) is int and type(moment.reward) is float for moment in first)
    # The paper's rewards: 1 for a solution's first lever, 10 for the lock, 50 for the door, half
    # as much again for the second solution; -.5 for what moves nothing.
    assert [moment.reward for moment in first] == [1, 10, 50, 1, 15, 75]
    assert [moment.reward for moment in second[:6]] == [1, 0, -0.5, -0.5, -0.5, -0.5]
    assert [moment.attempt_over for moment in first] == [False, False, True] * 2
    assert [moment.trial_over for moment in first] == [False] * 5 + [True]
    assert [moment.new_solution for moment in first] == [False, False, True] * 2
    assert [moment.solutions_left for moment in first] == [2, 2, 1, 1, 1, 0]
    assert {moment.solutions_left for moment in second} == {2}
    colours = [0, 1, 0, 1, 0, 1, 0]
    closed = [0, 0, 0, 0, 0, 0, 0, *colours, 1, 0]
    assert first[0].observation.tolist() == closed
    assert first[0].outcome.tolist() == [0, 1, 0, 0, 0, 0, 0, *colours, 1, 0]
    assert first[2].observation.tolist() == [0, 1, 0, 1, 0, 0, 0, *colours, 0, 0]
    assert first[2].outcome.tolist() == [0, 1, 0, 1, 0, 0, 0, *colours, 0, 1]
    assert first[3].observation.tolist() == closed  # the room was put back
    assert second[1].outcome.tolist() == closed  # UPPER was pulled back


def test_a_player_is_briefed_on_its_own_subject_and_on_no_other() -> None:
    chorus, play = PerSubjectAdapter(Tally), session("CC3", subjects=3)
    chorus.begin(play.brief)
    for player, generator in zip(chorus._players, play.brief.generators, strict=True):
        assert player.brief == replace(play.brief, subjects=1, generators=(generator,))
        assert player.generator is generator
    # A checkpoint holds the generator once, also where a player draws from the brief's.
    chorus.load_state_dict(chorus.state_dict())
    for player in chorus._players:
        assert player.brief.generators == (player.generator,)


@pytest.mark.parametrize("answer", [2.7, None, "3", np.array([1, 2])])
def test_a_player_that_answers_no_integer_is_told_so(answer: object) -> None:
    kind = type("Vague", (OneSubjectLearner,), {"act": lambda self, observation: answer})
    with pytest.raises(LearnerError, match="Vague has to answer with the index of an action"):
        session("CC3").play(PerSubjectAdapter(kind))


@pytest.mark.parametrize("answer", [3, np.int8(3), np.array(3)])
def test_any_integer_is_an_answer(answer: object) -> None:
    kind = type("Sure", (OneSubjectLearner,), {"act": lambda self, observation: answer})
    record = session("CC3").play(PerSubjectAdapter(kind)).to_pandas()
    assert {tuple(actions) for actions in record["actions"]} == {(3, 3, 3)}


# -- randomness -----------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [generators, unrelated_generators])
def test_a_subject_s_numbers_are_its_own(make: Callable[..., Any]) -> None:
    def numbers(generator: np.random.Generator) -> FloatArray:
        return np.concatenate([generator.random(8), *(g.random(8) for g in generator.spawn(2))])

    several, alone = make(1, "a", range(5)), make(1, "a", [3])
    mine = numbers(alone[0])
    assert len(set(mine)) == 24
    assert np.array_equal(numbers(several[3]), mine)
    others = {"subject": (1, "a", [4]), "key": (1, "b", [3]), "seed": (2, "a", [3])}
    for what, (seed, key, subjects) in others.items():
        assert not np.isin(numbers(make(seed, key, subjects)[0]), mine).any(), what


def test_a_learner_s_generators_carry_no_seed_of_the_experiment() -> None:
    one, other = (
        Session(Condition.named(name, find_schema), PROTOCOLS["human"], [7, 11], seed=2018)
        for name in ("CC3", "CC4")
    )
    seen = set()
    for generator in (*one.brief.generators, *other.brief.generators):
        for seeds in (generator, *generator.spawn(2)):
            held = seeds.bit_generator.seed_seq
            assert held.entropy.bit_length() > 200  # a hash; 2018 has 11 bits
            assert len(held.spawn_key) == (seeds is not generator)
            assert set(held.state) == {"entropy", "spawn_key", "pool_size", "n_children_spawned"}
        seen.add(held.entropy)
    assert len(seen) == 4


def test_streams_hand_out_each_generator_s_own_numbers_in_order() -> None:
    for block in (1, 3, 512):
        streams = Streams(generators(0, "x", range(3)), width=2, block=block)
        drawn = np.stack([streams.uniform() for _ in range(7)])
        for subject, generator in enumerate(generators(0, "x", range(3))):
            assert np.array_equal(drawn[:, subject], generator.random((7, 2)))


# -- the registry ---------------------------------------------------------------------------------


def fake_distribution(folder: Path, package: str, **names: str) -> None:
    register(folder, package, LEARNERS, **names)


def test_our_learners_are_registered() -> None:
    found = registry()
    assert {"random", "oracle", "ddqn"} <= set(found)
    assert list(found) == sorted(found)
    assert learner_class("random") is RandomLearner


def test_listing_learners_loads_none(tmp_path, monkeypatch) -> None:
    fake_distribution(tmp_path, "broken", breaks="no_such_module_here:Learner")
    monkeypatch.syspath_prepend(tmp_path)
    assert registry()["breaks"].dist.name == "broken"
    with pytest.raises(LearnerError, match=r"breaks.*no_such_module_here:Learner.*ModuleNotFound"):
        create("breaks")


def test_a_name_that_two_packages_register_is_an_error(tmp_path, monkeypatch) -> None:
    fake_distribution(tmp_path, "one", twin="one:A")
    fake_distribution(tmp_path, "two", twin="two:B")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(OpenLockError, match=r"'twin' is registered twice.*uninstall") as raised:
        registry()
    assert "one:A by one" in str(raised.value)
    assert "two:B by two" in str(raised.value)


def test_the_same_learner_registered_by_two_packages_is_none(tmp_path, monkeypatch) -> None:
    fake_distribution(tmp_path, "fork", same="one:A")
    fake_distribution(tmp_path, "origin", same="one:A")
    monkeypatch.syspath_prepend(tmp_path)
    assert registry()["same"].value == "one:A"


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("randon", "there is no learner 'randon'; did you mean random"),
        ("no_such_module:Learner", "there is no module no_such_module in .*known: "),
        (
            "openlock_learners.randon:Random",
            "there is no module openlock_learners.randon in .*did you mean random",
        ),
        (
            "openlock_learners.random.x:Random",
            "there is no module openlock_learners.random.x; known: none",
        ),
        (
            "openlock_learners.random:Learners",
            "random.py has no class Learners; .*known: RandomLearner$",
        ),
        ("openlock_learners.random:Streams", "not a subclass of Learner or OneSubjectLearner"),
        (
            "openlock_learners.networks.replay_buffer:np",
            "not a subclass of Learner or OneSubjectLearner",
        ),
        (":Learner", "names no learner; write it like my_module:MyLearner"),
        ("openlock_learners.random:", "names no learner; write it like"),
        ("a b:C", "names no learner; write it like"),
    ],
)
def test_what_is_no_learner_is_one_sentence(name: str, says: str) -> None:
    with pytest.raises(LearnerError, match=says) as raised:
        create(name)
    assert "\n" not in str(raised.value)


def test_a_module_of_the_working_directory_is_found(tmp_path, monkeypatch) -> None:
    text = "from openlock_learners.random import RandomLearner\n"
    text += "class Mine(RandomLearner):\n    '''Mine.'''\n"
    (tmp_path / "beside_the_notebook.py").write_text(text)
    (tmp_path / "does_not_parse.py").write_text("def\n")
    (tmp_path / "fails_at_import.py").write_text("1 / 0\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    assert isinstance(create("beside_the_notebook:Mine"), RandomLearner)
    with pytest.raises(LearnerError, match=r"imported: SyntaxError: .*does_not_parse.py, line 1"):
        create("does_not_parse:Mine")
    with pytest.raises(LearnerError, match="imported: ZeroDivisionError"):
        create("fails_at_import:Mine")


def test_a_misspelt_name_is_told_apart_from_a_module_that_fails(tmp_path, monkeypatch) -> None:
    text = "from openlock_learners.random import RandomLearner\n"
    text += "class Persistent(RandomLearner): pass\n"
    (tmp_path / "my_own_learners.py").write_text(text)
    (tmp_path / "needs_more.py").write_text("import no_such_module_here\n")
    (tmp_path / "needs_itself.py").write_text("import needs_itself\nneeds_itself.Persistent\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    for name, says in (
        ("my_own_learners:Persist", "^my_own_learners.py has no class Persist; did you mean Pers"),
        (
            "myownlearners:Persistent",
            f"^there is no module myownlearners in {tmp_path}.*; did you mean my_own_learners?",
        ),
        ("needs_more:Persistent", "imported: ModuleNotFoundError: .*no_such_module_here"),
        ("needs_itself:Persistent", "imported: AttributeError: .*partially initialized"),
    ):
        with pytest.raises(LearnerError, match=says):
            create(name)


def test_create_gives_a_learner_of_either_kind() -> None:
    assert type(create("oracle")) is Oracle
    chorus = create(f"{__name__}:Tally")
    assert isinstance(chorus, Learner)
    assert isinstance(chorus, PerSubjectAdapter)


# -- hyper-parameters -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Settings:
    rate: Annotated[float, Field(gt=0, le=1), "how fast"] = 0.5
    steps: Annotated[int | None, Field(ge=1, description="how often")] = None
    layers: Annotated[tuple[int, ...], "how wide", "and how many"] = (8, 8)
    rule: Annotated[Literal["win-stay", "lose-shift"], "what it goes by"] = "win-stay"
    greedy: bool = False

    def __post_init__(self) -> None:
        if self.greedy and self.rate < 0.1:
            raise ValueError("greedy asks for a rate of .1 or more")


class Tuned(RandomLearner):
    """Has parameters."""

    Parameters = Settings


TUNED = f"{__name__}:Tuned"


def test_parameters_come_from_plain_data() -> None:
    assert parse_parameters(TUNED, {}) == Settings()
    given = {"rate": 1, "steps": 3, "layers": [4, 5], "rule": "lose-shift", "greedy": True}
    assert parse_parameters(TUNED, given) == Settings(1.0, 3, (4, 5), "lose-shift", True)
    assert parse_parameters(TUNED, {"layers": (4, 5)}).layers == (4, 5)
    assert create(TUNED, {"rate": 0.1}).parameters == Settings(rate=0.1)


@pytest.mark.parametrize(
    ("name", "given", "says"),
    [
        (TUNED, {"rat": 1.0}, "has no parameter 'rat'; did you mean rate"),
        (TUNED, {"rate": "fast"}, r"rate of .* should be a valid number, and this is 'fast'"),
        (TUNED, {"rate": "0.5"}, r"rate of .* should be a valid number, and this is '0.5'"),
        (
            TUNED,
            {"rate": [0.1, 0.5]},
            "this is .*; to compare values, sweep: them in a file, or with ol.sweep",
        ),
        (TUNED, {"rate": True}, "rate of .* should be a valid number, and this is True"),
        (TUNED, {"rate": 0.0}, r"rate of .* should be greater than 0, and this is 0.0"),
        (TUNED, {"rate": float("nan")}, r"rate of .* should be .*, and this is nan"),
        (TUNED, {"steps": 2.0}, r"steps of .* should be a valid integer, and this is 2.0"),
        (TUNED, {"steps": 0}, r"steps of .* should be greater than or equal to 1, and this is 0"),
        (
            TUNED,
            {"layers": [8, "8"]},
            r"layers of .* should be a valid integer, and this is .*'8'\]$",
        ),
        (TUNED, {"rule": "win"}, "rule of .* should be 'win-stay' or 'lose-shift'"),
        (TUNED, {"greedy": 1}, "greedy of .* should be a valid boolean, and this is 1"),
        (TUNED, {"rate": object()}, "rate of .* must be plain data"),
        (TUNED, {"rate": 0.05, "greedy": True}, r"do not fit: greedy asks for a rate of .1"),
        ("random", {"seed": 1}, "random has no parameter 'seed'; known: none"),
        ("ddqn", {"gama": 0.5}, "did you mean gamma"),
        ("ddqn", {"gamma": 1.5}, "gamma of ddqn should be less than or equal to 1, and this is"),
        ("ddqn", {"batch_size": None}, "batch_size of ddqn should be a valid integer"),
    ],
)
def test_a_parameter_that_does_not_fit_is_one_sentence(name: str, given: dict, says: str) -> None:
    with pytest.raises(LearnerError, match=says) as raised:
        create(name, given)
    assert "\n" not in str(raised.value)


class Rule(Enum):
    WIN = "win"


@pytest.mark.parametrize(
    "default", [np.int64(3), np.float32(0.5), Path("a.csv"), frozenset({1}), Rule.WIN, b"a"]
)
def test_a_default_that_is_no_plain_data_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch, default: Any
) -> None:
    made = make_dataclass("Odd", [("odd", Any, field(default=default))], frozen=True)
    monkeypatch.setattr(Tuned, "Parameters", made)
    with pytest.raises(LearnerError, match=r"the default of the parameter odd of .* must be plain"):
        create(TUNED)


def test_numbers_of_numpy_are_numbers() -> None:
    given = {"steps": np.int64(3), "rate": np.float32(0.5), "greedy": np.bool_(True)}
    assert parse_parameters(TUNED, given) == Settings(0.5, 3, greedy=True)


def test_the_table_of_parameters_tells_defaults_and_meanings() -> None:
    rows = [(row.name, row.default, row.meaning) for row in parameter_table(TUNED)]
    assert rows == [
        ("rate", 0.5, "how fast"),
        ("steps", None, "how often"),
        ("layers", (8, 8), "how wide and how many"),
        ("rule", "win-stay", "what it goes by"),
        ("greedy", False, ""),
    ]
    assert parameter_table("random") == []


def test_changed_parameters_are_compared_as_a_file_has_them() -> None:
    given = {"rate": 0.5, "steps": None, "layers": [8, 8], "greedy": np.bool_(False)}
    assert changed_parameters(TUNED, given) == {}
    assert changed_parameters(TUNED, {**given, "layers": (8,)}) == {"layers": [8]}


def test_the_ddqn_s_defaults_are_the_paper_s() -> None:
    defaults = {row.name: row.default for row in parameter_table("ddqn")}
    paper = {
        "gamma": 0.8,
        "learning_rate": 0.001,
        "epsilon_start": 1.0,
        "epsilon_min": 0.01,
        "epsilon_decay": 0.995,
        "epsilon_after_trial": 0.5,
        "hidden_layers": 4,
        "hidden_units": 128,
    }
    assert {name: defaults[name] for name in paper} == paper

"""Every learner of this package keeps the contract of a learner."""

import tomllib
import unittest
from dataclasses import make_dataclass
from typing import Annotated

import numpy as np
import pytest
from pydantic import Field

from causal_openlock.belief import beliefs
from causal_openlock.contract.learner import Learner
from causal_openlock.contract.registry import create
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.condition import find_condition
from causal_openlock.experiment.plan import plan
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.experiment.session import Session
from causal_openlock.testing import LearnerContract
from causal_openlock.world.randomness import Streams, generators
from support.places import ROOT
from support.scripted_model import NETWORK, URL, ScriptedModel

pytestmark = pytest.mark.slow


def contract(learner, **settings):
    """The contract's tests of a learner."""
    return type("Contract", (LearnerContract,), {"learner": learner, **settings})


TWO = ("CC3", "CE4")
# It trains from the eighth action on, and copies its target network several times.
SMALL = {
    "batch_size": 8,
    "replay_size": 16,
    "hidden_units": 8,
    "hidden_layers": 2,
    "target_period": 5,
}


@pytest.fixture(autouse=True)
def few_structures(monkeypatch):
    """Sample few structures where they are too many to list: most of the time goes into these."""
    monkeypatch.setattr(beliefs, "PARTICLES", 20)


TestRandom = contract("random")
TestOracle = contract("oracle")
TestIdeal = contract("ideal", schemas=("CC3", "CE4", "chain3", "noisy_CC3"))
TestWinStay = contract("win_stay")
TestAssociative = contract("associative")
TestTabularQ = contract(
    "tabular_q", attempts=20
)  # so that it acts greedily in states that it knows
TestPosteriorSampling = contract("posterior_sampling")
TestTheoryBased = contract("theory_based")
TestTheoryBasedOnMeans = contract("theory_based", parameters={"beliefs": "mean"}, schemas=TWO)
TestBayes = contract("bayes", parameters={"planned": 30}, schemas=("CC3", "CE4", "chain3"))
TestBayesOfBoundedRationality = contract(
    "bayes",
    parameters={
        "temperature": 0.5,
        "lapse": 0.1,
        "forgetting": 0.8,
        "forgets": "failures",  # as the learner that is fitted to people
        "directness": 1.0,
        "noise": 0.3,
        "planned": 20,
    },
    schemas=("noisy_CC3", "CC3"),
    subjects=3,
)
# Beyond four levers structures are sampled, which takes luck of its own.
TestBayesOfManyLevers = contract(
    "bayes", parameters={"policy": "thompson", "lapse": 0.1}, schemas=("seven",), subjects=2
)
TestDDQN = contract("ddqn", parameters=SMALL, schemas=TWO, attempts=20)
# Sums of 128 terms, whose rounding shows where it depends on what else is evaluated.
TestDDQNOfFullSize = contract(
    "ddqn", parameters={"target_period": 20}, schemas=TWO, subjects=3, attempts=20
)
TestSemiMarkovDDQN = contract(
    "semi_markov_ddqn", parameters=SMALL, schemas=TWO, subjects=3, attempts=20
)
TestBayesNetDDQN = contract(
    "bayes_net_ddqn", parameters=SMALL, schemas=(*TWO, "noisy_CC3"), subjects=3, attempts=10
)
# It trains with every second action; pieces end and begin within a vector of the processor.
RECURRENT = {
    "hidden_units": 13,
    "burn_in": 2,
    "unroll": 4,
    "batch_size": 3,
    "train_period": 2,
    "replay_size": 16,
    "target_period": 3,
}
TestRecurrent = contract("recurrent", parameters=RECURRENT, schemas=TWO, subjects=3, attempts=8)
TestRL2 = contract("rl2")


class TestStableBaselines(LearnerContract):
    learner = "sb3"
    # It learns after every fifth action.
    parameters = {"algorithm": "A2C", "settings": {"n_steps": 5}}  # noqa: RUF012
    schemas = ("CC3", "CE4")
    subjects = 3

    @pytest.fixture(autouse=True)
    def _installed(self):
        pytest.importorskip("stable_baselines3")


class TestStableBaselinesOffPolicy(TestStableBaselines):
    # It trains from the eleventh action on.
    parameters = {  # noqa: RUF012
        "algorithm": "DQN",
        "settings": {"learning_starts": 10, "batch_size": 8, "buffer_size": 100, "train_freq": 1},
        "episode": "trial",
    }


class TestLanguageModel(LearnerContract):
    """Its model answers by what it is asked, so everything that it is told shows."""

    learner = "llm"
    parameters = {"model": "scripted", "base_url": URL}  # noqa: RUF012
    schemas = ("CC3",)
    subjects = 2

    @pytest.fixture(autouse=True)
    def _answered(self, tmp_path_factory, monkeypatch):
        # One folder for all tests: what was asked in one of them is not asked in the next.
        folder = tmp_path_factory.getbasetemp() / "llm_contract"
        monkeypatch.setenv("OPENLOCK_LLM_REPLAY", str(folder))
        monkeypatch.setattr(NETWORK, ScriptedModel())


OURS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"][
    "causal_openlock.learners"
]


def test_every_learner_of_this_package_has_a_contract_test():
    here = {
        getattr(value, "learner", "") for value in globals().values() if isinstance(value, type)
    }
    assert set(OURS) <= here, f"write a contract test above for {set(OURS) - here}"


# -- the contract tells good learners from bad ----------------------------------------------------


class Dice(Learner):
    """A learner that keeps the contract; those below break it in one way each."""

    def begin(self, brief):
        super().begin(brief)
        self.streams = Streams(brief.generators)

    def act(self, view):
        return self.streams.integers(self.brief.actions)


class AnswersFloats(Dice):
    def act(self, view):
        return super().act(view).astype(float)


class DrawsItsOwnSeed(Dice):
    def begin(self, brief):
        super().begin(brief)
        self.streams = Streams([np.random.default_rng() for _ in brief.generators])


class RemembersInItsClass(Dice):
    played = 0

    def act(self, view):
        type(self).played += 1
        return super().act(view) * 0 + self.played % 14


class LearnsFromTheFinished(Dice):
    paid = 0.0

    def learn(self, step):
        self.paid += step.reward.sum()

    def act(self, view):
        return (super().act(view) + int(2 * self.paid)) % self.brief.actions


class DrawsGlobally(Dice):
    def act(self, view):
        return np.random.randint(0, 15, self.brief.subjects)  # noqa: NPY002


class Forgets(Dice):
    def __getstate__(self):
        return vars(self) | {"streams": Streams(self.brief.generators)}


class NeedsToAct(Dice):
    def act(self, view):
        self.chosen = super().act(view)
        return self.chosen

    def learn(self, step):
        assert len(self.chosen) == len(step.action)


class ClaimsToPushTheDoor(Dice):
    def probabilities(self, view):
        return np.tile(np.eye(self.brief.actions)[-1], (self.brief.subjects, 1))


class ClaimsHalf(ClaimsToPushTheDoor):
    def probabilities(self, view):
        return super().probabilities(view) / 2


class DrawsWhenAsked(Dice):
    def probabilities(self, view):
        self.streams.uniform()
        return np.full((self.brief.subjects, self.brief.actions), 1 / self.brief.actions)


def with_parameters(hint, frozen=True):
    """A learner with a parameter ``rate``, whose default is .5."""
    declared = make_dataclass("Declared", [("rate", hint, 0.5)], frozen=frozen)
    body = {"Parameters": declared, "__module__": __name__, "__doc__": "Has parameters."}
    return type("WithParameters", (Dice,), body)


PROBABILITIES = "draws_its_actions_from_its_probabilities"
PARAMETERS = "its_parameters_are_a_frozen_dataclass_that_explains_itself"


class TestDice(LearnerContract):
    learner = f"{__name__}:Dice"


@pytest.mark.parametrize(
    ("kind", "test", "names"),
    [
        (AnswersFloats, "answers_with_one_action_for_each_subject", "float64"),
        (DrawsItsOwnSeed, "the_same_seed_gives_the_same_record", "row 0: .*actions"),
        (RemembersInItsClass, "a_subject_does_not_depend_on_its_batch", "row 0: .*actions"),
        (LearnsFromTheFinished, "ignores_subjects_that_have_finished", "step.view.playing"),
        (DrawsGlobally, "keeps_no_global_randomness", "numpy.random"),
        (ClaimsToPushTheDoor, PROBABILITIES, "cannot do that"),
        (ClaimsHalf, PROBABILITIES, "add up to 1"),
        (DrawsWhenAsked, PROBABILITIES, "once its probabilities are asked for"),
        (NeedsToAct, "learns_from_what_others_do", "chosen"),
        (Forgets, "goes_on_from_a_checkpoint", "every 6 steps"),
        (with_parameters(Annotated[float, "how fast"], frozen=False), PARAMETERS, "frozen=True"),
        (with_parameters(float), PARAMETERS, "rate"),
        (with_parameters(Annotated[float, Field(lt=0.1), "how fast"]), PARAMETERS, "0.1"),
        (AnswersFloats, PARAMETERS, "docstring"),
    ],
)
def test_a_broken_promise_is_found(kind, test, names, monkeypatch):
    monkeypatch.setitem(globals(), kind.__name__, kind)
    contract = type("Contract", (LearnerContract,), {"learner": f"{__name__}:{kind.__name__}"})()
    (method,) = [name for name in dir(contract) if name.startswith("test_") and test in name]
    with pytest.raises((AssertionError, AttributeError, LearnerError), match=f"(?s){names}"):
        getattr(contract, method)()


def test_the_generators_of_a_learner_do_not_lead_to_its_rooms():
    """The rooms can be drawn again from what generators of an experiment's seed carry."""
    condition, subjects = find_condition("CC4"), [3, 8, 21]

    def rooms(given):
        found = []
        for subject, generator in zip(subjects, given, strict=True):
            held = generator.bit_generator.seed_seq
            number = held.spawn_key[-1] if held.spawn_key else subject
            (again,) = generators(held.entropy, "environment/CC4", [number])
            visits = plan(condition, PROTOCOLS["human"], again)
            found.append([visit.layout.name for visit in visits])
        return found

    session = Session(condition, PROTOCOLS["human"], subjects, seed=2018)
    record = session.play(create("oracle")).to_pandas()
    played = [[*dict.fromkeys(rows.layout)] for _, rows in record.groupby("subject")]
    assert rooms(generators(2018, "learner/learner/CC4/human", subjects)) == played
    for found, room in zip(rooms(session.brief.generators), played, strict=True):
        assert found != room


def test_a_contract_without_a_learner_says_so():
    with pytest.raises(AssertionError, match="learner = "):
        LearnerContract().test_the_same_seed_gives_the_same_record()


def test_the_contract_runs_under_unittest():
    case = type("Case", (LearnerContract, unittest.TestCase), {"learner": "oracle"})
    result = unittest.TestResult()
    unittest.defaultTestLoader.loadTestsFromTestCase(case).run(result)
    assert result.testsRun > len(result.skipped)
    assert result.wasSuccessful()

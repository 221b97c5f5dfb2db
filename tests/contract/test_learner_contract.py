"""Every learner of this package keeps the contract of a learner."""

from __future__ import annotations

import random
import sys
import tomllib
import unittest
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import pytest
from pydantic import Field

from causal_openlock.contract.learner import Learner
from causal_openlock.contract.registry import create, learner_class
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.protocol import PROTOCOLS, Condition, plan
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import find_schema
from causal_openlock.testing import LearnerContract
from causal_openlock.world.randomness import Streams, generators
from support.places import ROOT
from support.scripted_server import scripted

pytestmark = pytest.mark.slow


class TestRandom(LearnerContract):
    learner = "random"


class TestOracle(LearnerContract):
    learner = "oracle"


class TestIdeal(LearnerContract):
    learner = "ideal"
    schemas = ("CC3", "CE4", "chain3", "noisy_CC3")


class TestDDQN(LearnerContract):
    learner = "ddqn"
    # It trains from the eighth action on, and copies its target network several times.
    parameters = {  # noqa: RUF012
        "batch_size": 8,
        "replay_size": 16,
        "hidden_units": 8,
        "hidden_layers": 2,
        "target_period": 5,
    }
    schemas = ("CC3", "CE4")
    attempts = 20


class TestDDQNOfFullSize(LearnerContract):
    """Sums of 128 terms, whose rounding shows where it depends on what else is evaluated."""

    learner = "ddqn"
    parameters = {"target_period": 20}  # noqa: RUF012
    schemas = ("CC3", "CE4")
    subjects = 3
    attempts = 20


class TestBayes(LearnerContract):
    learner = "bayes"
    parameters = {"particles": 20, "planned": 30}  # noqa: RUF012
    schemas = ("CC3", "CE4", "chain3")


class TestBayesOfBoundedRationality(LearnerContract):
    learner = "bayes"
    parameters = {  # noqa: RUF012
        "temperature": 0.5,
        "lapse": 0.1,
        "forgetting": 0.2,
        "noise": 0.3,
        "hypothesis_limit": 600,
        "particles": 10,
        "planned": 20,
    }
    schemas = ("CC3", "noisy_CC3")
    subjects = 2


class TestBayesOfManyLevers(LearnerContract):
    """Beyond four levers structures are sampled, which takes luck of its own."""

    learner = "bayes"
    parameters = {"policy": "thompson", "particles": 4, "lapse": 0.1}  # noqa: RUF012
    schemas = ("seven",)
    subjects = 2


class TestTheoryBased(LearnerContract):
    learner = "theory_based"


class TestTheoryBasedByChains(LearnerContract):
    learner = "theory_based"
    parameters = {"form": "cogsci_2019"}  # noqa: RUF012
    schemas = ("CC3", "CE4")


class TestWinStay(LearnerContract):
    learner = "win_stay"


class TestAssociative(LearnerContract):
    learner = "associative"


class TestTabularQ(LearnerContract):
    learner = "tabular_q"
    attempts = 20  # so that it acts greedily in states that it knows


class TestPosteriorSampling(LearnerContract):
    learner = "posterior_sampling"


class TestBayesNetDDQN(LearnerContract):
    learner = "bayes_net_ddqn"
    parameters = TestDDQN.parameters
    schemas = ("CC3", "CE4", "noisy_CC3")
    subjects = 3
    attempts = 10


class TestRecurrent(LearnerContract):
    learner = "recurrent"
    # It trains with every second action from the fifth on.
    parameters = {  # noqa: RUF012
        "hidden_units": 8,
        "burn_in": 2,
        "unroll": 4,
        "batch_size": 2,
        "train_period": 2,
        "replay_size": 16,
        "target_period": 3,
    }
    schemas = ("CC3", "CE4")
    subjects = 3
    attempts = 8


class TestRecurrentOfOddSizes(LearnerContract):
    """Pieces that end and begin within a vector of the processor's."""

    learner = "recurrent"
    parameters = TestRecurrent.parameters | {
        "cell": "lstm",
        "hidden_units": 13,
        "batch_size": 3,
    }
    schemas = ("CC3", "CE4")
    subjects = 3
    attempts = 8


class TestRecurrentOfFullSize(LearnerContract):
    learner = "recurrent"
    parameters = {"replay_size": 200}  # noqa: RUF012
    schemas = ("CC3", "CE4")
    subjects = 3
    attempts = 8


class TestSemiMarkovDDQN(LearnerContract):
    learner = "semi_markov_ddqn"
    parameters = TestDDQN.parameters | {"prioritised": True}
    schemas = ("CC3", "CE4")
    subjects = 3
    attempts = 20


class TestRL2(LearnerContract):
    learner = "rl2"


class TestRL2Learning(LearnerContract):
    learner = "rl2"
    parameters = {"learns": True, "unroll": 5, "reset": "trial"}  # noqa: RUF012
    schemas = ("CC3", "CE4")
    attempts = 10


class TestStableBaselines(LearnerContract):
    learner = "sb3"
    # It learns after every fifth action.
    parameters = {"algorithm": "A2C", "settings": {"n_steps": 5}}  # noqa: RUF012
    schemas = ("CC3", "CE4")
    subjects = 3

    @pytest.fixture(autouse=True)
    def _installed(self) -> None:
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
    schemas = ("CC3",)
    subjects = 2

    @pytest.fixture(autouse=True)
    def _served(
        self, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
    ) -> Iterator[None]:
        # One folder for all tests: what was asked in one of them is not asked in the next.
        folder = tmp_path_factory.getbasetemp() / "llm_contract"
        monkeypatch.setenv("OPENLOCK_LLM_REPLAY", str(folder))
        with scripted() as (_, url):
            kind = type(self)
            monkeypatch.setattr(kind, "parameters", {"model": "scripted", "base_url": url})
            yield


def test_every_learner_of_this_package_is_tested() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    ours = set(project["project"]["entry-points"]["causal_openlock.learners"])
    here = {
        value.learner
        for value in globals().values()
        if isinstance(value, type) and issubclass(value, LearnerContract) and value.learner
    }
    assert ours <= here, f"write a contract test above for {', '.join(sorted(ours - here))}"


WITHOUT_PROBABILITIES = {"posterior_sampling", "sb3", "llm"}
"""By choice: their modules say why, and the guide to scores names them."""


def test_every_learner_gives_its_probabilities_or_says_why_not() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    guide = (ROOT / "docs" / "howto" / "score.md").read_text()
    for name in project["project"]["entry-points"]["causal_openlock.learners"]:
        kind = learner_class(name)
        gives = kind.probabilities is not Learner.probabilities
        assert gives == (name not in WITHOUT_PROBABILITIES), name
        if not gives:
            assert "It gives no probabilities" in " ".join(
                sys.modules[kind.__module__].__doc__.split()
            )
            assert f"`{name}`" in guide
        if kind.sample_size is not Learner.sample_size:  # they are estimated
            assert f"`{name}`" in guide


# -- the contract tells good learners from bad ----------------------------------------------------


class Dice(Learner):
    """A learner that keeps the contract; those below break it in one way each."""

    def begin(self, brief):
        self.brief = brief
        self.streams = Streams(brief.generators)

    def act(self, view):
        return self.streams.integers(self.brief.actions)

    def state_dict(self):
        return self.streams.state_dict()

    def load_state_dict(self, state):
        self.streams.load_state_dict(state)


class KnowsOnlyTheSmallRoom(Dice):
    """Takes every room for one of seven positions, counting actions from 1."""

    def act(self, view):
        return self.streams.integers(15) + 1


class AnswersFloats(Dice):
    def act(self, view):
        return super().act(view).astype(float)


class AnswersForOne(Dice):
    def act(self, view):
        return 3


class DrawsItsOwnSeed(Dice):
    def begin(self, brief):
        super().begin(brief)
        self.streams = Streams([np.random.default_rng() for _ in brief.generators])


class SharesOneGenerator(Dice):
    def act(self, view):
        return self.brief.generators[0].integers(self.brief.actions, size=self.brief.subjects)


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


class SeedsGlobally(Dice):
    def begin(self, brief):
        super().begin(brief)
        random.seed(0)


class DrawsFromTorch(Dice):
    def act(self, view):
        import torch

        return torch.randint(15, (self.brief.subjects,)).numpy()


class LooksBehindTheScenes(Dice):
    def act(self, view):
        session = sys._getframe(1).f_locals["session"]
        schema = session.truth.rooms[0].schema
        return np.full(
            self.brief.subjects, len(schema.causes("L1") if schema.name == "known" else ())
        )


class ReadsTheCallStack(Dice):
    """Finds the session among the variables of its callers, and plays the solutions in order."""

    def act(self, view):
        frame = sys._getframe(1)
        while not isinstance(session := frame.f_locals.get("self"), Session):
            frame = frame.f_back
        truth, actions = session.truth, []
        for subject, room in enumerate(truth.room):
            found = min(view.console.solutions_found[subject], 2)
            used = self.brief.action_limit - view.console.actions_left[subject]
            solution = truth.rooms[room].schema.solutions[found]
            actions.append(truth.rooms[room].action_of(solution)[used])
        return np.array(actions)


class TurnsBits(Dice):
    def act(self, view):
        view.observation[0, 0] ^= 1
        return super().act(view)


class ClearsRewards(Dice):
    def learn(self, step):
        step.reward[:] = 0


class TurnsBitsThroughTorch(Dice):
    def act(self, view):
        import torch

        torch.from_numpy(view.observation).fill_(1)
        return super().act(view)


class Forgets(Dice):
    def state_dict(self):
        return {}

    def load_state_dict(self, state):
        pass


class Counts(Learner):
    def begin(self, brief):
        self.counts = np.zeros(brief.actions, dtype=int)

    def act(self, view):
        return np.full(len(view.playing), self.counts.argmin())

    def learn(self, step):
        self.counts[step.action[0]] += 1


class NeedsToAct(Dice):
    def act(self, view):
        self.chosen = super().act(view)
        return self.chosen

    def learn(self, step):
        assert len(self.chosen) == len(step.action)


class HandsOutItsOwnState(Counts):
    def state_dict(self):
        return {"counts": self.counts}

    def load_state_dict(self, state):
        self.counts = state["counts"].copy()


class TakesOverTheCheckpoint(Counts):
    def state_dict(self):
        return {"counts": self.counts.copy()}

    def load_state_dict(self, state):
        self.counts = state["counts"]


@dataclass
class Thawed:
    rate: Annotated[float, "how fast"] = 0.5


@dataclass(frozen=True)
class Silent:
    rate: float = 0.5


@dataclass(frozen=True)
class Demanding:
    rate: Annotated[float, "how fast"]


@dataclass(frozen=True)
class Inconsistent:
    rate: Annotated[float, Field(lt=0.1), "how fast"] = 0.5


class WithThawed(Dice):
    """Its parameters can be changed."""

    Parameters = Thawed


class WithSilent(Dice):
    """Its parameters have no meaning."""

    Parameters = Silent


class WithDemanding(Dice):
    """Its parameters have no defaults."""

    Parameters = Demanding


class WithInconsistent(Dice):
    """Its default is none of its values."""

    Parameters = Inconsistent


ANSWERS = "test_it_answers_with_one_action_for_each_subject"
BATCH = "test_a_subject_does_not_depend_on_its_batch"
SEED = "test_the_same_seed_gives_the_same_record"
FINISHED = "test_it_ignores_subjects_that_have_finished"
GLOBAL = "test_it_keeps_no_global_randomness"
LATENT = "test_it_sees_nothing_latent"
SEEN = "test_it_acts_only_on_what_it_sees"
GIVEN = "test_it_never_changes_what_it_is_given"
OTHERS = "test_it_learns_from_what_others_do"
RESUMES = "test_it_goes_on_from_a_checkpoint"
PARAMETERS = "test_its_parameters_are_a_frozen_dataclass_that_explains_itself"


def contract_of(kind: type) -> LearnerContract:
    name = f"{__name__}:{kind.__name__}"
    return type("Contract", (LearnerContract,), {"learner": name})()


class TestDice(LearnerContract):
    learner = f"{__name__}:Dice"


@pytest.mark.parametrize(
    ("kind", "test", "says"),
    [
        (KnowsOnlyTheSmallRoom, ANSWERS, "7 positions, act answered .* integers from 0 to 14"),
        (AnswersFloats, ANSWERS, "act answered float64"),
        (AnswersForOne, ANSWERS, r"of shape \(\), 3, where 4 integers"),
        (DrawsItsOwnSeed, SEED, r"twice with the same seed .* row 0: actions .* or "),
        (SharesOneGenerator, BATCH, "subject 0, which played as one of 4 and then as one of 1"),
        (RemembersInItsClass, BATCH, "row 0: actions .* or "),
        (LearnsFromTheFinished, FINISHED, "1 steps after .* step.view.playing"),
        (DrawsGlobally, GLOBAL, r"used or seeded numpy.random; draw from brief.generators"),
        (SeedsGlobally, GLOBAL, "used or seeded random;"),
        (DrawsFromTorch, GLOBAL, "used or seeded torch;"),
        (DrawsItsOwnSeed, GLOBAL, "depends on the global generators"),
        (LooksBehindTheScenes, LATENT, "names of their levers alone"),
        (ReadsTheCallStack, SEEN, r"action 1 of the subjects is .* nothing but what it is given"),
        (TurnsBits, GIVEN, "act changes an array .* copy"),
        (ClearsRewards, GIVEN, "learn changes an array .* copy"),
        (TurnsBitsThroughTorch, GIVEN, "act changes an array .* copy"),
        (NeedsToAct, OTHERS, "given another's action, it fails with AttributeError"),
        (Forgets, RESUMES, "as it would have uninterrupted: .* agree for"),
        (HandsOutItsOwnState, RESUMES, "changed with the learner it came from"),
        (TakesOverTheCheckpoint, RESUMES, "changed with the learner it went to"),
        (WithThawed, PARAMETERS, r"dataclass\(frozen=True\)"),
        (WithSilent, PARAMETERS, "no meaning: rate"),
        (WithDemanding, PARAMETERS, "no default: rate"),
        (WithInconsistent, PARAMETERS, "should be less than 0.1"),
        (AnswersFloats, PARAMETERS, "no docstring"),
    ],
)
@pytest.mark.filterwarnings("ignore:The given NumPy array is not writable")
def test_a_broken_promise_is_found(kind: type, test: str, says: str) -> None:
    contract = contract_of(kind)
    with pytest.raises((AssertionError, LearnerError), match=f"(?s){kind.__name__}.*{says}"):
        getattr(contract, test)()


def test_python_lets_a_learner_read_the_call_stack() -> None:
    """Nothing in one process can prevent it; the contract test above is what finds it."""
    session = Session(Condition.named("CC4", find_schema), PROTOCOLS["human"], 4)
    assert set(session.play(ReadsTheCallStack())["attempt"].to_pylist()) == {1, 2, 3}


class ReadsTheSeed(Learner):
    """Draws the rooms again from what its generators carry."""

    def begin(self, brief):
        self.rooms = []
        for subject, generator in enumerate(brief.generators):
            held = generator.bit_generator.seed_seq
            number = held.spawn_key[-1] if held.spawn_key else subject
            (again,) = generators(held.entropy, "environment/CC4", [number])
            visits = plan(Condition.named("CC4", find_schema), PROTOCOLS["human"], again)
            self.rooms.append([visit.layout.name for visit in visits])

    def act(self, view):
        return np.zeros(len(view.playing), dtype=int)


def test_the_generators_of_a_learner_do_not_lead_to_its_rooms() -> None:
    subjects, cheat = [3, 8, 21], ReadsTheSeed()
    session = Session(Condition.named("CC4", find_schema), PROTOCOLS["human"], subjects, seed=2018)
    rooms = [list(dict.fromkeys(of_one)) for of_one in _layouts(session)]
    telling = generators(2018, "learner/learner/CC4/human", subjects)
    cheat.begin(replace(session.brief, generators=telling))
    assert cheat.rooms == rooms, "it would find them in generators that carry the seed"
    cheat.begin(session.brief)
    assert not any(found == room for found, room in zip(cheat.rooms, rooms, strict=True))


def _layouts(session: Session) -> list[list[str]]:
    """The layouts of each subject's trials, in order."""
    record = session.play(create("oracle")).to_pandas()
    return [rows.layout.tolist() for _, rows in record.groupby("subject")]


def test_a_contract_without_a_learner_says_so() -> None:
    with pytest.raises(AssertionError, match=r'learner = "my_package:MyLearner"'):
        LearnerContract().test_it_plays_a_session_to_its_end()


def test_the_contract_runs_under_unittest() -> None:
    case = type("Case", (LearnerContract, unittest.TestCase), {"learner": "oracle"})
    result = unittest.TestResult()
    unittest.defaultTestLoader.loadTestsFromTestCase(case).run(result)
    assert result.testsRun == 14
    assert result.wasSuccessful()
    assert len(result.skipped) == 2

"""The simple learners, learners for one subject, and the generators that learners get."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from causal_openlock import compare, open_results
from causal_openlock.analysis.topics.learning_cost import costs_by_learner, shown, subject_costs
from causal_openlock.contract.one_subject import OneSubjectLearner, PerSubjectAdapter
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.condition import find_condition
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import bundled_schemas, find_schema
from causal_openlock.testing import LearnerContract
from causal_openlock.world.randomness import Streams, generators, unrelated_generators
from openlock_learners.oracle import Oracle
from openlock_learners.random import RandomLearner
from support.session_play import one_room

HUMAN = PROTOCOLS["human"]
LONG = replace(HUMAN, attempt_limit=300, stop_when_solved=False, baseline_trials=3)
DETERMINISTIC = [name for name, schema in bundled_schemas().items() if schema.deterministic]


def session(condition, protocol=HUMAN, subjects=10):
    return Session(find_condition(condition), protocol, subjects, seed=3)


def test_the_random_learner_draws_every_action_equally_often_and_independently():
    record = session("CC4", LONG, 12).play(RandomLearner()).to_pandas()
    done = [np.concatenate(rows["actions"].to_numpy()) for _, rows in record.groupby("subject")]
    for actions in done:
        counts = np.bincount(actions, minlength=15)
        assert (len(counts), counts.sum() > 2500) == (15, True)
        assert stats.chisquare(counts).pvalue > 1e-3


@pytest.mark.parametrize("name", DETERMINISTIC)
def test_the_oracle_needs_as_many_attempts_as_there_are_solutions(name):
    solutions = len(find_schema(name).solutions)
    record = session(name, replace(HUMAN, layouts="random")).play(Oracle()).to_pandas()
    assert record["new_solution"].all()
    assert set(record.groupby(["subject", "trial"]).size()) == {solutions}
    assert record["solutions_found"].max() == record["solutions"].iloc[0] == solutions


@pytest.mark.parametrize(
    ("action_limit", "chance"),
    [
        # L0 is free and certain; L1 (or L2) and the door take effect four times in five.
        (3, 0.8**2),
        # Two of the four actions after L0 must take effect: it looks, and tries again.
        (5, 1 - 0.2**4 - 4 * 0.8 * 0.2**3),
    ],
)
def test_the_oracle_tries_again_where_a_noisy_room_does_not_obey(action_limit, chance):
    protocol = replace(HUMAN, action_limit=action_limit, attempt_limit=60)
    record = session("noisy_CC3", protocol, 400).play(Oracle()).to_pandas()
    attempts = record.groupby(["subject", "trial"]).size()
    # Attempts to the second success: mean 2/p, variance 2(1 - p)/p².
    deviation = (2 * (1 - chance)) ** 0.5 / chance / len(attempts) ** 0.5
    assert attempts.mean() == pytest.approx(2 / chance, abs=4 * deviation)
    assert record.groupby(["subject", "trial"])["new_solution"].sum().eq(2).all()


class Tally(OneSubjectLearner):
    """Does what it has done least, at random among equals."""

    def begin(self):
        self.done = np.zeros(self.brief.actions, dtype=int)

    def act(self, observation):
        observation[:] = 7  # which is its own
        least = np.flatnonzero(self.done == self.done.min())
        return int(self.generator.choice(least))

    def learn(self, moment):
        assert moment.observation.max() == 1
        self.done[moment.action] += 1


class TestTally(LearnerContract):
    learner = f"{__name__}:Tally"


class Scripted(OneSubjectLearner):
    """Follows a script and writes down what it is told."""

    scripts = iter(())
    players = []  # noqa: RUF012

    def begin(self):
        self.moments, self.script = [], next(self.scripts)
        self.players.append(self)

    def act(self, observation):
        return next(self.script)

    def learn(self, moment):
        self.moments.append(moment)


def test_a_player_is_told_what_its_own_action_led_to():
    # Positions: UPPER 1, LEFT 3, LOWER 5. The first subject solves it all, and is done.
    room = one_room("CC3", {"L0": "UPPER", "L1": "LEFT", "L2": "LOWER"})
    Scripted.scripts = map(iter, ([1, 3, 14, 1, 5, 14], [1, 8, 6, 14, 14, 3] + [0] * 6))
    Scripted.players.clear()
    play = Session(room, replace(HUMAN, attempt_limit=4, baseline_trials=1), 2)
    play.play(PerSubjectAdapter(Scripted))
    for player, generator in zip(Scripted.players, play.brief.generators, strict=True):
        assert player.brief == replace(play.brief, subjects=1, generators=(generator,))
        assert player.generator is generator
    first, second = (player.moments for player in Scripted.players)
    assert (len(first), len(second)) == (6, 12)
    assert [moment.action for moment in first] == [1, 3, 14, 1, 5, 14]
    assert all(type(moment.action) is int and type(moment.reward) is float for moment in first)
    assert [moment.reward for moment in first] == [1, 10, 50, 1, 15, 75]
    assert [moment.attempt_over for moment in first] == [False, False, True] * 2
    assert [moment.trial_over for moment in first] == [False] * 5 + [True]
    assert [moment.new_solution for moment in first] == [False, False, True] * 2
    assert [moment.solutions_left for moment in first] == [2, 2, 1, 1, 1, 0]
    assert {moment.solutions_left for moment in second} == {2}
    colours = [0, 1, 0, 1, 0, 1, 0]
    closed = [0, 0, 0, 0, 0, 0, 0, *colours, 1, 0]
    assert first[0].observation.tolist() == closed
    assert first[2].outcome.tolist() == [0, 1, 0, 1, 0, 0, 0, *colours, 0, 1]
    assert first[3].observation.tolist() == closed  # the room was put back


@pytest.mark.parametrize("answer", [2.7, None, "3", np.array([1, 2]), 2**70])
def test_a_player_that_answers_no_integer_is_named(answer):
    kind = type("Vague", (OneSubjectLearner,), {"act": lambda self, observation: answer})
    with pytest.raises(LearnerError, match="Vague"):
        session("CC3").play(PerSubjectAdapter(kind))


class Experienced(OneSubjectLearner):
    """Has played before."""

    before = 5000

    @classmethod
    def prior_attempts(cls, parameters):
        return cls.before

    def act(self, observation):
        return int(self.generator.integers(self.brief.actions))


class OfUnknownOrigin(Experienced):
    before = None


class Wrong(Experienced):
    before = -1


def test_attempts_before_the_experiment_count(tmp_path):
    results = compare("CC3", [Experienced, OfUnknownOrigin], subjects=1, workers=0, out=tmp_path)
    for read in (results, open_results(tmp_path)):
        assert read.trained_before == pytest.approx(
            {"Experienced": 5000, "OfUnknownOrigin": np.nan}, nan_ok=True
        )
    board = results.leaderboard.set_index("learner")["before"]
    assert (board["Experienced"], np.isnan(board["OfUnknownOrigin"])) == (5000, True)
    costs = costs_by_learner(subject_costs(results, results.trials))
    assert shown(costs)["before the experiment"].tolist() == ["5,000", "unknown"]
    assert costs["attempts"].iloc[0] > 5000
    assert np.isfinite(costs["asked"]).all()
    assert "What OfUnknownOrigin had learned before the experiment is unknown." in results.methods()
    with pytest.raises(LearnerError, match=r"prior_attempts of .*Wrong.*-1"):
        compare("CC3", Wrong, subjects=1, workers=0)


@pytest.mark.parametrize("make", [generators, unrelated_generators])
def test_the_numbers_of_a_subject_are_its_own(make):
    def numbers(generator):
        return np.concatenate([generator.random(8), *(g.random(8) for g in generator.spawn(2))])

    several, alone = make(1, "a", range(5)), make(1, "a", [3])
    mine = numbers(alone[0])
    assert len(set(mine)) == 24
    assert np.array_equal(numbers(several[3]), mine)
    others = {"subject": (1, "a", [4]), "key": (1, "b", [3]), "seed": (2, "a", [3])}
    for what, (seed, key, subjects) in others.items():
        assert not np.isin(numbers(make(seed, key, subjects)[0]), mine).any(), what


def test_streams_hand_out_the_numbers_of_each_generator_in_order():
    for block in (1, 3, 512):
        streams = Streams(generators(0, "x", range(3)), width=2, block=block)
        drawn = np.stack([streams.uniform() for _ in range(7)])
        for subject, generator in enumerate(generators(0, "x", range(3))):
            assert np.array_equal(drawn[:, subject], generator.random((7, 2)))

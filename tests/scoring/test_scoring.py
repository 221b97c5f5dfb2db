"""Who predicts recorded subjects: by exact probabilities, in the rooms that they met."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import causal_openlock as ol
from causal_openlock.errors import LearnerError, StoreError
from causal_openlock.experiment.making import make_experiment
from causal_openlock.experiment.session import Session
from causal_openlock.running.runner import run
from causal_openlock.scoring.scores import Scores
from causal_openlock.storage.store import Store
from openlock_learners.ddqn import DDQN
from openlock_learners.random import RandomLearner
from support.command import at_once
from support.scores import score_actions

pytestmark = pytest.mark.slow

SHORT = ol.Protocol("short", 8, stop_when_solved=True, baseline_trials=2)
LEARNERS = [
    ol.learner("bayes", label="thompson", policy="thompson"),
    ol.learner("bayes", label="noisy", temperature=1.0, lapse=0.05),
    ol.learner("ddqn", hidden_units=16, batch_size=16),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Results of three learners, six subjects each."""
    made = make_experiment(["CC3"], LEARNERS, subjects=6, protocol=SHORT, seed=5)
    folder = tmp_path_factory.mktemp("scored")
    run(made, folder, workers=0)
    return folder


@pytest.fixture(scope="module")
def played(folder):
    return Store(folder).record()


def spec(name, *others):
    made = make_experiment(["CC3"], [*LEARNERS, *others]).learners
    return next(one for one in made if one.name == name)


def test_random_needs_the_logarithm_of_the_number_of_actions(played):
    subjects = Scores(score_actions(*played, spec("random", "random"))).subjects
    assert subjects["bits"].to_numpy() == pytest.approx(np.log2(15))
    assert subjects["expected"].to_numpy() == pytest.approx(np.log2(15))
    assert subjects["actions"].sum() == sum(len(row) for row in played[0]["actions"].to_pylist())


def test_numbers_that_were_chosen_have_a_price_and_a_policy_has_none(played):
    both = [spec("thompson"), spec("noisy")]
    scores = Scores(score_actions(*played, both, lapse=0.01, of=["noisy"]))
    subjects = scores.subjects.set_index("scored")
    price = subjects["bic"] - 2 * subjects["nll"]
    assert price["thompson"].to_numpy() == pytest.approx(0.0)
    assert price["noisy"].to_numpy() == pytest.approx(2 * np.log(subjects["actions"]["noisy"]))


def test_learners_that_predict_alike_are_both_best(played):
    same = [spec(name, "random", ol.learner("random", label="same")) for name in ("random", "same")]
    alike = pd.concat(score_actions(*played, one) for one in same)
    assert Scores(alike).ranking["best_of"].tolist() == [18, 18]


def test_its_own_actions_surprise_a_learner_by_its_entropy(played):
    own = score_actions(*played, spec("thompson"), of=["thompson"])
    more = -own["log_probability"] - own["entropy"]
    assert np.isfinite(more).all()
    assert abs(more.mean()) < 4 * more.std() / np.sqrt(len(more))


def test_a_learner_that_trains_predicts_with_the_probabilities_that_it_acted_by(played):
    _, experiment = played
    asked = []

    class Watched(DDQN):
        def act(self, view):
            asked.append(self.probabilities(view))
            return super().act(view)

    made = spec("ddqn")
    # This label has the random numbers of a predicting ddqn, so that both begin alike.
    label = {"learner": "ddqn, predicting", "experiment": "comparison"}
    session = Session(experiment.conditions[0], SHORT, 6, seed=5, reward=made.reward, **label)
    learner = Watched(DDQN.Parameters(hidden_units=16, batch_size=16))
    session.begin(learner)
    then = [
        asked[-1][subject, action]
        for step in session.steps(learner)
        for subject, action in enumerate(step.action.tolist())
        if step.view.playing[subject]
    ]
    now = score_actions(session.record(), experiment, made)
    assert sorted(np.exp(now["log_probability"])) == pytest.approx(sorted(then), abs=1e-9)


def test_lapses_bound_what_an_action_can_cost(played):
    never = score_actions(*played, spec("thompson"), of=["ddqn"])
    impossible = np.isneginf(never["log_probability"])
    assert impossible.any()
    assert Scores(never).subjects["impossible"].sum() == impossible.sum()
    assert np.isnan(Scores(never).ranking["low"]).all()
    some = score_actions(*played, spec("thompson"), lapse=0.15, of=["ddqn"])
    assert some["log_probability"].min() == pytest.approx(np.log(0.15 / 15))
    mixed = np.log(0.85 * np.exp(never["log_probability"]) + 0.15 / 15)
    assert some["log_probability"].tolist() == pytest.approx(mixed.tolist())
    assert Scores(some).subjects["impossible"].sum() == impossible.sum()


class Odd(RandomLearner):
    """Answers with what a test gives it, and fails where a test says so."""

    chances = None
    fails = ""

    def begin(self, brief):
        if self.fails == "begin":
            raise KeyError("beliefs")
        super().begin(brief)

    def learn(self, step):
        if self.fails == "learn":
            raise KeyError("beliefs")

    def probabilities(self, view):
        if self.fails == "probabilities":
            raise KeyError("beliefs")
        return super().probabilities(view) if self.chances is None else self.chances


ODD = ol.learner("test_scoring:Odd", label="odd")


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"chances": np.full((6, 15), 3.0)}, "the probabilities of odd"),
        ({"chances": np.full((6, 3), 1 / 3)}, "the probabilities of odd"),
        ({"chances": np.full((6, 15), np.nan)}, "the probabilities of odd"),
        ({"chances": "likely"}, "the probabilities of odd"),
        ({"fails": "begin"}, "odd fails .KeyError: 'beliefs'"),
        ({"fails": "learn"}, "odd fails .KeyError: 'beliefs'"),
        ({"fails": "probabilities"}, "odd fails .KeyError: 'beliefs'"),
    ],
)
def test_a_learner_that_gives_no_probabilities_is_named(played, monkeypatch, changes, named):
    for name, value in changes.items():
        monkeypatch.setattr(Odd, name, value)
    with pytest.raises(LearnerError, match=named):
        score_actions(*played, spec("odd", ODD), of=["thompson"])


def test_a_record_that_is_not_of_these_rooms_is_refused(played):
    record, experiment = played
    elsewhere = replace(experiment, conditions=(ol.find_condition("CE3"),))
    names = pa.array(["CE3"] * len(record)).dictionary_encode()
    moved = record.set_column(record.schema.get_field_index("condition"), "condition", names)
    with pytest.raises(StoreError, match="CE3"):
        score_actions(moved, elsewhere, spec("random", "random"))


def test_actions_at_the_limit_of_draws_are_counted(folder, tmp_path):
    words = ["score", folder, "-l", "posterior_sampling", "--of", "thompson", "--draws", 4]
    done = at_once(*words, "--workers", 1, "--out", tmp_path)
    assert done.status == 0, done.stderr
    actions = pq.read_table(tmp_path / "actions.parquet").to_pandas()
    at_limit = actions["at_limit"].sum()
    assert 0 < at_limit < len(actions)
    assert pd.read_csv(tmp_path / "subjects.csv")["at_limit"].sum() == at_limit
    assert f"posterior_sampling: of {len(actions):,} actions, {at_limit:,} " in " ".join(
        done.stdout.split()
    )

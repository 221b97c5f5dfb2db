"""Who predicts recorded subjects: by exact probabilities, in the rooms that they met."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

import causal_openlock as ol
from causal_openlock.cli import app
from causal_openlock.errors import LearnerError, StoreError
from causal_openlock.experiment.building import make_experiment
from causal_openlock.experiment.experiment import LearnerSpec
from causal_openlock.experiment.session import Session
from causal_openlock.running.runner import run
from causal_openlock.scoring.scores import by_subject, ranking
from causal_openlock.scoring.teacher_forcing import score_actions
from causal_openlock.storage.store import Store
from causal_openlock.storage.stored import StoredExperiment
from openlock_learners.ddqn import DDQN

pytestmark = pytest.mark.slow

SHORT = ol.Protocol("short", 8, stop_when_solved=True, baseline_trials=2)
LEARNERS = [
    ol.learner("bayes", label="thompson", policy="thompson"),
    ol.learner("bayes", label="noisy", temperature=1.0, lapse=0.05),
    ol.learner("ddqn", hidden_units=16, batch_size=16),
]
Played = tuple[pa.Table, StoredExperiment]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of three learners, six subjects each."""
    made = make_experiment(["CC3"], LEARNERS, subjects=6, protocol=SHORT, seed=5)
    folder = tmp_path_factory.mktemp("scored")
    run(made, folder, workers=0)
    return folder


@pytest.fixture(scope="module")
def played(folder: Path) -> Played:
    return Store(folder).record()


def spec(name: str, *others: Any) -> LearnerSpec:
    (found,) = (one for one in make_experiment(["CC3"], [*LEARNERS, *others]).learners
                if one.name == name)  # fmt: skip
    return found


def of(played: Played, learner: str) -> Played:
    record, experiment = played
    own = [name == learner for name in record["learner"].to_pylist()]
    return record.filter(pa.array(own)), experiment


def test_one_that_knows_nothing_needs_as_many_bits_as_there_are_actions(played: Played) -> None:
    actions = score_actions(*played, spec("random", "random"))
    subjects = by_subject(actions)
    assert subjects["bits"].to_numpy() == pytest.approx(np.log2(15))
    assert subjects["expected"].to_numpy() == pytest.approx(np.log2(15))
    taken = [len(one) for one in played[0]["actions"].to_pylist()]
    assert subjects["actions"].sum() == sum(taken)


def test_who_acted_predicts_best(played: Played) -> None:
    for name, other in (("thompson", "noisy"), ("noisy", "thompson")):
        own = of(played, name)
        scored = [
            score_actions(*own, spec(each, "random"), 0.01) for each in (other, name, "random")
        ]
        ranked = ranking(by_subject(pd.concat(scored)))
        assert ranked["scored"].iloc[0] == name
        assert ranked["best_of"].tolist() == [6, 0, 0]
        assert (ranked["worse_low"].iloc[1:] > 0).all()


def test_it_is_as_surprised_as_it_expects_to_be(played: Played) -> None:
    own = score_actions(*of(played, "thompson"), spec("thompson"))
    more = -own["log_probability"] - own["entropy"]
    assert np.isfinite(more).all()
    assert abs(more.mean()) < 4 * more.std() / np.sqrt(len(more))


def test_a_learner_that_trains_has_the_probabilities_that_it_acted_by(played: Played) -> None:
    _, experiment = of(played, "ddqn")
    asked: list[np.ndarray] = []

    class Watched(DDQN):
        def act(self, view: Any) -> Any:
            asked.append(self.probabilities(view))
            return super().act(view)

    made = spec("ddqn")
    # This label has the random numbers of a predicting ddqn, so that both begin alike.
    session = Session(experiment.conditions[0], SHORT, 6, seed=5, learner="ddqn, predicting",
                      reward=made.reward, experiment="comparison")  # fmt: skip
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


def test_lapses_bound_what_an_action_can_cost(played: Played) -> None:
    own = of(played, "ddqn")
    never = score_actions(*own, spec("thompson"))
    assert np.isneginf(never["log_probability"]).any()
    assert by_subject(never)["impossible"].sum() == np.isneginf(never["log_probability"]).sum()
    assert np.isnan(ranking(by_subject(never))["low"]).all()
    some = score_actions(*own, spec("thompson"), lapse=0.15)
    assert some["log_probability"].min() == pytest.approx(np.log(0.15 / 15))
    assert by_subject(some)["impossible"].sum() == by_subject(never)["impossible"].sum()


@pytest.mark.parametrize(
    "wrong",
    [
        np.full((6, 15), 3.0),
        np.full((6, 3), 1 / 3),
        np.full((6, 15), np.nan),
        [[1 / 15] * 15] * 6,
        "likely",
        3,
    ],
)
def test_what_are_no_probabilities_is_refused(
    played: Played, monkeypatch: pytest.MonkeyPatch, wrong: object
) -> None:
    monkeypatch.setattr("openlock_learners.random.RandomLearner.probabilities", lambda *_: wrong)
    with pytest.raises(LearnerError, match="the probabilities of random are not an array of 15"):
        score_actions(*played, spec("random", "random"))


def test_a_learner_that_fails_in_the_place_of_a_subject_is_named(
    played: Played, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        raise KeyError("beliefs")

    for name in ("probabilities", "learn", "begin"):
        with monkeypatch.context() as broken:
            broken.setattr(f"openlock_learners.random.RandomLearner.{name}", fails)
            with pytest.raises(
                LearnerError, match=r"the learner random failed .* KeyError: 'beliefs'"
            ):
                score_actions(*played, spec("random", "random"))


@pytest.mark.parametrize("size", [-1, np.full(6, -1.0), np.full(6, np.nan), np.ones(2), "many"])
def test_a_number_of_draws_that_is_none_is_named(
    played: Played, monkeypatch: pytest.MonkeyPatch, size: object
) -> None:
    monkeypatch.setattr("openlock_learners.random.RandomLearner.sample_size", lambda _: size)
    with pytest.raises(LearnerError, match="the sample_size of random is not an array"):
        score_actions(*played, spec("random", "random"))


def test_no_flipped_bit_of_a_part_that_is_kept_passes(played: Played, tmp_path: Path) -> None:
    scored = spec("random", "random")
    made = score_actions(*played, scored, keep=tmp_path)
    (path, *_) = sorted(tmp_path.glob("*.parquet"))
    whole = path.read_bytes()
    pd.testing.assert_frame_equal(score_actions(*played, scored, keep=tmp_path), made)
    for place in np.linspace(0, len(whole) - 1, 40).astype(int).tolist():
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :])
        with pytest.raises(StoreError, match=r"cannot be read \(.+\); remove it"):
            score_actions(*played, scored, keep=tmp_path)


def test_those_who_predict_alike_are_both_best(played: Played) -> None:
    alike = [score_actions(*played, spec(name, "random", ol.learner("random", label="same")))
             for name in ("random", "same")]  # fmt: skip
    assert ranking(by_subject(pd.concat(alike)))["best_of"].tolist() == [18, 18]


def test_what_does_not_come_out_again_is_refused(played: Played) -> None:
    record, experiment = played
    elsewhere = replace(experiment, conditions=(ol.Condition.named("CE3", ol.find_schema),))
    names = pa.array(["CE3"] * len(record)).dictionary_encode()
    moved = record.set_column(record.schema.get_field_index("condition"), "condition", names)
    with pytest.raises(StoreError, match="does not come out again in the rooms"):
        score_actions(moved, elsewhere, spec("random", "random"))


def test_a_learner_that_knows_its_own_actions_alone_is_refused(played: Played) -> None:
    with pytest.raises(LearnerError, match="sb3 learns from its own actions alone"):
        score_actions(*played, spec("sb3", "sb3"))


def test_on_the_command_line(folder: Path, tmp_path: Path) -> None:
    words = [
        "score",
        str(folder),
        "-l",
        "random",
        "-l",
        "oracle",
        "--of",
        "thompson",
        "--workers",
        "1",
    ]
    result = CliRunner().invoke(app, [*words, "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    said = " ".join(result.output.split())
    assert "n = 6 subjects, of 1 learner in 1 condition; 0.01 of all actions" in said
    actions = pq.read_table(tmp_path / "actions.parquet").to_pandas()
    assert set(actions["scored"]) == {"random", "oracle"}
    assert set(actions["learner"]) == {"thompson"}
    assert len(pd.read_csv(tmp_path / "subjects.csv")) == 2 * 6


def test_actions_at_the_limit_of_draws_are_counted(folder: Path, tmp_path: Path) -> None:
    words = ["score", str(folder), "-l", "posterior_sampling", "--of", "thompson", "--draws", "4"]
    result = CliRunner().invoke(app, [*words, "--workers", "1", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    actions = pq.read_table(tmp_path / "actions.parquet").to_pandas()
    at_limit = actions["at_limit"].sum()
    assert 0 < at_limit < len(actions)
    assert pd.read_csv(tmp_path / "subjects.csv")["at_limit"].sum() == at_limit
    said = f"of {len(actions):,} actions, {at_limit:,} were not hit before the limit of draws"
    assert said in " ".join(result.output.split())


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([], "name who predicts, with --learner, --from or --fits"),
        (["-l", "byes"], "did you mean bayes?"),
        (["-l", "bayes", "--of", "nobody"], "there is no learner 'nobody'"),
        (["--from", "default", "-l", "mine"], "there is no learner 'mine'"),
    ],
)
def test_mistakes_are_explained(folder: Path, words: list[str], sentence: str) -> None:
    result = CliRunner().invoke(app, ["score", str(folder), *words])
    assert result.exit_code != 0
    assert sentence in str(result.exception)

"""Training that is shown: each solution of each room once, and nothing of it is a result."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from causal_openlock import Results
from causal_openlock.contract.registry import create
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.building import make_experiment
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.protocol import Condition, plan, shown_trials
from causal_openlock.experiment.session import Session
from causal_openlock.export.as_csv import write_csv
from causal_openlock.export.as_minari import write_minari
from causal_openlock.export.croissant import data_card
from causal_openlock.export.experiment_file import experiment_file
from causal_openlock.files.yaml_file import dump_yaml
from causal_openlock.importing.folder import import_files
from causal_openlock.render.watch import watch
from causal_openlock.running.runner import run
from causal_openlock.scoring.inverse_binomial import Draws
from causal_openlock.scoring.teacher_forcing import score_actions
from causal_openlock.storage.store import Store
from openlock_learners.random import RandomLearner
from support.command import at_once
from support.made_up_experiments import stored
from support.session_play import HUMAN, RL, SCHEMAS, Scripted, named, play, trials_of

SHOWN = "shown-CC3-CC4"
ONE_LOOP = replace(RL, name="one_loop", attempt_limit=9, train_loops=1, test_loops=1)
PLAYED = replace(named(SHOWN), name="same", shown=False)
"""The same condition, and the same rooms, as the condition ``same`` whose training is shown."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Results of two learners, next to those who play their training."""
    made = make_experiment(["CC3-CC4", SHOWN], ["random", "bayes"], subjects=3, seed=5)
    folder = tmp_path_factory.mktemp("shown")
    run(made, folder, workers=0)
    return folder


@pytest.fixture(scope="module")
def record(folder):
    return Store(folder).record()[0].to_pandas()


# -- sessions --------------------------------------------------------------------------------------


@pytest.mark.parametrize("protocol", [HUMAN, ONE_LOOP], ids=["human", "one loop"])
def test_each_solution_is_shown_once_in_the_room_then_the_test_is_played(protocol):
    record = play(create("oracle"), SHOWN, protocol, 30)
    shown = record[record["phase"] == "shown"]
    assert shown["new_solution"].all()
    assert (trials_of(shown)["attempts"] == 2).all()
    assert shown.groupby("subject")["trial"].max().eq(6).all()
    rest = record[record["phase"] != "shown"]
    assert set(rest["phase"]) == {"test"}
    assert set(rest["schema"]) == {"CC4"}
    # Orders are drawn for each subject and room: about as often the one as the other.
    first = shown.loc[shown["attempt"] == 1, "solution"]
    assert 60 < (first == 0).sum() < 120


def test_rooms_are_those_of_subjects_who_play_their_training_by_the_same_name():
    both = [
        [(visit.trial, visit.schema.name, visit.layout.name) for visit in plan(one, HUMAN, rng)]
        for one in (PLAYED, replace(PLAYED, shown=True))
        for rng in [np.random.default_rng(4)]
    ]
    assert both[0] == both[1]
    assert [shown_trials(one, HUMAN) for one in (PLAYED, named(SHOWN))] == [0, 6]


def test_what_subjects_do_is_what_they_were_shown_and_then_they_act_themselves():
    learner = Scripted([], [], afterwards=0)  # it does nothing of its own
    session = Session(named(SHOWN), HUMAN, 2)
    session.begin(learner)
    steps = session.steps(learner)
    taken = [next(steps) for _ in range(6 * 2 * 3)]
    assert session.shown is None
    assert all((step.view.trial <= 6).all() for step in taken)
    assert next(steps).view.trial.tolist() == [7, 7]
    assert session.record().num_rows == 2 * 6 * 2


@pytest.mark.parametrize("name", ["bayes", "win_stay"])
def test_being_shown_teaches_what_doing_the_same_teaches(name):
    sessions = [Session(one, HUMAN, 2) for one in (replace(PLAYED, shown=True), PLAYED)]
    learners = [create(name) for _ in sessions]
    for session, learner in zip(sessions, learners, strict=True):
        session.begin(learner)
    before = learners[0].probabilities(sessions[0].view)
    for _ in range(6 * 2 * 3):
        action = sessions[0].shown
        for session, learner in zip(sessions, learners, strict=True):
            learner.probabilities(session.view)
            learner.learn(session.step(action))
    after = [one.probabilities(own.view) for one, own in zip(learners, sessions, strict=True)]
    np.testing.assert_array_equal(*after)
    assert not np.array_equal(before, after[0])


class Alone(RandomLearner):
    learns_from_others = False


def test_who_learns_from_its_own_actions_alone_is_shown_nothing():
    with pytest.raises(OpenLockError, match="Alone"):
        Session(named(SHOWN), HUMAN, 1).play(Alone())
    made = make_experiment([SHOWN, "CC3-CC4"], ["random", Alone], subjects=1)
    ((who, left_out),) = made.not_applicable.items()
    assert (who, [*left_out]) == ("Alone", [SHOWN])


# -- declared --------------------------------------------------------------------------------------

FILE = """\
name: own
subjects: 2
conditions:
  - shown-CC3-CC4
  - name: watched
    train: {shown: CC3}
    test: [{schema: CC4}]
  - name: several
    train: {shown: [{schema: CC3, layouts: random, trials: 1}, {schema: CE3, trials: 2}]}
    test: [{schema: CC4, layouts: [trial7]}]
learners: [random]
"""


def test_a_file_says_what_is_shown_and_survives_being_described(tmp_path):
    (tmp_path / "own.yaml").write_text(FILE, encoding="utf-8")
    experiment = read_experiment(tmp_path / "own.yaml")
    by_name, watched, several = experiment.conditions
    assert [one.shown for one in experiment.conditions] == [True] * 3
    assert (watched.train, watched.test) == (by_name.train, by_name.test)
    assert [shown_trials(one, HUMAN) for one in experiment.conditions] == [6, 6, 3]
    assert [trials.schema.name for trials in several.train] == ["CC3", "CE3"]
    kept = stored(experiment)
    assert kept.conditions == experiment.conditions
    (tmp_path / "schemas").mkdir()
    for name in ("CC3", "CC4", "CE3"):
        (tmp_path / "schemas" / f"{name}.yaml").write_text(SCHEMAS[name].to_yaml())
    (tmp_path / "again.yaml").write_text(dump_yaml(experiment_file(kept)), encoding="utf-8")
    assert read_experiment(tmp_path / "again.yaml").identity == experiment.identity


def test_a_mapping_declares_the_condition_that_has_its_name():
    declared = {"train": {"shown": "CC3"}, "test": "CC4"}
    (made,) = make_experiment([declared], ["random"]).conditions
    assert made == named(SHOWN)
    (own,) = make_experiment([{"name": "own", **declared}], ["random"]).conditions
    assert own == Condition("own", made.train, made.test, shown=True)


# -- what is made of it ----------------------------------------------------------------------------


def test_results_are_of_what_was_played(folder):
    results = Results.read(folder)
    trials = results.trials[results.trials["condition"] == SHOWN]
    assert trials.groupby("learner", observed=True).size().to_dict() == {"random": 3, "bayes": 3}
    for table in (trials, results.summary, results.regret):
        assert set(table.query("condition == @SHOWN")["phase"].astype(str)) == {"test"}
    assert len(results.structure_recovery.query("condition == @SHOWN and learner == 'bayes'")) == 3
    assert "were first shown rooms of CC3" in " ".join(results.methods().split())
    assert results.plot.beliefs(learner="bayes", condition=SHOWN) is not None
    with pytest.raises(OpenLockError, match="from 1 to 1"):
        results.plot.beliefs(learner="bayes", condition=SHOWN, trial=2)


@pytest.mark.parametrize("trial", [1, 7])
def test_traces_and_films_tell_a_shown_trial_from_a_played_one(trial, folder, tmp_path):
    options = (SHOWN, "--learner", "bayes", "--trial", trial)
    said = at_once("trace", *options, cwd=tmp_path).stdout
    assert [word in said for word in ("Shown in", "Solved in")] == [trial == 1, trial == 7]
    done = at_once("film", *options, "--from", folder, "--out", "film.svg", cwd=tmp_path)
    picture = (tmp_path / "film.svg").read_text(encoding="utf-8")
    assert ("2 of 2 solutions shown" in done.stdout) == (trial == 1)
    assert ("3 of 3 solutions found" in done.stdout) == (trial == 7)
    assert ("Trial 1 of 7 (shown to the subject): CC3" in picture) == (trial == 1)
    title = watch("bayes", SHOWN, trial=trial, attempts=1).title
    assert ("(shown to the subject)" in title) == (trial == 1)


def test_what_was_shown_is_not_counted_among_what_was_played(folder, record, tmp_path):
    played = record.query("phase != 'shown'")
    own = played.query("learner == 'bayes' and condition == @SHOWN")
    table = Store(folder).record(["learner", "condition", "subject", "phase"])[0]
    card = data_card(Store(folder).experiment(), table, {})
    assert f"| bayes | {SHOWN} | 3 | {len(own)} |" in card
    assert write_csv(Store(folder), tmp_path / "out.csv") == len(played)
    made = import_files([tmp_path / "out.csv"], tmp_path / "in")
    assert made.attempts == len(played)
    rows = Counter(record["phase"])
    assert Counter(Store(tmp_path / "in").record()[0]["phase"].to_pylist()) == rows
    assert rows["shown"] == 2 * 3 * 6 * 2


def test_a_data_set_for_learning_has_what_was_played(folder, tmp_path):
    minari = pytest.importorskip("minari")
    written, count = write_minari(Store(folder), tmp_path, episodes="trial", conditions=[SHOWN])
    assert count == 2 * 3
    data = minari.MinariDataset(written / "data")
    assert {one["phase"] for one in data.storage.get_episode_metadata(range(count))} == {"test"}


@pytest.mark.parametrize("scored", ["bayes", "theory_based"])
def test_scores_are_of_what_was_chosen_after_what_was_shown(scored, folder):
    record, experiment = Store(folder).record()
    (spec,) = make_experiment(["CC3"], [scored]).learners
    table = score_actions(record, experiment, spec, of=["bayes"], draws=Draws(hits=1))
    rows = record.to_pandas().query(
        "learner == 'bayes' and condition == @SHOWN and phase == 'test'"
    )
    own = table[table["condition"] == SHOWN]
    assert set(own["trial"]) == {7}
    assert own["action_index"].tolist() == [one for each in rows["actions"] for one in each]
    if scored == "bayes":
        assert not own["impossible"].any()


@pytest.mark.parametrize(("trial", "also"), [(1, ["phase", "layout"]), (1, []), (7, ["layout"])])
def test_a_table_without_what_was_shown_is_told_so(trial, also, record, tmp_path):
    """Actions of the test alone, whether or not its number counts on from what was shown."""
    table = record.query("learner == 'bayes' and phase == 'test' and condition == @SHOWN")
    table = table.assign(trial=trial).explode("actions").rename(columns={"actions": "action"})
    columns = ["subject", "condition", "trial", "attempt", "action", *also]
    table[columns].to_csv(tmp_path / "played.csv", index=False)
    with pytest.raises(OpenLockError, match=r"played.csv:\d: .*add rows of what it was shown"):
        import_files([tmp_path / "played.csv"], tmp_path / "in", layouts="drawn")

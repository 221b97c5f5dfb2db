"""Training that is shown: each solution of each room once, and nothing of it is a result."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from causal_openlock import Results
from causal_openlock.contract.registry import create
from causal_openlock.errors import FileError, LearnerError, OpenLockError, ProtocolError
from causal_openlock.experiment.building import Changes, make_experiment
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.protocol import Condition, Protocol, Trials, plan, shown_trials
from causal_openlock.experiment.session import Session
from causal_openlock.export.as_csv import write_csv
from causal_openlock.export.as_minari import write_minari
from causal_openlock.export.croissant import data_card
from causal_openlock.export.experiment_file import experiment_file
from causal_openlock.files.yaml_file import dump_yaml
from causal_openlock.importing.folder import import_files
from causal_openlock.render.watch import watch
from causal_openlock.running.runner import run
from causal_openlock.schemas.schema import Schema
from causal_openlock.scoring.inverse_binomial import Draws
from causal_openlock.scoring.teacher_forcing import score_actions
from causal_openlock.storage.store import Store
from openlock_learners.random import RandomLearner
from support.command import at_once
from support.made_up_experiments import stored
from support.session_play import HUMAN, RL, SCHEMAS, Scripted, named, play, trials_of

SHOWN = "shown-CC3-CC4"
ONE_LOOP = replace(RL, name="one_loop", attempt_limit=9, train_loops=1, test_loops=1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of two learners, next to those who play their training."""
    made = make_experiment(["CC3-CC4", SHOWN], ["random", "bayes"], subjects=3, seed=5)
    folder = tmp_path_factory.mktemp("shown")
    run(made, folder, workers=0)
    return folder


@pytest.mark.parametrize("protocol", [HUMAN, ONE_LOOP], ids=["human", "one loop"])
def test_each_solution_is_shown_once_in_the_room_then_the_test_is_played(
    protocol: Protocol,
) -> None:
    record = play(create("oracle"), SHOWN, protocol, 30)
    shown = record[record["phase"] == "shown"]
    assert shown["new_solution"].all()
    assert shown["opened"].all()
    assert (trials_of(shown)["attempts"] == 2).all()
    assert shown.groupby("subject")["trial"].max().eq(6).all()
    rest = record[record["phase"] != "shown"]
    assert set(rest["phase"]) == {"test"}
    assert set(rest["schema"]) == {"CC4"}
    # Orders are drawn for each subject and room: about as often the one as the other.
    first = shown.loc[shown["attempt"] == 1, "solution"]
    assert 60 < (first == 0).sum() < 120


def test_rooms_are_those_of_subjects_who_play_their_training_by_the_same_name() -> None:
    """A name draws rooms; that the training is shown changes which phase they are in."""
    shown = Condition("same", named("CC3-CC4").train, named("CC3-CC4").test, shown=True)
    both = [
        [(visit.trial, visit.schema.name, visit.layout.name) for visit in plan(one, HUMAN, rng)]
        for one in (shown, replace(shown, shown=False))
        for rng in [np.random.default_rng(4)]
    ]
    assert both[0] == both[1]
    assert shown_trials(shown, HUMAN) == 6
    assert shown_trials(replace(shown, shown=False), HUMAN) == 0


def test_what_subjects_do_is_what_they_were_shown_and_they_learn_from_it() -> None:
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
def test_being_shown_teaches_what_doing_the_same_teaches(name: str) -> None:
    """Elsewhere the same actions are taken in the same rooms, as when a record is scored."""
    shown = Condition("same", named("CC3-CC4").train, named("CC3-CC4").test, shown=True)
    sessions = [Session(one, HUMAN, 2) for one in (shown, replace(shown, shown=False))]
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


def test_what_cannot_be_shown_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ProtocolError, match="shown-CC3 is only shown; add a test"):
        named("shown-CC3")
    with pytest.raises(ProtocolError, match="CC4 is a condition of the paper"):
        replace(named("CC3-CC4"), shown=True)
    noisy = Schema("noisy", ["L0"], {"L0": {"door": 0.5}})
    with pytest.raises(ProtocolError, match="a push can fail in rooms of noisy"):
        Condition("own", (Trials(noisy),), (Trials(SCHEMAS["CC4"]),), shown=True)
    with pytest.raises(
        ProtocolError, match=r"CC3 has 2 solutions to show.*raise its attempt_limit"
    ):
        Session(named(SHOWN), replace(HUMAN, name="one", attempt_limit=1), 1)
    with pytest.raises(OpenLockError, match="is not a condition"):
        named("shown-shown-CC3-CC4")


class Alone(RandomLearner):
    learns_from_others = False


def test_who_learns_from_its_own_actions_alone_is_shown_nothing() -> None:
    with pytest.raises(LearnerError, match="Alone learns from its own actions alone"):
        Session(named(SHOWN), HUMAN, 1).play(Alone())
    made = make_experiment([SHOWN, "CC3-CC4"], ["random", Alone], subjects=1)
    ((who, left_out),) = made.not_applicable.items()
    assert who == "Alone"
    assert "nothing can be shown to it" in left_out.pop(SHOWN)
    assert not left_out


# -- files ----------------------------------------------------------------------------------------

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


def written(folder: Path, text: str = FILE) -> Experiment:
    (folder / "own.yaml").write_text(text, encoding="utf-8")
    return read_experiment(folder / "own.yaml", Changes())


def test_a_file_says_what_is_shown_and_survives_being_described(tmp_path: Path) -> None:
    experiment = written(tmp_path)
    named_, watched, several = experiment.conditions
    assert [one.shown for one in experiment.conditions] == [True] * 3
    assert (watched.train, watched.test) == (named_.train, named_.test)
    assert [shown_trials(one, HUMAN) for one in experiment.conditions] == [6, 6, 3]
    assert [trials.schema.name for trials in several.train] == ["CC3", "CE3"]
    kept = stored(experiment)
    assert kept.conditions == experiment.conditions
    (tmp_path / "schemas").mkdir()
    for name in ("CC3", "CC4", "CE3"):
        (tmp_path / "schemas" / f"{name}.yaml").write_text(SCHEMAS[name].to_yaml())
    (tmp_path / "again.yaml").write_text(dump_yaml(experiment_file(kept)), encoding="utf-8")
    assert read_experiment(tmp_path / "again.yaml").identity == experiment.identity


@pytest.mark.parametrize(
    ("train", "says"),
    [
        ("{shown: CC5}", r":6:13: .*did you mean CC4\?"),
        ("{show: CC3}", r":6:13: .*did you mean shown\?"),
        ("{shown: {}}", r":6:13: write a schema by name or path or a list of trials here"),
        ("{shown: []}", r":6:13: .*at least 1"),
        ("[{shown: CC3}]", r":6:13: only the whole of train can be shown, as in train: {shown: C"),
        ("[{shwn: CC3}]", r"'shwn' is not a key here; known: layouts, schema, shuffle, trials"),
    ],
)
def test_a_fault_in_what_is_shown_names_its_line(train: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(OpenLockError, match=says):
        written(tmp_path, FILE.replace("{shown: CC3}", train))
    with pytest.raises(OpenLockError, match=r":5:.*watched is only shown; add a test"):
        written(tmp_path, FILE.replace("    test: [{schema: CC4}]\n", ""))


@pytest.mark.parametrize("test", ["{shown: CC4}", "[{shown: CC4}]"])
def test_a_test_cannot_be_shown(test: str, tmp_path: Path) -> None:
    with pytest.raises(FileError, match="only the whole of train can be shown, as in train"):
        written(tmp_path, FILE.replace("test: [{schema: CC4}]", f"test: {test}"))


@pytest.mark.parametrize(
    ("declared", "name"),
    [
        ({"train": {"shown": "CC3"}, "test": "CC4"}, SHOWN),
        ({"train": "CC3", "test": "CC4"}, "CC3-CC4"),
        ({"train": "CC3"}, "CC3"),
    ],
)
def test_a_mapping_declares_the_condition_that_has_its_name(
    declared: dict[str, Any], name: str, tmp_path: Path
) -> None:
    (made,) = make_experiment([declared], ["random"]).conditions
    (in_file,) = written(
        tmp_path, dump_yaml({"name": "own", "conditions": [declared], "learners": ["random"]})
    ).conditions
    assert made == in_file == named(name)
    (own,) = make_experiment([{"name": "own", **declared}], ["random"]).conditions
    assert own == replace(made, name="own")


def test_a_faulty_mapping_is_told_what_a_file_is_told() -> None:
    trials = [{"schema": "CC3", "trials": 2}]
    for declared, said in (
        ({"train": trials, "test": "CC4"}, "name: is missing; add it"),
        ({"train": [{"shown": "CC3"}], "test": "CC4"}, "only the whole of train can be shown"),
        ({"train": {"shown": "CC5"}, "test": "CC4"}, r"did you mean CC4\?"),
    ):
        with pytest.raises(OpenLockError, match=f"{said}") as caught:
            make_experiment([declared], ["random"])
        assert len(str(caught.value).splitlines()) == 1


# -- what is made of it ---------------------------------------------------------------------------


def test_results_are_of_what_was_played(folder: Path) -> None:
    results = Results.read(folder)
    trials = results.trials[results.trials["condition"] == SHOWN]
    assert trials.groupby("learner", observed=True).size().to_dict() == {"random": 3, "bayes": 3}
    assert set(trials["phase"]) == {"test"}
    assert set(results.summary.query("condition == @SHOWN")["phase"]) == {"test"}
    found = results.regret
    assert set(found.loc[found["condition"] == SHOWN, "phase"].astype(str)) == {"test"}
    assert len(results.structure_recovery.query("condition == @SHOWN and learner == 'bayes'")) == 3
    assert "In shown-CC3-CC4 subjects were first shown rooms of CC3" in " ".join(
        results.methods().split()
    )


def test_beliefs_after_what_was_shown_are_traced(folder: Path) -> None:
    results = Results.read(folder)
    axes = results.plot.beliefs(learner="bayes", condition=SHOWN)
    assert axes is not None
    with pytest.raises(OpenLockError, match="trials from 1 to 1"):
        results.plot.beliefs(learner="bayes", condition=SHOWN, trial=2)


@pytest.mark.parametrize("trial", [1, 7])
def test_a_trace_tells_a_shown_trial_from_a_played_one(trial: int, tmp_path: Path) -> None:
    done = at_once("trace", SHOWN, "--learner", "bayes", "--trial", trial, cwd=tmp_path)
    said = [part in done.stdout for part in ("it is shown the solutions", "Shown in", "Solved in")]
    assert said == ([True, True, False] if trial == 1 else [False, False, True])


@pytest.mark.parametrize("trial", [1, 7])
def test_a_film_tells_a_shown_trial_from_a_played_one(
    trial: int, folder: Path, tmp_path: Path
) -> None:
    options = "--learner", "bayes", "--trial", trial, "--from", folder, "--out", "film.svg"
    done = at_once("film", SHOWN, *options, cwd=tmp_path)
    picture = (tmp_path / "film.svg").read_text(encoding="utf-8")
    said = [
        "2 of 2 solutions shown to the subject" in done.stdout,
        "Trial 1 of 7 (shown to the subject): CC3" in picture,
        "All solutions shown in 2 attempts" in picture,
    ]
    assert said == [trial == 1] * 3
    assert ("3 of 3 solutions found in the trial" in done.stdout) == (trial == 7)
    watched = watch("bayes", SHOWN, trial=trial, attempts=1)
    assert ("trial 1 of 7 (shown to the subject)" in watched.title) == (trial == 1)


def test_what_was_shown_is_not_counted_among_what_was_played(folder: Path, tmp_path: Path) -> None:
    record = Store(folder).record()[0].to_pandas().query("phase != 'shown'")
    own = record.query("learner == 'bayes' and condition == @SHOWN")
    card = data_card(
        Store(folder).experiment(),
        Store(folder).record(["learner", "condition", "subject", "phase"])[0],
        {},
    )
    assert f"| bayes | {SHOWN} | 3 | {len(own)} |" in card
    assert write_csv(Store(folder), tmp_path / "out.csv") == len(record)
    made = import_files([tmp_path / "out.csv"], tmp_path / "in")
    assert made.attempts == len(record)


@pytest.mark.parametrize("episodes", ["trial", "attempt"])
def test_a_data_set_for_learning_has_what_was_played(
    episodes: str, folder: Path, tmp_path: Path
) -> None:
    minari = pytest.importorskip("minari")
    written, count = write_minari(Store(folder), tmp_path, episodes=episodes, conditions=[SHOWN])
    played = Store(folder).record()[0].to_pandas().query("phase != 'shown' and condition == @SHOWN")
    assert count == (2 * 3 if episodes == "trial" else len(played))
    data = minari.MinariDataset(written / "data")
    assert {one["phase"] for one in data.storage.get_episode_metadata(range(count))} == {"test"}
    assert data.spec.env_spec.kwargs["schema"] == "CC4"  # rooms of CC3 were only shown


@pytest.mark.parametrize("scored", ["bayes", "theory_based"])
def test_scores_are_of_what_was_chosen_after_what_was_shown(folder: Path, scored: str) -> None:
    record, experiment = Store(folder).record()
    table = score_actions(
        record,
        experiment,
        make_experiment(["CC3"], [scored]).learners[0],
        of=["bayes"],
        draws=Draws(hits=1),
    )
    rows = record.to_pandas().query(
        "learner == 'bayes' and condition == @SHOWN and phase == 'test'"
    )
    own = table[table["condition"] == SHOWN]
    assert set(own["trial"]) == {7}
    assert own["action_index"].tolist() == [one for each in rows["actions"] for one in each]
    if scored == "bayes":
        assert not own["impossible"].any()


@pytest.mark.parametrize(
    ("trial", "also"),
    [(1, ["phase", "layout"]), (1, ["phase"]), (1, ["layout"]), (1, []), (7, ["layout"])],
)
def test_a_table_without_what_was_shown_is_told_so(
    trial: int, also: list[str], folder: Path, tmp_path: Path
) -> None:
    """Actions of the test alone, whether or not its number counts on from what was shown."""
    table = Store(folder).record()[0].to_pandas().query("learner == 'bayes'")
    table = table[(table["phase"] == "test") & (table["condition"] == SHOWN)].assign(trial=trial)
    table = table.explode("actions").rename(columns={"actions": "action"})
    columns = ["subject", "condition", "trial", "attempt", "action", *also]
    table[columns].to_csv(tmp_path / "played.csv", index=False)
    with pytest.raises(OpenLockError, match=r"played.csv:\d: .*add rows of what it was shown"):
        import_files([tmp_path / "played.csv"], tmp_path / "in", layouts="drawn")


def test_a_table_that_goes_out_comes_back(folder: Path, tmp_path: Path) -> None:
    write_csv(Store(folder), tmp_path / "out.csv")
    import_files([tmp_path / "out.csv"], tmp_path / "in")
    rows = Counter(Store(folder).record()[0]["phase"].to_pylist())
    assert Counter(Store(tmp_path / "in").record()[0]["phase"].to_pylist()) == rows
    assert rows["shown"] == 2 * 3 * 6 * 2

"""What ``compare`` takes, what it plays, and what it says when it cannot."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
import pytest

import causal_openlock as ol
from causal_openlock.comparison import comparing
from causal_openlock.errors import ExperimentError, Interrupted, LearnerError, OpenLockError
from causal_openlock.running.workers import InlineExecutor
from support.processes import start_prepared

pytestmark = pytest.mark.slow

VAULT = ol.Schema(
    "vault",
    ["key", "dial", "second"],
    {"key": ["door"], "dial": ["second"], "second": ["door"]},
    gates={"door": ol.Gate("all")},
)


class Persistent(ol.OneSubjectLearner):
    """Push the door, always."""

    def act(self, observation: Any) -> int:
        return self.brief.actions - 1


class Recorded(Persistent):
    """Notes in which process it acts."""

    processes: ClassVar[set[int]] = set()

    def act(self, observation: Any) -> int:
        self.processes.add(os.getpid())
        return super().act(observation)


@pytest.fixture(autouse=True)
def prepared_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    start_prepared(monkeypatch)


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The cells that this process plays, in words."""
    cells: list[str] = []
    submit = InlineExecutor.submit

    def noted(self: InlineExecutor, job: Any, cell: Any, *rest: Any, **options: Any) -> Future[Any]:
        cells.append(cell.in_words)
        return submit(self, job, cell, *rest, **options)

    monkeypatch.setattr(InlineExecutor, "submit", noted)
    return cells


def labels(results: ol.Results) -> list[str]:
    return [spec.name for spec in results.experiment.learners]


def test_conditions_and_learners_in_every_form() -> None:
    made = ol.make_experiment(
        ["CC4", "CC3-CC4", VAULT, ["CC3", VAULT], ("CC3", "CE3", "CC4")],
        ["bayes", ol.learner("ddqn", learning_rate=0.0005, label="slow"), Persistent],
        subjects=2,
    )
    assert [one.name for one in made.conditions] == [
        "CC4", "CC3-CC4", "vault", "CC3-vault", "CC3-CE3-CC4",
    ]  # fmt: skip
    last = made.conditions[-1]
    assert [[trials.schema.name for trials in part] for part in (last.train, last.test)] == [
        ["CC3", "CE3"], ["CC4"],
    ]  # fmt: skip
    assert [spec.name for spec in made.learners] == ["bayes", "slow", "Persistent"]
    assert made.learners[1].parameters["learning_rate"] == 0.0005
    assert made.learners[2].learner == f"{__name__}:Persistent"


def test_an_instance_counts_by_its_class_and_parameters() -> None:
    instance = ol.create("bayes", {"policy": "thompson"})
    (spec,) = ol.make_experiment(["CC3"], [instance]).learners
    assert (spec.learner, spec.parameters["policy"]) == ("bayes", "thompson")
    single = ol.create(f"{__name__}:Persistent")
    (spec,) = ol.make_experiment(["CC3"], [single]).learners
    assert spec.learner == f"{__name__}:Persistent"


def test_a_declared_experiment_is_that_of_a_file(tmp_path: Path) -> None:
    (tmp_path / "e.yaml").write_text(
        "name: comparison\nseed: 3\nsubjects: 2\nconditions: [CC3, CC3-CC4]\n"
        "learners: [oracle, {learner: ddqn, name: slow, parameters: {learning_rate: 0.0005}}]\n"
    )
    slow = ol.learner("ddqn", learning_rate=0.0005, label="slow")
    made = ol.make_experiment(["CC3", ["CC3", "CC4"]], ["oracle", slow], seed=3, subjects=2)
    assert made.identity == ol.read_experiment(tmp_path / "e.yaml").identity


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((["CC4"], ["bayess"]), "did you mean bayes"),
        ((["CC44"], ["bayes"]), "CC44"),
        ((["CC4"],), "name the learners to compare"),
        ((["CC4"], [dict]), "is not a learner"),
        (([3], ["bayes"]), "3 is not a condition"),
        (([[]], ["bayes"]), "is not a condition"),
        ((["CC4"], ["oracle", "oracle"]), "listed twice"),
        (("defautl",), "default"),
    ],
)
def test_mistakes_are_one_sentence(arguments: tuple[Any, ...], message: str) -> None:
    with pytest.raises(OpenLockError, match=message) as caught:
        ol.compare(*arguments, subjects=1)
    assert "\n" not in str(caught.value)


def test_learner_is_checked_at_once() -> None:
    with pytest.raises(LearnerError, match="did you mean learning_rate"):
        ol.learner("ddqn", learnin_rate=1.0)
    with pytest.raises(LearnerError, match="learning_rate"):
        ol.learner("ddqn", learning_rate="fast")
    with pytest.raises(ExperimentError, match="subjects"):
        ol.learner("ddqn", subjects=0)

    class Local(Persistent):
        """Nobody else can find it."""

    with pytest.raises(LearnerError, match="top level"):
        ol.learner(Local)


@pytest.mark.parametrize(("name", "value"), [("subjects", 0), ("seed", -1), ("name", "a b")])
def test_settings_are_checked(name: str, value: object) -> None:
    with pytest.raises(ExperimentError, match=name):
        ol.make_experiment(["CC3"], ["oracle"], **{name: value})  # type: ignore[arg-type]


def test_what_was_played_is_not_played_again(played: list[str]) -> None:
    one = ol.compare(["CC3"], ["oracle"], subjects=2, seed=71, workers=0)
    two = ol.compare(["CC3"], ["oracle", "random"], subjects=2, seed=71, workers=0)
    assert played == ["oracle in CC3, subjects 0-1", "random in CC3, subjects 0-1"]
    assert (labels(one), labels(two)) == (["oracle"], ["oracle", "random"])
    assert one.folders != two.folders
    own = two.attempts[two.attempts["learner"] == "oracle"].reset_index(drop=True)
    for name in ("subject", "trial", "attempt", "reward", "wall_time"):
        np.testing.assert_array_equal(one.attempts[name], own[name])


def test_a_file_a_folder_and_changes(tmp_path: Path, played: list[str]) -> None:
    path, out = tmp_path / "e.yaml", tmp_path / "out"
    path.write_text("name: e\nconditions: [CC3]\nsubjects: 2\nlearners: [oracle, random]\n")
    ol.compare(path, out=out, workers=0)
    assert played == ["oracle in CC3, subjects 0-1", "random in CC3, subjects 0-1"]
    played.clear()
    again = ol.compare(ol.read_experiment(path), out=out, workers=0)
    assert played == []
    assert labels(again) == ["oracle", "random"]
    assert labels(ol.compare(path, ["random"], workers=0)) == ["random"]
    with pytest.raises(ExperimentError, match="make_experiment"):
        ol.compare(ol.read_experiment(path), ["random"])
    with pytest.raises(ExperimentError, match="reward"):
        ol.compare(path, reward="basic")


def test_no_workers_play_in_this_process() -> None:
    results = ol.compare(["CC3", "CE3"], Recorded, subjects=1, workers=0)
    assert Recorded.processes == {os.getpid()}
    assert len(results.headline) == 2


def test_stopping_keeps_what_is_done(monkeypatch: pytest.MonkeyPatch, played: list[str]) -> None:
    ended: list[Any] = []
    run = comparing.run

    def stopped(*arguments: Any, done: Any, **options: Any) -> Any:
        def then_stop(cell: Any, was_there: bool) -> None:
            done(cell, was_there)
            ended.append(cell)
            raise KeyboardInterrupt

        return run(*arguments, done=then_stop, **options)

    with monkeypatch.context() as patch:
        patch.setattr(comparing, "run", stopped)
        with pytest.raises(Interrupted, match="1 of 2 cells are done and stored") as caught:
            ol.compare(["CC3"], ["oracle", "random"], subjects=2, seed=72, workers=0)
    assert caught.value._render_traceback_() == [str(caught.value)]
    played.clear()
    ol.compare(["CC3"], ["oracle", "random"], subjects=2, seed=72, workers=0)
    assert played == ["random in CC3, subjects 0-1"]


class Stopped(ol.OneSubjectLearner):
    """Somebody presses the stop button while it thinks, the first time."""

    stops = 1

    def act(self, observation: Any) -> int:
        if Stopped.stops:
            Stopped.stops -= 1
            raise KeyboardInterrupt
        return 0


def test_a_cell_can_be_stopped_in_this_process(played: list[str]) -> None:
    # The check of new learners comes before the cell.
    with pytest.raises(Interrupted, match="0 of 1 cells"):
        ol.compare(["CC3"], [Stopped], subjects=1, seed=73, workers=0)
    assert len(ol.compare(["CC3"], [Stopped], subjects=1, seed=73, workers=0).trials) == 5


def test_processes_play_by_default() -> None:
    Recorded.processes.clear()
    results = ol.compare(["CC3"], [Recorded], subjects=1, workers=1)
    assert results.learners == ("Recorded",)
    assert not Recorded.processes


def test_cells_that_fail_are_warned_of_and_named(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="failed: ZeroDivisionError") as warned:
        results = ol.compare(["CC3"], [Failing, "oracle"], subjects=2, workers=0)
    assert {Path(one.filename).name for one in warned} == {Path(__file__).name}
    assert results.warnings[0].startswith("1 cell of 2 missing: the learner Failing in CC3")
    every = pytest.raises(LearnerError, match="every cell failed")
    with every, pytest.warns(UserWarning, match="failed"):
        ol.compare(["CC3"], [Failing], subjects=2, workers=0)


class Failing(ol.OneSubjectLearner):
    """It does not work."""

    def act(self, observation: Any) -> int:
        return 1 // 0


def test_every_form_of_what_is_listed(tmp_path: Path) -> None:
    (tmp_path / "v.yaml").write_text(VAULT.to_yaml())
    conditions = [tmp_path / "v.yaml", "A -> door", Path("CC3")]
    made = ol.make_experiment(conditions, ["oracle"], title="Mine", subjects=np.int64(1))
    assert [one.name for one in made.conditions] == ["vault", "schema", "CC3"]
    assert (made.title, made.learners[0].subjects) == ("Mine", 1)
    results = ol.compare(tmp_path / "v.yaml", {"oracle"}, subjects=1, workers=0)
    assert results.learners == ("oracle",)
    names = iter(["oracle"])
    assert ol.compare(pd.Index(["CC3"]), names, subjects=1, workers=0).learners == ("oracle",)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"subjects": 0}, "subjects"),
        ({"subjects": 2.5}, "subjects"),
        ({"seed": -1}, "seed"),
        ({"learners": []}, "there are no learners"),
        ({"protocol": 5}, "5 is not a protocol"),
        ({"workers": -1, "subjects": 1}, "workers must be a whole number of at least 0"),
        ({"workers": "2", "subjects": 1}, "workers must be a whole number of at least 0"),
        ({"checkpoint_every": "x", "subjects": 1}, "checkpoint_every is a number of seconds"),
        ({"checkpoint_every": None, "subjects": 1}, "checkpoint_every is a number of seconds"),
        ({"time_limit": True, "subjects": 1}, "time_limit is a number of seconds, not True"),
        ({"time_limit": -1, "subjects": 1}, "time_limit is a number of seconds, not -1"),
        ({"cell_size": 3}, "decides the cell_size"),
    ],
)
def test_changes_to_a_file_are_checked(
    changes: dict[str, Any], message: str, tmp_path: Path
) -> None:
    path = tmp_path / "e.yaml"
    path.write_text("name: e\nconditions: [CC3]\nlearners: [oracle]\n")
    with pytest.raises(OpenLockError, match=message):
        ol.compare(path, **changes)


@pytest.mark.parametrize("what", [5, None, {}, [], "CC3-"])
def test_what_is_no_condition_is_refused(what: Any) -> None:
    with pytest.raises(OpenLockError):
        ol.compare(what, ["oracle"])


def test_one_more_learner_of_a_file_plays_what_is_missing(
    tmp_path: Path, played: list[str]
) -> None:
    path, out = tmp_path / "e.yaml", tmp_path / "out"
    path.write_text("name: e\nconditions: [CC3]\nsubjects: 2\nlearners: [oracle, random]\n")
    ol.compare(path, ["oracle"], out=out, workers=0)
    ol.compare(path, ["oracle", "random"], out=out, workers=0)
    assert played == ["oracle in CC3, subjects 0-1", "random in CC3, subjects 0-1"]


def test_a_record_is_not_an_experiment_to_run(tmp_path: Path) -> None:
    results = ol.compare(["CC3"], ["oracle"], subjects=1, workers=0)
    with pytest.raises(ExperimentError, match="record of one that was run"):
        ol.compare(results.experiment)


def test_when_nothing_is_missing_the_progress_is_shown_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shares: list[float] = []

    @contextmanager
    def shown(name: str) -> Iterator[Any]:
        yield lambda standing: shares.append(standing.share)

    monkeypatch.setattr(comparing, "shown_here", shown)
    for _ in range(2):
        ol.compare(["CC3"], ["oracle"], subjects=1, seed=75, workers=0)
    assert shares[-1] == 1.0
    shares.clear()
    ol.compare(["CC3"], ["oracle"], subjects=1, seed=75, workers=0)
    assert shares == [1.0]


def test_without_links_cells_are_copied(monkeypatch: pytest.MonkeyPatch, played: list[str]) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError("no links here")

    monkeypatch.setattr(os, "link", refuse)
    ol.compare(["CC3"], ["oracle"], subjects=1, seed=76, workers=0)
    ol.compare(["CC3"], ["oracle", "random"], subjects=1, seed=76, workers=0)
    assert played == ["oracle in CC3, subject 0", "random in CC3, subject 0"]


def test_messages_of_a_notebook_say_what_to_do_there() -> None:
    with pytest.raises(ExperimentError, match=r"'slow ddqn' is not a label; it must have letters"):
        ol.learner("ddqn", label="slow ddqn")
    with pytest.raises(ExperimentError, match="CC4 is a condition; also name the learners"):
        ol.compare("CC4", subjects=1)
    with pytest.raises(ExperimentError, match=r"remove one .* name, as in learner\(\.\.\., label="):
        ol.make_experiment(["CC3"], ["oracle", "oracle"])
    with pytest.raises(LearnerError, match="Unfinished has no method act"):
        ol.learner(Unfinished)
    with pytest.raises(LearnerError) as caught:
        ol.learner("bays")
    (sentence,) = caught.value._render_traceback_()
    assert sentence.startswith("LearnerError: there is no learner 'bays'; did you mean bayes?")


class Unfinished(ol.OneSubjectLearner):
    """It cannot act."""

"""Contract tests for learners, to be subclassed.

pytest runs the inherited tests; with ``unittest.TestCase`` as a second base class, unittest does.
Give a slow learner settings and schemas with which each test takes seconds::

    from causal_openlock.testing import LearnerContract

    class TestMyNetwork(LearnerContract):
        learner = "my_network"
        parameters = {"batch_size": 8, "hidden_units": 16}
        schemas = ("CC3", "CE4")
        attempts = 40  # enough for a few hundred training steps

Each test checks one rule of :class:`~causal_openlock.contract.learner.Learner`, and its message
explains the rule, what happened and where to look. Whether a learner learns well is not tested.
"""

from __future__ import annotations

import pickle
import unittest
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, asdict, fields, is_dataclass, replace
from itertools import takewhile
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from causal_openlock.contract.checks import GlobalRandomness, are_probabilities
from causal_openlock.contract.learner import InformedLearner, Learner, View, state_of
from causal_openlock.contract.registry import (
    create,
    learner_class,
    parameter_table,
    parse_parameters,
)
from causal_openlock.experiment.protocol import Condition, Protocol, Trials
from causal_openlock.experiment.record import record_schema
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import bundled_schemas, find_schema
from causal_openlock.schemas.schema import Schema

if TYPE_CHECKING:
    import pyarrow as pa

SHORT = Protocol("contract", 5, stop_when_solved=True, baseline_trials=2, training_trials=2)
"""The protocol of the tests: two trials of five attempts, and a third one to test on."""

Change = Callable[[Any, int], Any]
"""Changes a view or a step, by the number of steps taken before."""

UNLIKELY = 4.0
"""Standard errors beyond which actions are not drawn as a learner says: one in 16,000 is."""

EARLY = 12
"""Actions after which a learner is interrupted, or a subject finishes."""

NINE = Schema(
    "nine",
    [f"L{lever}" for lever in range(9)],
    {"L0": [f"L{lever}" for lever in range(1, 9)]}
    | {f"L{lever}": ["door"] for lever in range(1, 9)},
    title="A room of nine positions",
)


class LearnerContract:
    """Tests of one learner; see the module's docstring for how to use it.

    Attributes:
        learner: Its registered name, or ``module:Class``.
        parameters: Hyper-parameters that differ from their defaults.
        schemas: Names of the schemas to play; by default all that are bundled.
        subjects: How many subjects play at once; at least two.
        attempts: Attempts of a trial in the tests of batches and of checkpoints. Use more for a
            learner that is trained, so that differences in rounding, or gaps in its state, have
            time to show.
        independent_of_batch: Whether a subject's data are identical whatever other subjects are in
            its batch. ``False`` for a learner that computes many networks in one matrix product,
            where rounding depends on their number; then only equal cells must give equal data, and
            results depend on ``cell_size``.
    """

    learner: ClassVar[str] = ""
    parameters: ClassVar[Mapping[str, Any]] = {}
    schemas: ClassVar[Sequence[str] | None] = None
    subjects: ClassVar[int] = 4
    attempts: ClassVar[int] = SHORT.attempt_limit
    independent_of_batch: ClassVar[bool] = True
    _first_plays: ClassVar[dict[int, pa.Table]] = {}

    def __init_subclass__(cls, **given: Any) -> None:
        """Each contract has records of its own."""
        super().__init_subclass__(**given)
        cls._first_plays = {}

    # -- what it answers ------------------------------------------------------------------------

    def test_it_answers_with_one_action_for_each_subject(self) -> None:
        """``act`` gives B integers within the action space, in rooms of every size and kind."""
        names = bundled_schemas() if self.schemas is None else self.schemas
        for schema in [*map(find_schema, names), NINE]:
            self._answers(Condition(schema.name, (Trials(schema),)))

    def test_it_plays_a_session_to_its_end(self) -> None:
        """Every trial of every subject is in the record, with all of its attempts."""
        record = self._first_play()
        self._require(
            record.schema.equals(record_schema()), "the record has other columns than it should"
        )
        trials: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
        for row in record.drop_columns(["wall_time"]).to_pylist():
            trials.setdefault((row["subject"], row["phase"], row["trial"]), []).append(row)
        played = {
            (subject, *visit)
            for subject in range(self.subjects)
            for visit in (("train", 1), ("train", 2), ("test", 1))
        }
        self._require(set(trials) == played, f"trials are missing: {sorted(played - {*trials})}")
        for trial, rows in trials.items():
            numbers = [row["attempt"] for row in rows]
            solved = rows[-1]["solutions_found"] == rows[-1]["solutions"]
            self._require(
                numbers == [*range(1, len(rows) + 1)]
                and (solved or len(rows) == SHORT.attempt_limit),
                f"the trial {trial} has the attempts {numbers} and was "
                f"{'' if solved else 'not '}solved",
            )

    # -- what its answers depend on -------------------------------------------------------------

    def test_the_same_seed_gives_the_same_record(self) -> None:
        """All its randomness comes from ``brief.generators``."""
        self._require_same(
            self._first_play(), self._play(), "was played twice with the same seed and differs"
        )

    def test_a_subject_does_not_depend_on_its_batch(self) -> None:
        """No subject sees another's data, and no cell what was played before it."""
        together = self._first_play(self.attempts)
        last = self.subjects - 1
        if not self.independent_of_batch:
            self._play(range(self.subjects, 2 * self.subjects), attempts=self.attempts)
            self._require_same(
                together,
                self._play(attempts=self.attempts),
                "differs after another cell was played in the same process",
            )
            return
        for subject, among in ((0, [0]), (last, [last]), (last, [*range(1, self.subjects)])):
            ours, theirs = (
                table.filter(np.equal(table["subject"].to_numpy(), subject))
                for table in (together, self._play(among, attempts=self.attempts))
            )
            self._require_same(
                ours,
                theirs,
                f"differs for subject {subject}, which played as one of {self.subjects} and then "
                f"as one of {len(among)}",
            )

    def test_it_ignores_subjects_that_have_finished(self) -> None:
        """The learner ignores rows of views and steps where ``view.playing`` is false."""
        gone = np.arange(self.subjects) == 1

        def others(garble: bool) -> list[list[int]]:
            def departed(given: Any, steps: int) -> Any:
                return given if steps < EARLY else _with_finished(given, gone, garble)

            answers = self._answers(self._transfer(), departed)
            return [answer[~gone].tolist() for answer in answers[EARLY:]]

        plain, garbled = others(garble=False), others(garble=True)
        for moment, (one, other) in enumerate(zip(plain, garbled, strict=True)):
            self._require(
                one == other,
                f"{moment} steps after a subject had finished, the others' actions depend on what "
                f"it seems to have done since: {one} or {other}; look at step.view.playing",
            )

    def test_it_keeps_no_global_randomness(self) -> None:
        """The learner neither draws from the global generators nor seeds them."""
        first = self._first_play()  # so that later plays import nothing
        before = GlobalRandomness.now()
        try:
            for seed in (1, 2):
                GlobalRandomness.seed(seed)
                start = GlobalRandomness.now()
                again = self._play()
                touched = start.differs_from(GlobalRandomness.now())
                self._require(
                    not touched,
                    f"it used or seeded {', '.join(touched)}; draw from brief.generators instead",
                )
                self._require_same(
                    first, again, "depends on the global generators of random, numpy or torch"
                )
        finally:
            before.restore()

    # -- its probabilities ----------------------------------------------------------------------

    def test_it_draws_its_actions_from_its_probabilities(self) -> None:
        """Actions are as likely as the learner's probabilities say, and asking changes nothing.

        Two sums over all its actions are compared with their expectations: how surprising the
        actions are, and how often the likeliest is taken.
        """
        learner, asked = self._made(), list[Any]()
        act = learner.act

        def answer(view: View) -> Any:
            asked.append(learner.probabilities(view))
            return act(view)

        learner.act = answer  # type: ignore[method-assign]
        session = self._session(self._transfer())
        session.begin(learner)
        beyond = np.zeros((2, 2))  # of surprise and of the likeliest: more than expected, variance
        for step in session.steps(learner):
            found = asked.pop()
            if found is None:
                raise unittest.SkipTest(f"{self.learner} gives no probabilities")
            rows = found[step.view.playing]
            self._require(
                are_probabilities(rows, session.brief.actions),
                "its probabilities are not numbers of 0 or more for each action that add up to 1",
            )
            taken = rows[np.arange(len(rows)), step.action[step.view.playing]]
            self._require(
                bool((taken > 0).all()), "it did what is impossible by its own probabilities"
            )
            beyond += _more_than_expected(rows, taken)
        for what, (more, variance) in zip(("surprising", "likeliest"), beyond, strict=True):
            off = abs(more) / np.sqrt(variance) if variance > 1e-9 else abs(more) * 1e6
            self._require(
                off < UNLIKELY,
                f"its actions are not drawn from its probabilities: the sum of how {what} they "
                f"are is {off:.1f} standard errors off",
            )
        self._require_same(
            self._first_play(), session.record(), "is another once its probabilities are asked for"
        )

    def test_it_learns_from_what_others_do(self) -> None:
        """``learn`` takes another's actions, where nothing was asked before but probabilities."""
        learner = self._made()
        if not learner.learns_from_others:
            raise unittest.SkipTest(f"{self.learner} learns from its own actions alone")
        session = self._session(self._transfer())
        session.begin(learner)
        other = np.random.default_rng(1)
        while not session.over:
            try:
                learner.probabilities(session.view)
                step = session.step(other.integers(session.brief.actions, size=self.subjects))
                learner.learn(step)
            except Exception as error:  # whatever it is, it tells what the learner needs
                raise AssertionError(
                    f"{self.learner}: given another's action, it fails with "
                    f"{type(error).__name__}: {error}; let learn use step.view and step.action, "
                    "and nothing that act has kept, or set learns_from_others = False"
                ) from error
            if isinstance(learner, InformedLearner) and step.trial_over.any():
                learner.inform(session.truth)

    def test_it_learns_from_what_it_is_shown(self) -> None:
        """Shown training has each solution once, and the same seed gives the same record."""
        if not self._made().learns_from_others:
            raise unittest.SkipTest(f"{self.learner} learns from its own actions alone")
        played, shown = self._transfer(), replace(self._transfer(), name="shown", shown=True)
        record, again = (self._session(shown).play(self._made()) for _ in range(2))
        self._require_same(record, again, "of a condition with shown training is not the same")
        rows = [row for row in record.to_pylist() if row["phase"] == "shown"]
        solutions = len(played.train[0].schema.solutions)
        trials = Counter((row["subject"], row["trial"]) for row in rows)
        self._require(
            [*trials.values()] == [solutions] * 2 * self.subjects
            and all(row["new_solution"] for row in rows),
            f"in {self.subjects} subjects' two rooms of {solutions} solutions each, it was shown "
            f"{dict(trials)}",
        )

    # -- its input and its state ----------------------------------------------------------------

    def test_it_goes_on_from_a_checkpoint(self) -> None:
        """A new learner with the state of an old one acts as the old one would have."""
        if not self._made().resumable:
            raise unittest.SkipTest(f"{self.learner} is not resumable")

        def session() -> Session:
            return self._session(self._transfer(), attempt_limit=self.attempts)

        plain, whole = self._first_play(self.attempts), session()
        half = _steps_of(plain) // 2
        moments = [min(EARLY, half), half, half + half // 2]
        learner = self._made()
        course: list[NDArray[Any]] = []
        states: dict[int, bytes] = {}
        for answer in self._steps(whole, learner):
            course.append(answer)
            if len(course) in moments:
                states[len(course)] = pickle.dumps(state_of(learner))
        self._require_same(plain, whole.record(), "changes once its state has been asked for")
        for moment, state in states.items():
            resumed = session()
            for answer in course[:moment]:
                resumed.step(answer)
            steps = self._steps(resumed, self._made(), state=pickle.loads(state))
            again = [answer.tolist() for answer in steps]
            after = [answer.tolist() for answer in course[moment:]]
            self._require(
                again == after,
                f"interrupted after {moment} steps, it does not continue as it would have "
                f"uninterrupted: its actions agree for {_common(after, again)} of {len(after)} "
                "steps (does __getstate__ leave out what __setstate__ does not make anew?)",
            )

    # -- its parameters -------------------------------------------------------------------------

    def test_its_parameters_are_a_frozen_dataclass_that_explains_itself(self) -> None:
        """Each has a default that fits its own type, and a text in its ``Annotated`` type."""
        declared: Any = learner_class(self.learner).Parameters
        self._require(is_dataclass(declared), "Parameters is not a dataclass")
        self._require(
            declared.__dataclass_params__.frozen, "Parameters must be a dataclass(frozen=True)"
        )
        bare = [
            field.name
            for field in fields(declared)
            if field.default is MISSING and field.default_factory is MISSING
        ]
        self._require(not bare, f"these parameters have no default: {', '.join(bare)}")
        silent = [row.name for row in parameter_table(self.learner) if not row.meaning.strip()]
        self._require(
            not silent,
            f"these parameters have no meaning: {', '.join(silent)}; write them like "
            'rate: Annotated[float, "of Adam"] = 0.001',
        )
        defaults = declared()
        again = parse_parameters(self.learner, asdict(defaults))
        self._require(again == defaults, f"its defaults are read back as {again}")
        about = (learner_class(self.learner).__doc__ or "").strip()
        self._require(bool(about), "its class has no docstring, which lists of learners show")

    # -- how the tests play ---------------------------------------------------------------------

    def _require(self, holds: bool, message: str) -> None:
        if not holds:
            raise AssertionError(f"{self.learner}: {message}")

    def _require_same(self, one: pa.Table, other: pa.Table, message: str) -> None:
        left, right = (table.drop_columns(["wall_time"]).to_pylist() for table in (one, other))
        same = _common(left, right)
        for row, (was, is_now) in enumerate(zip(left[same:], right[same:], strict=False), same):
            differ = "; ".join(f"{k} {was[k]} or {is_now[k]}" for k in was if was[k] != is_now[k])
            self._require(False, f"its record {message}; first in row {row}: {differ}")
        self._require(len(left) == len(right), f"its record {message}; one is longer")

    def _made(self) -> Learner:
        if not self.learner:
            raise AssertionError(
                f"{type(self).__name__} has no learner to test; give it an attribute, as in "
                'learner = "my_package:MyLearner"'
            )
        return create(self.learner, self.parameters)

    def _transfer(self) -> Condition:
        names = self.schemas or ("CC3", "CE4")
        return Condition.named(f"{names[0]}-{names[-1]}", find_schema)

    def _session(
        self, condition: Condition, subjects: Sequence[int] | None = None, **changes: Any
    ) -> Session:
        numbers = range(self.subjects) if subjects is None else subjects
        return Session(condition, replace(SHORT, **changes), numbers, seed=7, learner="contract")

    def _play(
        self, subjects: Sequence[int] | None = None, attempts: int = SHORT.attempt_limit
    ) -> pa.Table:
        session = self._session(self._transfer(), subjects, attempt_limit=attempts)
        return session.play(self._made())

    def _first_play(self, attempts: int = SHORT.attempt_limit) -> pa.Table:
        """The record of one session, played once for all tests of this class."""
        if attempts not in self._first_plays:
            self._first_plays[attempts] = self._play(attempts=attempts)
        return self._first_plays[attempts]

    def _steps(
        self,
        session: Session,
        learner: Learner,
        change: Change = lambda given, steps: given,
        state: Any = None,
    ) -> Iterator[NDArray[Any]]:
        """Play to the end; yields the learner's answers, each after it has learned from its step.

        Args:
            session: The session.
            learner: A learner that has not begun.
            change: Changes the views and steps that the learner gets.
            state: A state to load when it begins.
        """
        session.begin(learner, state)
        actions, steps = session.brief.actions, 0
        while not session.over:
            view = change(session.view, steps)
            answer = np.array(learner.act(view))
            self._require(
                answer.shape == (self.subjects,)
                and answer.dtype.kind in "iu"
                and bool((((answer >= 0) & (answer < actions)) | ~view.playing).all()),
                f"in a room of {session.brief.positions} positions, act answered {answer.dtype} "
                f"of shape {answer.shape}, {answer.tolist()}, where {self.subjects} integers from "
                f"0 to {actions - 1} are wanted",
            )
            step = session.step(np.where(view.playing, answer, 0))
            learner.learn(change(step, steps))
            if isinstance(learner, InformedLearner) and step.trial_over.any():
                learner.inform(session.truth)
            steps += 1
            yield answer

    def _answers(self, condition: Condition, *change: Change) -> list[NDArray[Any]]:
        return [*self._steps(self._session(condition), self._made(), *change)]


def _more_than_expected(
    rows: NDArray[np.float64], taken: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Sums of surprise and of likeliest actions: excess over the expectation, and variance."""
    surprise = -np.log(np.where(rows > 0, rows, 1.0))
    mean = (rows * surprise).sum(axis=1)
    spread = (rows * (surprise - mean[:, None]) ** 2).sum(axis=1)
    highest = rows.max(axis=1)
    among = np.isclose(rows, highest[:, None])
    share = (rows * among).sum(axis=1)
    hit = np.isclose(taken, highest)
    return np.array(
        [
            [(-np.log(taken) - mean).sum(), spread.sum()],
            [(hit - share).sum(), (share * (1.0 - share)).sum()],
        ]
    )


def _with_finished(given: Any, gone: NDArray[Any], garble: bool) -> Any:
    """A view or a step in which some subjects have finished.

    Args:
        given: The view or step.
        gone: ``[B]`` which subjects have finished.
        garble: Whether to fill their rows with nonsense, from which a learner must not learn.
    """
    changed = {}
    for field in fields(given):
        value = getattr(given, field.name)
        if not isinstance(value, np.ndarray):
            changed[field.name] = _with_finished(value, gone, garble)
            continue
        value = value.copy()
        if field.name == "playing":
            value[gone] = False
        elif field.name in ("attempt_over", "trial_over", "new_solution"):
            value[gone] = garble
        elif garble:
            value[gone] = 1 - value[gone] if value.ndim == 2 else 1 + value[gone]
        changed[field.name] = value
    return replace(given, **changed)


def _steps_of(record: pa.Table) -> int:
    """Number of steps in a session: the most actions of any subject."""
    taken = Counter[int]()
    for subject, actions in zip(
        record["subject"].to_pylist(), record["actions"].to_pylist(), strict=True
    ):
        taken[subject] += len(actions)
    return max(taken.values())


def _common(one: Sequence[Any], other: Sequence[Any]) -> int:
    """Number of items that two sequences have in common before they first differ."""
    agree = (left == right for left, right in zip(one, other, strict=False))
    return sum(takewhile(bool, agree))

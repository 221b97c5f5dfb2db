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
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass, replace
from itertools import takewhile
from typing import Any, ClassVar

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
from causal_openlock.experiment.declare import Condition, Protocol, Trials, find_condition
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import bundled_schemas, find_schema
from causal_openlock.schemas.schema import Schema

Rows = list[dict[str, Any]]
"""The attempts of a record."""

SHORT = Protocol("contract", 5, stop_when_solved=True, baseline_trials=2, training_trials=2)
"""The protocol of the tests: two trials of five attempts, and a third one to test on."""

EARLY = 6
"""Actions after which a learner is interrupted, or a subject finishes."""

LEAVES = [f"L{lever}" for lever in range(1, 9)]
NINE = Schema("nine", ["L0", *LEAVES], {"L0": LEAVES} | {leaf: ["door"] for leaf in LEAVES})


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

    # -- what it answers, and what its answers depend on ----------------------------------------

    def test_it_answers_with_one_action_for_each_subject(self) -> None:
        """``act`` gives B integers within the action space, in rooms of every size and kind."""
        names = bundled_schemas() if self.schemas is None else self.schemas
        for schema in [*map(find_schema, names), NINE]:
            self._answers(self._session(Condition(schema.name, (Trials(schema),))))

    def test_it_plays_a_session_to_its_end(self) -> None:
        """Every trial of every subject is in the record, solved or with all of its attempts."""
        trials = {(row["subject"], row["phase"], row["trial"]) for row in self._play()}
        self._require(
            len(trials) == 3 * self.subjects, f"{len(trials)} trials are recorded: {trials}"
        )

    def test_the_same_seed_gives_the_same_record(self) -> None:
        """All its randomness comes from ``brief.generators``."""
        again = self._play(), self._play()
        self._require_same(*again, "was played twice with the same seed and differs")

    def test_a_subject_does_not_depend_on_its_batch(self) -> None:
        """No subject sees another's data, and no cell what was played before it."""
        together, everyone = self._play(attempts=self.attempts), [*range(self.subjects)]
        batches = [everyone[:1], everyone[-1:], everyone[1:]]
        if not self.independent_of_batch:
            self._play([subject + self.subjects for subject in everyone], self.attempts)
            batches = [everyone]  # after another cell in the same process
        for batch in batches:
            before = [row for row in together if row["subject"] in batch]
            message = f"of the subjects {batch} differs from theirs as some of {self.subjects}"
            self._require_same(before, self._play(batch, self.attempts), message)

    def test_it_ignores_subjects_that_have_finished(self) -> None:
        """The learner ignores rows of views and steps where ``view.playing`` is false."""
        gone = np.arange(self.subjects) == 1

        def others(garble: bool) -> list[list[int]]:
            def change(given: Any, steps: int) -> Any:
                return given if steps < EARLY else _with_finished(given, gone, garble)

            answers = self._answers(self._session(), change=change)
            return [np.array(answer)[~gone].tolist() for answer in answers[EARLY:]]

        plain, garbled = others(garble=False), others(garble=True)
        self._require(
            plain == garbled,
            f"{_common(plain, garbled)} steps after a subject had finished, the others' actions "
            "depend on what it seems to have done since; look at step.view.playing",
        )

    def test_it_keeps_no_global_randomness(self) -> None:
        """The learner neither draws from the global generators nor seeds them."""
        first = self._play()  # so that later plays import nothing
        for seed in (1, 2):
            with GlobalRandomness.seeded(seed) as start:
                again = self._play()
                touched = start.differs_from(GlobalRandomness.now())
            message = f"it used or seeded {touched}; draw from brief.generators instead"
            self._require(not touched, message)
            self._require_same(first, again, "depends on random, numpy.random or torch")

    # -- its probabilities, and what others do --------------------------------------------------

    def test_it_draws_its_actions_from_its_probabilities(self) -> None:
        """Its probabilities add up to 1 and allow what it does, and asking changes nothing."""
        session, learner = self._session(), self._made()
        act = learner.act

        def ask_and_act(view: View) -> Any:
            rows, everyone = learner.probabilities(view), np.arange(self.subjects)
            if rows is None:
                raise unittest.SkipTest(f"{self.learner} gives no probabilities")
            self._require(
                are_probabilities(rows[view.playing], session.brief.actions),
                "its probabilities are not numbers of 0 or more for each action that add up to 1",
            )
            answer = act(view)
            self._require(
                bool((rows[everyone, answer] > 0)[view.playing].all()),
                "it did what is impossible by its own probabilities",
            )
            return answer

        learner.act = ask_and_act  # type: ignore[method-assign]
        asked = self._rows(session, learner)
        self._require_same(self._play(), asked, "is another once its probabilities are asked for")

    def test_it_learns_from_what_others_do(self) -> None:
        """``learn`` takes another's actions, where nothing was asked before but probabilities."""
        session, learner, other = self._session(), self._made(), np.random.default_rng(1)
        if not learner.learns_from_others:
            raise unittest.SkipTest(f"{self.learner} learns from its own actions alone")

        def act_for_another(view: View) -> Any:
            learner.probabilities(view)
            return other.integers(session.brief.actions, size=self.subjects)

        learner.act = act_for_another  # type: ignore[method-assign]
        try:
            session.play(learner)
        except Exception as error:  # whatever it is, it tells what the learner needs
            raise AssertionError(
                f"{self.learner}: given another's action, it fails with "
                f"{type(error).__name__}: {error}; let learn use step.view and step.action, "
                "and nothing that act has kept, or set learns_from_others = False"
            ) from error

    # -- its state and its parameters -----------------------------------------------------------

    def test_it_goes_on_from_a_checkpoint(self) -> None:
        """A new learner with the state of an old one acts as the old one would have."""
        if not self._made().resumable:
            raise unittest.SkipTest(f"{self.learner} is not resumable")
        course, states = [], []
        learner = self._made()
        for answer in self._steps(self._session(attempt_limit=self.attempts), learner):
            course.append(answer)
            states.append(pickle.dumps(state_of(learner)) if len(course) % EARLY == 0 else b"")
        for moment in sorted({EARLY, len(course) // 2 // EARLY * EARLY} - {0}):
            session = self._session(attempt_limit=self.attempts)
            for answer in course[:moment]:
                session.step(answer)
            again = self._answers(session, state=pickle.loads(states[moment - 1]))
            self._require(
                again == course[moment:],
                f"interrupted after {moment} steps, it does not continue as it would have "
                f"uninterrupted: its actions agree for {_common(again, course[moment:])} of "
                f"{len(again)} steps (does __getstate__ leave out what __setstate__ does not make "
                "anew?)",
            )

    def test_its_parameters_are_a_frozen_dataclass_that_explains_itself(self) -> None:
        """Each has a default that fits its own type, and a text in its ``Annotated`` type."""
        kind: Any = learner_class(self.learner)
        declared = kind.Parameters
        self._require(
            getattr(getattr(declared, "__dataclass_params__", None), "frozen", False),
            "Parameters must be a dataclass(frozen=True)",
        )
        silent = [row.name for row in parameter_table(self.learner) if not row.meaning.strip()]
        example = 'rate: Annotated[float, "of Adam"] = 0.001'
        self._require(not silent, f"write the meaning of {', '.join(silent)}, as in {example}")
        default = parse_parameters(self.learner, {})
        again = parse_parameters(self.learner, asdict(default))
        self._require(again == default, f"its defaults are read back as {again}")
        self._require(bool(kind.__doc__), "its class has no docstring, which lists show")

    # -- how the tests play ---------------------------------------------------------------------

    def _require(self, holds: bool, message: str) -> None:
        if not holds:
            raise AssertionError(f"{self.learner}: {message}")

    def _require_same(self, one: Rows, other: Rows, message: str) -> None:
        same = _common(one, other)
        for was, is_now in zip(one[same:], other[same:], strict=False):
            differ = "; ".join(f"{k} {was[k]} or {is_now[k]}" for k in was if was[k] != is_now[k])
            self._require(False, f"its record {message}; first in row {same}: {differ}")
        self._require(len(one) == len(other), f"its record {message}; one is longer")

    def _made(self) -> Learner:
        self._require(
            bool(self.learner),
            f"{type(self).__name__} has no learner to test; give it an attribute, as in "
            'learner = "my_package:MyLearner"',
        )
        return create(self.learner, self.parameters)

    def _session(
        self,
        condition: Condition | None = None,
        subjects: Sequence[int] | None = None,
        **changes: Any,
    ) -> Session:
        names = self.schemas or ("CC3", "CE4")
        transfer = find_condition(f"{names[0]}-{names[-1]}")
        numbers = range(self.subjects) if subjects is None else subjects
        protocol = replace(SHORT, **changes)
        return Session(condition or transfer, protocol, numbers, seed=7, learner="contract")

    def _play(
        self, subjects: Sequence[int] | None = None, attempts: int = SHORT.attempt_limit
    ) -> Rows:
        return self._rows(self._session(subjects=subjects, attempt_limit=attempts), self._made())

    def _rows(self, session: Session, learner: Learner) -> Rows:
        return session.play(learner).drop_columns(["wall_time"]).to_pylist()

    def _answers(self, session: Session, **given: Any) -> list[list[int]]:
        return [*self._steps(session, self._made(), **given)]

    def _steps(
        self,
        session: Session,
        learner: Learner,
        change: Callable[[Any, int], Any] = lambda given, steps: given,
        state: Any = None,
    ) -> Iterator[list[int]]:
        """Play to the end; yields the learner's answers, each after it has learned from its step.

        Args:
            session: The session.
            learner: A learner that has not begun.
            change: Changes the views and steps that the learner gets, by the steps taken before.
            state: A state to begin with.
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
            yield answer.tolist()


def _common(one: Sequence[Any], other: Sequence[Any]) -> int:
    """Number of items that two sequences have in common before they first differ."""
    agree = (left == right for left, right in zip(one, other, strict=False))
    return sum(takewhile(bool, agree))


def _with_finished(given: Any, gone: NDArray[np.bool_], garble: bool) -> Any:
    """A view or a step in which some subjects have finished; garbled, their rows are nonsense."""
    changed = {}
    for field in fields(given):
        value = getattr(given, field.name)
        if is_dataclass(value):
            changed[field.name] = _with_finished(value, gone, garble)
        elif field.name == "playing":
            changed[field.name] = value & ~gone
        elif garble:
            nonsense = (
                ~value if value.dtype == bool else 1 - value if value.ndim == 2 else 1 + value
            )
            changed[field.name] = np.where(
                gone.reshape(-1, *[1] * (value.ndim - 1)), nonsense, value
            )
    return replace(given, **changed)

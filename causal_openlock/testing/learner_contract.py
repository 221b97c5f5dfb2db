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
says what to look at. Whether a learner learns well is not tested.
"""

from __future__ import annotations

import pickle
import unittest
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass, replace
from itertools import zip_longest
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from causal_openlock.contract.checks import GlobalRandomness, are_probabilities
from causal_openlock.contract.learner import InformedLearner, Learner, View
from causal_openlock.contract.registry import create, learner_class, parameter_table
from causal_openlock.experiment.condition import Condition, Trials, find_condition
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import bundled_schemas, find_schema
from causal_openlock.schemas.schema import Schema

SHORT = Protocol("contract", 5, stop_when_solved=True, baseline_trials=2, training_trials=2)
"""The protocol of the tests: two trials of five attempts, and a third one to test on."""

EARLY = 6
"""Actions after which a learner is interrupted, or a subject finishes."""

LEAVES = [f"L{lever}" for lever in range(1, 9)]
NINE = Schema("nine", ["L0", *LEAVES], {"L0": LEAVES} | {leaf: ["door"] for leaf in LEAVES})


class LearnerContract:
    """Tests of one learner; see the module's docstring for how to use it."""

    learner: ClassVar[str] = ""  #: its registered name, or ``module:Class``
    parameters: ClassVar[Mapping[str, Any]] = {}  #: those that differ from their defaults
    schemas: ClassVar[Sequence[str] | None] = None  #: to play; by default all that are bundled
    subjects: ClassVar[int] = 4  #: how many play at once; at least two
    attempts: ClassVar[int] = SHORT.attempt_limit
    """Attempts of a trial in the tests of batches and of checkpoints. A learner that is trained
    needs more, so that rounding, or gaps in its state, have time to show."""
    independent_of_batch: ClassVar[bool] = True
    """Whether a subject's data are identical whatever other subjects are in its batch. False for a
    learner that computes many networks in one matrix product, where rounding depends on their
    number: then results depend on ``cell_size``."""

    # -- what it answers, and what its answers depend on ----------------------------------------

    def test_it_answers_with_one_action_for_each_subject(self) -> None:
        """``act`` gives B integers within the action space, in rooms of every size and kind."""
        names = bundled_schemas() if self.schemas is None else self.schemas
        for schema in [*map(find_schema, names), NINE]:
            self._play(condition=Condition(schema.name, (Trials(schema),)))

    def test_the_same_seed_gives_the_same_record(self) -> None:
        """All its randomness comes from ``brief.generators``."""
        self._require_same(self._play(), self._play(), "differs if it is played twice")

    def test_a_subject_does_not_depend_on_its_batch(self) -> None:
        """No subject sees another's data, and no cell what was played before it."""
        together, everyone = self._play(attempts=self.attempts), [*range(self.subjects)]
        batches = [everyone[:1], everyone[-1:], everyone[1:]]
        if not self.independent_of_batch:
            self._play([subject + self.subjects for subject in everyone], attempts=self.attempts)
            batches = [everyone]  # after another cell in the same process
        for batch in batches:
            before = [row for row in together if row["subject"] in batch]
            message = f"of the subjects {batch} differs from theirs as some of {self.subjects}"
            self._require_same(before, self._play(batch, attempts=self.attempts), message)

    def test_it_ignores_subjects_that_have_finished(self) -> None:
        """The learner ignores rows of views and steps where ``view.playing`` is false."""
        gone = np.arange(self.subjects) == 1

        def others(garble: bool) -> list[list[int]]:
            def change(given: Any, steps: int) -> Any:
                return given if steps < EARLY else _with_finished(given, gone, garble)

            answers = self._answers(change)
            return [np.array(answer)[~gone].tolist() for answer in answers[EARLY:]]

        self._require_same(
            others(garble=False),
            others(garble=True),
            "depends on what a subject that has finished seems to do; look at step.view.playing",
        )

    def test_it_keeps_no_global_randomness(self) -> None:
        """The learner neither draws from the global generators nor seeds them."""
        self._play()  # so that the play below imports nothing
        with GlobalRandomness.seeded(1) as start:
            self._play()
            touched = start.differs_from(GlobalRandomness.now())
        assert not touched, f"it used or seeded {touched}; draw from brief.generators instead"

    # -- its probabilities, and what others do --------------------------------------------------

    def test_it_draws_its_actions_from_its_probabilities(self) -> None:
        """Its probabilities add up to 1 and allow what it does, and asking changes nothing."""
        learner = self._made()
        act, everyone = learner.act, np.arange(self.subjects)

        def ask_and_act(view: View) -> Any:
            rows = learner.probabilities(view)
            if rows is None:
                raise unittest.SkipTest(f"{self.learner} gives no probabilities")
            assert are_probabilities(rows[view.playing], _actions(view)), (
                "its probabilities are not numbers of 0 or more for each action that add up to 1"
            )
            answer = act(view)
            possible = rows[everyone, answer] > 0
            assert possible[view.playing].all(), "its own probabilities say that it cannot do that"
            return answer

        learner.act = ask_and_act  # type: ignore[method-assign]
        asked = self._play(learner=learner)
        self._require_same(self._play(), asked, "is another once its probabilities are asked for")

    def test_it_learns_from_what_others_do(self) -> None:
        """``learn`` uses the step, and nothing that ``act`` kept; or set ``learns_from_others``."""
        learner, other = self._made(), np.random.default_rng(1)
        if not learner.learns_from_others:
            raise unittest.SkipTest(f"{self.learner} learns from its own actions alone")

        def act_for_another(view: View) -> Any:
            learner.probabilities(view)
            return other.integers(_actions(view), size=self.subjects)

        learner.act = act_for_another  # type: ignore[method-assign]
        self._play(learner=learner)

    # -- its state and its parameters -----------------------------------------------------------

    def test_it_goes_on_from_a_checkpoint(self) -> None:
        """New learners, each with the state of the one before, act as the first would have."""
        if not self._made().resumable:
            raise unittest.SkipTest(f"{self.learner} is not resumable")
        self._require_same(
            self._answers(attempts=self.attempts),
            self._answers(attempts=self.attempts, interrupted=True),
            f"is another if it is interrupted after every {EARLY} steps; does __getstate__ leave "
            "out what __setstate__ does not make anew?",
        )

    def test_its_parameters_are_a_frozen_dataclass_that_explains_itself(self) -> None:
        """Each has a default that fits its own type, and a text in its ``Annotated`` type."""
        kind: Any = learner_class(self.learner)
        frozen = getattr(getattr(kind.Parameters, "__dataclass_params__", None), "frozen", False)
        assert frozen, "Parameters must be a dataclass(frozen=True)"
        silent = [row.name for row in parameter_table(self.learner) if not row.meaning.strip()]
        assert not silent, f'what {silent} mean is missing, as in rate: Annotated[float, "of Adam"]'
        defaults = create(self.learner).parameters
        again = create(self.learner, asdict(defaults)).parameters
        assert again == defaults, f"its defaults are read back as {again}"
        assert kind.__doc__, "its class has no docstring, which lists show"

    # -- how the tests play ---------------------------------------------------------------------

    def _require_same(self, record: Sequence[Any], again: Sequence[Any], message: str) -> None:
        for row, (was, now) in enumerate(zip_longest(record, again)):
            if isinstance(was, dict) and isinstance(now, dict):
                was, now = ({k: of[k] for k in of if was[k] != now[k]} for of in (was, now))
            assert was == now, f"its record {message} (row {row}: {was} and {now})"

    def _made(self) -> Learner:
        assert self.learner, 'learner = "my_package:MyLearner" is missing'
        return create(self.learner, self.parameters)

    def _session(
        self, subjects: Sequence[int], attempts: int, condition: Condition | None = None
    ) -> Session:
        names = self.schemas or ("CC3", "CE4")
        transfer = find_condition(f"{names[0]}-{names[-1]}")
        protocol = replace(SHORT, attempt_limit=attempts)
        return Session(condition or transfer, protocol, subjects, seed=7, learner="contract")

    def _play(
        self,
        subjects: Sequence[int] = (),
        *,
        condition: Condition | None = None,
        attempts: int = SHORT.attempt_limit,
        learner: Learner | None = None,
    ) -> list[dict[str, Any]]:
        """The rows of the record of a session."""
        session = self._session(subjects or range(self.subjects), attempts, condition)
        return session.play(learner or self._made()).drop_columns(["wall_time"]).to_pylist()

    def _answers(
        self,
        change: Callable[[Any, int], Any] = lambda given, steps: given,
        attempts: int = SHORT.attempt_limit,
        interrupted: bool = False,
    ) -> list[list[int]]:
        """The learner's answers in a session; others continue it if it is interrupted.

        Views and steps reach it through ``change``, with the number of steps before.
        """
        session, learner = self._session(range(self.subjects), attempts), self._made()
        answers: list[list[int]] = []
        session.begin(learner)
        while not session.over:
            if interrupted and answers and len(answers) % EARLY == 0:
                state = pickle.loads(pickle.dumps(learner.__getstate__()))
                learner = self._made()
                session.begin(learner, state)
            view = change(session.view, len(answers))
            answer = learner.act(view)
            step = session.step(np.where(view.playing, answer, 0))
            learner.learn(change(step, len(answers)))
            if isinstance(learner, InformedLearner) and step.trial_over.any():
                learner.inform(session.truth)
            answers.append(answer.tolist())
        return answers


def _actions(view: View) -> int:
    return view.observation.shape[1] - 1


def _with_finished(given: Any, gone: NDArray[np.bool_], garble: bool) -> Any:
    """A view or a step in which some subjects have finished; garbled, their rows are nonsense."""
    changed = {}
    for field in fields(given):
        value = getattr(given, field.name)
        if is_dataclass(value):
            changed[field.name] = _with_finished(value, gone, garble)
            continue
        value = value.copy()
        if field.name == "playing":
            value[gone] = False
        elif garble:
            value[gone] = np.logical_not(value[gone])
        changed[field.name] = value
    return replace(given, **changed)

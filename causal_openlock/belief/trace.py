"""The beliefs of one subject in one trial, action by action.

The information that an action was expected to give and the information that it gave, the difference
of the entropies, agree on average, not action by action: an unlikely outcome is worth more bits
than expected, a likely one fewer, and ruling out the most probable hypothesis can leave a subject
less certain than it was.

:func:`trace_text` writes a trace as text, :mod:`causal_openlock.analysis.plots.belief` draws it.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import groupby
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from causal_openlock.belief.belief_learner import BeliefLearner
from causal_openlock.belief.beliefs import Belief
from causal_openlock.belief.likelihoods import observed
from causal_openlock.belief.structure_schemas import (
    behave_alike,
    by_position,
    in_words,
    same_structure,
)
from causal_openlock.contract.learner import Learner, Step
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.condition import Condition
from causal_openlock.experiment.plan import check_trial
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.schemas.schema import DOOR, Schema
from causal_openlock.wording import counted
from causal_openlock.world.rewards import PAPER_REWARD, RewardFunction
from causal_openlock.world.room import position_names

if TYPE_CHECKING:
    import pandas as pd

OUTCOMES = {
    "nothing": "nothing moved",
    "moved": "moved",
    "unlocked": "moved, and unlocked the door",
    "locked": "moved, and locked the door again",
    "opened": "opened, nothing new",
    "new solution": "opened, a new solution",
}
"""The results of an action, and how they are written."""
OUTCOME_WIDTH = max(map(len, OUTCOMES.values())) + len(" (1 of 3)")
RENEWED = {
    "noise": "no hypothesis explains this: from here on levers may fail to move",
    "sampled": "other hypotheses from here on",
}
"""Why hypotheses are others than before, and how it is written."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Moment:
    """An action, and what the subject believes after it: a row of :meth:`Trace.table`."""

    attempt: int = 0  #: number of the attempt in the trial, from 1; 0 before the first action
    number: int = 0  #: number of the action in the attempt, from 1
    action: str = ""  #: the action, such as ``push_UPPER``
    outcome: str = ""  #: its result, one of :data:`OUTCOMES`
    chance: float = 1.0  #: the subject's predictive probability of what it then observed
    entropy_before: float  #: entropy of the belief before the action, in bits
    entropy_after: float  #: the same after it
    gain_predicted: float = 0.0  #: expected information gain of the action alone, in bits
    gain_obtained: float  #: information gain in bits: the difference of the entropies
    renewed: str = ""
    """Why the subject has other hypotheses than before, one of :data:`RENEWED`; empty if they are
    the same. Entropies of different hypotheses differ by no information."""
    hypotheses: int  #: how many hypotheses are possible
    structure: Schema  #: the most probable structure, its levers named by position
    probability: float  #: its probability
    edges: FloatArray  #: ``[P, P + 1]`` probability of each edge from a position to one or the door

    @classmethod
    def of(cls, learner: BeliefLearner, entropy_before: float, **action: Any) -> Moment:
        """What the first subject of a learner believes, after an action."""
        belief, posterior = learner.belief(0), learner.posterior(0)
        structure, probability = posterior.most_probable()
        entropy = max(0.0, belief.entropy)  # never -0.0
        return cls(
            entropy_before=entropy_before,
            entropy_after=entropy,
            gain_obtained=entropy_before - entropy,
            hypotheses=int(np.count_nonzero(belief.weight)),
            structure=structure,
            probability=min(probability, 1.0),
            edges=np.clip(posterior.expected().edges, 0.0, 1.0),
            **action,
        )


@dataclass(frozen=True, eq=False)
class Trace:
    """One trial of one subject; N actions."""

    learner: str  #: label of the learner
    condition: str
    protocol: Protocol
    subject: int
    trial: int  #: number of the trial in the condition, from 1, of ``trials``
    trials: int
    truth: Schema  #: the schema of the room, its levers named by position
    moments: tuple[Moment, ...]  #: the N + 1 beliefs: before the first action, and after each
    shown: bool = False  #: whether the subject was shown the trial and did not act itself

    @property
    def actions(self) -> tuple[Moment, ...]:
        """The N moments after an action."""
        return self.moments[1:]

    @property
    def attempts(self) -> list[tuple[Moment, ...]]:
        """The actions of each attempt."""
        return [tuple(run) for _, run in groupby(self.actions, attrgetter("attempt"))]

    @property
    def found(self) -> int:
        """Number of solutions found."""
        return sum(action.outcome == "new solution" for action in self.actions)

    @property
    def known_from(self) -> int | None:
        """The first attempt at whose end, and at all later ends, the truth is most probable.

        None if another structure is most probable in the end.
        """
        ends = [attempt[-1] for attempt in self.attempts]
        wrong = [end.attempt for end in ends if not same_structure(end.structure, self.truth)]
        last = max(wrong, default=0)
        return last + 1 if last < ends[-1].attempt else None

    @property
    def entropies(self) -> FloatArray:
        """``[N + 1]`` entropy in bits, before the first action and after each."""
        return np.array([moment.entropy_after for moment in self.moments])

    @property
    def edges(self) -> FloatArray:
        """``[N + 1, P, P + 1]`` probability of each edge, at first and after each action."""
        return np.array([moment.edges for moment in self.moments])

    @property
    def nodes(self) -> tuple[str, ...]:
        """``[P + 1]`` names of the rows and columns of :attr:`edges`; the door is last."""
        return (*position_names(len(self.moments[0].edges)), DOOR)

    def table(self) -> pd.DataFrame:
        """A row for each action.

        Returns:
            The ``trial``, the attributes of each :class:`Moment`, its ``structure`` in words, and
            for each edge that was ever possible a column such as ``UPPER -> door`` with its
            probability after the action.
        """
        import pandas as pd

        rows = [
            {"trial": self.trial, **vars(action), "structure": in_words(action.structure)}
            for action in self.actions
        ]
        edges = self.edges
        arrows = {
            f"{self.nodes[cause]} -> {self.nodes[effect]}": edges[1:, cause, effect]
            for cause, effect in np.argwhere(edges.max(axis=0) > 0)
        }
        return pd.DataFrame(rows).drop(columns="edges").assign(**arrows)


def trace_trial(
    learner: Learner,
    condition: Condition,
    protocol: Protocol,
    *,
    trial: int = 1,
    subject: int = 0,
    seed: int = 0,
    reward: RewardFunction | str = PAPER_REWARD,
    label: str = "learner",
    recorded: Iterable[int] | None = None,
) -> Trace:
    """Play one subject up to the end of a trial, and record its beliefs in this trial.

    The subject acts as in a :class:`~causal_openlock.experiment.session.Session`.

    Args:
        learner: The learner; it must not have begun.
        condition: Which rooms are visited.
        protocol: With what budgets.
        trial: Number of the trial to trace in the whole condition, from 1.
        subject: Number of the subject.
        seed: Seed of the experiment.
        reward: The reward of each action.
        label: Label of the learner; it keys the learner's randomness.
        recorded: The actions that the subject is known to have taken up to the end of the trial,
            but for those that it is shown; by default the learner acts.

    Raises:
        LearnerError: If the learner holds no beliefs.
        ExperimentError: If there is no such trial, or a schema does not fit the protocol.

    Example:
        >>> from causal_openlock import PROTOCOLS, create, find_condition
        >>> condition = find_condition("CC3")
        >>> trace = trace_trial(create("bayes"), condition, PROTOCOLS["human"], seed=2018)
        >>> trace.found, trace.actions[0].action, round(trace.actions[0].gain_predicted, 2)
        (2, 'push_UPPERLEFT', 1.5)
    """
    if not isinstance(learner, BeliefLearner):
        raise LearnerError(
            f"{label} has no beliefs to trace; choose a learner that has, such as bayes"
        )
    session = Session(condition, protocol, [subject], seed=seed, reward=reward, learner=label)
    check_trial(trial, session.brief.trials, f"{condition.name} under protocol {protocol.name}")
    given = None if recorded is None else iter(recorded)

    def chosen() -> IntArray:
        if given is None or session.shown is not None:
            return session.chosen(learner)
        learner.beliefs.enter(session.view)
        return np.array([next(given, 0)])

    def learn(step: Step) -> None:
        # Where actions are given, beliefs are all that is needed: no network is trained.
        (learner.learn if given is None else learner.beliefs.update)(step)

    session.begin(learner)
    while session.view.trial[0] < trial:
        learn(session.step(chosen()))
    room = session.truth.rooms[int(session.truth.room[0])]
    moments: list[Moment] = []
    over = False
    while not over:
        view, action = session.view, chosen()
        belief = replace(learner.belief(0))  # a copy, as the learner changes its own
        moments = moments or [Moment.of(learner, belief.entropy)]
        predicted = float(learner.gains(0, view)[action[0]])
        step = session.step(action)
        over, event = bool(step.trial_over[0]), observed(step, 0, belief.slots, belief.found)
        # The end of the trial would make the learner forget the room.
        learn(replace(step, trial_over=np.zeros_like(step.trial_over)))
        attempt = int(view.attempt[0])
        moment = Moment.of(
            learner,
            moments[-1].entropy_after,
            attempt=attempt,
            number=1 + sum(past.attempt == attempt for past in moments),
            action=session.brief.action_names[action[0]],
            outcome=_outcome(step),
            chance=1.0 if event is None else float(belief.weight @ belief.likelihood(event)),
            gain_predicted=predicted,
            renewed=_renewed(belief, learner.belief(0)),
        )
        moments.append(moment)
    return Trace(
        learner=label,
        condition=condition.name,
        protocol=protocol,
        subject=subject,
        trial=trial,
        trials=session.brief.trials,
        truth=by_position(room),
        moments=tuple(moments),
        shown=trial <= session.shown_trials,
    )


def _renewed(before: Belief, after: Belief) -> str:
    if after.space is before.space:
        return ""
    return "noise" if len(after.space.strengths) > len(before.space.strengths) else "sampled"


def _outcome(step: Step) -> str:
    before, after = step.view.observation[0], step.outcome[0]
    if step.new_solution[0]:
        return "new solution"
    if after[-1] != before[-1]:
        return "opened"
    if after[-2] != before[-2]:
        return "locked" if after[-2] else "unlocked"
    return "nothing" if (after == before).all() else "moved"


# -- as text --------------------------------------------------------------------------------------


def trace_text(trace: Trace, most: int = 30) -> Iterator[str]:
    """The lines of a trace; of more than ``most`` attempts, the later ones are summarised."""
    solutions, protocol = len(trace.truth.solutions), trace.protocol
    actions = counted(protocol.actions_for(trace.truth), "action")
    yield (
        f"{trace.learner} in {trace.condition} under protocol {protocol.name}, subject "
        f"{trace.subject}, trial {trace.trial} of {trace.trials}"
    )
    yield (
        f"{counted(solutions, 'solution')} to find, {counted(protocol.attempt_limit, 'attempt')} "
        f"of {actions}"
    )
    yield ""
    begins = "is shown the solutions" if trace.shown else "acts"
    yield from _wrapped(f"Before it {begins}: {belief_in_words(trace.moments[0])}")
    found = 0
    width = max(len(shown_name(action)) for action in trace.actions)
    for attempt in trace.attempts[:most]:
        yield ""
        yield f"Attempt {attempt[0].attempt}"
        for action in attempt:
            result = OUTCOMES[action.outcome]
            if action.outcome == "new solution":
                found += 1
                result += f" ({found} of {solutions})"
            gain, predicted = _bits(action.gain_obtained), _bits(action.gain_predicted)
            yield (
                f"  {shown_name(action):{width}}  {result:{OUTCOME_WIDTH}}  {gain} bits learned, "
                f"{predicted} expected"
            )
            if action.renewed:
                yield f"    {RENEWED[action.renewed]}"
        yield from _wrapped(f"Now {belief_in_words(attempt[-1])}", "  ")
    if rest := trace.attempts[most:]:
        more = trace.found - found
        news = counted(more, "new solution") if more else "no new solution"
        yield ""
        yield f"and {counted(len(rest), 'more attempt')}, with {news}"
        yield from _wrapped(f"In the end {belief_in_words(trace.moments[-1])}", "  ")
    yield ""
    unsolved = f"Not solved: {trace.found} of {solutions} solutions"
    end = "Shown" if trace.shown else "Solved" if trace.found == solutions else unsolved
    verdict = {
        "same": "is the same structure",
        "alike": f"acts the same in attempts of {actions}",
        "different": "acts differently",
    }[agreement(trace)]
    yield from _wrapped(
        f"{end} in {counted(len(trace.attempts), 'attempt')}. In truth, {in_words(trace.truth)}. "
        f"What it believes most probable {verdict}."
    )


def agreement(trace: Trace) -> str:
    """Compare the most probable structure in the end with the truth, strengths aside.

    Returns:
        ``same``, ``alike`` if it behaves alike in every attempt, or ``different``.
    """
    most, limit = trace.moments[-1].structure, trace.protocol.actions_for(trace.truth)
    if same_structure(most, trace.truth):
        return "same"
    return "alike" if behave_alike(trace.truth, most, limit) else "different"


def belief_in_words(belief: Moment) -> str:
    """The entropy of a belief and its most probable structure, in words."""
    return (
        f"{_bits(belief.entropy_after)} bits left, "
        f"{counted(belief.hypotheses, 'hypothesis', 'hypotheses')}; most probable "
        f"({percent(belief.probability)}): {in_words(belief.structure)}."
    )


def shown_name(action: Moment) -> str:
    """The name of an action as people read it: ``push UPPER``."""
    return action.action.replace("_", " ", 1)


def percent(probability: float) -> str:
    """A probability in percent; 0% and 100% only if it is certain.

    >>> percent(0.5), percent(0.9999), percent(0.001)
    ('50%', 'over 99%', 'under 1%')
    """
    if 0.995 <= probability < 1.0 - 1e-9:
        return "over 99%"
    return f"{probability:.0%}" if probability >= 0.01 else "under 1%"


def _bits(bits: float) -> str:
    return f"{round(bits, 2) + 0.0:.2f}"


def _wrapped(text: str, indent: str = "") -> list[str]:
    return textwrap.wrap(
        text, 96, initial_indent=indent, subsequent_indent=indent + "  ", break_long_words=False
    )

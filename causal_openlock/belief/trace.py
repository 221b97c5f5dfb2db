"""The beliefs of one subject in one trial, action by action.

A :class:`Trace` holds the belief before and after each action, the expected information gain of the
action, and the gain that was obtained: the difference of the entropies. The two agree on average,
not action by action: an unlikely outcome is worth more bits than expected, a likely one fewer, and
ruling out the most probable hypothesis can leave a subject less certain than it was.

:func:`trace_text` writes a trace as text, :mod:`causal_openlock.analysis.plots.belief` draws it.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from causal_openlock.belief.belief_learner import BeliefLearner
from causal_openlock.belief.beliefs import Belief
from causal_openlock.belief.likelihoods import likelihood, observed
from causal_openlock.belief.structure_schemas import (
    behave_alike,
    by_position,
    in_words,
    same_structure,
)
from causal_openlock.contract.learner import Learner, Step
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.declare import Condition, Protocol
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.schemas.schema import DOOR, Schema
from causal_openlock.wording import counted
from causal_openlock.world.rewards import PAPER_REWARD, RewardFunction
from causal_openlock.world.room import position_names

if TYPE_CHECKING:
    import pandas as pd

WIDTH = 96
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
NOISE = (
    "No hypothesis explains this. From here on levers may fail to move, and everything observed in "
    "this room counts again for the new hypotheses."
)
IMPOSSIBLE = 1e-12
"""Outcomes with a lower probability were impossible for the subject."""
SURPRISING = 0.1
NOTHING = 0.005
"""Fewer bits than these count as none."""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """A belief at one moment; P positions.

    Attributes:
        entropy: Its entropy in bits.
        hypotheses: How many hypotheses are possible.
        structure: The most probable structure, its levers named by position.
        probability: Its probability.
        edges: ``[P, P + 1]`` probability of each edge from a position to another or the door.
    """

    entropy: float
    hypotheses: int
    structure: Schema
    probability: float
    edges: FloatArray


@dataclass(frozen=True, eq=False)
class TracedAction:
    """One action and its effect on the belief.

    Attributes:
        attempt: Number of the attempt in the trial, from 1.
        number: Number of the action in the attempt, from 1.
        name: The action, such as ``push_UPPER``.
        outcome: Its result, one of :data:`OUTCOMES`.
        chance: The subject's predictive probability of what it then observed.
        predicted: Expected information gain of the action alone, in bits.
        renewed: Why the subject has other hypotheses afterwards: ``sampled`` if too few of the
            sampled ones were left and it sampled again, ``noise`` if it concluded that levers may
            fail to move; empty if they are the same. Entropies before and after a renewal are of
            different hypotheses, and their difference is not information.
        before: The belief before it.
        after: The belief after it.
    """

    attempt: int
    number: int
    name: str
    outcome: str
    chance: float
    predicted: float
    renewed: str
    before: Snapshot
    after: Snapshot

    @property
    def obtained(self) -> float:
        """Information gain in bits: the entropy before the action less that after it."""
        return self.before.entropy - self.after.entropy


@dataclass(frozen=True, eq=False)
class Trace:
    """One trial of one subject; N actions.

    Attributes:
        learner: Label of the learner.
        condition: Name of the condition.
        protocol: The protocol that was played.
        subject: Number of the subject.
        trial: Number of the trial in the condition, from 1.
        trials: How many trials the condition has.
        truth: The schema of the room, its levers named by position.
        action_limit: Actions in an attempt.
        forgetting: Share of the trial's evidence that the subject loses with every attempt; the
            loss counts against the last action of the attempt.
        actions: The actions.
        shown: Whether the subject was shown the trial and did not act itself.
    """

    learner: str
    condition: str
    protocol: Protocol
    subject: int
    trial: int
    trials: int
    truth: Schema
    action_limit: int
    forgetting: float
    actions: tuple[TracedAction, ...]
    shown: bool = False

    @property
    def snapshots(self) -> list[Snapshot]:
        """The N + 1 beliefs: before the first action, and after each."""
        return [self.actions[0].before, *(action.after for action in self.actions)]

    @property
    def attempts(self) -> list[tuple[TracedAction, ...]]:
        """The actions of each attempt."""
        return [tuple(run) for _, run in groupby(self.actions, key=lambda one: one.attempt)]

    @property
    def found(self) -> int:
        """Number of solutions found."""
        return sum(action.outcome == "new solution" for action in self.actions)

    @property
    def solved(self) -> bool:
        """Whether every solution was found."""
        return self.found == len(self.truth.solutions)

    @property
    def known_from(self) -> int | None:
        """The first attempt at whose end, and at all later ends, the truth is most probable.

        None if another structure is most probable in the end.
        """
        after = 1
        for attempt in self.attempts:
            if not same_structure(attempt[-1].after.structure, self.truth):
                after = attempt[0].attempt + 1
        last = self.actions[-1].attempt
        return None if after > last else after

    @property
    def entropies(self) -> FloatArray:
        """``[N + 1]`` entropy in bits, before the first action and after each."""
        return np.array([snapshot.entropy for snapshot in self.snapshots])

    @property
    def edges(self) -> FloatArray:
        """``[N + 1, P, P + 1]`` probability of each edge, at first and after each action."""
        return np.array([snapshot.edges for snapshot in self.snapshots])

    def table(self) -> pd.DataFrame:
        """A row for each action.

        Returns:
            ``trial``, ``attempt``, ``number``, ``action``, ``outcome``, ``chance``,
            ``entropy_before``, ``entropy_after``, ``gain_predicted``, ``gain_obtained`` (all in
            bits), ``renewed``, ``hypotheses``, ``structure`` (in words) and its ``probability``,
            and for each edge that was ever possible a column such as ``UPPER -> door`` with its
            probability after the action.
        """
        import pandas as pd

        nodes = self.nodes
        edges = self.edges
        possible = np.argwhere(edges.max(axis=0) > 0)
        arrows = {
            f"{nodes[cause]} -> {nodes[effect]}": edges[1:, cause, effect]
            for cause, effect in possible
        }
        rows: list[dict[str, Any]] = [
            {
                "trial": self.trial,
                "attempt": action.attempt,
                "number": action.number,
                "action": action.name,
                "outcome": action.outcome,
                "chance": action.chance,
                "entropy_before": action.before.entropy,
                "entropy_after": action.after.entropy,
                "gain_predicted": action.predicted,
                "gain_obtained": action.obtained,
                "renewed": action.renewed,
                "hypotheses": action.after.hypotheses,
                "structure": in_words(action.after.structure),
                "probability": action.after.probability,
            }
            for action in self.actions
        ]
        return pd.DataFrame(rows).assign(**arrows)

    @property
    def nodes(self) -> tuple[str, ...]:
        """``[P + 1]`` names of the rows and columns of :attr:`edges`; the door is last."""
        return (*position_names(len(self.actions[0].before.edges)), DOOR)


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
) -> Trace:
    """Play one subject up to the end of a trial, and record its beliefs in this trial.

    The subject acts as in any :class:`~causal_openlock.experiment.session.Session` with the same
    condition, protocol, number, seed and label.

    Args:
        learner: The learner; it must not have begun.
        condition: Which rooms are visited.
        protocol: With what budgets.
        trial: Number of the trial to trace in the whole condition, from 1.
        subject: Number of the subject.
        seed: Seed of the experiment.
        reward: The reward of each action.
        label: Label of the learner; it keys the learner's randomness.

    Raises:
        LearnerError: If the learner holds no beliefs.
        ExperimentError: If there is no such trial, or a schema does not fit the protocol.

    Example:
        >>> from causal_openlock import PROTOCOLS, create, find_condition
        >>> condition = find_condition("CC3")
        >>> trace = trace_trial(create("bayes"), condition, PROTOCOLS["human"], seed=2018)
        >>> trace.found, trace.actions[0].name, round(trace.actions[0].predicted, 2)
        (2, 'push_UPPERLEFT', 1.5)
    """
    if not isinstance(learner, BeliefLearner):
        raise LearnerError(
            f"{label} has no beliefs to trace; choose a learner that has, such as bayes"
        )
    session = Session(condition, protocol, [subject], seed=seed, reward=reward, learner=label)
    session.begin_trial(learner, trial)
    room = session.truth.rooms[int(session.truth.room[0])]
    actions: list[TracedAction] = []
    over = False
    while not over:
        view = session.view
        chosen = session.chosen(learner)
        before = actions[-1].after if actions else _snapshot(learner)
        belief = replace(learner.belief(0))  # a copy, as the learner changes its own
        predicted = float(learner.gains(0, view)[chosen[0]])
        step = session.step(chosen)
        over = bool(step.trial_over[0])
        # The end of the trial would make the learner forget the room.
        learner.learn(replace(step, trial_over=np.zeros_like(step.trial_over)))
        attempt = int(view.attempt[0])
        actions.append(
            TracedAction(
                attempt=attempt,
                number=1 + sum(action.attempt == attempt for action in actions),
                name=session.brief.action_names[chosen[0]],
                outcome=_outcome(step),
                chance=_chance(belief, step),
                predicted=predicted,
                renewed=_renewed(belief, learner.belief(0)),
                before=before,
                after=_snapshot(learner),
            )
        )
    return Trace(
        learner=label,
        condition=condition.name,
        protocol=protocol,
        subject=subject,
        trial=trial,
        trials=session.brief.trials,
        truth=by_position(room),
        action_limit=protocol.actions_for(room.schema),
        forgetting=learner.beliefs.prior.forgetting,
        actions=tuple(actions),
        shown=trial <= session.shown_trials,
    )


def _snapshot(learner: BeliefLearner) -> Snapshot:
    belief = learner.belief(0)
    structure, probability = learner.most_probable(0)
    return Snapshot(
        entropy=max(0.0, belief.entropy),  # never -0.0
        hypotheses=int(np.count_nonzero(belief.weight)),
        structure=structure,
        probability=min(probability, 1.0),
        edges=np.clip(learner.edges(0), 0.0, 1.0),
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


def _chance(belief: Belief, step: Step) -> float:
    """The predictive probability of what was observed; 1 if the action could not do anything."""
    event = observed(step, 0, belief.slots, belief.found)
    if event is None:
        return 1.0
    space = belief.space
    return float(belief.weight @ likelihood(space.hypotheses, belief.which, space.strengths, event))


# -- as text --------------------------------------------------------------------------------------


def trace_text(trace: Trace, most: int = 30) -> Iterator[str]:
    """The lines of a trace; of more than ``most`` attempts, the later ones are summarised."""
    solutions, protocol = len(trace.truth.solutions), trace.protocol
    yield (
        f"{trace.learner} in {trace.condition} under protocol {protocol.name}, subject "
        f"{trace.subject}, trial {trace.trial} of {trace.trials}"
    )
    yield (
        f"{counted(solutions, 'solution')} to find, {counted(protocol.attempt_limit, 'attempt')} "
        f"of {counted(trace.action_limit, 'action')}"
    )
    yield ""
    before = "Before it is shown the solutions" if trace.shown else "Before it acts"
    yield from _wrapped(f"{before}: {belief_in_words(trace.snapshots[0])}")
    found = 0
    width = max(len(shown_name(action)) for action in trace.actions)
    for attempt in trace.attempts[:most]:
        yield ""
        yield f"Attempt {attempt[0].attempt}"
        for action in attempt:
            found += action.outcome == "new solution"
            yield from _action_lines(action, width, found, solutions)
        yield from _wrapped(f"Now {belief_in_words(attempt[-1].after)}", "  ")
    if rest := trace.attempts[most:]:
        more = sum(action.outcome == "new solution" for attempt in rest for action in attempt)
        news = counted(more, "new solution") if more else "no new solution"
        yield ""
        yield f"and {counted(len(rest), 'more attempt')}, with {news}"
        yield from _wrapped(f"In the end {belief_in_words(trace.snapshots[-1])}", "  ")
    yield ""
    yield from _wrapped(_verdict(trace))
    kept = [action for action in trace.actions if not action.renewed]
    if len(kept) < len(trace.actions):
        yield from _wrapped(
            "Where other hypotheses replaced the old ones, because few or none were left, the "
            "difference of entropies is not information and is not shown."
        )
    if trace.forgetting:
        yield from _wrapped(
            f"It forgets {trace.forgetting:.0%} of the evidence with every attempt, which counts "
            "against the attempt's last action."
        )
    yield from _wrapped(
        f"Information in all: {_bits(sum(action.predicted for action in kept))} bits expected, "
        f"{_bits(sum(action.obtained for action in kept))} obtained. The two agree on average over "
        "rooms that are as probable as the subject believes, not in every room or action."
    )


def _action_lines(action: TracedAction, width: int, found: int, solutions: int) -> Iterator[str]:
    result = OUTCOMES[action.outcome]
    if action.outcome == "new solution":
        result += f" ({found} of {solutions})"
    if action.renewed:
        gain = f"{_bits(action.predicted)} bits expected; other hypotheses from here on"
    elif max(action.predicted, abs(action.obtained)) < NOTHING:
        gain = "nothing to learn"
    else:
        change = "learned" if action.obtained >= 0 else "less certain"
        gain = f"{_bits(abs(action.obtained))} bits {change}, {_bits(action.predicted)} expected"
    if IMPOSSIBLE <= action.chance < SURPRISING:
        gain += f"; its probability was {percent(action.chance)}"
    yield f"  {shown_name(action):{width}}  {result:{OUTCOME_WIDTH}}  {gain}"
    if action.renewed == "noise":
        yield from _wrapped(NOISE, "    ")


def _verdict(trace: Trace) -> str:
    attempts, truth = len(trace.attempts), in_words(trace.truth)
    if trace.shown:
        end = f"Shown in {counted(attempts, 'attempt')}."
    elif trace.solved:
        last = max(a.attempt for a in trace.actions if a.outcome == "new solution")
        end = f"Solved in {counted(last, 'attempt')}"
        end += f"; the trial continued to {attempts:,}." if attempts > last else "."
    else:
        found = f"{trace.found} of {len(trace.truth.solutions)} solutions"
        end = f"Not solved: {found} in {counted(attempts, 'attempt')}."
    verdict = {
        "same": "is the same structure",
        "alike": f"acts the same in attempts of {counted(trace.action_limit, 'action')}",
        "different": "acts differently",
    }[agreement(trace)]
    return f"{end} In truth, {truth}. What it believes most probable {verdict}."


def agreement(trace: Trace) -> str:
    """Compare the most probable structure in the end with the truth, strengths aside.

    Returns:
        ``same``, ``alike`` if it behaves alike in every attempt, or ``different``.
    """
    most = trace.snapshots[-1].structure
    if same_structure(most, trace.truth):
        return "same"
    return "alike" if behave_alike(trace.truth, most, trace.action_limit) else "different"


def belief_in_words(belief: Snapshot) -> str:
    """The entropy of a belief and its most probable structure, in words."""
    return (
        f"{_bits(belief.entropy)} bits left, "
        f"{counted(belief.hypotheses, 'hypothesis', 'hypotheses')}; most probable "
        f"({percent(belief.probability)}): {in_words(belief.structure)}."
    )


def shown_name(action: TracedAction) -> str:
    """The name of an action as people read it: ``push UPPER``."""
    return action.name.replace("_", " ", 1)


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
        text, WIDTH, initial_indent=indent, subsequent_indent=indent + "  ", break_long_words=False
    )

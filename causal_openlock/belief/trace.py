"""One trial of belief, action by action: what a subject did, saw, expected to learn and learned.

A :class:`Trace` is the inside of one trial as data. Each action comes with the belief before and
after it, the information that was expected of it and the information that it gave. The two agree on
average, not action by action: a question that is worth one bit tells two bits when the unlikely
answer comes and less than one when the likely one does, and an answer that rules out what seemed
most probable can leave a subject less certain than it was.

:mod:`causal_openlock.belief.story` tells a trace in words,
:mod:`causal_openlock.analysis.plots.belief` draws it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from causal_openlock.belief.beliefs import Belief
from causal_openlock.belief.believer import Believer, situation_of
from causal_openlock.belief.evidence import DOOR as DOOR_SLOT
from causal_openlock.belief.evidence import Event, likelihood
from causal_openlock.belief.likeness import by_position
from causal_openlock.belief.words import told
from causal_openlock.contract.learner import InformedLearner, Learner, Step, View
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.protocol import Condition, Protocol, check_trial
from causal_openlock.experiment.session import Session
from causal_openlock.world.fsm import FloatArray
from causal_openlock.world.rewards import PAPER_REWARD, RewardFunction
from causal_openlock.world.room import position_names
from causal_openlock.world.schema import DOOR, Schema

if TYPE_CHECKING:
    import pandas as pd

OUTCOMES = ("nothing", "moved", "unlocked", "locked", "opened", "new solution")
"""What can come of an action, as one word each; the door is ``locked`` by pulling a lever back."""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """A belief at one moment; P positions.

    Attributes:
        entropy: Bits that are missing to certainty.
        hypotheses: How many hypotheses are held possible.
        structure: The most probable structure, its levers called by their positions.
        probability: Its probability.
        edges: ``[P, P + 1]`` probability of each arrow from a position to another or the door.
    """

    entropy: float
    hypotheses: int
    structure: Schema
    probability: float
    edges: FloatArray


@dataclass(frozen=True, eq=False)
class TracedAction:
    """One action and what it did to the belief.

    Attributes:
        attempt: Number of the attempt in the trial, from 1.
        number: Number of the action in the attempt, from 1.
        name: What was done, such as ``push_UPPER``.
        outcome: What came of it, one of :data:`OUTCOMES`.
        chance: Probability that the subject had given to what it then saw.
        predicted: Bits that the action, by itself, was expected to tell.
        renewed: Why its hypotheses are others after it: ``sampled`` if too few of those that it had
            drawn were left and it drew others, ``noise`` if it came to believe that levers may
            fail to move; empty if they are the same. Entropies before and after a renewal are of
            different sets of hypotheses, and their difference is no information.
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
        """Bits that the action told: how much less is missing to certainty after it."""
        return self.before.entropy - self.after.entropy


@dataclass(frozen=True, eq=False)
class Trace:
    """One trial of one subject; N actions.

    Attributes:
        learner: Label of the learner.
        condition: Name of the condition.
        protocol: What it was played under.
        subject: Number of the subject.
        trial: Number of the trial in the condition, from 1.
        trials: How many trials the condition has.
        truth: What governs the room, its levers called by their positions.
        action_limit: Actions in an attempt.
        forgetting: Share of the trial's evidence that the subject loses with every attempt. The
            loss counts against the last action of the attempt.
        actions: What was done.
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
        """How many solutions were found."""
        return sum(action.outcome == "new solution" for action in self.actions)

    @property
    def solved(self) -> bool:
        """Whether all of them were."""
        return self.found == len(self.truth.solutions)

    @property
    def entropies(self) -> FloatArray:
        """``[N + 1]`` bits missing to certainty, before the first action and after each."""
        return np.array([snapshot.entropy for snapshot in self.snapshots])

    @property
    def predicted(self) -> FloatArray:
        """``[N]`` bits that each action was expected to tell."""
        return np.array([action.predicted for action in self.actions])

    @property
    def obtained(self) -> FloatArray:
        """``[N]`` bits that each action told."""
        return np.array([action.obtained for action in self.actions])

    @property
    def edges(self) -> FloatArray:
        """``[N + 1, P, P + 1]`` probability of each arrow, at first and after each action."""
        return np.array([snapshot.edges for snapshot in self.snapshots])

    def table(self) -> pd.DataFrame:
        """A row for each action.

        Returns:
            ``trial``, ``attempt``, ``number``, ``action``, ``outcome``, ``chance``,
            ``entropy_before``, ``entropy_after``, ``gain_predicted``, ``gain_obtained`` (all in
            bits), ``renewed``, ``hypotheses``, ``structure`` (in words) and its ``probability``,
            and for each arrow that was ever possible a column such as ``UPPER -> door`` with its
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
                "structure": told(action.after.structure),
                "probability": action.after.probability,
            }
            for action in self.actions
        ]
        return pd.DataFrame(rows).assign(**arrows)

    @property
    def nodes(self) -> tuple[str, ...]:
        """``[P + 1]`` what rows and columns of :attr:`edges` stand for; the door is last."""
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
    """Let one subject play up to the end of a trial, and watch what it believes in this trial.

    The subject does what it does in any :class:`~causal_openlock.experiment.session.Session` with
    the same condition, protocol, number, seed and label.

    Args:
        learner: What plays; it must not have begun.
        condition: Which rooms are visited.
        protocol: With what budgets.
        trial: Number of the trial to trace in the whole condition, from 1.
        subject: Number of the subject.
        seed: Seed of the experiment.
        reward: The reward of each action.
        label: Label of the learner; it keys the learner's randomness.

    Raises:
        LearnerError: If the learner holds no beliefs.
        ProtocolError: If there is no such trial, or a schema does not fit the protocol.
    """
    if not isinstance(learner, Believer):
        raise LearnerError(
            f"{label} holds no beliefs that could be traced; trace one that does, such as bayes"
        )
    session = Session(condition, protocol, [subject], seed=seed, reward=reward, learner=label)
    trials = session.brief.trials
    check_trial(trial, trials, f"{condition.name} under protocol {protocol.name}")
    session.begin(learner)
    informed = learner if isinstance(learner, InformedLearner) else None
    actions: list[TracedAction] = []
    while True:
        view = session.view
        truth = session.truth
        chosen = learner.act(view)
        watched = view.trial[0] == trial
        if watched:
            before = actions[-1].after if actions else _snapshot(learner)
            belief = replace(learner.belief(0))  # a copy, as the learner changes its own
            predicted = float(learner.gains(0, view)[chosen[0]])
        step = session.step(chosen)
        over = bool(step.trial_over[0])
        if watched and over:
            # With the trial the room would be forgotten, and nothing is played after it.
            learner.learn(replace(step, trial_over=np.zeros_like(step.trial_over)))
        else:
            learner.learn(step)
        if watched:
            actions.append(
                TracedAction(
                    attempt=int(view.attempt[0]),
                    number=actions[-1].number + 1
                    if actions and actions[-1].attempt == view.attempt[0]
                    else 1,
                    name=session.brief.action_names[chosen[0]],
                    outcome=_outcome(step),
                    chance=_chance(belief, view, step),
                    predicted=predicted,
                    renewed=_renewed(belief, learner.belief(0)),
                    before=before,
                    after=_snapshot(learner),
                )
            )
            if over:
                break
        elif informed and over:
            informed.inform(session.truth)
    room = truth.rooms[int(truth.room[0])]
    return Trace(
        learner=label,
        condition=condition.name,
        protocol=protocol,
        subject=subject,
        trial=trial,
        trials=trials,
        truth=by_position(room),
        action_limit=protocol.actions_for(room.schema),
        forgetting=learner.beliefs.prior.forgetting,
        actions=tuple(actions),
    )


def _snapshot(learner: Believer) -> Snapshot:
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


def _chance(belief: Belief, view: View, step: Step) -> float:
    """The probability of what was seen under a belief; certain where nothing else could be."""
    before, after = view.observation[0], step.outcome[0]
    positions = len(belief.slots)
    lever, action = int(step.action[0]) % positions, int(step.action[0])
    door = action == 2 * positions
    could = before[-2] == 0 if door else before[lever] == (action >= positions)
    if not could:
        return 1.0
    many = len(belief.which)
    event = Event(
        slot=np.full(many, DOOR_SLOT if door else belief.slots[lever]),
        pushed=np.full(many, situation_of(belief, view, 0).pushed, dtype=np.uint16),
        took_effect=np.full(many, after[-1] == 1 if door else after[lever] != before[lever]),
        unlocked=np.full(many, after[-2] == 0),
        new=np.full(many, step.new_solution[0]),
        found=np.tile(np.array(belief.found, dtype=np.uint16), (many, 1)),
    )
    space = belief.space
    return float(belief.weight @ likelihood(space.hypotheses, belief.which, space.strengths, event))

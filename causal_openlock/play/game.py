"""One person's way through a condition: perhaps a practice room, then the trials, then the end.

A game is the state of a person and nothing else; it knows neither files nor the network. Every
change of it is a *turn*, numbered from 0, and the same turns lead to the same game, which is how a
server that was killed restores it. What a game shows (:meth:`Game.view`, :meth:`Game.act`) is what
a learner gets: observations, console and budgets. A shown room is a film: the page takes the
actions that it is given, one after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

import numpy as np

from causal_openlock.contract.learner import View
from causal_openlock.experiment.declare import Cell, Condition, Protocol, Trials
from causal_openlock.experiment.session import Session
from causal_openlock.play.person import LABEL
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.room import Layout

Stage = Literal["practice", "room", "question", "end"]
Answer = dict[str, Any]
"""Answer to the page: plain data, ready for JSON."""

EXPERIMENT = "people"
PRACTICE = Schema("practice", ["L0"], {"L0": ["door"]})
"""One free lever unlocks the door: enough to learn what a click does, and no more."""
PRACTICE_PLACE = 2
"""Position of the only grey lever of the practice room."""


@dataclass(frozen=True)
class PlayedAction:
    """An action of a trial that counts, for the record of reaction times.

    Attributes:
        visit: Number of the trial in the whole condition, from 1.
        attempt: Number of the attempt in the trial, from 1.
        action: Its index.
        moved: Whether it moved something.
        reaction: Seconds from when the person could act to the click, by the page's clock.
        time: Seconds since the person joined, by the server's clock; not always known of data from
            elsewhere.
        attempt_over: Whether the attempt ended with it.
    """

    visit: int
    attempt: int
    action: int
    moved: bool
    reaction: float | None
    time: float | None
    attempt_over: bool


class Game:
    """One person's game.

    Args:
        cell: Which rooms are visited, with what budgets and seed, and the number of the person.
        practice: Whether a practice room comes first.
        ask: Whether the person is asked after each trial that they play which lever enables which.

    Attributes:
        turn: How many turns have been taken.
        done: The actions of the trials that count, in order.
        answers: What the person said of the rooms that they left, a row for each pair of levers.
    """

    def __init__(self, cell: Cell, practice: bool, ask: bool = False) -> None:
        self._subject = cell.first_subject
        self.session = Session(
            cell.condition,
            cell.spec.protocol,
            [self._subject],
            seed=cell.seed,
            learner=LABEL,
            experiment=EXPERIMENT,
        )
        self._practice = _practice_room(self.session) if practice else None
        self._ask = ask
        self._question: tuple[int, ...] | None = None  # the levers that are asked about
        self._ended: list[Answer] = []  # what came of each trial
        self.turn = 0
        self.done: list[PlayedAction] = []
        self.answers: list[Answer] = []

    @property
    def trials_over(self) -> int:
        """Number of trials that have ended, practice not counted."""
        return len(self._ended)

    @property
    def stage(self) -> Stage:
        """Stage of the game that the person is at."""
        if self._practice is not None:
            return "practice"
        if self._question is not None:
            return "question"
        return "end" if self.session.over else "room"

    def allows(self, action: int | None) -> bool:
        """Whether an action is possible now; ``None`` leaves the practice room.

        In a shown room only the action that comes next is possible; the page takes it.
        """
        if action is None:
            return self._practice is not None
        session = self._practice or self.session
        if session.over or self._question is not None:
            return False
        if session.shown is not None:
            return action == int(session.shown[0])
        return 0 <= action < session.brief.actions

    def allows_answer(self, edges: Sequence[tuple[int, int]]) -> bool:
        """Whether an answer is possible now: pairs of a lever asked about and what it enables."""
        return self._question is not None and set(edges) <= {*self._pairs(self._question)}

    def _pairs(self, levers: Sequence[int]) -> list[tuple[int, int]]:
        """Each of these levers with each other one and the door, in order."""
        door = self.session.brief.positions
        return [pair for pair in product(levers, (*levers, door)) if pair[0] != pair[1]]

    def view(self) -> Answer:
        """State of the game that the person may know now."""
        brief, stage = self.session.brief, self.stage
        shown: Answer = {
            "stage": stage,
            "turn": self.turn,
            "positions": brief.positions,
            "trials": brief.trials,
            "ended": self._ended,
        }
        if stage == "question":
            shown["levers"] = list(self._question or ())
        elif stage != "end":
            shown["room"] = _room(self._practice or self.session)
        return shown

    def proceed(self) -> Answer:
        """Leave the practice room; one turn."""
        self._practice = None
        self.turn += 1
        return self.view()

    def answer(self, edges: Sequence[tuple[int, int]], time: float) -> Answer:
        """Take what the person says of the room that they have left; one turn."""
        about = {
            "learner": LABEL,
            "condition": self.session.condition.name,
            "subject": self._subject,
            "visit": self.trials_over,
            "time": time,
        }
        for cause, effect in self._pairs(self._question or ()):
            pair = {"cause": cause, "effect": effect, "enables": (cause, effect) in edges}
            self.answers.append(about | pair)
        self._question = None
        self.turn += 1
        return self.view()

    def act(self, action: int, reaction: float | None, time: float) -> Answer:
        """Take an action; one turn.

        Args:
            action: Its index.
            reaction: Seconds that the person took, if the page says.
            time: Seconds since the person joined.

        Returns:
            ``outcome``, the observation before any reset; whether it ``moved`` something, ended
            the attempt or the trial, and found a new solution; and what comes next.
        """
        session = self._practice or self.session
        step = session.step(np.array([action]))
        moved = bool((step.outcome != step.view.observation).any())
        attempt_over, trial_over = bool(step.attempt_over[0]), bool(step.trial_over[0])
        new = bool(step.new_solution[0])
        console = step.view.console
        left = int(console.solutions_left[0]) - new
        if session is self.session:
            visit, attempt = int(step.view.trial[0]), int(step.view.attempt[0])
            self.done.append(
                PlayedAction(visit, attempt, action, moved, reaction, time, attempt_over)
            )
            if trial_over:
                found = int(console.solutions_found[0]) + new
                ended: Answer = {"attempts": attempt, "found": found, "left": left}
                watched = visit <= session.shown_trials
                self._ended.append(ended | {"shown": True} if watched else ended)
                if self._ask and not watched:
                    positions = session.brief.positions
                    grey = np.flatnonzero(step.view.observation[0, positions : 2 * positions])
                    self._question = tuple(grey.tolist())
        self.turn += 1
        return {
            "outcome": step.outcome[0].tolist(),
            "moved": moved,
            "attempt_over": attempt_over,
            "trial_over": trial_over,
            "new_solution": new,
            "solutions_left": left,
            "next": self.view(),
        }


def _room(session: Session) -> Answer:
    view: View = session.view
    console = view.console
    room: Answer = {
        "over": session.over,
        "observation": view.observation[0].tolist(),
        "solutions_left": int(console.solutions_left[0]),
        "attempts_left": int(console.attempts_left[0]),
        "actions_left": int(console.actions_left[0]),
        "trial": int(view.trial[0]),
        "attempt": int(view.attempt[0]),
    }
    if (shown := session.shown) is not None:
        room["shown"] = int(shown[0])
    return room


def _practice_room(session: Session) -> Session:
    layout = Layout((PRACTICE_PLACE,), session.brief.positions)
    condition = Condition("practice", (Trials(PRACTICE, (layout,)),))
    protocol = Protocol("practice", session.brief.attempt_limit, stop_when_solved=True)
    return Session(condition, protocol, [0], learner=LABEL)

"""One person's way through a condition: perhaps a practice room, then the trials, then the end.

A game is the state of a person and nothing else; it knows neither files nor the network. Every
change of it is a *turn*, numbered from 0, and the same turns lead to the same game, which is how a
server that was killed restores it. What a game shows (:meth:`Game.view`) is what a learner gets:
observations, console and budgets. A shown room is a film: the page takes the actions that it is
given, one after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any, Literal

import numpy as np

from causal_openlock.contract.learner import Step
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.condition import Condition, Trials
from causal_openlock.experiment.declare import Cell
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.experiment.session import Session
from causal_openlock.play.log import Joined, Turn
from causal_openlock.play.person import LABEL
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.room import Layout

Stage = Literal["practice", "room", "question", "end"]
Answer = dict[str, Any]
"""Answer to the page: plain data, ready for JSON."""

PRACTICE = Schema("practice", ["L0"], {"L0": ["door"]})
"""One free lever unlocks the door: enough to learn what a click does, and no more."""


class Refused(OpenLockError):  # noqa: N818 - an answer to the page
    """A request that changes nothing.

    Args:
        status: Its status in HTTP.
        title: What the page shows, as a heading.
        why: What the page shows below.
        advice: What the researcher is told; empty where there is nothing for them to do.
        now: Where the request is not meant for the person's turn: what they may know now.
    """

    def __init__(
        self, status: int, title: str, why: str, advice: str = "", now: Answer | None = None
    ) -> None:
        super().__init__(why)
        self.status, self.title, self.advice, self.now = status, title, advice, now


class Game:
    """One person's game, in the rooms of a cell.

    Attributes:
        turn: How many turns have been taken.
        done: The actions of the trials that count, in order, as rows of
            :func:`~causal_openlock.experiment.beside_record.reactions_schema`, with
            ``attempt_over``.
        answers: What the person said of the rooms that they left, a row for each pair of levers.
    """

    def __init__(self, joined: Joined, cell: Cell) -> None:
        self.number, self.cell = joined.join, cell
        self.session = Session.of(cell)
        self._joined, self._seconds = joined.at, 0.0
        self._practice = _practice_room(self.session) if joined.practice else None
        self.ask = joined.ask  # whether rooms that are left are asked about
        self._question: tuple[int, ...] | None = None  # the levers that are asked about
        self._ended: list[Answer] = []  # what came of each trial
        self.turn = 0
        self.step: Step | None = None  # what the last action led to
        self.done: list[Answer] = []
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

    def view(self) -> Answer:
        """State of the game that the person may know now."""
        stage, session = self.stage, self._playing
        shown: Answer = {
            "stage": stage,
            "turn": self.turn,
            "positions": session.brief.positions,
            "trials": self.session.brief.trials,
            "ended": self._ended,
        }
        if self._question is not None:
            shown["levers"] = list(self._question)
        elif stage != "end":
            shown["room"] = _room(session)
        return shown

    def allows(self, turn: Turn) -> bool:
        """Whether a turn is the next one, and possible.

        In a shown room only the action that comes next is possible; the page takes it.
        """
        if turn.turn != self.turn:
            return False
        if turn.edges is not None:
            return self._question is not None and {*turn.edges} <= {*self._pairs()}
        if turn.action is None:
            return self._practice is not None
        session = self._playing
        if session.over or self._question is not None:
            return False
        if session.shown is not None:
            return turn.action == int(session.shown[0])
        return turn.action < session.brief.actions

    def take(self, turn: Turn) -> Answer:
        """Take a turn that is possible.

        Returns:
            :meth:`view`; after an action what came of it, with that as ``next``: ``outcome``, the
            observation before any reset; whether it ``moved`` something, ended the attempt or the
            trial, and found a new solution.
        """
        self.turn += 1
        self._seconds = max(self._seconds, turn.at - self._joined)  # clocks are set back
        if turn.edges is not None:
            self._answer(turn.edges)
        elif turn.action is None:
            self._practice = None
        else:
            reaction = None if turn.reaction is None else turn.reaction / 1000
            return {**self._act(turn.action, reaction), "next": self.view()}
        return self.view()

    def _answer(self, edges: Sequence[tuple[int, int]]) -> None:
        about = {
            "learner": self.cell.spec.name,
            "condition": self.session.condition.name,
            "subject": self.cell.first_subject,
            "visit": self.trials_over,
            "time": self._seconds,
        }
        for cause, effect in self._pairs():
            pair = {"cause": cause, "effect": effect, "enables": (cause, effect) in edges}
            self.answers.append(about | pair)
        self._question = None

    def _act(self, action: int, reaction: float | None) -> Answer:
        session = self._playing
        self.step = step = session.step(np.array([action]))
        console = step.view.console
        new = bool(step.new_solution[0])
        said = {
            "outcome": step.outcome[0].tolist(),
            "moved": bool((step.outcome != step.view.observation).any()),
            "attempt_over": bool(step.attempt_over[0]),
            "trial_over": bool(step.trial_over[0]),
            "new_solution": new,
            "solutions_left": int(console.solutions_left[0]) - new,
        }
        if session is self.session:
            visit, attempt = int(step.view.trial[0]), int(step.view.attempt[0])
            about = {"visit": visit, "attempt": attempt, "action": action, "time": self._seconds}
            came = {"moved": said["moved"], "attempt_over": said["attempt_over"]}
            self.done.append({**about, "reaction": reaction, **came})
            if said["trial_over"]:
                found, left = int(console.solutions_found[0]) + new, said["solutions_left"]
                shown = visit <= session.shown_trials
                ended = {"attempts": attempt, "found": found, "left": left, "shown": shown}
                self._ended.append(ended)
                if self.ask and not shown:
                    grey = step.view.observation[0, self._door : 2 * self._door]
                    self._question = tuple(np.flatnonzero(grey).tolist())
        return said

    def _pairs(self) -> list[tuple[int, int]]:
        """Each lever that is asked about with each other one and the door, in order."""
        levers = self._question or ()
        return [pair for pair in product(levers, (*levers, self._door)) if pair[0] != pair[1]]

    @property
    def _playing(self) -> Session:
        """The session of the room that the person is in."""
        return self._practice or self.session

    @property
    def _door(self) -> int:
        """The number that answers give the door: that of the positions of levers."""
        return self.session.brief.positions


def _room(session: Session) -> Answer:
    view, console, truth = session.view, session.view.console, session.truth
    schema = truth.rooms[truth.room[0]].schema
    room: Answer = {
        "over": session.over,
        "observation": view.observation[0].tolist(),
        "solutions_left": int(console.solutions_left[0]),
        "attempts_left": int(console.attempts_left[0]),
        "actions_left": int(console.actions_left[0]),
        "action_limit": session.protocol.actions_for(schema),
        "trial": int(view.trial[0]),
        "attempt": int(view.attempt[0]),
    }
    if (shown := session.shown) is not None:
        room["shown"] = int(shown[0])
    return room


def _practice_room(session: Session) -> Session:
    upper_left = Layout((2,))
    condition = Condition("practice", (Trials(PRACTICE, (upper_left,)),))
    protocol = Protocol("practice", session.brief.attempt_limit, stop_when_solved=True)
    return Session(condition, protocol, [0], learner=LABEL)

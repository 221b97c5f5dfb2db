"""All people who play in a folder: their sessions, the log of what they did, and their record.

A person is identified by a *session id*, drawn at random when they join and known to their browser
only. The log holds a hash of it, so that a reader of the folder cannot play in another person's
name. Who joins with the identifier of a recruiting service that has joined before continues that
person's game, in whatever browser.

People are numbered in the order of joining; conditions are dealt out in shuffled blocks, so
that at any time every condition has as many people as any other, give or take one.

Every request that changes something carries the number of the turn that it is meant for. A request
that comes twice, too late or too early is refused and changes nothing.
"""

from __future__ import annotations

import hashlib
import secrets
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from causal_openlock.errors import ExperimentError, StoreError
from causal_openlock.experiment.beside_record import (
    REACTIONS,
    STRUCTURES,
    write_answers,
    write_reactions,
)
from causal_openlock.experiment.condition import Condition
from causal_openlock.experiment.declare import AGENT, PERSON, Cell, Experiment
from causal_openlock.experiment.plan import plan
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.experiment.record import with_times
from causal_openlock.files.atomic import sweep, write_text
from causal_openlock.files.checksums import digest
from causal_openlock.play import log
from causal_openlock.play.game import Answer, Game, Refused
from causal_openlock.play.person import LABEL, as_learner
from causal_openlock.play.recruiting import identified, read_identifiers, write_identifiers
from causal_openlock.storage.store import LOG, Store
from causal_openlock.wording import joined
from causal_openlock.world.rewards import PAPER_REWARD, find_reward

PEOPLE, AGENTS = "people", "agents"  #: names of the experiment that they play
MOST_PEOPLE = 10_000
"""Most people who can join in one folder."""


class People:
    """All people who play in one results folder.

    Args:
        folder: Where their record is kept; a folder that people have played in is continued.
        conditions: What is played; people are dealt among them.
        protocol: With what budgets.
        seed: Seed of rooms, of luck and of who plays which condition.
        practice: Whether people who join now begin with a practice room.
        ask: Whether people who join now are asked after each trial which lever enables which.
        consent: What people have to agree to before they join, in Markdown; empty for nothing.
        recruiting: What a recruiting service adds to the address of the page to say who joins, such
            as ``("PROLIFIC_PID", "STUDY_ID", "SESSION_ID")``. It is kept in ``recruited.csv``.
            The first of them identifies the person, and nobody joins without it.
        command: The command that continues, for the report.
        agent: What tables call the agent that all subjects are; None for people.
        clock: Returns the time in seconds.

    Attributes:
        consent_mark: What the log calls the consent: a hash of its text; empty without one.

    Raises:
        StoreError: If the folder holds something else, is in use, damaged, or cannot be written to.
        ExperimentError: If a condition does not fit the protocol.
    """

    def __init__(
        self,
        folder: Path | str,
        conditions: Sequence[Condition],
        protocol: Protocol,
        *,
        seed: int = 0,
        practice: bool = True,
        ask: bool = False,
        consent: str = "",
        recruiting: Sequence[str] = (),
        command: str = "",
        agent: str | None = None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        names = [condition.name for condition in conditions]
        if not names or len({*names}) < len(names):
            raise ExperimentError(f"give conditions, each with a name of its own: {joined(names)}")
        for condition in conditions:
            plan(condition, protocol, np.random.default_rng(0))
        who = (LABEL, PERSON) if agent is None else (agent, AGENT)
        self.experiment = Experiment(
            name=PEOPLE if agent is None else AGENTS,
            title="People" if agent is None else "Agents",
            command=command,
            seed=seed,
            cell_size=1,
            conditions=tuple(conditions),
            learners=(as_learner(protocol, find_reward(PAPER_REWARD), *who),),
        )
        self.practice, self.ask, self.consent, self._clock = practice, ask, consent, clock
        self.recruiting = tuple(recruiting)
        self.consent_mark = digest(consent) if consent else ""
        self.store = Store(folder)
        self._sessions: dict[str, Game] = {}  # by the hash of the session id
        self._order: list[Game | None] = []  # None: their data were deleted
        self._written: dict[int, int] = {}  # how many rows of each game are in the files
        self._lock = threading.Lock()  # held while games, the log or identifiers are used
        # Loaded now, and not while a person waits for an answer.
        import pyarrow.parquet  # noqa: F401

        self.store.open(self.experiment, changed=False)
        with ExitStack() as opened:
            opened.callback(self.store.close)
            self._identifiers = read_identifiers(self.store.folder)
            lines = log.read_log(self.store.folder / LOG)
            self._log = log.Log(self.store.folder / LOG)
            opened.callback(self._log.close)
            if consent:
                write_text(self.store.folder / f"consent_{self.consent_mark}.md", consent)
            self._resume(lines)
            self._declare()
            opened.pop_all()

    # -- what the page requests -----------------------------------------------------------------

    def join(
        self, agreed: str = "", recruited: Mapping[str, str] | None = None, session_id: str = ""
    ) -> str:
        """Add a person, or let one who has joined continue; returns the session id.

        Args:
            agreed: The ``consent_mark`` of the text that the person was shown and has agreed to.
            recruited: Identifiers that the recruiting service gives them.
            session_id: The one that their browser has drawn, with which a call that is repeated
                joins once; by default one is drawn here.

        Raises:
            Refused: If there is a consent, and they have agreed to none or to another one; if an
                identifier is missing or cannot be one; or if as many have joined as can.
            StoreError: If it cannot be written to the log.
        """
        if agreed != self.consent_mark and self.consent:
            title = "What you agree to has changed"
            raise Refused(403, title, "Please read it before you begin.")
        given = identified(recruited or {}, self.recruiting)
        session_id = session_id or secrets.token_urlsafe(24)
        key = _key(session_id)
        with self._lock:
            known = key in self._sessions  # the answer to a first call was lost
            if not known:
                line = self._line_of(given, key)
                self._log.append(line)
                self._repeat(line)
            # Not before the log: no other person may get a number that has an identifier.
            number, before = self._sessions[key].number, self._identifiers
            if given and not (known and number in before):
                now = {**before, number: before.get(number, {}) | given}
                write_identifiers(self.store.folder, now)
                self._identifiers = now
        return session_id

    def _line_of(self, given: Mapping[str, str], key: str) -> log.Joined | log.Returned:
        """The line of the log for who begins a session with these identifiers."""
        who = {(name, given[name]) for name in self.recruiting[:1]}
        at, consent = self._clock(), self.consent_mark
        for number, stored in self._identifiers.items():
            if who and who <= stored.items():
                return log.Returned(of=number, key=key, at=at, consent=consent)
        if self.number >= MOST_PEOPLE:
            why = "As many have joined as can; please tell the person who invited you."
            raise Refused(429, "No more people can join now", why)
        return log.Joined(
            join=self.number, key=key, at=at, practice=self.practice, ask=self.ask, consent=consent
        )

    def game(self, session_id: str) -> Game:
        """The game in a session; :class:`Refused` if there is none."""
        game = self._sessions.get(_key(session_id))
        if game is None:
            raise Refused(
                404,
                "This session is not known here",
                "The page was opened with an address that belongs to no session, or to one that is "
                "kept elsewhere.",
            )
        return game

    def view(self, session_id: str) -> Answer:
        """State of a person's game that the person may know now; refused as :meth:`game` is."""
        with self._lock:
            return self.game(session_id).view()

    def take(self, session_id: str, turn: int, **what: Any) -> Answer:
        """Take a person's turn.

        Args:
            session_id: Who takes it.
            turn: The number of the turn.
            what: ``action`` and ``reaction``, or ``edges``, as in
                :class:`~causal_openlock.play.log.Move`.

        Raises:
            Refused: If there is no such session, this is not the turn, or it is not possible.
            StoreError: If it cannot be written to the log; nothing has changed then.
        """
        game = self.game(session_id)
        with self._lock:
            line = log.Turn(of=game.number, turn=turn, at=self._clock(), **what)
            if not game.allows(line):
                why = "This is not the turn that the session is at."
                raise Refused(409, "This does not fit", why, now=game.view())
            self._log.append(line)  # first it is on file, then it is done, then it is answered
            return game.take(line)

    def identifiers(self, session_id: str) -> dict[str, str]:
        """The identifiers that a recruiting service has given a person; empty without one."""
        given = self._identifiers.get(self.game(session_id).number, {})
        return {key: given.get(key, "") for key in self.recruiting}

    # -- what the log holds ---------------------------------------------------------------------

    def _cell(self, number: int) -> Cell:
        """Cell that a person plays."""
        which, subject = dealt(self.experiment, number)
        condition, (spec,) = self.experiment.conditions[which], self.experiment.learners
        return Cell(self.experiment.name, self.experiment.seed, spec, condition, subject, 1)

    def _resume(self, lines: Sequence[log.Line]) -> None:
        """Repeat what the log holds."""
        began = log.Began(identity=self.experiment.identity)
        if not lines:
            self._log.append(began)
        elif lines[0] != began:
            raise StoreError(
                f"{self.store.folder} is of others, or of people who played other conditions, or "
                "with another protocol, seed or version; choose another folder"
            )
        for number, line in enumerate(lines[1:], start=2):
            if not self._repeat(line):
                raise log.fault(self._log.path, number, "this was not possible then")
        # A power cut can take the end of the log, and leave the identifiers.
        numbers = {game.number for game in self._games}
        there = {number: given for number, given in self._identifiers.items() if number in numbers}
        if there != self._identifiers:
            self._identifiers = there
            write_identifiers(self.store.folder, there)

    def _repeat(self, line: log.Line) -> bool:
        """Do again what a line of the log says; whether it was possible."""
        people = len(self._order)
        match line:
            case log.Joined(join=number) if number == people < MOST_PEOPLE:
                joined = self._sessions[line.key] = Game(line, self._cell(number))
                self._order.append(joined)
            case log.Forgotten(join=number) if number == people < MOST_PEOPLE:
                self._order.append(None)
            case log.Returned(of=number) if number < people and (game := self._order[number]):
                self._sessions[line.key] = game
            case log.Turn(of=number) if number < people and (game := self._order[number]):
                if not game.allows(line):
                    return False
                game.take(line)
            case _:
                return False
        return True

    @property
    def _games(self) -> list[Game]:
        """The games of the people whose data have not been deleted."""
        return [game for game in self._order if game is not None]

    # -- the record -----------------------------------------------------------------------------

    @property
    def number(self) -> int:
        """Number of people who have joined."""
        return len(self._order)

    @property
    def finished(self) -> int:
        """How many of them have played to the end, apart from those whose data were deleted."""
        return sum(game.stage == "end" for game in self._games)

    def sync(self) -> None:
        """Flush the log to the disk."""
        self._log.sync()

    def keep(self) -> None:
        """Write the tables of every person who has done something since the last time.

        Raises:
            StoreError: If it cannot be written; the log still has everything.
        """
        for data in (REACTIONS, STRUCTURES):
            sweep(self.store.folder / data)
        written = [self._write(game) for game in self._games]
        if any(written):
            self._declare()

    def _write(self, game: Game) -> bool:
        """Write the tables of one game, if they have new rows; whether they have."""
        with self._lock:
            rows = len(game.done) + len(game.answers)
            if rows == self._written.get(game.number, 0):
                return False
            done, answers, record = [*game.done], [*game.answers], game.session.record()
            over = game.trials_over
        cell, folder = game.cell, self.store.folder
        write_reactions(
            folder / REACTIONS / cell.file_name, cell.condition.name, cell.first_subject, done
        )
        if answers:
            write_answers(folder / STRUCTURES / cell.file_name, answers)
        # A trial that is not over, also of somebody who has left for good, is not recorded.
        if (timed := with_times(record, done, over)).num_rows:
            self.store.write(cell, timed)
        self._written[game.number] = rows
        return True

    def _declare(self) -> None:
        """List in ``experiment.json`` the cells that there are."""
        cells = [game.cell for game in self._games if self.store.path(game.cell).exists()]
        cells.sort(key=lambda cell: cell.name)
        many = max((cell.first_subject + 1 for cell in cells), default=1)
        (spec,) = self.experiment.learners
        declared = replace(self.experiment, learners=(replace(spec, subjects=many),))
        names = [cell.file_name for cell in cells]
        self.store.declare(declared, names, self.experiment.identity)

    def close(self) -> None:
        """Write the record and release the folder."""
        try:
            self.keep()
        finally:
            self._log.close()
            self.store.close()


def dealt(experiment: Experiment, number: int) -> tuple[int, int]:
    """The condition, by its place, of the person who joins as this number, and theirs in it."""
    conditions = len(experiment.conditions)
    subject, place = divmod(number, conditions)
    order = np.random.default_rng([experiment.seed, subject]).permutation(conditions)
    return int(order[place]), subject


def _key(session_id: str) -> str:
    return hashlib.sha256(session_id.encode()).hexdigest()

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

import numpy as np

from causal_openlock.errors import StoreError
from causal_openlock.experiment.beside_record import REACTIONS, STRUCTURES
from causal_openlock.experiment.declare import Cell, Condition, Experiment, LearnerSpec, Protocol
from causal_openlock.experiment.plan import plan
from causal_openlock.files.atomic import sweep, write_text
from causal_openlock.files.digest import digest
from causal_openlock.play.game import EXPERIMENT, Answer
from causal_openlock.play.log import (
    Acted,
    Answered,
    Began,
    Forgotten,
    Joined,
    Line,
    Log,
    Returned,
    Turn,
    fault,
    read_log,
)
from causal_openlock.play.participant import Participant
from causal_openlock.play.person import LABEL, LEARNER
from causal_openlock.play.recruiting import Recruited
from causal_openlock.play.refusals import Refused
from causal_openlock.storage.store import LOG, Store
from causal_openlock.world.rewards import PAPER_REWARD, find_reward

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
        clock: Callable[[], float] = time.time,
    ) -> None:
        for condition in conditions:
            plan(condition, protocol, np.random.default_rng(0))
        reward = find_reward(PAPER_REWARD)
        people = LearnerSpec(
            learner=LEARNER, name=LABEL, protocol=protocol, reward=reward, subjects=1
        )
        self.experiment = Experiment(
            name=EXPERIMENT,
            title="People",
            command=command,
            seed=seed,
            cell_size=1,
            conditions=tuple(conditions),
            learners=(people,),
        )
        self.practice, self.ask, self.consent, self._clock = practice, ask, consent, clock
        self.recruiting = tuple(recruiting)
        self.consent_mark = digest(consent) if consent else ""
        self.store = Store(folder)
        self._sessions: dict[str, Participant] = {}  # by the hash of the session id
        self._order: list[Participant | None] = []  # None: their data were deleted
        self._joining, self._keeping = threading.Lock(), threading.Lock()
        # Loaded now, and not while a person waits for an answer.
        import pyarrow.parquet  # noqa: F401

        self.store.open(self.experiment, changed=False)
        with ExitStack() as opened:
            opened.callback(self.store.close)
            self._recruited = Recruited(self.store.folder, self.recruiting)
            lines = read_log(self.store.folder / LOG)
            self._log = Log(self.store.folder / LOG)
            opened.callback(self._log.close)
            if consent:
                write_text(self.store.folder / f"consent_{self.consent_mark}.md", consent)
            self._resume(lines)
            self._declare()
            opened.pop_all()

    # -- what the page requests -----------------------------------------------------------------

    def join(
        self, agreed: str = "", recruited: Mapping[str, str] | None = None, name: str = ""
    ) -> str:
        """Add a person, or let one who has joined continue; returns the session id.

        Args:
            agreed: The ``consent_mark`` of the text that the person was shown and has agreed to.
            recruited: Identifiers that the recruiting service gives them.
            name: The session id that their browser has drawn, with which a call that is repeated
                joins once; by default one is drawn here.

        Raises:
            Refused: If there is a consent, and they have agreed to none or to another one; if an
                identifier is missing or cannot be one; or if as many have joined as can.
            StoreError: If it cannot be written to the log.
        """
        if agreed != self.consent_mark and self.consent:
            title = "What you agree to has changed"
            raise Refused(403, title, "Please read it before you begin.")
        identifiers = self._recruited.identifiers(recruited or {})
        name = name or secrets.token_urlsafe(24)
        key, at, consent = _key(name), self._clock(), self.consent_mark
        with self._joining:
            if key not in self._sessions:  # else the answer to a first call was lost
                before, number = self._recruited.number(identifiers), self.number
                if before is None and number >= MOST_PEOPLE:
                    title = "No more people can join now"
                    why = "As many have joined as can; please tell the person who invited you."
                    advice = (
                        "a person could not join: this folder is full; start with another --out"
                    )
                    raise Refused(429, title, why, advice)
                line: Line = Joined(
                    join=number, key=key, at=at, practice=self.practice, ask=self.ask,
                    consent=consent,
                )  # fmt: skip
                if before is not None:
                    line = Returned(of=before, key=key, at=at, consent=consent)
                self._log.append(line)
                self._repeat(line)
            # Not before the log: no other person may get a number that has an identifier.
            self._recruited.add(self._sessions[key].number, identifiers)
        return name

    def view(self, name: str) -> Answer:
        """State of a person's game that the person may know now.

        Raises:
            Refused: If there is no such session.
        """
        person = self._find(name)
        with person.lock:
            return person.game.view()

    def proceed(self, name: str, turn: int) -> Answer:
        """Let a person leave the practice room; refused as :meth:`act` is."""
        return self._turn(name, Turn, turn)

    def answer(self, name: str, turn: int, edges: Sequence[Sequence[int]]) -> Answer:
        """Take what a person says of a room; refused as :meth:`act` is."""
        return self._turn(name, Answered, turn, edges=[(cause, effect) for cause, effect in edges])

    def act(self, name: str, turn: int, action: int, reaction: int | None) -> Answer:
        """Carry out a person's action, with its reaction time in milliseconds if the page sends it.

        Raises:
            Refused: If there is no such session, this is not the turn, there is no such action, or
                the person has finished.
            StoreError: If it cannot be written to the log; nothing has changed then.
        """
        return self._turn(name, Acted, turn, action=action, reaction=reaction)

    def identifiers(self, name: str) -> dict[str, str]:
        """The identifiers that a recruiting service has given a person; empty without one."""
        given = self._recruited.of(self._find(name).number)
        return {key: given.get(key, "") for key in self.recruiting}

    def _turn(self, name: str, kind: type[Turn], turn: int, **what: object) -> Answer:
        person = self._find(name)
        with person.lock:
            line = kind(of=person.number, turn=turn, at=self._clock(), **what)
            if not person.allows(line):
                why = "This is not the turn that the session is at."
                raise Refused(409, "This does not fit", why, now=person.game.view())
            self._log.append(line)  # first it is on file, then it is done, then it is answered
            return person.take(line)

    def _find(self, name: str) -> Participant:
        person = self._sessions.get(_key(name))
        if person is None:
            raise Refused(
                404,
                "This session is not known here",
                "The page was opened with an address that belongs to no session, or to one that is "
                "kept elsewhere.",
            )
        return person

    # -- joining and coming back ----------------------------------------------------------------

    def _cell(self, number: int) -> Cell:
        """Cell that a person plays."""
        which, subject = dealt(self.experiment, number)
        condition, (spec,) = self.experiment.conditions[which], self.experiment.learners
        return Cell(EXPERIMENT, self.experiment.seed, spec, condition, subject, 1)

    def _resume(self, lines: Sequence[Line]) -> None:
        """Repeat what the log holds."""
        began = Began(identity=self.experiment.identity)
        if not lines:
            self._log.append(began)
        elif lines[0] != began:
            raise StoreError(
                f"{self.store.folder} is of people who played other conditions, or with another "
                "protocol, seed or version; choose another folder"
            )
        for number, line in enumerate(lines[1:], start=2):
            if not self._repeat(line):
                raise fault(self._log.path, number, "this was not possible then")
        # A power cut can take the end of the log, and leave the identifiers.
        for number in self._recruited.numbers - {person.number for person in self._there}:
            self._recruited.forget(number)

    def _repeat(self, line: object) -> bool:
        """Do again what a line of the log says; whether it was possible."""
        people = len(self._order)
        match line:
            case Joined(join=number) if number == people < MOST_PEOPLE:
                joined = self._sessions[line.key] = Participant(line, self._cell(number))
                self._order.append(joined)
            case Forgotten(join=number) if number == people < MOST_PEOPLE:
                self._order.append(None)
            case Returned(of=number) if number < people and (person := self._order[number]):
                self._sessions[line.key] = person
            case Turn(of=number) if number < people and (person := self._order[number]):
                if not person.allows(line):
                    return False
                person.take(line)
            case _:
                return False
        return True

    @property
    def _there(self) -> list[Participant]:
        """People whose data have not been deleted."""
        return [person for person in self._order if person is not None]

    # -- the record -----------------------------------------------------------------------------

    @property
    def number(self) -> int:
        """Number of people who have joined."""
        return len(self._order)

    @property
    def finished(self) -> int:
        """How many of them have played to the end, apart from those whose data were deleted."""
        return sum(person.game.stage == "end" for person in self._there)

    def sync(self) -> None:
        """Flush the log to the disk."""
        self._log.sync()

    def keep(self, pause: float = 0.0, ended_only: bool = False) -> None:
        """Write the record of every person who has acted, or ended a trial, since the last time.

        After each person it pauses some seconds, so that clicks are answered in between.

        Raises:
            StoreError: If it cannot be written; the log still has everything.
        """
        with self._keeping:
            for data in (REACTIONS, STRUCTURES):
                sweep(self.store.folder / data)
            written = False
            for person in self._there:
                if person.keep(self.store, ended_only):
                    written = True
                    time.sleep(pause)
            if written:
                self._declare()

    def _declare(self) -> None:
        """List in ``experiment.json`` the cells that there are."""
        cells = [person.cell for person in self._there if self.store.path(person.cell).exists()]
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


def _key(name: str) -> str:
    return hashlib.sha256(name.encode()).hexdigest()

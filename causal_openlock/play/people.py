"""All people who play in a folder: their sessions, the log of what they did, and their record.

A person is identified by a *session id*, drawn at random when they join and known to their browser
only. The log holds a hash of it, so that a reader of the folder cannot play in another person's
name. An identifier of a recruiting service, which others know, opens no game that has begun: who
joins again under it needs the session id, or is let in by the researcher (:meth:`People.readmit`).
Those who have finished cannot play again.

People are numbered in the order of joining; conditions are dealt out in shuffled blocks, so
that at any time every condition has as many people as any other, give or take one.

Every request that changes something carries the number of the turn that it is meant for. A request
that comes twice, too late or too early is refused and changes nothing.
"""

from __future__ import annotations

import hashlib
import math
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
from causal_openlock.files.validation import present
from causal_openlock.play.game import EXPERIMENT, Answer
from causal_openlock.play.log import Entry as LogEntry
from causal_openlock.play.log import Log, is_forgotten, is_join, is_return, is_turn
from causal_openlock.play.participant import Participant, delete_files
from causal_openlock.play.person import LABEL, LEARNER
from causal_openlock.play.recruiting import Recruited
from causal_openlock.play.refusals import (
    HasBegun,
    HasFinished,
    NotAgreed,
    OutOfTurn,
    TooManyPeople,
    UnknownPerson,
)
from causal_openlock.storage.store import Store
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
            as ``("PROLIFIC_PID", "STUDY_ID", "SESSION_ID")``. It is kept in ``recruited.jsonl``.
            The first of them identifies the person, and nobody joins without it.
        command: The command that continues, for the report.
        clock: Returns the time in seconds, and never goes back; by default the time of day when the
            folder was opened and, from then on, a clock that cannot be set.

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
        clock: Callable[[], float] | None = None,
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
        self.practice = practice
        self._clock, self._ahead = clock or _steady_clock(), 0.0
        self.ask, self.consent, self.recruiting = ask, consent, tuple(recruiting)
        self.consent_mark = digest(consent) if consent else ""
        self.store = Store(folder)
        self._people: dict[str, Participant] = {}
        self._order: list[Participant | None] = []  # None: their data were deleted
        self._readmitted: set[int] = set()
        self._joining, self._keeping = threading.Lock(), threading.Lock()
        # Loaded now, and not while a person waits for an answer.
        import pyarrow.parquet  # noqa: F401

        self.store.open(self.experiment, changed=False)
        with ExitStack() as opened:
            opened.callback(self.store.close)
            self._log = Log(self.store.folder / "log.jsonl")
            opened.callback(self._log.close)
            self._recruited = Recruited(self.store.folder, self.recruiting)
            opened.callback(self._recruited.close)
            if consent:
                write_text(self.store.folder / f"consent_{self.consent_mark}.md", consent)
            self._resume()
            self._declare()
            opened.pop_all()

    # -- what the page requests -----------------------------------------------------------------

    def join(
        self, agreed: str = "", recruited: Mapping[str, str] | None = None, name: str = ""
    ) -> str:
        """Add a person; returns their session id.

        Args:
            agreed: The ``consent_mark`` of the text that the person was shown and has agreed to.
            recruited: Identifiers that the recruiting service gives them.
            name: The session id that their browser has drawn, with which a call that is repeated
                joins once; by default one is drawn here.

        Raises:
            NotAgreed: If there is a consent, and they have agreed to none or to another one.
            NotIdentified: If an identifier is missing or cannot be one.
            HasBegun: If somebody has joined with the first identifier, under another session id.
            HasFinished: If that person has played to the end.
            TooManyPeople: If as many have joined as can.
            StoreError: If it cannot be written to the log.
        """
        if self.consent and agreed != self.consent_mark:
            raise NotAgreed("to join, one has to have agreed to the text that is shown now")
        given = self._recruited.identifiers(recruited or {})
        name = name or secrets.token_urlsafe(24)
        with self._joining:
            if _key(name) in self._people:  # the answer to the first call was lost
                return name
            before = self._recruited.number(given[self.recruiting[0]]) if given else None
            if before is not None and (known := self._order[before]):
                self._return(known, name)
                return name
            if len(self._order) >= MOST_PEOPLE:
                raise TooManyPeople("no more people can join")
            entry = present(
                {
                    "join": len(self._order),
                    "key": _key(name),
                    "at": self._now(),
                    "practice": self.practice,
                    "ask": self.ask or None,
                    "consent": self.consent_mark if self.consent else None,
                }
            )
            person = self._person(entry)
            self._log.append(entry)
            self._add(entry, person)
            # Not before the log: no other person may get a number that has an identifier.
            self._recruited.add(person.number, given)
        return name

    def readmit(self, identifier: str) -> None:
        """Let the next one who joins under a first identifier continue that person's game.

        Raises:
            StoreError: If nobody has joined under it.
        """
        number = self._recruited.number(identifier.strip())
        if number is None:
            raise StoreError(
                f"{self.store.folder} has nobody whose identifier is {identifier!r}; give one of "
                "recruited.jsonl, and the same --recruiting as before"
            )
        self._readmitted.add(number)

    def _return(self, person: Participant, name: str) -> None:
        """Give a person whom the researcher lets in another session id; the old one stays good."""
        with person.lock:
            if person.game.stage == "end":
                raise HasFinished("this person has played to the end, and cannot play again")
        if person.number not in self._readmitted:
            raise HasBegun(person.number)
        key = _key(name)
        entry = {"of": person.number, "key": key, "at": self._now()}
        if self.consent:
            entry["consent"] = self.consent_mark
        self._log.append(entry)
        self._readmitted.remove(person.number)
        self._people[key] = person

    def view(self, name: str) -> Answer:
        """State of a person's game that the person may know now.

        Raises:
            UnknownPerson: If there is no such session.
        """
        person = self._find(name)
        with person.lock:
            return person.game.view()

    def proceed(self, name: str, turn: int) -> Answer:
        """Let a person leave the practice room; refused as :meth:`act` is."""
        return self._turn(name, turn, {})

    def answer(self, name: str, turn: int, edges: list[list[int]]) -> Answer:
        """Take what a person says of a room; refused as :meth:`act` is."""
        return self._turn(name, turn, {"edges": edges})

    def act(self, name: str, turn: int, action: int, reaction: int | None) -> Answer:
        """Carry out a person's action, with its reaction time in milliseconds if the page sends it.

        Raises:
            UnknownPerson: If there is no such session.
            OutOfTurn: If this is not the turn, there is no such action, or the person has finished.
            StoreError: If it cannot be written to the log; nothing has changed then.
        """
        return self._turn(name, turn, {"action": action, "reaction": reaction})

    def _turn(self, name: str, turn: int, what: LogEntry) -> Answer:
        person = self._find(name)
        with person.lock:
            game = person.game
            if turn != game.turn or not person.allows(what):
                raise OutOfTurn(game.view())
            entry = {"of": person.number, "turn": turn, "at": self._now(), **what}
            self._log.append(entry)  # first it is on file, then it is done, then it is answered
            return person.take(entry)

    def _now(self) -> float:
        return self._clock() + self._ahead

    def _find(self, name: str) -> Participant:
        person = self._people.get(_key(name))
        if person is None:
            raise UnknownPerson("there is no such session")
        return person

    # -- joining and coming back ----------------------------------------------------------------

    def _person(self, entry: LogEntry) -> Participant:
        number = entry["join"]
        ask = entry.get("ask", False)
        return Participant(number, self._cell(number), entry["at"], entry["practice"], ask)

    def _add(self, entry: LogEntry, person: Participant) -> None:
        self._order.append(person)
        self._people[entry["key"]] = person

    def _cell(self, number: int) -> Cell:
        """Cell that a person plays; conditions come in shuffled blocks."""
        conditions = self.experiment.conditions
        subject, place = divmod(number, len(conditions))
        generator = np.random.default_rng([self.experiment.seed, subject])
        which = int(generator.permutation(len(conditions))[place])
        (entry,) = self.experiment.learners
        return Cell(EXPERIMENT, self.experiment.seed, entry, conditions[which], subject, 1)

    def _resume(self) -> None:
        """Repeat what the log holds."""
        identity = self.experiment.identity
        head, *entries = self._log.entries or [{"identity": identity}]
        if head.get("identity") != identity:
            raise StoreError(
                f"{self.store.folder} is of people who played other conditions, or with another "
                "protocol, seed or version; choose another folder"
            )
        if not self._log.entries:
            self._log.append(head)
        for number, entry in enumerate(entries, start=2):
            if is_join(entry) and entry["join"] == len(self._order) < MOST_PEOPLE:
                self._add(entry, self._person(entry))
                continue
            if is_forgotten(entry) and entry["join"] == len(self._order) < MOST_PEOPLE:
                self._order.append(None)
                continue
            known = (is_turn(entry) or is_return(entry)) and entry["of"] < len(self._order)
            person = self._order[entry["of"]] if known else None
            if person is None:
                raise self._log.fault(number, "this line is not an entry of a play")
            if "key" in entry:
                self._people[entry["key"]] = person
                continue
            if entry["turn"] != person.game.turn:
                raise self._log.fault(number, "a turn is missing before this one")
            if not person.allows(entry):
                raise self._log.fault(number, "this was not possible then")
            person.take(entry)
        # The time of day can have been set back while no server ran.
        last = max((entry["at"] for entry in entries if "at" in entry), default=-math.inf)
        self._ahead = max(0.0, last - self._clock())
        self._log.entries = []
        self._recruited.resume({person.number for person in self._there})
        for person in self._there:
            person.find_kept(self.store)

    @property
    def _there(self) -> list[Participant]:
        """People whose data have not been deleted."""
        return [person for person in self._order if person is not None]

    def forget(self, condition: str, subject: int) -> list[Path]:
        """Delete everything that one person did and said, and their identifiers; others stay.

        Returns the files that were deleted.

        Raises:
            StoreError: If there is no such person, or it cannot be written.
        """
        found = [
            person for person in self._there
            if (person.cell.condition.name, person.cell.first_subject) == (condition, subject)
        ]  # fmt: skip
        if not found:
            raise StoreError(f"{self.store.folder} has no person {subject} in {condition}")
        (person,) = found
        with self._keeping, self._joining:
            self._order[person.number] = None
            for key in [key for key, one in self._people.items() if one is person]:
                del self._people[key]
            self._declare()
            deleted = delete_files(self.store, person.cell.file_name)
            # The log last: the same command deletes what a killed one has left.
            self._recruited.forget(person.number)
            entries, _ = self._log.read()
            self._log.rewrite(_without(entries, person.number))
        return deleted

    # -- the record -----------------------------------------------------------------------------

    @property
    def number(self) -> int:
        """Number of people who have joined."""
        return len(self._order)

    @property
    def finished(self) -> int:
        """How many of them have played to the end, apart from those whose data were deleted."""
        return sum(person.game.stage == "end" for person in [*self._there])

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
        cells = [person.cell for person in self._there if person.kept_trials]
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
            self._recruited.close()
            self._log.close()
            self.store.close()


def _without(entries: Sequence[LogEntry], number: int) -> list[LogEntry]:
    """A log without one person, who leaves a number."""
    gone = {"join": number, "forgotten": True}
    return [
        gone if one.get("join") == number else one for one in entries if one.get("of") != number
    ]


def _steady_clock() -> Callable[[], float]:
    start = time.time() - time.monotonic()
    return lambda: start + time.monotonic()


def _key(name: str) -> str:
    return hashlib.sha256(name.encode()).hexdigest()

"""All people who play in a folder: their sessions, the log of what they did, and their record.

A person is identified by a *session id*, drawn at random when they join and known to their browser
only. The log holds a hash of it, so nobody who gets the folder can play in another's name. People
are numbered in the order of joining; conditions are dealt out in shuffled blocks, so that at any
time every condition has as many people as any other, give or take one.

Somebody who comes again under the same name of a recruiting service gets another session id of the
same person and goes on where they stopped. Those who have finished cannot play again.

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
from typing import TYPE_CHECKING

import numpy as np

from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.answers import FOLDER as STRUCTURES
from causal_openlock.experiment.answers import write_answers
from causal_openlock.experiment.experiment import Cell, Experiment, LearnerSpec
from causal_openlock.experiment.protocol import Condition, Protocol, plan
from causal_openlock.experiment.record import with_times
from causal_openlock.experiment.store import Store
from causal_openlock.files.atomic import sweep, write_text
from causal_openlock.play.game import EXPERIMENT, Answer, Game
from causal_openlock.play.log import Entry as LogEntry
from causal_openlock.play.log import Log, is_forgotten, is_join, is_name, is_return, is_turn
from causal_openlock.play.person import LABEL, LEARNER
from causal_openlock.play.reactions import FOLDER, reactions_table, rows_kept, write_reactions
from causal_openlock.world.rewards import PAPER_REWARD, find_reward

if TYPE_CHECKING:
    import pyarrow as pa

RECRUITED = "recruited.jsonl"
"""What a recruiting service calls people, by the number of joining."""
DATA = ("cells", FOLDER, STRUCTURES)
"""The folders that have a file for each person."""
MOST_PEOPLE = 10_000
"""How many people can join in one folder."""
MOST_RETURNS = 100
"""How often a person can come again without the session id that they had."""


class Refused(OpenLockError):  # noqa: N818 - an answer to the page
    """A request that changes nothing."""


class UnknownPerson(Refused):
    """There is no such session."""


class OutOfTurn(Refused):
    """The request is not meant for the turn that the person is at.

    Attributes:
        now: What the person may know now.
    """

    def __init__(self, now: Answer) -> None:
        super().__init__("this is not the turn that the session is at")
        self.now = now


class TooManyPeople(Refused):
    """Nobody else can join."""


class HasFinished(Refused):
    """Somebody would play again who has played to the end."""


class NotAgreed(Refused):
    """Somebody would join who has not agreed to the consent as it is now."""


class _Person:
    """A person: their number, their game, and when they joined."""

    def __init__(
        self, number: int, cell: Cell, joined: float, practice: bool, ask: bool = False
    ) -> None:
        self.number, self.cell, self.joined, self.returns = number, cell, joined, 0
        self.lock = threading.Lock()
        self.game = Game(
            cell.condition, cell.spec.protocol, cell.first_subject, cell.seed, practice, ask
        )
        # How many actions, ended trials and answers are in the files.
        self.kept = self.kept_trials = self.kept_answers = 0

    def take(self, turn: LogEntry) -> Answer:
        """Take a turn as it is in the log."""
        if "edges" in turn:
            return self.game.answer(turn["edges"], turn["at"] - self.joined)
        if "action" not in turn:
            return self.game.proceed()
        reaction = turn["reaction"]
        seconds = None if reaction is None else reaction / 1000
        return self.game.act(turn["action"], seconds, turn["at"] - self.joined)

    def record(self) -> pa.Table:
        """The trials that are over, with the times at which attempts really ended."""
        # The trial that a person is in, or has left for good, is no trial of the record.
        over = self.game.trials_over
        ends = [one.time for one in self.game.done if one.attempt_over and one.visit <= over]
        table = self.game.session.record().slice(0, len(ends))
        return with_times(table, ends)


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
        recruiting: What a recruiting service adds to the address of the page to say who comes, such
            as ``("PROLIFIC_PID", "STUDY_ID", "SESSION_ID")``. It is kept in ``recruited.jsonl``.
            The first of them says who is the same person.
        command: The command that continues, for the report.
        clock: Returns the time in seconds.

    Attributes:
        consent_mark: What the log calls the consent: a hash of its text; empty without one.

    Raises:
        StoreError: If the folder holds something else, is in use, damaged, or cannot be written to.
        ProtocolError: If a condition does not fit the protocol.
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
        entry = LearnerSpec(LABEL, LEARNER, {}, protocol, reward, subjects=1)
        self.experiment = Experiment(
            EXPERIMENT, "People", seed, 1, tuple(conditions), (entry,), command
        )
        self.practice, self._clock = practice, clock
        self.ask, self.consent, self.recruiting = ask, consent, tuple(recruiting)
        self.consent_mark = hashlib.sha256(consent.encode()).hexdigest()[:16] if consent else ""
        self.store = Store(folder)
        self._people: dict[str, _Person] = {}
        self._called: dict[str, _Person] = {}  # by what the recruiting service calls them
        self._order: list[_Person | None] = []  # None: their data were deleted
        self._joining, self._keeping = threading.Lock(), threading.Lock()
        # Loaded now, and not while somebody waits for an answer.
        import pyarrow.parquet  # noqa: F401

        self.store.open(self.experiment, changed=False)
        self._made_with = self.store.made_with()
        with ExitStack() as opened:
            opened.callback(self.store.close)
            self._log = Log(self.store.folder / "log.jsonl")
            opened.callback(self._log.close)
            called = self.store.folder / RECRUITED
            self._recruited = Log(called) if self.recruiting or called.exists() else None
            if self._recruited:
                opened.callback(self._recruited.close)
            if consent:
                write_text(self.store.folder / f"consent_{self.consent_mark}.md", consent)
            self._resume()
            self._declare()
            opened.pop_all()

    # -- what the page requests -----------------------------------------------------------------

    def join(self, agreed: str = "", recruited: Mapping[str, str] | None = None) -> str:
        """Add a person, or let one go on who came before, and return a session id of theirs.

        Args:
            agreed: The ``consent_mark`` of the text that the person was shown and has agreed to.
            recruited: What the recruiting service calls them.

        Raises:
            NotAgreed: If there is a consent, and they have agreed to none or to another one.
            HasFinished: If they have played to the end before.
            TooManyPeople: If nobody else can join.
            StoreError: If it cannot be written to the log.
        """
        if self.consent and agreed != self.consent_mark:
            raise NotAgreed("nobody joins without having agreed to the text that is shown now")
        told = {key: value for key, value in (recruited or {}).items() if key in self.recruiting}
        called = told.get(self.recruiting[0], "") if self.recruiting else ""
        name = secrets.token_urlsafe(24)
        with self._joining:
            if before := self._called.get(called):
                self._return(before, name)
                return name
            if len(self._order) >= MOST_PEOPLE:
                raise TooManyPeople("nobody else can join")
            entry = {
                "join": len(self._order),
                "key": _key(name),
                "at": self._clock(),
                "practice": self.practice,
                **({"ask": True} if self.ask else {}),
                **({"consent": self.consent_mark} if self.consent else {}),
            }
            person = self._person(entry)
            self._log.append(entry)
            self._add(entry, person)
            # Not before the log: nobody else may get a number that somebody is called by.
            if self._recruited is not None:
                self._recruited.append({"join": entry["join"], **told})
            if called:
                self._called[called] = person
        return name

    def _return(self, person: _Person, name: str) -> None:
        """Give a person a further session id; the one they had stays good."""
        with person.lock:
            if person.game.view()["stage"] == "end":
                raise HasFinished("this person has played to the end, and cannot play again")
        if person.returns >= MOST_RETURNS:
            raise TooManyPeople("this person has come again too often")
        entry = {"of": person.number, "key": _key(name), "at": self._clock()}
        if self.consent:
            entry["consent"] = self.consent_mark
        self._log.append(entry)
        self._known_again(entry, person)

    def _known_again(self, entry: LogEntry, person: _Person) -> None:
        person.returns += 1
        self._people[entry["key"]] = person

    def view(self, name: str) -> Answer:
        """What a person may know now.

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
        """Carry out a person's action, after so many milliseconds if the page sends them.

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
            if turn != game.turn or not _allows(game, what):
                raise OutOfTurn(game.view())
            entry = {"of": person.number, "turn": turn, "at": self._clock(), **what}
            self._log.append(entry)  # first it is on file, then it is done, then it is answered
            return person.take(entry)

    def _find(self, name: str) -> _Person:
        person = self._people.get(_key(name))
        if person is None:
            raise UnknownPerson("there is no such session")
        return person

    # -- joining and coming back ----------------------------------------------------------------

    def _person(self, entry: LogEntry) -> _Person:
        number = entry["join"]
        ask = entry.get("ask", False)
        return _Person(number, self._cell(number), entry["at"], entry["practice"], ask)

    def _add(self, entry: LogEntry, person: _Person) -> None:
        self._order.append(person)
        self._people[entry["key"]] = person

    def _cell(self, number: int) -> Cell:
        """What a person plays: conditions come in shuffled blocks."""
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
                raise self._log.fault(number, "this line is no entry of a play")
            if "key" in entry:
                self._known_again(entry, person)
                continue
            if entry["turn"] != person.game.turn:
                raise self._log.fault(number, "a turn is missing before this one")
            if not _allows(person.game, entry):
                raise self._log.fault(number, "this was not possible then")
            person.take(entry)
        self._log.entries = []
        if self._recruited is not None:
            self._take_names(self._recruited)
        for person in self._there:
            done, ended = len(person.game.done), person.game.trials_over
            file = person.cell.file_name
            whole = rows_kept(self.store.folder / FOLDER / file) == done
            if whole and (not ended or self.store.check(person.cell) is None):
                person.kept, person.kept_trials = done, ended

    def _take_names(self, recruited: Log) -> None:
        """What people are called; who is not in the log, or has been forgotten, is dropped."""
        for line, one in enumerate(recruited.entries, start=1):
            if not is_name(one):
                raise recruited.fault(line, "this line names nobody who plays")
        there = {person.number: person for person in self._there}
        kept = [one for one in recruited.entries if one["join"] in there]
        if len(kept) < len(recruited.entries):
            recruited.rewrite(kept)
        for one in kept:
            if self.recruiting and (called := one.get(self.recruiting[0])):
                self._called.setdefault(called, there[one["join"]])
        recruited.entries = []

    @property
    def _there(self) -> list[_Person]:
        """Those whose data have not been deleted."""
        return [person for person in self._order if person is not None]

    def forget(self, condition: str, subject: int) -> list[Path]:
        """Delete everything that one person did, said and is called by; others stay as they are.

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
            for known in (self._people, self._called):
                for key in [key for key, one in known.items() if one is person]:
                    del known[key]
            self._declare()
            deleted = delete_files(self.store, person.cell.file_name)
            # The log last: the same command deletes what a killed one has left.
            for log, mine in ((self._recruited, ""), (self._log, "join")):
                if log is not None:
                    entries, _ = log.read()
                    log.rewrite(_without(entries, person.number, mine))
        return deleted

    # -- the record -----------------------------------------------------------------------------

    @property
    def number(self) -> int:
        """How many have joined."""
        return len(self._order)

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
            folder = self.store.folder / FOLDER
            for data in (FOLDER, STRUCTURES):
                sweep(self.store.folder / data)
            written = False
            for person in self._there:
                with person.lock:
                    game = person.game
                    same = len(game.answers) == person.kept_answers
                    if len(game.done) == person.kept and same:
                        continue
                    if ended_only and game.trials_over == person.kept_trials and same:
                        continue
                    answers = list(game.answers)
                    done, record, trials = list(game.done), person.record(), game.trials_over
                cell = person.cell
                table = reactions_table(cell.condition.name, cell.first_subject, done)
                write_reactions(folder / cell.file_name, table)
                if answers:
                    positions = person.game.session.brief.positions
                    path = self.store.folder / STRUCTURES / cell.file_name
                    write_answers(path, answers, positions)
                if record.num_rows:
                    self.store.write(cell, record)
                person.kept_answers = len(answers)
                person.kept, person.kept_trials = len(done), trials
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
        self.store.declare(declared, cells, self.experiment.identity, self._made_with)

    def close(self) -> None:
        """Write the record and release the folder."""
        try:
            self.keep()
        finally:
            if self._recruited is not None:
                self._recruited.close()
            self._log.close()
            self.store.close()


def _allows(game: Game, what: LogEntry) -> bool:
    return game.allows_answer(what["edges"]) if "edges" in what else game.allows(what.get("action"))


def _without(entries: Sequence[LogEntry], number: int, join: str) -> list[LogEntry]:
    """A log without one person; in the log of what people do, they leave a number."""
    gone = {"join": number, "forgotten": True}
    return [
        gone if join and one.get("join") == number else one
        for one in entries
        if one.get("of") != number and (join or one.get("join") != number)
    ]


def delete_files(store: Store, name: str) -> list[Path]:
    """Delete the files of this name in all folders that have one for each person."""
    paths = [store.folder / folder / name for folder in DATA]
    there = [path for path in paths if path.exists()]
    for path in there:
        path.unlink()
    return there


def _key(name: str) -> str:
    return hashlib.sha256(name.encode()).hexdigest()

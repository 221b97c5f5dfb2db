"""Everybody who plays: who they are told apart by, what is on file, and the record made of it.

A person is known by a *session id*, drawn at random when they join and told to nobody else. The log
holds only a hash of it, so that a folder that is passed on lets nobody play in another's name.
Each person has a number, by the order of joining; conditions are dealt out in shuffled blocks, so
that at any time every condition has as many people as any other, give or take one.

Every call that changes something carries the number of the turn that it is meant for. A call that
comes twice, too late or too early is refused and changes nothing.
"""

from __future__ import annotations

import hashlib
import secrets
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.experiment import Cell, Experiment, LearnerSpec
from causal_openlock.experiment.protocol import Condition, Protocol, plan
from causal_openlock.experiment.store import Store
from causal_openlock.files.atomic import sweep
from causal_openlock.play.game import EXPERIMENT, Game, Told
from causal_openlock.play.log import Entry as LogEntry
from causal_openlock.play.log import Log, is_join, is_turn
from causal_openlock.play.person import LABEL, LEARNER
from causal_openlock.play.reactions import FOLDER, reactions_table, rows_kept, write_reactions
from causal_openlock.world.rewards import PAPER_REWARD, find_reward

if TYPE_CHECKING:
    import pyarrow as pa

MOST_PEOPLE = 10_000
"""How many people can join in one folder."""


class Refused(OpenLockError):  # noqa: N818 - the page is told, nobody is to blame
    """A call that changes nothing."""


class UnknownPerson(Refused):
    """There is no such session."""


class OutOfTurn(Refused):
    """The call is not meant for the turn that the person is at.

    Attributes:
        now: What the person may know now.
    """

    def __init__(self, now: Told) -> None:
        super().__init__("this is not the turn that the session is at")
        self.now = now


class FullHouse(Refused):
    """Nobody else can join."""


class _Person:
    """A person: a number, a game, and when they joined."""

    def __init__(self, number: int, cell: Cell, joined: float, practice: bool) -> None:
        self.number, self.cell, self.joined = number, cell, joined
        self.lock = threading.Lock()
        self.game = Game(
            cell.condition, cell.spec.protocol, cell.first_subject, cell.seed, practice
        )
        self.kept = self.kept_trials = 0  # how many actions and ended trials are in the files

    def take(self, turn: LogEntry) -> Told:
        """Take a turn as it is in the log."""
        if "action" not in turn:
            return self.game.proceed()
        reaction = turn["reaction"]
        seconds = None if reaction is None else reaction / 1000
        return self.game.act(turn["action"], seconds, turn["at"] - self.joined)

    def record(self) -> pa.Table:
        """The trials that are over, with the times at which attempts really ended."""
        import pyarrow as pa

        # A trial that somebody is in, or has left for good, has not come to anything yet.
        ends = [one for one in self.game.done if one.attempt_over]
        whole = [one for one in ends if one.visit <= self.game.trials_over]
        table = self.game.session.record().slice(0, len(whole))
        where = table.schema.get_field_index("wall_time")
        times = pa.array([one.time for one in whole], pa.float32())
        return table.set_column(where, table.schema.field(where), times)


class People:
    """All people who play in one results folder.

    Args:
        folder: Where their record is kept; what it holds already is gone on with.
        conditions: What is played; people are dealt among them.
        protocol: With what budgets.
        seed: Seed of rooms, of luck and of who plays which condition.
        practice: Whether people who join now begin with a practice room.
        command: What to type to go on, for the report.
        clock: Tells the seconds.

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
        self.store = Store(folder)
        self._people: dict[str, _Person] = {}
        self._order: list[_Person] = []
        self._joining, self._keeping = threading.Lock(), threading.Lock()
        # Loaded now, and not while somebody waits for an answer.
        import pyarrow.parquet  # noqa: F401

        self.store.open(self.experiment, changed=False)
        try:
            self._log = Log(self.store.folder / "log.jsonl")
            self._resume()
            self._declare()
        except BaseException:
            self.store.close()
            raise

    # -- what the page asks for -----------------------------------------------------------------

    def join(self) -> str:
        """A new person.

        Returns:
            The session id.

        Raises:
            FullHouse: If there are too many.
            StoreError: If it cannot be put on file.
        """
        name = secrets.token_urlsafe(24)
        with self._joining:
            if len(self._order) >= MOST_PEOPLE:
                raise FullHouse("nobody else can join")
            entry = {
                "join": len(self._order),
                "key": _key(name),
                "at": self._clock(),
                "practice": self.practice,
            }
            person = self._made(entry)
            self._log.append(entry)
            self._add(entry, person)
        return name

    def view(self, name: str) -> Told:
        """What a person may know now.

        Raises:
            UnknownPerson: If there is no such session.
        """
        person = self._find(name)
        with person.lock:
            return person.game.view()

    def proceed(self, name: str, turn: int) -> Told:
        """Let a person leave the practice room.

        Raises:
            UnknownPerson: If there is no such session.
            OutOfTurn: If this is not the turn, or there is nothing to leave.
            StoreError: If it cannot be put on file; nothing has changed then.
        """
        person = self._find(name)
        with person.lock:
            if turn != person.game.turn or person.game.stage != "practice":
                raise OutOfTurn(person.game.view())
            return self._take(person, {})

    def act(self, name: str, turn: int, action: int, reaction: int | None) -> Told:
        """Let a person act.

        Args:
            name: The session id.
            turn: The turn that the action is meant for.
            action: Its index.
            reaction: Milliseconds that the person took, if the page knows.

        Raises:
            UnknownPerson: If there is no such session.
            OutOfTurn: If this is not the turn, there is no such action, or the person has finished.
            StoreError: If it cannot be put on file; nothing has changed then.
        """
        person = self._find(name)
        with person.lock:
            game = person.game
            if turn != game.turn or not game.can_act or not 0 <= action < game.actions:
                raise OutOfTurn(game.view())
            return self._take(person, {"action": action, "reaction": reaction})

    def cell_of(self, name: str) -> Cell:
        """Under which condition and number a person is recorded.

        Raises:
            UnknownPerson: If there is no such session.
        """
        return self._find(name).cell

    def _take(self, person: _Person, what: LogEntry) -> Told:
        entry = {"of": person.number, "turn": person.game.turn, "at": self._clock(), **what}
        self._log.append(entry)  # first on file, then done, then answered
        return person.take(entry)

    def _find(self, name: str) -> _Person:
        person = self._people.get(_key(name))
        if person is None:
            raise UnknownPerson("there is no such session")
        return person

    # -- joining and coming back ----------------------------------------------------------------

    def _made(self, entry: LogEntry) -> _Person:
        number = entry["join"]
        return _Person(number, self._cell(number), entry["at"], entry["practice"])

    def _add(self, entry: LogEntry, person: _Person) -> None:
        self._order.append(person)
        self._people[entry["key"]] = person

    def _cell(self, number: int) -> Cell:
        """What the person of some number plays: conditions come in shuffled blocks."""
        conditions = self.experiment.conditions
        subject, place = divmod(number, len(conditions))
        generator = np.random.default_rng([self.experiment.seed, subject])
        which = int(generator.permutation(len(conditions))[place])
        (entry,) = self.experiment.learners
        return Cell(EXPERIMENT, self.experiment.seed, entry, conditions[which], subject, 1)

    def _resume(self) -> None:
        """Go through the log."""
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
                self._add(entry, self._made(entry))
                continue
            if not is_turn(entry) or entry["of"] >= len(self._order):
                raise self._log.fault(number, "this line is none of a play")
            game = self._order[entry["of"]].game
            if entry["turn"] != game.turn:
                raise self._log.fault(number, "a turn is missing before this one")
            can = game.can_act and entry["action"] < game.actions if "action" in entry else False
            if not (can or ("action" not in entry and game.stage == "practice")):
                raise self._log.fault(number, "nobody could do this then")
            self._order[entry["of"]].take(entry)
        self._log.entries = []
        for person in self._order:
            done, ended = len(person.game.done), person.game.trials_over
            file = person.cell.file_name
            whole = rows_kept(self.store.folder / FOLDER / file) == done
            if whole and (not ended or self.store.check(person.cell) is None):
                person.kept, person.kept_trials = done, ended

    # -- the record -----------------------------------------------------------------------------

    @property
    def number(self) -> int:
        """How many have joined."""
        return len(self._order)

    def sync(self) -> None:
        """See to it that the log is on the disk."""
        self._log.sync()

    def keep(self, pause: float = 0.0, ended_only: bool = False) -> None:
        """Write the record of whoever has acted since theirs was last written.

        Args:
            pause: Seconds to wait after each person, so that those who play do not notice.
            ended_only: Whether to wait with each person until they have ended a trial.

        Raises:
            StoreError: If it cannot be written; the log still has everything.
        """
        with self._keeping:
            folder = self.store.folder / FOLDER
            sweep(folder)
            written = 0
            for person in list(self._order):
                with person.lock:
                    game = person.game
                    if len(game.done) == person.kept:
                        continue
                    if ended_only and game.trials_over == person.kept_trials:
                        continue
                    done, record, trials = list(game.done), person.record(), game.trials_over
                cell = person.cell
                table = reactions_table(cell.condition.name, cell.first_subject, done)
                write_reactions(folder / cell.file_name, table)
                if record.num_rows:
                    self.store.write(cell, record)
                person.kept, person.kept_trials = len(done), trials
                written += 1
                time.sleep(pause)
            if written:
                self._declare()

    def _declare(self) -> None:
        """Say in ``experiment.json`` whose cells there are."""
        cells = [
            person.cell
            for person in sorted(self._order, key=lambda one: one.cell.name)
            if person.kept_trials
        ]
        many = max(1, *(cell.first_subject + 1 for cell in cells)) if cells else 1
        (spec,) = self.experiment.learners
        declared = replace(self.experiment, learners=(replace(spec, subjects=many),))
        self.store.declare(declared, cells, self.experiment.identity)

    def close(self) -> None:
        """Write the record and let others work in the folder."""
        try:
            self.keep()
        finally:
            self._log.close()
            self.store.close()


def _key(name: str) -> str:
    return hashlib.sha256(name.encode()).hexdigest()

"""One person who plays: their game, and its files."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING

from causal_openlock.experiment.beside_record import (
    REACTIONS,
    STRUCTURES,
    rows_kept,
    write_answers,
    write_reactions,
)
from causal_openlock.experiment.declare import Cell
from causal_openlock.experiment.record import with_times
from causal_openlock.play.game import Answer, Game
from causal_openlock.play.log import Entry
from causal_openlock.storage.store import Store

if TYPE_CHECKING:
    import pyarrow as pa

DATA = ("cells", REACTIONS, STRUCTURES)
"""The folders that have a file for each person."""


class Participant:
    """A person: their number, their game, and what is in the files.

    Attributes:
        lock: To be held while the game is used.
        kept_trials: How many trials that are over are in the files.
    """

    def __init__(
        self, number: int, cell: Cell, joined: float, practice: bool, ask: bool = False
    ) -> None:
        self.number, self.cell = number, cell
        self._joined = self._at = joined
        self._seconds = 0.0  # since the person joined
        self.lock = threading.Lock()
        self.game = Game(
            cell.condition, cell.spec.protocol, cell.first_subject, cell.seed, practice, ask
        )
        self.kept_trials = self._kept_actions = self._kept_answers = 0

    def allows(self, turn: Entry) -> bool:
        """Whether what is done in a turn is possible now."""
        if "edges" in turn:
            return self.game.allows_answer(turn["edges"])
        return self.game.allows(turn.get("action"))

    def take(self, turn: Entry) -> Answer:
        """Take a turn as it is in the log."""
        # A log of an earlier release has the time of day, which can have been set back: no time has
        # passed then.
        self._joined += min(0.0, turn["at"] - self._at)
        self._at = turn["at"]
        self._seconds = max(self._seconds, self._at - self._joined)
        if "edges" in turn:
            return self.game.answer(turn["edges"], self._seconds)
        if "action" not in turn:
            return self.game.proceed()
        reaction = turn["reaction"]
        seconds = None if reaction is None else reaction / 1000
        return self.game.act(turn["action"], seconds, self._seconds)

    def find_kept(self, store: Store) -> None:
        """Note what is in the files already, so that :meth:`keep` does not write it again."""
        done, ended = len(self.game.done), self.game.trials_over
        whole = rows_kept(store.folder / REACTIONS / self.cell.file_name) == done
        if whole and (not ended or store.check(self.cell) is None):
            self._kept_actions, self.kept_trials = done, ended

    def keep(self, store: Store, ended_only: bool) -> bool:
        """Write what they did since the last time, or only if a trial has ended; returns whether.

        Raises:
            StoreError: If it cannot be written.
        """
        with self.lock:
            game, cell = self.game, self.cell
            same = len(game.answers) == self._kept_answers
            if len(game.done) == self._kept_actions and same:
                return False
            if ended_only and game.trials_over == self.kept_trials and same:
                return False
            answers = list(game.answers)
            done, record, trials = list(game.done), self._record(), game.trials_over
        path = store.folder / REACTIONS / cell.file_name
        write_reactions(path, cell.condition.name, cell.first_subject, done)
        if answers:
            path = store.folder / STRUCTURES / cell.file_name
            write_answers(path, answers)
        if record.num_rows:
            store.write(cell, record)
        self._kept_answers = len(answers)
        self._kept_actions, self.kept_trials = len(done), trials
        return True

    def _record(self) -> pa.Table:
        """The trials that are over, with the times at which attempts really ended."""
        # The trial that a person is in, or has left for good, is no trial of the record.
        over = self.game.trials_over
        ends = [one.time for one in self.game.done if one.attempt_over and one.visit <= over]
        table = self.game.session.record().slice(0, len(ends))
        return with_times(table, ends)


def delete_files(store: Store, name: str) -> list[Path]:
    """Delete the files of this name in all folders that have a file for each person."""
    paths = [store.folder / folder / name for folder in DATA]
    there = [path for path in paths if path.exists()]
    for path in there:
        path.unlink()
    return there

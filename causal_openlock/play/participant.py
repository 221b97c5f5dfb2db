"""One person who plays: their game, and its files."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from causal_openlock.experiment.beside_record import (
    REACTIONS,
    STRUCTURES,
    write_answers,
    write_reactions,
)
from causal_openlock.experiment.declare import Cell
from causal_openlock.experiment.record import with_times
from causal_openlock.play.game import Answer, Game
from causal_openlock.play.log import Acted, Answered, Joined, Turn
from causal_openlock.storage.store import Store

if TYPE_CHECKING:
    import pyarrow as pa


class Participant:
    """A person: their number, their game, and what of it is in the files.

    Attributes:
        lock: To be held while the game is used.
    """

    def __init__(self, joined: Joined, cell: Cell) -> None:
        self.number, self.cell = joined.join, cell
        self._joined, self._seconds = joined.at, 0.0
        self.lock = threading.Lock()
        self.game = Game(cell, joined.practice, joined.ask)
        self._kept = 0, 0, 0  # trials, answers and actions that are in the files

    def allows(self, turn: Turn) -> bool:
        """Whether this is the turn that the person is at, and possible."""
        if turn.turn != self.game.turn:
            return False
        if isinstance(turn, Answered):
            return self.game.allows_answer(turn.edges)
        return self.game.allows(turn.action if isinstance(turn, Acted) else None)

    def take(self, turn: Turn) -> Answer:
        """Take a turn."""
        self._seconds = max(self._seconds, turn.at - self._joined)  # clocks are set back
        if isinstance(turn, Answered):
            return self.game.answer(turn.edges, self._seconds)
        if not isinstance(turn, Acted):
            return self.game.proceed()
        reaction = None if turn.reaction is None else turn.reaction / 1000
        return self.game.act(turn.action, reaction, self._seconds)

    def keep(self, store: Store, ended_only: bool) -> bool:
        """Write what they did since the last time, or only if a trial has ended; returns whether.

        Raises:
            StoreError: If it cannot be written.
        """
        with self.lock:
            game, cell = self.game, self.cell
            now = game.trials_over, len(game.answers), len(game.done)
            if now == self._kept or (ended_only and now[:2] == self._kept[:2]):
                return False
            done, answers, record = [*game.done], [*game.answers], self._record()
        path = store.folder / REACTIONS / cell.file_name
        write_reactions(path, cell.condition.name, cell.first_subject, done)
        if answers:
            write_answers(store.folder / STRUCTURES / cell.file_name, answers)
        if record.num_rows:
            store.write(cell, record)
        self._kept = now
        return True

    def _record(self) -> pa.Table:
        """The trials that are over, with the times at which attempts really ended."""
        # The trial that a person is in, or has left for good, is no trial of the record.
        over = self.game.trials_over
        ends = [one.time for one in self.game.done if one.attempt_over and one.visit <= over]
        return with_times(self.game.session.record().slice(0, len(ends)), ends)

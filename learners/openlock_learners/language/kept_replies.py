"""Cache of models' replies, by everything that they depend on, so that none is asked for twice.

A comparison that is repeated finds every reply here: it needs no server and gives the same, byte
for byte. One that was interrupted asks only for what is missing. The key of a reply is a hash of
the request (model, settings and transcript), of the subject's seed, whether or not that was sent,
and of how many answers the subject gave before; where the server is does not count.

The folder is the environment variable ``OPENLOCK_LLM_REPLAY``, by default
``~/.cache/causal_openlock/llm``. It holds files of lines of JSON, one for each process that asked;
a line that is damaged, or that a kill has cut off, is ignored. A transcript in a results folder has
the same lines, so ``OPENLOCK_LLM_REPLAY=results/transcripts`` repeats a comparison from its
results.

With ``OPENLOCK_LLM_BUDGET`` no attempt begins once the replies in the folder add up to this number
of tokens. A server that does not count tokens is an error then.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import secrets
from functools import cache
from pathlib import Path
from typing import Any

from causal_openlock.errors import NotAvailableError
from openlock_learners.language.offered_actions import plainly
from openlock_learners.language.reply import Reply, is_whole, plain

FOLDER, BUDGET = "OPENLOCK_LLM_REPLAY", "OPENLOCK_LLM_BUDGET"
"""Environment variables; not parameters, since results do not depend on them."""


def key_of(request: dict[str, Any], seed: int, number: int) -> str:
    """The key of a request; it holds no address and no secret.

    Args:
        request: The request.
        seed: The subject's.
        number: How many answers the subject gave before. A short memory can make a request come
            again, and it is another question then.
    """
    plain_request = {**request, "messages": [plainly(one) for one in request["messages"]]}
    text = json.dumps({"request": plain_request, "seed": seed, "number": number}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def replay() -> Replay:
    """The kept replies of the folder that the environment names, as they are now."""
    default = Path.home() / ".cache" / "causal_openlock" / "llm"
    kept = _replay(Path(os.environ.get(FOLDER) or default))
    kept.refresh()
    return kept


@cache
def _replay(folder: Path) -> Replay:
    return Replay(folder)


class Replay:
    """The kept replies in a folder; other processes may add to them at the same time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._replies: dict[str, Reply] = {}
        self._read: dict[Path, int] = {}
        self._own = folder / f"{secrets.token_hex(8)}.jsonl"

    def refresh(self) -> None:
        """Read what has been added since the last time.

        Raises:
            NotAvailableError: If a file cannot be read.
        """
        for path in sorted(self.folder.glob("*.jsonl")):
            try:
                self._read_on(path)
            except OSError as error:
                raise _not_possible(path, "read", error) from None

    def _read_on(self, path: Path) -> None:
        with path.open("rb") as file:
            file.seek(self._read.get(path, 0))
            for line in file:
                if not line.endswith(b"\n"):
                    break  # it is being written, or was cut off
                self._read[path] = self._read.get(path, 0) + len(line)
                self._take(line)

    def _take(self, line: bytes) -> None:
        try:
            kept = json.loads(line)
            key, reply = kept["key"], plain(kept["reply"])
            whole = isinstance(key, str) and is_whole(reply)
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError):
            return  # a line of another kind, or a damaged one
        if whole:
            self._replies.setdefault(key, reply)

    def get(self, key: str) -> Reply | None:
        """The reply to a request, if it was ever given."""
        return self._replies.get(key)

    def put(self, key: str, reply: Reply) -> None:
        """Keep a reply.

        Raises:
            NotAvailableError: If it cannot be written, or a budget is set and its tokens were not
                counted.
        """
        self._replies[key] = reply
        line = json.dumps({"key": key, "reply": reply}) + "\n"
        self.require_place()
        try:
            with self._own.open("ab") as file:
                file.write(line.encode())
        except OSError as error:
            raise _not_possible(self._own, "written", error) from None
        if _budget() is not None and not any(reply["tokens"]):
            raise NotAvailableError(
                f"{reply['server'] or 'the server'} does not say how many tokens it took, so no "
                f"budget can be kept; unset {BUDGET}"
            )

    def require_place(self) -> None:
        """Make sure that replies can be kept.

        Raises:
            NotAvailableError: If they cannot.
        """
        if (self.folder.parent / "experiment.json").exists():
            raise NotAvailableError(
                f"{self.folder} belongs to results, to which no replies are added, and one is "
                f"missing there; name a copy of it in {FOLDER}"
            )
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            if not os.access(self.folder, os.W_OK):
                raise PermissionError(errno.EACCES, "Permission denied")
        except OSError as error:
            raise _not_possible(self._own, "written", error) from None

    @property
    def spent(self) -> int:
        """The tokens of all kept replies and of what they answer."""
        return sum(sum(reply["tokens"]) for reply in self._replies.values())

    def require_budget(self) -> None:
        """Make sure that not all tokens are spent.

        Raises:
            NotAvailableError: If they are, or the budget is not a number.
        """
        if (budget := _budget()) is None:
            return
        self.refresh()
        if (spent := self.spent) >= budget:
            raise NotAvailableError(
                f"the budget is spent: {spent:,} of {budget:,} tokens ({BUDGET}); nothing is "
                "lost, set a larger one and give the same command again"
            )


def _budget() -> int | None:
    """The budget that is set, in tokens."""
    budget = os.environ.get(BUDGET)
    if not budget:
        return None
    if not (budget.isdecimal() and len(budget) < 19):
        raise NotAvailableError(f"{BUDGET} is a number of tokens, and this is {budget!r}")
    return int(budget)


def _not_possible(path: Path, what: str, error: OSError) -> NotAvailableError:
    return NotAvailableError(
        f"{path} cannot be {what} ({error.strerror}); name another folder in {FOLDER}"
    )

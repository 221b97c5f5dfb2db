"""Replies of models, kept by everything that they depend on, so that none is asked for twice.

A comparison that is repeated finds every reply here: it needs no server and gives the same, byte
for byte. One that was interrupted asks only for what is missing.

The folder is the environment variable ``OPENLOCK_LLM_REPLAY``, by default
``~/.cache/causal_openlock/llm``. It holds files of lines of JSON, one for each learner that asked;
a line that is damaged, or that a kill has cut off, is ignored. A transcript in a results folder has
the same lines, so ``OPENLOCK_LLM_REPLAY=results/transcripts`` repeats a comparison from its
results.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import Annotated, Any

from pydantic import BaseModel, Field, NonNegativeInt

from causal_openlock.errors import NotAvailableError

IN_WORDS = "name another server in base_url, or score by what it does in words (--draws 200)"
"""What to do where answers come without logprobs."""
FOLDER = "OPENLOCK_LLM_REPLAY"
"""Environment variable; not a parameter, since results do not depend on it."""
Request = dict[str, Any]
Reply = dict[str, Any]
"""The fields of :class:`_Reply`."""


class _Reply(BaseModel):
    message: dict[str, Any]
    finish: str | None
    model: str | None = None
    server: str | None = None
    fingerprint: str | None = None
    tokens: tuple[NonNegativeInt, NonNegativeInt]  # of the question, and of the answer
    latency: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    retries: NonNegativeInt = 0
    logprobs: dict[str, float] | None = Field(None, exclude_if=lambda given: given is None)


def checked(reply: Any) -> Reply:
    """A reply that anybody may have written, as valid Unicode and JSON.

    Raises:
        ValueError, TypeError, RecursionError: If it is not a reply.
    """
    text = json.dumps(reply, ensure_ascii=False, allow_nan=False).encode("utf-8", "replace")
    return _Reply.model_validate_json(text).model_dump(mode="json")


def key_of(request: Request, seed: int, number: int) -> str:
    """The key of a request of a subject with this seed, after a ``number`` of answers.

    It holds no address and no secret. The number tells equal requests apart, which a short memory
    can repeat.
    """
    text = json.dumps({"request": request, "seed": seed, "number": number}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


class Replies:
    """The replies in a folder as it is now, and those that a server adds; threads may ask.

    Args:
        connect: Finds the server, for the first reply that is missing; what it returns is asked.
    """

    def __init__(self, connect: Callable[[], Callable[[Request], Reply]]) -> None:
        self._connect, self._connecting = connect, Lock()
        self._ask: Callable[[Request], Reply] | None = None
        default = Path.home() / ".cache" / "causal_openlock" / "llm"
        self.folder = Path(os.environ.get(FOLDER) or default)
        self._own = self.folder / f"{secrets.token_hex(8)}.jsonl"
        self._kept: dict[str, Reply] = {}
        for path in sorted(self.folder.glob("*.jsonl")):
            for line in path.read_bytes().splitlines():
                # A line of another kind, or a damaged one, is passed over.
                with suppress(LookupError, TypeError, ValueError, RecursionError):
                    kept = json.loads(line)
                    self._kept.setdefault(str(kept["key"]), checked(kept["reply"]))

    def reply(self, key: str, request: Request, logprobs: bool = False) -> tuple[Reply, bool]:
        """The reply to a request, and whether it is one that was given before.

        Raises:
            NotAvailableError: If nobody gives one, or none with ``logprobs``, or it cannot be kept.
        """
        if key in self._kept:
            return self._kept[key], True
        with self._connecting:
            if self._ask is None:
                self._require_place()
                self._ask = self._connect()
        reply = self._ask(request)
        if logprobs and "logprobs" not in reply and reply["finish"] != "content_filter":
            raise NotAvailableError(f"{request['model']} answers without logprobs; {IN_WORDS}")
        self._kept[key] = reply
        line = json.dumps({"key": key, "reply": reply}) + "\n"
        with self._own.open("ab", buffering=0) as file:
            file.write(line.encode())  # at once, whichever threads do so too
        return reply, False

    def _require_place(self) -> None:
        """Make sure that what will be answered, and paid for, can be kept."""
        if (self.folder.parent / "experiment.json").exists():
            raise NotAvailableError(
                f"{self.folder} belongs to results, to which no replies are added, and one is "
                f"missing there; name a copy of it in {FOLDER}"
            )
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._own.touch()
        except OSError as error:
            raise NotAvailableError(
                f"{self._own} cannot be written ({error.strerror}); name another folder in {FOLDER}"
            ) from None

"""Requests to a server that has the OpenAI-compatible chat interface, hosted or local.

The package ``openai`` repeats a request after 408, 409, 429, 5xx and cut connections, with growing
pauses or after as long as the server asks for. Every request has a time limit as a whole, so that a
server that stalls, or sends a byte now and then, is asked again. No more requests are under way at
a time than the limit.

The key is ``OPENAI_API_KEY`` of the environment. It, and the organization, project and headers that
the environment names for the package, are sent only to the server that ``OPENAI_BASE_URL`` names,
by default OpenAI's: an experiment file can name any server, and may be from anybody. The key, and
what these headers say, is removed from everything that a server says, once it is decoded and before
it is shortened.
"""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

import httpx2
import openai

from causal_openlock.errors import NotAvailableError, in_short
from learners.language.reply import Reply, is_whole, plain, read_json

OPENAI = "https://api.openai.com/v1"
KEY, TRUSTED, HEADERS = "OPENAI_API_KEY", "OPENAI_BASE_URL", "OPENAI_CUSTOM_HEADERS"
SHORTEST_SECRET = 8
"""Characters from which on the value of a header is removed from what is said."""
_HINTS = {
    "tool": "tools: false",
    "seed": "send_seed: false",
    "temperature": "temperature: null",
    "response_format": "ask_structure: false",
}
"""What may help, by a word in the reason why a server refuses."""
_COUNTED = ("prompt", "completion")


LARGEST = 16 * 2**20
"""Bytes of a reply; no proper one has nearly so many."""


class _Client(openai.DefaultAsyncHttpxClient):
    """A client whose requests end in time, whatever has come by then, and whose replies are small.

    It goes where it is sent and nowhere else: a redirection is a refusal.
    """

    limit = 0.0

    async def send(self, request: Any, **kwargs: Any) -> Any:
        kwargs |= {"stream": True, "follow_redirects": False}
        try:
            async with asyncio.timeout(self.limit):
                reply = await super().send(request, **kwargs)
                try:
                    return await _whole(reply)
                finally:
                    await reply.aclose()
        except TimeoutError:
            raise httpx2.ReadTimeout("the time limit") from None  # which is asked again


async def _whole(reply: httpx2.Response) -> httpx2.Response:
    content = bytearray()
    async for part in reply.aiter_bytes():
        content += part
        if len(content) > LARGEST:
            raise httpx2.DecodingError("its reply is too large")
    # What it says of how it was packed is true no more.
    unpacked = ("content-encoding", "content-length", "content-type", "transfer-encoding")
    headers = [(name, value) for name, value in reply.headers.items() if name not in unpacked]
    return httpx2.Response(
        reply.status_code,
        headers=[*headers, ("content-type", "application/json")],
        content=bytes(content),
        request=reply.request,
    )


class Server:
    """A server that models are asked at.

    Args:
        base_url: Its address.
        seconds: The time limit of a request.
        retries: How often a request is repeated that fails.
        requests: How many are made at the same time.

    Raises:
        NotAvailableError: If there is no key for OpenAI's server.
    """

    def __init__(self, base_url: str, seconds: float, retries: int, requests: int) -> None:
        self.base_url = base_url
        trusted = _place(base_url) == _place(os.environ.get(TRUSTED) or OPENAI)
        self._key = os.environ.get(KEY, "").strip() if trusted else ""
        if not (self._key.isascii() and self._key.isprintable()):
            # The error of sending it would show it, with escapes.
            raise NotAvailableError(
                f"{KEY} in the environment is no key: it has unusual characters"
            )
        if _place(base_url) == _place(OPENAI) and not self._key:
            raise NotAvailableError(
                f"{base_url} asks for a key; set {KEY} in the environment, or name another server "
                "in base_url"
            )
        http = _Client()
        http.limit = seconds
        self._client = openai.AsyncOpenAI(
            api_key=self._key or "none",
            base_url=base_url,
            max_retries=retries,
            timeout=seconds,
            http_client=http,
        )
        if not trusted:
            self._client.organization = self._client.project = None
            self._client._custom_headers = {}  # OPENAI_CUSTOM_HEADERS; no argument leaves them out
        given = os.environ.get(HEADERS, "") if trusted else ""
        values = [line.partition(":")[2].strip() for line in given.splitlines()]
        self._secrets = [one for one in values if len(one) >= SHORTEST_SECRET]
        self._secrets += [self._key] if self._key else []
        self._free = asyncio.Semaphore(requests)

    async def ask(self, request: dict[str, Any], before: Callable[[], None] | None) -> Reply:
        """Make a request, as soon as fewer than the limit are under way.

        Args:
            request: What is asked.
            before: Called right before, when its turn has come, if it is anything.

        Raises:
            NotAvailableError: If the server refuses it, or fails however often it is asked.
        """
        async with self._free:
            if before is not None:
                before()
            began, text = time.perf_counter(), ""
            try:
                raw = await self._client.chat.completions.with_raw_response.create(**request)
                latency = time.perf_counter() - began
                text = raw.http_response.content.decode("utf-8", "replace")
                said = plain(read_json(text), self._secrets)
                choice, usage = said["choices"][0], said.get("usage") or {}
                reply = {
                    "message": dict(choice["message"]),
                    "finish": choice.get("finish_reason"),
                    "model": said.get("model"),
                    "server": plain(raw.headers.get("server"), self._secrets),
                    "fingerprint": said.get("system_fingerprint"),
                    "tokens": [int(usage.get(f"{of}_tokens") or 0) for of in _COUNTED],
                    "latency": round(latency, 3),
                    "retries": raw.retries_taken,
                }
                if not is_whole(reply):
                    raise ValueError("not of the right types")
                return reply
            except openai.APIStatusError as error:
                why = self._in_short(error)
                hints = [hint for word, hint in _HINTS.items() if word in why.lower()]
                hint = f"; perhaps it takes {hints[0]} among the parameters" if hints else ""
                raise self._failure(f"refuses ({why}){hint}") from None
            except openai.APITimeoutError:
                raise self._failure("did not answer in time") from None
            except openai.OpenAIError as error:
                cause = error.__cause__ or error
                why = self._in_short(cause) or type(cause).__name__
                raise self._failure(f"cannot be asked ({why})") from None
            except (
                LookupError,
                TypeError,
                ValueError,
                AttributeError,
                OverflowError,
                RecursionError,
            ):
                what = in_short(Exception(plain(text, self._secrets)[:100])) if text else "nothing"
                raise self._failure(f"gives no chat completion ({what})") from None

    async def close(self) -> None:
        """Close the connections."""
        await self._client.close()

    def _in_short(self, error: BaseException) -> str:
        return in_short(Exception(plain(str(error), self._secrets)))

    def _failure(self, what: str) -> NotAvailableError:
        again = "what was answered is kept, so give the same command again once that is fixed"
        return NotAvailableError(
            plain(f"the server at {self.base_url} {what}; {again}", self._secrets)
        )


def _place(url: str) -> tuple[str, str | None, int | None]:
    """Scheme, host and port of an address."""
    try:
        parts = urlsplit(url)
        return parts.scheme, parts.hostname, parts.port
    except ValueError:  # base_url was looked at before
        raise NotAvailableError(
            f"{TRUSTED} in the environment is no address: {url[:200]}"
        ) from None

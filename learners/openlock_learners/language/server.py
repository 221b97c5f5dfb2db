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
import json
import os
import re
import time
from collections.abc import Callable
from typing import Any
from urllib.parse import parse_qsl, urlsplit
from urllib.request import getproxies, proxy_bypass

import httpx2
import openai

from causal_openlock.errors import NotAvailableError, in_short
from openlock_learners.language.offered_actions import plainly
from openlock_learners.language.reply import Reply, is_whole, plain

OPENAI = "https://api.openai.com/v1"
KEY, TRUSTED, HEADERS = "OPENAI_API_KEY", "OPENAI_BASE_URL", "OPENAI_CUSTOM_HEADERS"
SHORTEST_SECRET = 8
"""Characters from which on the value of a header is removed from what is said."""
_HINTS = {
    r"context|too long|max_model_len": "recent: 20",
    r"\btools\b|tool[ _-](choice|use)|function calling": "tools: false",
    r"\bseed\b": "send_seed: false",
    r"temperature": "temperature: null",
    r"response_format": "ask_structure: false",
}
"""Settings that may help, by a pattern of the reason why a server refuses."""
_LOOPBACK = re.compile(r"localhost|127(\.\d{1,3}){3}|::1", re.ASCII)
_EXTRA = (400, 422)
"""Status codes of a server that refuses fields which it does not know."""
_COUNTED = ("prompt", "completion")
TRANSPORT: httpx2.AsyncBaseTransport | None = None
"""What carries requests; None for the network. Tests set an ``httpx2.MockTransport``."""
LARGEST = 16 * 2**20
"""The most bytes of a reply; proper ones are far smaller."""


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
        _status(reply.status_code, bytes(content)),
        headers=[*headers, ("content-type", "application/json")],
        content=bytes(content),
        request=reply.request,
    )


def _status(status: int, content: bytes) -> int:
    """The status of a reply: some servers say with 200 that they have failed."""
    if status != 200:
        return status
    try:
        said = json.loads(content)
    except (ValueError, RecursionError):
        return status
    if not isinstance(said, dict) or not said.get("error") or said.get("choices"):
        return status
    error = said["error"]
    code = error.get("code") if isinstance(error, dict) else None
    return code if type(code) is int and 400 <= code < 600 else 400


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not JSON")  # and could not be sent again


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
                f"{KEY} in the environment is not a key: it has unusual characters"
            )
        if _place(base_url) == _place(OPENAI) and not self._key:
            raise NotAvailableError(
                f"{base_url} asks for a key; set {KEY} in the environment, or name another server "
                "in base_url"
            )
        address, _, query = base_url.partition("?")
        self._through = _proxy_of(base_url)
        self._plainly = False  # whether it refuses what it gave
        try:
            # What runs on this machine is not asked through a proxy.
            local = _LOOPBACK.fullmatch(_place(base_url)[1] or "")
            http = _Client(trust_env=not local, transport=TRANSPORT)
        except (ImportError, ValueError) as error:
            raise NotAvailableError(
                f"{base_url} cannot be asked through the proxy that the environment names "
                f"({in_short(error)}); unset ALL_PROXY, HTTPS_PROXY and HTTP_PROXY, name the host "
                "in NO_PROXY, or for a SOCKS proxy install socksio"
            ) from None
        http.limit = seconds
        self._client = openai.AsyncOpenAI(
            api_key=self._key or "none",
            base_url=address,
            default_query=dict(parse_qsl(query)),
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
                raw = await self._asked(request)
                latency = time.perf_counter() - began
                text = raw.http_response.content.decode("utf-8", "replace")
                said = plain(json.loads(text, parse_constant=_refuse), self._secrets)
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
                if " - " not in why:  # the reason stands where the library does not look
                    why = f"{why} - {self._in_short(Exception(error.response.text[:200]))}"
                why = why.removesuffix(" - ")
                hints = [hint for words, hint in _HINTS.items() if re.search(words, why.lower())]
                hint = f"; perhaps it takes {hints[0]} among the parameters" if hints else ""
                if error.status_code in (404, 405) or "endpoint" in why.lower():
                    hint = self._other_address()
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
                hint = self._other_address() if "<" in what else ""
                raise self._failure(f"gives no chat completion ({what}){hint}") from None

    async def _asked(self, request: dict[str, Any]) -> Any:
        """The raw reply; messages are given back whole, unless the server refuses what it gave."""
        create = self._client.chat.completions.with_raw_response.create
        plain_request = {**request, "messages": [plainly(one) for one in request["messages"]]}
        if self._plainly or plain_request == request:
            return await create(**plain_request)
        try:
            return await create(**request)
        except openai.APIStatusError as error:
            if error.status_code not in _EXTRA:
                raise
            try:
                reply = await create(**plain_request)
            except openai.APIStatusError:
                raise error from None
            self._plainly = True
            return reply

    def _other_address(self) -> str:
        """A clause on the address, if it may be another one."""
        address = self.base_url.partition("?")[0].rstrip("/")
        if address.endswith("/v1"):
            return "; base_url is the address without /chat/completions: is it right?"
        return f"; perhaps base_url is {address}/v1"

    async def close(self) -> None:
        """Close the connections."""
        await self._client.close()

    def _in_short(self, error: BaseException) -> str:
        return in_short(Exception(plain(str(error), self._secrets)))

    def _failure(self, what: str) -> NotAvailableError:
        again = "what was answered is kept, so give the same command again once that is fixed"
        return NotAvailableError(
            plain(f"the server at {self.base_url}{self._through} {what}; {again}", self._secrets)
        )


def _proxy_of(url: str) -> str:
    """A clause on the proxy that the environment has for an address; empty for none."""
    scheme, host, _ = _place(url)
    known = getproxies()
    proxy = known.get(scheme) or known.get("all")
    if not proxy or not host or _LOOPBACK.fullmatch(host) or proxy_bypass(host):
        return ""
    return f" (through the proxy {proxy.rpartition('@')[2]} of the environment)"  # no password


def _place(url: str) -> tuple[str, str | None, int | None]:
    """Scheme, host and port of an address."""
    try:
        parts = urlsplit(url)
        return parts.scheme, parts.hostname, parts.port
    except ValueError:  # base_url was looked at before
        raise NotAvailableError(
            f"{TRUSTED} in the environment is not an address: {url[:200]}"
        ) from None

"""Requests to a server that has the OpenAI-compatible chat interface, by the package ``openai``.

The key is ``OPENAI_API_KEY`` of the environment. It, and the organization, project and headers that
the environment names for the package, are sent only to the server that ``OPENAI_BASE_URL`` names,
by default OpenAI's: an experiment file can name any server, and may be from anybody.
"""

from __future__ import annotations

import json
import os
import time
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import httpx2
import openai

from causal_openlock.errors import NotAvailableError, in_short
from openlock_learners.language.replies import IN_WORDS, Reply, Request, checked

OPENAI = "https://api.openai.com/v1"
KEY, TRUSTED = "OPENAI_API_KEY", "OPENAI_BASE_URL"
FILTERED = ("content_filter", "content_policy_violation", "data_inspection_failed")
"""Error codes of a server that refuses a conversation for what it says."""


class Server:
    """A server that models are asked at; threads may use it at the same time."""

    def __init__(self, base_url: str, seconds: float, retries: int) -> None:
        self.base_url = base_url
        trusted = urlsplit(base_url)[:2] == urlsplit(os.environ.get(TRUSTED) or OPENAI)[:2]
        self._key = os.environ.get(KEY, "").strip() if trusted else ""
        missing = not self._key and urlsplit(base_url)[:2] == urlsplit(OPENAI)[:2]
        if missing or not (self._key.isascii() and self._key.isprintable()):
            raise NotAvailableError(
                f"{KEY} in the environment is not a key that {base_url} could take; set it, or "
                "name another server in base_url"
            )
        address, _, query = base_url.partition("?")
        self._client = openai.OpenAI(
            api_key=self._key or "none",
            base_url=address,
            default_query=dict(parse_qsl(query)),
            max_retries=retries,
            timeout=seconds,
        )
        if not trusted:
            self._client.organization = self._client.project = None
            self._client._custom_headers = {}  # OPENAI_CUSTOM_HEADERS; no argument leaves them out

    def ask(self, request: Request) -> Reply:
        """Make a request.

        Raises:
            NotAvailableError: If the server refuses it, or fails however often it is asked.
        """
        began, text = time.perf_counter(), ""
        try:
            response = self._client.post(  # chat.completions.create walks over the conversation
                "/chat/completions",
                body=request,
                cast_to=httpx2.Response,
                options={"follow_redirects": False},
            )
            text = response.text
            said = json.loads(text)
            choice = said["choices"][0]
            reply = {
                "message": choice["message"],
                "finish": choice.get("finish_reason"),
                "model": said.get("model"),
                "server": response.headers.get("server"),
                "fingerprint": said.get("system_fingerprint"),
                "tokens": tokens_of(said.get("usage") or {}),
                "latency": round(time.perf_counter() - began, 3),
                "retries": int(response.request.headers.get("x-stainless-retry-count", 0)),
                "logprobs": first_logprobs(choice.get("logprobs")),
            }
            return checked(reply)
        except openai.APIStatusError as error:
            if error.code not in FILTERED:
                raise self._failure(f"refuses ({in_short(error)})") from None
            refusal = {"message": {"refusal": in_short(error)}, "finish": "content_filter"}
            latency = round(time.perf_counter() - began, 3)
            return checked({**refusal, "tokens": [0, 0], "latency": latency})
        except openai.APITimeoutError:
            raise self._failure("did not answer in time") from None
        except openai.OpenAIError as error:
            why = in_short(error.__cause__ or error)
            raise self._failure(f"cannot be asked ({why})") from None
        except (LookupError, TypeError, ValueError, AttributeError, OverflowError, RecursionError):
            what = in_short(Exception(text[:200])) or "nothing"
            raise self._failure(f"gives no chat completion ({what})") from None

    def _failure(self, what: str) -> NotAvailableError:
        again = "what was answered is kept, so give the same command again once that is fixed"
        again = IN_WORDS if "logprobs" in what else again
        told = f"the server at {self.base_url} {what}; {again}"
        return NotAvailableError(told.replace(self._key, "[key]") if self._key else told)


def first_logprobs(given: Any) -> dict[str, float] | None:
    """Log-probabilities of the likeliest first tokens of an answer; None if a server gives none."""
    try:
        likeliest = given["content"][0]["top_logprobs"]
        return {str(one["token"]): max(float(one["logprob"]), -1e4) for one in likeliest} or None
    except (LookupError, TypeError, ValueError):
        return None


def tokens_of(usage: dict[str, Any]) -> tuple[int, int]:
    """Tokens of a question and of its answer; thoughts may be counted in the total alone.

    >>> tokens_of({"prompt_tokens": 100, "completion_tokens": 5, "total_tokens": 1105})
    (100, 1005)
    """
    parts = ("prompt_tokens", "completion_tokens", "total_tokens")
    question, answer, total = (int(usage.get(part) or 0) for part in parts)
    question = question or max(total - answer, 0)
    return question, max(answer, total - question)

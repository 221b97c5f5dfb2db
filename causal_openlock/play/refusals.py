"""Requests that are refused: what the page shows, and what the researcher is told."""

from __future__ import annotations

from typing import Any

from causal_openlock.errors import OpenLockError


class Refused(OpenLockError):  # noqa: N818 - an answer to the page
    """A request that changes nothing.

    Args:
        status: Its status in HTTP.
        title: What the page shows, as a heading.
        why: What the page shows below.
        advice: What the researcher is told; empty where there is nothing for them to do.
        now: For a request that is not meant for the turn that the person is at: what they may know
            now.
    """

    def __init__(
        self, status: int, title: str, why: str, advice: str = "", now: dict[str, Any] | None = None
    ) -> None:
        super().__init__(why)
        self.status, self.title, self.advice, self.now = status, title, advice, now

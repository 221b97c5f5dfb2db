"""A function that is called at each look at a comparison, of which there are many."""

from __future__ import annotations

from collections.abc import Callable

import pytest


class _Watching:
    def __init__(self, look: Callable[..., None]) -> None:
        self.look = look

    def __call__(self, name: str) -> _Watching:
        return self

    def __enter__(self) -> Callable[..., None]:
        return self.look

    def __exit__(self, *_: object) -> None: ...


def look_often(patches: pytest.MonkeyPatch, look: Callable[..., None]) -> None:
    """Have a function called while a comparison runs, and after each of its cells."""
    patches.setattr("causal_openlock.comparison.comparing.shown_here", _Watching(look))
    patches.setattr("causal_openlock.running.workers.LOOK_EVERY", 0.0)

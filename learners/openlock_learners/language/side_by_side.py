"""Work that waits, side by side: an event loop in a thread of its own.

A learner is called from outside any event loop, or, in a notebook, from inside one; so it has its
own.
"""

from __future__ import annotations

import asyncio
import threading
import weakref
from collections.abc import Callable, Coroutine, Sequence
from typing import Any, TypeVar

T = TypeVar("T")


def _go(
    loop: asyncio.AbstractEventLoop, ends: list[Callable[[], Coroutine[Any, Any, None]]]
) -> None:
    loop.run_forever()
    for end in ends:
        loop.run_until_complete(end())
    loop.close()


class SideBySide:
    """An event loop that ends with this object."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self.at_the_end: list[Callable[[], Coroutine[Any, Any, None]]] = []
        """Work to do when the loop ends, such as closing connections."""
        threading.Thread(target=_go, args=(self._loop, self.at_the_end), daemon=True).start()
        weakref.finalize(self, self._loop.call_soon_threadsafe, self._loop.stop)

    def run(self, work: Sequence[Coroutine[Any, Any, T]]) -> list[T]:
        """The results of all, once all have ended; the first error, if any failed."""

        async def everything() -> list[T | BaseException]:
            return await asyncio.gather(*work, return_exceptions=True)

        waiting = asyncio.run_coroutine_threadsafe(everything(), self._loop)
        try:
            ended = waiting.result()
        except BaseException:  # such as an interrupt
            waiting.cancel()
            raise
        results: list[T] = []
        for one in ended:
            if isinstance(one, BaseException):
                raise one
            results.append(one)
        return results

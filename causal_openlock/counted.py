"""How many of what, in words."""

from __future__ import annotations


def counted(number: int, one: str, many: str | None = None) -> str:
    """A number and its noun: ``1 attempt``, ``2,000 attempts``.

    Args:
        number: How many.
        one: The noun for one.
        many: The noun for any other number; by default that for one with an s.
    """
    return f"{number:,} {one if number == 1 else many or f'{one}s'}"


__all__ = ["counted"]

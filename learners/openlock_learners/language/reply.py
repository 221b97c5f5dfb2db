"""A reply: what a server said, once it is read, checked, and free of secrets.

What comes from a server, and what is kept of it in a folder of anybody's, is looked at in the same
way before it is used.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

Reply = dict[str, Any]
"""An answer: ``message``, ``finish``, ``model``, ``server``, ``fingerprint``, ``tokens``,
``latency`` and ``retries``."""

LONG = 6000
"""Characters of a conversation from which on a cut is looked for: about 1,500 tokens."""
DEEPEST = 100
"""Levels of nesting. Far fewer are in any proper reply, and what copies and writes one recurses."""


def plain(value: Any, secrets: Sequence[str] = (), levels: int = DEEPEST) -> Any:
    """Prepare a server's data for storage and for sending: no secrets, valid Unicode only.

    Raises:
        ValueError: If it is nested more deeply than that.
    """
    if isinstance(value, str):
        text = value.encode("utf-8", "replace").decode()
        for secret in secrets:
            text = text.replace(secret, "[key]")
        return text
    if not isinstance(value, (dict, list)):
        return value
    if not levels:
        raise ValueError("nested too deeply")
    if isinstance(value, list):
        return [plain(one, secrets, levels - 1) for one in value]
    return {plain(name, secrets): plain(one, secrets, levels - 1) for name, one in value.items()}


def was_cut(sizes: Sequence[tuple[int, int]]) -> bool:
    """Whether a server seems to have cut off its prompts, without a word.

    Tokens grow with the text. Where a much longer text is counted as hardly more tokens, a part of
    it was not read. Servers that count only what is new, and not what they remember, count few
    tokens of each; that does not count as a cut.

    >>> was_cut([(2000, 500), (9000, 1000), (18000, 1000)]), was_cut([(2000, 500), (18000, 4400)])
    (True, False)
    >>> was_cut([(2000, 500), (9000, 40), (18000, 35)])
    False

    Args:
        sizes: Of each request in succession, its characters and the tokens of its prompt.
    """
    most = max((tokens for _, tokens in sizes), default=0)
    characters, tokens = max(sizes, default=(0, 0))
    if characters < LONG or tokens < 0.7 * most or not tokens:
        return False
    # Of a short prompt that was read, a token has a few characters; otherwise nothing is counted.
    whole = [(size, own) for size, own in sizes if size <= 0.6 * characters and size <= 10 * own]
    return any(own >= 0.9 * tokens for _, own in whole)


def is_whole(reply: Reply) -> bool:
    """Whether all that is read of a reply is there, and of its type: anybody may have written it.

    Raises:
        KeyError, TypeError, ValueError, OverflowError: If it is not.
    """
    prompt, completion = reply["tokens"]
    latency, finish = reply["latency"], reply["finish"]
    return (
        isinstance(reply["message"], dict)
        and all(type(many) is int and many >= 0 for many in (prompt, completion))
        and (finish is None or isinstance(finish, str))
        and type(latency) in (int, float)
        and math.isfinite(latency)
    )

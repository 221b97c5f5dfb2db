"""A reply: what a server said, once it is read, checked, and free of secrets.

What comes from a server, and what is kept of it in a folder of anybody's, is looked at in the same
way before it is used.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

Reply = dict[str, Any]
"""What was answered: ``message``, ``finish``, ``model``, ``server``, ``fingerprint``, ``tokens``,
``latency`` and ``retries``."""

DEEPEST = 100
"""Levels of nesting. Far fewer are in any proper reply, and what copies and writes one recurses."""


def plain(value: Any, secrets: Sequence[str] = (), levels: int = DEEPEST) -> Any:
    """What a server said, as it can be kept and sent on: without secrets, in valid Unicode.

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


def read_json(text: str | bytes) -> Any:
    """The content of a JSON text; what is no number there, such as NaN, is a fault.

    Raises:
        ValueError, RecursionError: If it is none.
    """

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


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

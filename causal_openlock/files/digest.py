"""A short hash that identifies contents: code that was run, a consent that was read, a claim."""

from __future__ import annotations

import hashlib


def digest(content: bytes | str) -> str:
    """The first 16 hexadecimal digits of the SHA-256 of a content; a text is taken as UTF-8.

    >>> digest("the same"), digest(b"the same")
    ('fa0487f2dc91544a', 'fa0487f2dc91544a')
    """
    whole = content if isinstance(content, bytes) else content.encode()
    return hashlib.sha256(whole).hexdigest()[:16]

"""Text of a file that somebody else wrote: UTF-8, with or without the mark that Windows puts first.

What is in another encoding is refused with its name, never guessed at: a wrong guess changes names.
"""

from __future__ import annotations

_MARKS = {b"\xff\xfe\0\0": "UTF-32", b"\xff\xfe": "UTF-16", b"\xfe\xff": "UTF-16"}
"""Byte order marks of other encodings; Excel's "Unicode text" is UTF-16."""


def decoded(content: bytes) -> str:
    r"""The text of a file, without a byte order mark.

    >>> decoded(b"\xef\xbb\xbfname: CC3")
    'name: CC3'

    Raises:
        UnicodeDecodeError: If it is not UTF-8; its ``reason`` is for people.
    """
    for mark, other in _MARKS.items():
        if content.startswith(mark):
            raise UnicodeDecodeError("utf-8", content, 0, len(mark), f"it is {other}")
    return content.decode("utf-8").removeprefix("\ufeff")

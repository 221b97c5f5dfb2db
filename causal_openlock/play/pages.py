"""What the page is told: a text in Markdown, the geometry of rooms, and where people go at the end.

The address that people type is checked here as well.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any
from urllib.parse import quote

from pydantic import HttpUrl, ValidationError

from causal_openlock.errors import OpenLockError
from causal_openlock.files.validation import adapter
from causal_openlock.physics.geometry import BAR_LENGTH, BAR_WIDTH, DOOR_SWING, HANDLE, RoomGeometry
from causal_openlock.world.facts import room_facts
from causal_openlock.world.room import position_names


def as_html(markdown: str) -> str:
    r"""A text in Markdown as HTML; what is HTML in it already is shown as it is written.

    >>> as_html("*Yes* & <b>")
    '<p><em>Yes</em> &amp; &lt;b&gt;</p>\n'
    """
    from markdown_it import MarkdownIt

    html: str = MarkdownIt("commonmark", {"html": False}).render(markdown)
    return html


def geometry(positions: int) -> dict[str, Any]:
    """Geometry of a room of some size, as the page needs it; it holds nothing latent.

    See :class:`~causal_openlock.physics.geometry.RoomGeometry`.
    """
    facts = room_facts()
    return {
        **asdict(RoomGeometry.of(positions)),
        "names": [_in_words(name) for name in position_names(positions)],
        "bar_length": BAR_LENGTH,
        "bar_width": BAR_WIDTH,
        "track_width": facts["track"]["width"],
        "button_side": facts["button"]["side"],
        "swing": DOOR_SWING,
        "handle": HANDLE,
    }


def _in_words(name: str) -> str:
    """``UPPERRIGHT`` in words: ``upper right``."""
    if not name.isalpha():
        return f"number {int(name[1:]) + 1}"
    return re.sub(r"^(upper|lower)\B", r"\1 ", name.lower())


def completion(address: str, names: Sequence[str]) -> str:
    """The address of the page of completion, if it is one.

    Raises:
        OpenLockError: If it is not, or has a placeholder that no identifier fills in.
    """
    example = filled(address, dict.fromkeys(names, "x"))
    if address and not _web_page(example):
        raise OpenLockError(
            f"{address!r} is not an address of a page; give one such as "
            "https://app.prolific.com/submissions/complete?cc=C0DE"
        )
    if left := re.search(r"[{}<>]|%(?![0-9a-fA-F]{2})\w*%?", example):
        raise OpenLockError(
            f"--completion {address} has {left[0]}, which nothing fills in; %NAME% is filled in "
            "with the identifier NAME of --recruiting, and a percent sign is written %25"
        )
    return address


def filled(address: str, identifiers: Mapping[str, str]) -> str:
    """An address with a person's identifiers in the place of their names.

    >>> filled("https://a.org/?code=%PID%", {"PID": "a&b"})
    'https://a.org/?code=a%26b'
    """
    for name, value in identifiers.items():
        address = address.replace(f"%{name}%", quote(value, safe=""))
    return address


def public_address(address: str) -> str:
    """An address that people can type, with a slash at its end; empty without one.

    Raises:
        OpenLockError: If it is not the address of a whole server.

    >>> public_address("https://Study.example.org")
    'https://study.example.org/'
    """
    url = _web_page(address)
    whole = url and url.path == "/" and not (url.query or url.fragment or url.username)
    if address and not whole:
        raise OpenLockError(
            f"{address!r} is not an address of a server; give one such as "
            "https://study.example.org, without a path: the page needs a host name of its own"
        )
    return str(url or "")


def _web_page(address: str) -> HttpUrl | None:
    """An address of a page; None if it is not one."""
    try:
        url: HttpUrl = adapter(HttpUrl).validate_python(address)
    except ValidationError:
        return None
    return url

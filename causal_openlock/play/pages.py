"""What the page is told: a text in Markdown, and the geometry of the room that it draws."""

from __future__ import annotations

from dataclasses import asdict
from functools import cache
from typing import Any

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


@cache
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
    for start in ("UPPER", "LOWER"):
        if name.startswith(start) and name != start:
            return f"{start} {name.removeprefix(start)}".lower()
    return name.lower() if name.isalpha() else f"number {int(name[1:]) + 1}"

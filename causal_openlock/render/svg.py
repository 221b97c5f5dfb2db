"""A room as SVG, for papers: the same shapes as in pixels, each part in a group of its own.

The groups are named (``lever_UPPER``, ``door``, ``arm``, ``button``), so that a figure can be
changed in any editor. Equal rooms give equal files.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from xml.sax.saxutils import escape, quoteattr

from causal_openlock.render.panel import BACKGROUND, HEIGHT, WIDTH, Label, Panel
from causal_openlock.render.scene import OUTLINE, Colour, Look, Shape, colour, frame
from causal_openlock.world.room import position_names

UNIT = 100
"""Units of the SVG's own coordinates in an arm link."""
INCHES = 3.3
"""Height of the figure."""


def room_svg(look: Look, panel: Panel | None = None, title: str = "An OpenLock room") -> str:
    """A room as an SVG file, with a console if there is one; the title is its description."""
    shown = frame(look.positions, UNIT)
    high = UNIT * UNIT / shown.scale  # of the room, in the SVG's units
    wide = high * shown.width / shown.height
    stretch = high / (HEIGHT * UNIT)
    whole = wide + (WIDTH * UNIT * stretch if panel else 0.0)
    names = position_names(look.positions)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_n(whole)} {_n(high)}" '
        f'width="{_n(INCHES * whole / high)}in" height="{_n(INCHES)}in" role="img">',
        f"<title>{escape(title)}</title>",
        f'<rect width="{_n(whole)}" height="{_n(high)}" fill="{_hex(colour("background"))}"/>',
    ]
    origin = -shown.left * UNIT, shown.top * UNIT
    for part, shapes in look.shapes().items():
        kind, _, place = part.partition(" ")
        name = f"{kind}_{names[int(place)]}" if place else kind
        lines += _group(name, _shapes(shapes, origin))
    if panel is not None:
        shapes, labels = panel.layout()
        body = [f'<rect width="{WIDTH * UNIT:g}" height="{HEIGHT * UNIT:g}" '
                f'fill="{_hex(BACKGROUND)}"/>']  # fmt: skip
        body += _shapes(shapes, (0.0, HEIGHT * UNIT))
        body += map(_label, labels)
        moved = f' transform="translate({_n(wide)} 0) scale({_n(stretch, 5)})"'
        lines += _group("console", body, moved)
    return "\n".join([*lines, "</svg>", ""])


def _group(name: str, body: Iterable[str], more: str = "") -> Iterator[str]:
    yield f"<g id={quoteattr(name)}{more}>"
    yield from (f"  {line}" for line in body)
    yield "</g>"


def _shapes(shapes: Iterable[Shape], origin: tuple[float, float]) -> Iterator[str]:
    for shape in shapes:
        x, y = origin[0] + shape.x * UNIT, origin[1] - shape.y * UNIT
        length, width = shape.length * UNIT, shape.width * UNIT
        style = f'fill="{_hex(shape.fill)}"'
        if shape.line:
            style += f' stroke="{_hex(OUTLINE)}" stroke-width="{_n(shape.line * UNIT)}"'
        if shape.corner == shape.length:
            yield f'<circle cx="{_n(x)}" cy="{_n(y)}" r="{_n(length)}" {style}/>'
            continue
        rounded = f' rx="{_n(shape.corner * UNIT)}"' if shape.corner else ""
        turned = -math.degrees(shape.angle)
        turn = f' transform="rotate({_n(turned)} {_n(x)} {_n(y)})"' if turned else ""
        yield (
            f'<rect x="{_n(x - length)}" y="{_n(y - width)}" width="{_n(2 * length)}" '
            f'height="{_n(2 * width)}"{rounded}{turn} {style}/>'
        )


def _label(label: Label) -> str:
    weight = ' font-weight="bold"' if label.bold else ""
    return (
        f'<text x="{_n(label.x * UNIT)}" y="{_n((HEIGHT - label.y) * UNIT)}" '
        f'font-family="DejaVu Sans, Verdana, sans-serif" '
        f'font-size="{_n(label.height * UNIT)}"{weight} fill="{_hex(label.colour)}">'
        f"{escape(label.text)}</text>"
    )


def _n(number: float, digits: int = 2) -> str:
    """A number, short and never ``-0``."""
    return f"{round(number, digits) + 0.0:.{digits}f}".rstrip("0").rstrip(".")


def _hex(rgb: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*rgb)

"""``causal-openlock room``: a room as a figure."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from causal_openlock.cli.options import PictureSize


def room(
    schema: Annotated[str, typer.Argument(help="Name of a schema, or path of a file.")],
    layout: Annotated[
        str | None, typer.Option(help="Where its levers stand, such as trial7.")
    ] = None,
    after: Annotated[
        list[str] | None,
        typer.Option("--after", "-a", help="Do this first, such as push_UPPER; one or more times."),
    ] = None,
    part: Annotated[
        float,
        typer.Option(min=0.0, max=1.0, help="How much of the last movement is done."),
    ] = 1.0,
    size: PictureSize = 600,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Picture to write (SVG or PNG).")
    ] = None,
) -> None:
    """Draw a room as in the paper's Figure 2: at first, or after or amid some actions."""
    from causal_openlock.cli.terminal import say
    from causal_openlock.errors import LayoutError
    from causal_openlock.formats.schema_file import find_schema
    from causal_openlock.render.room import look_after, save_still
    from causal_openlock.wording import nearest
    from causal_openlock.world.room import (
        Layout,
        Room,
        action_names,
        positions_for,
        published_layouts,
    )

    found = find_schema(schema)
    published = published_layouts(found)
    if layout is None:
        places = Layout(tuple(range(len(found.levers))), positions_for(found))
        chosen = Room.of(found, published[0] if published else places)
    else:
        chosen = Room.of(found, layout)
    names = action_names(chosen.positions)
    for name in after or []:
        if name not in names:
            raise LayoutError(f"there is no action {name!r}; {nearest(name, names)}")
    path = out or Path(f"room_{found.name}.svg")
    actions = [names.index(name) for name in after or []]
    title = ", ".join([f"{found.name} in {chosen.layout.name}", *(after or [])])
    save_still(look_after(chosen, actions, part), path, size, title=title)
    say(f"{path} written")

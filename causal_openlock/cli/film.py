"""``causal-openlock film`` and ``room``: a learner's trial as a film, a room as a figure."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from causal_openlock.cli.one_trial import (
    ConditionName,
    ExperimentName,
    ProtocolName,
    Seed,
    Subject,
    one_trial,
)

Size = Annotated[int, typer.Option(min=120, max=2160, help="Height in pixels.")]


def film(
    condition: ConditionName,
    learner: Annotated[str, typer.Option("--learner", "-l", help="Who plays.")] = "bayes",
    trial: Annotated[
        int, typer.Option(min=1, help="The trial to show, counted over the whole condition.")
    ] = 1,
    subject: Subject = 0,
    seed: Seed = None,
    protocol: ProtocolName = None,
    experiment: ExperimentName = "default",
    recorded: Annotated[
        Path | None,
        typer.Option(
            "--from", help="Show a subject recorded in this folder, which compare wrote to."
        ),
    ] = None,
    attempts: Annotated[int, typer.Option(min=1, help="Attempts to show at most.")] = 10,
    size: Size = 480,
    fps: Annotated[int, typer.Option(min=1, max=50, help="Frames per second.")] = 25,
    speed: Annotated[
        float, typer.Option(min=0.1, max=20.0, help="How many times faster than usual.")
    ] = 1.0,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="Film (GIF, MP4), or its last moment (PNG, SVG), by the suffix."
        ),
    ] = None,
) -> None:
    """Show a trial: the arm carries out what a learner did, with the console beside the room."""
    from causal_openlock.cli.terminal import Console, say
    from causal_openlock.errors import OpenLockError
    from causal_openlock.render.film import STILLS, check_suffix, save_film
    from causal_openlock.render.filmed_trial import play_trial, recorded_trial
    from causal_openlock.wording import counted

    path = check_suffix(out or Path(f"film_{Path(condition).stem}_{learner.split(':')[-1]}.gif"))
    if recorded is None:
        who, how = one_trial(condition, learner, trial, subject, seed, protocol, experiment)
        played = play_trial(*who, **how)
    elif seed is not None or protocol is not None or experiment != "default":
        raise OpenLockError(
            "--from shows what was recorded; leave out --seed, --protocol and --experiment, "
            "which are in the record"
        )
    else:
        played = recorded_trial(recorded, learner, condition, subject, trial)
    shown = min(attempts, len(played.attempts))
    with Console(stderr=True).status("drawing") as status:
        frames = save_film(
            played,
            path,
            size=size,
            fps=fps,
            speed=speed,
            attempts=attempts,
            watch=lambda attempt, _: status.update(f"drawing attempt {attempt} of {shown}"),
        )
    what = "" if path.suffix.lower() in STILLS else f", {frames / fps:.0f} seconds"
    cut = f", the first {shown} of {len(played.attempts)} attempts (--attempts shows more)"
    many = counted(len(played.schema.solutions), "solution")
    found = f"{played.found} of {many} found in the trial"
    say(f"{path} written{what}{cut * (shown < len(played.attempts))}; {found}")


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
    size: Size = 600,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Picture to write (SVG or PNG).")
    ] = None,
) -> None:
    """Draw a room as in the paper's Figure 2: at first, or after or amid some actions."""
    from causal_openlock.cli.terminal import say
    from causal_openlock.errors import LayoutError
    from causal_openlock.formats.schema_file import find_schema
    from causal_openlock.render.film import save_still
    from causal_openlock.render.stills import look_after
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

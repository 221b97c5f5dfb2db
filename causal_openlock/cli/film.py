"""``causal-openlock film``: a learner's trial as a film."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from causal_openlock.cli.one_trial import one_trial
from causal_openlock.cli.options import (
    ConditionName,
    ExperimentName,
    PictureSize,
    ProtocolName,
    Seed,
    SubjectNumber,
)


def film(
    condition: ConditionName,
    learner: Annotated[
        str, typer.Option("--learner", "-l", help="The learner that plays.")
    ] = "bayes",
    trial: Annotated[
        int, typer.Option(min=1, help="The trial to show, counted over the whole condition.")
    ] = 1,
    subject: SubjectNumber = 0,
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
    size: PictureSize = 480,
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
    from causal_openlock.render.film import check_suffix, save_film
    from causal_openlock.render.filmed_trial import play_trial, recorded_trial
    from causal_openlock.render.room import STILLS
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

"""``causal-openlock room``, ``film`` and ``trace``: a room, a trial and beliefs as pictures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, TypeVar

import typer

from causal_openlock.cli.options import (
    ConditionName,
    Output,
    ProtocolName,
    SchemaName,
    Seed,
    SubjectNumber,
)
from causal_openlock.cli.terminal import say
from causal_openlock.comparison.progress_bar import shown_steps
from causal_openlock.errors import OpenLockError
from causal_openlock.files.atomic import write_text
from causal_openlock.files.escaping import csv_of
from causal_openlock.wording import counted

T = TypeVar("T")
LearnerName = Annotated[str, typer.Option("--learner", "-l", help="The learner that plays.")]
TrialNumber = Annotated[
    int, typer.Option("--trial", min=1, help="The trial, counted over the whole condition.")
]
ExperimentName = Annotated[
    str,
    typer.Option(
        "--experiment",
        "-e",
        help="An experiment to take part in: its seed, its protocols, its learners by name.",
    ),
]
PictureSize = Annotated[int, typer.Option(min=120, max=2160, help="Height in pixels.")]


def room(
    schema: SchemaName,
    layout: Annotated[
        str | None, typer.Option(help="The layout of its levers, such as trial7.")
    ] = None,
    after: Annotated[
        list[str] | None,
        typer.Option("--after", "-a", help="Do this first, such as push_UPPER; one or more times."),
    ] = None,
    part: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="How much of the last movement is done.")
    ] = 1.0,
    size: PictureSize = 600,
    out: Output = None,
) -> None:
    """Draw a room as in the paper's Figure 2, or after some actions.

    It is an SVG or PNG.
    """
    from causal_openlock.render.paint import save_still
    from causal_openlock.render.scene import look_after
    from causal_openlock.schemas.finding import find_schema
    from causal_openlock.world.room import Room, action_index, first_layout

    found = find_schema(schema)
    chosen = Room.of(found, layout or first_layout(found))
    path = out or Path(f"room_{found.name}.svg")
    actions = [action_index(name, chosen.positions) for name in after or []]
    title = ", ".join([f"{found.name} in {chosen.layout.name}", *(after or [])])
    save_still(look_after(chosen, actions, part), path, size, title=title)
    say(f"{path} written")


def _one_trial(
    play: Callable[..., T],
    condition: str,
    learner: str,
    trial: int,
    subject: int,
    seed: int | None,
    protocol: str | None,
    experiment: str,
) -> T:
    """One trial of a learner, as ``play_trial`` or ``trace_trial`` returns it."""
    from causal_openlock.contract.checks import failures_of
    from causal_openlock.contract.registry import create
    from causal_openlock.experiment.making import Changes, find_experiment, read_experiment

    changes = Changes([condition], [learner], protocol, None, seed)
    chosen = read_experiment(
        find_experiment(experiment), changes, lambda line: say(line, error=True)
    )
    (entry,), (played,) = chosen.learners, chosen.conditions
    with failures_of(entry.name):
        return play(
            create(entry.learner, entry.parameters),
            played,
            entry.protocol,
            trial=trial,
            subject=subject,
            seed=chosen.seed,
            reward=entry.reward,
            label=entry.name,
        )


def film(
    condition: ConditionName,
    learner: LearnerName = "bayes",
    trial: TrialNumber = 1,
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
    out: Output = None,
) -> None:
    """Film a trial: the arm carries out a learner's actions.

    The film is a GIF or MP4; a PNG or SVG is its last moment.
    """
    from causal_openlock.render import STILLS
    from causal_openlock.render.film import check_suffix, play_trial, recorded_trial, save_film

    path = check_suffix(out or Path(f"film_{Path(condition).stem}_{learner.split(':')[-1]}.gif"))
    if recorded is None:
        asked = (condition, learner, trial, subject, seed, protocol, experiment)
        played = _one_trial(play_trial, *asked)
    elif seed is not None or protocol is not None or experiment != "default":
        raise OpenLockError(
            "--from shows what was recorded; leave out --seed, --protocol and --experiment, "
            "which are in the record"
        )
    else:
        played = recorded_trial(recorded, learner, condition, subject, trial)
    shown = min(attempts, len(played.attempts))
    with shown_steps("film") as begin:
        frames = save_film(
            played,
            path,
            size=size,
            fps=fps,
            speed=speed,
            attempts=attempts,
            watch=lambda attempt, _: begin(f"drawing attempt {attempt} of {shown}"),
        )
    what = "" if path.suffix.lower() in STILLS else f", {counted(round(frames / fps), 'second')}"
    if shown < len(played.attempts):
        what += f", the first {shown} of {len(played.attempts)} attempts (--attempts shows more)"
    many = counted(len(played.room.schema.solutions), "solution")
    by_whom = "shown to the subject" if played.shown else "found in the trial"
    found = f"{played.found} of {many} {by_whom}"
    say(f"{path} written{what}; {found}")


def trace(
    condition: ConditionName,
    learner: LearnerName = "bayes",
    trial: TrialNumber = 1,
    subject: SubjectNumber = 0,
    seed: Seed = None,
    protocol: ProtocolName = None,
    experiment: ExperimentName = "default",
    attempts: Annotated[int, typer.Option(min=1, help="Attempts to describe at most.")] = 30,
    actions: Annotated[int, typer.Option(min=1, help="Actions to draw at most.")] = 36,
    out: Output = None,
    table: Annotated[
        Path | None, typer.Option(help="Also write a row for each action to this CSV file.")
    ] = None,
) -> None:
    """Describe a trial: what a subject did, saw, learned and believed.

    The learner must hold beliefs, as bayes does. The picture is an SVG, PNG or PDF.
    """
    from matplotlib.figure import Figure

    from causal_openlock.analysis.plots import style
    from causal_openlock.analysis.plots.belief import plot_trace
    from causal_openlock.belief.trace import trace_text, trace_trial
    from causal_openlock.render import path_of_picture

    path = path_of_picture(out) if out else None
    asked = (condition, learner, trial, subject, seed, protocol, experiment)
    traced = _one_trial(trace_trial, *asked)
    path = path or Path(f"trace_{traced.condition}.svg")
    for line in trace_text(traced, attempts):
        say(line)
    figure = Figure()
    plot_trace(traced, actions=actions, ax=figure)
    style.save(figure, path)
    say(f"\n{path} written")
    if table is not None:
        write_text(table, csv_of(traced.table()))
        say(f"{table} written")

"""``causal-openlock trace``: a trial of belief, in words and as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def trace(
    condition: Annotated[str, typer.Argument(help="What is played: CC4, CC3-CC4, my.yaml, ...")],
    learner: Annotated[
        str, typer.Option("--learner", "-l", help="Who plays; it must hold beliefs, as bayes does.")
    ] = "bayes",
    trial: Annotated[
        int, typer.Option(min=1, help="The trial to tell, counted over the whole condition.")
    ] = 1,
    subject: Annotated[int, typer.Option(min=0, help="Number of the subject.")] = 0,
    seed: Annotated[
        int | None, typer.Option(min=0, max=2**63 - 1, help="Seed of all randomness.")
    ] = None,
    protocol: Annotated[
        str | None, typer.Option(help="human, rl, or one that the experiment declares.")
    ] = None,
    experiment: Annotated[
        str,
        typer.Option(
            "--experiment",
            "-e",
            help="An experiment to take part in: its seed, its protocols, its learners by name.",
        ),
    ] = "default",
    attempts: Annotated[int, typer.Option(min=1, help="Attempts to tell at most.")] = 30,
    actions: Annotated[int, typer.Option(min=1, help="Actions to draw at most.")] = 36,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Picture to write (SVG, PNG or PDF, by its suffix)."),
    ] = None,
    table: Annotated[
        Path | None, typer.Option(help="Write a row for each action to this CSV file, too.")
    ] = None,
) -> None:
    """Tell what a subject did in a trial, what it saw, what it learned and what it believes."""
    from causal_openlock.analysis.belief import check_suffix, save_trace_figure
    from causal_openlock.belief.story import story
    from causal_openlock.belief.trace import trace_trial
    from causal_openlock.experiment_file import Changes, find_experiment, read_experiment
    from causal_openlock.files import write_text
    from causal_openlock.learner_registry import create

    changes = Changes([condition], [learner], protocol, None, seed)
    chosen = read_experiment(find_experiment(experiment), changes)
    (entry,), (played,) = chosen.entries, chosen.conditions
    path = check_suffix(out or Path(f"trace_{played.name}.svg"))
    traced = trace_trial(
        create(entry.learner, entry.parameters),
        played,
        entry.protocol,
        trial=trial,
        subject=subject,
        seed=chosen.seed,
        reward=entry.reward,
        label=entry.name,
    )
    for line in story(traced, attempts):
        typer.echo(line)
    save_trace_figure(traced, path, actions)
    typer.echo(f"\n{path} written")
    if table is not None:
        write_text(table, traced.table().to_csv(index=False))
        typer.echo(f"{table} written")

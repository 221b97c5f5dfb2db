"""``causal-openlock text``: play in words, in the terminal, as language models do."""

from __future__ import annotations

from typing import Annotated

import typer

from causal_openlock.cli.options import Budgets, ConditionName, SubjectNumber
from causal_openlock.cli.terminal import say

STOP = ("quit", "exit")


def text(
    condition: ConditionName,
    story: Annotated[
        str, typer.Option(help="levers, switches, symbols, or any: one is drawn.")
    ] = "any",
    protocol: Budgets = "human",
    subject: SubjectNumber = 0,
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Seed of rooms and words.")] = 0,
) -> None:
    """Play in words, in the terminal, as a language model does."""
    import numpy as np

    from causal_openlock.experiment.condition import find_condition
    from causal_openlock.experiment.protocol import find_protocol
    from causal_openlock.experiment.session import Session
    from causal_openlock.render.words import Wording, feedback, room_now

    session = Session(
        find_condition(condition), find_protocol(protocol), [subject], seed=seed, learner="text"
    )
    brief = session.brief
    words = Wording.draw(brief.positions, brief.generators[0], story)  # type: ignore[arg-type]
    say(words.instructions(brief.action_limit, brief.attempt_limit))
    say(f"- `{STOP[0]}` ends the game.")
    say(f"\n{room_now(words, session.view, 0, brief.trials)}")
    while not session.over:
        if (shown := session.shown) is not None:
            say(f"> {words.actions[int(shown[0])]} (shown to you)")
            say(feedback(words, session.step(shown), 0, brief.trials))
            continue
        say("> ", end="")
        try:
            answer = input()
        except EOFError:
            say()
            return
        except UnicodeDecodeError:
            answer = ""
        if answer.strip().lower() in STOP:
            return
        action = words.read(answer)
        if action is None:
            say(words.no_action)
            continue
        say(feedback(words, session.step(np.array([action])), 0, brief.trials))

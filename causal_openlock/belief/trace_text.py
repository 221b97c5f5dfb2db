"""A trace of beliefs as text: attempt by attempt, for a terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

from causal_openlock.belief.structure_schemas import behave_alike, in_words, same_structure
from causal_openlock.belief.trace import Snapshot, Trace, TracedAction
from causal_openlock.wording import counted

WIDTH = 96
OUTCOME_TEXTS = {
    "nothing": "nothing moved",
    "moved": "moved",
    "unlocked": "moved, and unlocked the door",
    "locked": "moved, and locked the door again",
    "opened": "opened, nothing new",
    "new solution": "opened, a new solution",
}
OUTCOME_WIDTH = max(map(len, OUTCOME_TEXTS.values())) + len(" (1 of 3)")
NOISE = (
    "No hypothesis explains this. From here on levers may fail to move, and everything observed in "
    "this room counts again for the new hypotheses."
)
IMPOSSIBLE = 1e-12
"""Outcomes with a lower probability were impossible for the subject."""
SURPRISING = 0.1
NOTHING = 0.005
"""Fewer bits than these count as none."""


def trace_text(trace: Trace, most: int = 30) -> Iterator[str]:
    """The lines of a trace.

    Args:
        trace: What happened.
        most: How many attempts to write out at most; later ones are summarised.
    """
    solutions, protocol = len(trace.truth.solutions), trace.protocol
    yield (
        f"{trace.learner} in {trace.condition} under protocol {protocol.name}, subject "
        f"{trace.subject}, trial {trace.trial} of {trace.trials}"
    )
    yield (
        f"{counted(solutions, 'solution')} to find, {counted(protocol.attempt_limit, 'attempt')} "
        f"of {counted(trace.action_limit, 'action')}"
    )
    yield ""
    yield from _wrapped(f"Before it acts: {belief_in_words(trace.snapshots[0])}")
    found = 0
    width = max(len(shown_name(action)) for action in trace.actions)
    for attempt in trace.attempts[:most]:
        yield ""
        yield f"Attempt {attempt[0].attempt}"
        for action in attempt:
            found += action.outcome == "new solution"
            yield from _action_lines(action, width, found, solutions)
        yield from _wrapped(f"Now {belief_in_words(attempt[-1].after)}", "  ")
    if rest := trace.attempts[most:]:
        more = sum(action.outcome == "new solution" for attempt in rest for action in attempt)
        news = counted(more, "new solution") if more else "nothing new"
        yield ""
        yield f"and {counted(len(rest), 'more attempt')}, with {news}"
        yield from _wrapped(f"In the end {belief_in_words(trace.snapshots[-1])}", "  ")
    yield ""
    yield from _wrapped(_verdict(trace))
    kept = [action for action in trace.actions if not action.renewed]
    if len(kept) < len(trace.actions):
        yield from _wrapped(
            "Where other hypotheses replaced the old ones, because few or none were left, the "
            "difference of entropies is not information and is not shown."
        )
    if trace.forgetting:
        yield from _wrapped(
            f"It forgets {trace.forgetting:.0%} of the evidence with every attempt, which counts "
            "against the attempt's last action."
        )
    yield from _wrapped(
        f"Information in all: {_bits(sum(action.predicted for action in kept))} bits expected, "
        f"{_bits(sum(action.obtained for action in kept))} obtained. The two agree on average over "
        "rooms that are as probable as the subject believes, not in every room or action."
    )


def _action_lines(action: TracedAction, width: int, found: int, solutions: int) -> Iterator[str]:
    result = OUTCOME_TEXTS[action.outcome]
    if action.outcome == "new solution":
        result += f" ({found} of {solutions})"
    if action.renewed:
        gain = f"{_bits(action.predicted)} bits expected; other hypotheses from here on"
    elif max(action.predicted, abs(action.obtained)) < NOTHING:
        gain = "nothing to learn"
    else:
        change = "learned" if action.obtained >= 0 else "less certain"
        gain = f"{_bits(abs(action.obtained))} bits {change}, {_bits(action.predicted)} expected"
    if IMPOSSIBLE <= action.chance < SURPRISING:
        gain += f"; its probability was {percent(action.chance)}"
    yield f"  {shown_name(action):{width}}  {result:{OUTCOME_WIDTH}}  {gain}"
    if action.renewed == "noise":
        yield from _wrapped(NOISE, "    ")


def _verdict(trace: Trace) -> str:
    attempts, truth = len(trace.attempts), in_words(trace.truth)
    if trace.solved:
        last = max(a.attempt for a in trace.actions if a.outcome == "new solution")
        end = f"Solved in {counted(last, 'attempt')}"
        end += f"; the trial went on to {attempts:,}." if attempts > last else "."
    else:
        found = f"{trace.found} of {len(trace.truth.solutions)} solutions"
        end = f"Not solved: {found} in {counted(attempts, 'attempt')}."
    verdict = {
        "same": "is the same structure",
        "alike": f"acts the same in attempts of {counted(trace.action_limit, 'action')}",
        "different": "acts differently",
    }[agreement(trace)]
    return f"{end} In truth, {truth}. What it believes most probable {verdict}."


def agreement(trace: Trace) -> str:
    """How the most probable structure in the end compares with the truth, strengths aside.

    Returns:
        ``same``, ``alike`` if it behaves alike in every attempt, or ``different``.
    """
    most = trace.snapshots[-1].structure
    if same_structure(most, trace.truth):
        return "same"
    return "alike" if behave_alike(trace.truth, most, trace.action_limit) else "different"


def belief_in_words(belief: Snapshot) -> str:
    """The entropy of a belief and its most probable structure, in words."""
    return (
        f"{_bits(belief.entropy)} bits left, "
        f"{counted(belief.hypotheses, 'hypothesis', 'hypotheses')}; most probable "
        f"({percent(belief.probability)}): {in_words(belief.structure)}."
    )


def shown_name(action: TracedAction) -> str:
    """The name of an action as people read it: ``push UPPER``."""
    return action.name.replace("_", " ", 1)


def percent(probability: float) -> str:
    """A probability in percent; 0% and 100% only if it is certain.

    >>> percent(0.5), percent(0.9999), percent(0.001)
    ('50%', 'over 99%', 'under 1%')
    """
    if 0.995 <= probability < 1.0 - 1e-9:
        return "over 99%"
    return f"{probability:.0%}" if probability >= 0.01 else "under 1%"


def _bits(bits: float) -> str:
    return f"{round(bits, 2) + 0.0:.2f}"


def _wrapped(text: str, indent: str = "") -> list[str]:
    return textwrap.wrap(
        text, WIDTH, initial_indent=indent, subsequent_indent=indent + "  ", break_long_words=False
    )

"""A trial of belief in words: attempt by attempt, for a terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

from causal_openlock.belief.likeness import act_alike, same_arrows
from causal_openlock.belief.trace import Snapshot, Trace, TracedAction
from causal_openlock.belief.words import told

WIDTH = 96
IN_WORDS = {
    "nothing": "nothing moved",
    "moved": "moved",
    "unlocked": "moved, and unlocked the door",
    "locked": "moved, and locked the door again",
    "opened": "opened, nothing new",
    "new solution": "opened, a new solution",
}
CAME = max(map(len, IN_WORDS.values())) + len(" (1 of 3)")
NOISE = (
    "Nothing that it held possible explains this. From here on levers may fail to move, for all it "
    "knows, and it judges anew what it has seen in this room."
)
IMPOSSIBLE = 1e-12
"""What was less probable than this was held impossible."""
SURPRISING = 0.1
NOTHING = 0.005
"""Bits that are told as none."""


def story(trace: Trace, most: int = 30) -> Iterator[str]:
    """Tell a trace, line by line.

    Args:
        trace: What happened.
        most: How many attempts to tell at most; what comes after them is summed up.
    """
    solutions, protocol = len(trace.truth.solutions), trace.protocol
    yield (
        f"{trace.learner} in {trace.condition} under protocol {protocol.name}, subject "
        f"{trace.subject}, trial {trace.trial} of {trace.trials}"
    )
    yield (
        f"{_count(solutions, 'solution')} to find, {_count(protocol.attempt_limit, 'attempt')} of "
        f"{_count(trace.action_limit, 'action')}"
    )
    yield ""
    yield from _wrapped(f"Before it acts: {belief_in_words(trace.snapshots[0])}")
    found = 0
    names = [shown_name(action) for action in trace.actions]
    width = max(map(len, names))
    for attempt in trace.attempts[:most]:
        yield ""
        yield f"Attempt {attempt[0].attempt}"
        for action in attempt:
            found += action.outcome == "new solution"
            yield from _told_action(action, width, found, solutions)
        yield from _wrapped(f"Now {belief_in_words(attempt[-1].after)}", "  ")
    if rest := trace.attempts[most:]:
        more = sum(action.outcome == "new solution" for attempt in rest for action in attempt)
        yield ""
        yield (
            f"and {_count(len(rest), 'more attempt')}, with "
            f"{_count(more, 'new solution') if more else 'nothing new'}"
        )
        yield from _wrapped(f"In the end {belief_in_words(trace.snapshots[-1])}", "  ")
    yield ""
    yield from _wrapped(_verdict(trace))
    kept = [action for action in trace.actions if not action.renewed]
    if len(kept) < len(trace.actions):
        yield from _wrapped(
            "Where it went on with other hypotheses, drawn anew because few were left or listed "
            "anew because none was, the difference of entropies is no information and is not told."
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


def _told_action(action: TracedAction, width: int, found: int, solutions: int) -> Iterator[str]:
    came = IN_WORDS[action.outcome]
    if action.outcome == "new solution":
        came += f" ({found} of {solutions})"
    if action.renewed:
        gain = f"{_bits(action.predicted)} bits expected; other hypotheses from here on"
    elif max(action.predicted, abs(action.obtained)) < NOTHING:
        gain = "nothing to learn"
    else:
        told = "learned" if action.obtained >= 0 else "less certain"
        gain = f"{_bits(abs(action.obtained))} bits {told}, {_bits(action.predicted)} expected"
    if IMPOSSIBLE <= action.chance < SURPRISING:
        gain += f"; it had given this {percent(action.chance)}"
    yield f"  {shown_name(action):{width}}  {came:{CAME}}  {gain}"
    if action.renewed == "noise":
        yield from _wrapped(NOISE, "    ")


def _verdict(trace: Trace) -> str:
    attempts, truth = len(trace.attempts), told(trace.truth)
    if trace.solved:
        last = max(a.attempt for a in trace.actions if a.outcome == "new solution")
        end = f"Solved in {_count(last, 'attempt')}"
        end += f"; the trial went on to {attempts:,}." if attempts > last else "."
    else:
        found = f"{trace.found} of {len(trace.truth.solutions)} solutions"
        end = f"Not solved: {found} in {_count(attempts, 'attempt')}."
    verdict = {
        "same": "is the same structure",
        "alike": f"acts the same in attempts of {_count(trace.action_limit, 'action')}",
        "different": "acts differently",
    }[agreement(trace)]
    return f"{end} In truth, {truth}. What it holds most probable {verdict}."


def agreement(trace: Trace) -> str:
    """Whether what is most probable in the end is the ``same`` as the truth, strengths aside.

    If not, whether it acts ``alike`` in every attempt, or ``different``.
    """
    most = trace.snapshots[-1].structure
    if same_arrows(most, trace.truth):
        return "same"
    return "alike" if act_alike(trace.truth, most, trace.action_limit) else "different"


def belief_in_words(belief: Snapshot) -> str:
    """A belief in plain words: how much is missing, and what is most probable."""
    return (
        f"{_bits(belief.entropy)} bits left, {_count(belief.hypotheses, 'hypothesis')}; most "
        f"probable ({percent(belief.probability)}): {told(belief.structure)}."
    )


def shown_name(action: TracedAction) -> str:
    """The name of an action as people read it: ``push UPPER``."""
    return action.name.replace("_", " ", 1)


def percent(probability: float) -> str:
    """A probability in percent; certainty only where it is certain."""
    if 0.995 <= probability < 1.0 - 1e-9:
        return "over 99%"
    return f"{probability:.0%}" if probability >= 0.01 else "under 1%"


def _bits(bits: float) -> str:
    return f"{round(bits, 2) + 0.0:.2f}"


def _count(number: int, thing: str) -> str:
    if number == 1:
        return f"1 {thing}"
    return f"{number:,} {thing[:-2] + 'es' if thing.endswith('is') else thing + 's'}"


def _wrapped(text: str, indent: str = "") -> list[str]:
    return textwrap.wrap(
        text, WIDTH, initial_indent=indent, subsequent_indent=indent + "  ", break_long_words=False
    )

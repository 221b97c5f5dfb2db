"""A room in words: what people see in the browser, as text.

The same room can be described in several *stories*: levers and a door, switches and a lamp, neutral
symbols. A :class:`Wording` is a story, a name for each position, and the order in which positions
are listed. Names and order are drawn at random, so that texts about this room that a language model
was trained on do not help. The text says everything that can be perceived, and nothing latent.

The environment ``causal_openlock/OpenLockText-v0``, ``causal-openlock text``, ``causal-openlock
serve`` and the learner ``llm`` use the same words.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from causal_openlock.contract.learner import Step, View
from causal_openlock.errors import OpenLockError
from causal_openlock.wording import counted, joined, nearest

StoryName = Literal["levers", "switches", "symbols", "any"]
ANY: Literal["any"] = "any"
"""Stands for a story's name: one story is drawn."""


_VOCABULARY = {  # in each of the three stories
    "story": ("levers", "switches", "symbols"),
    "place": ("room", "board", "page"),
    "thing": ("lever", "switch", "symbol"),
    "things": ("levers", "switches", "symbols"),
    "push": ("push", "turn on", "raise"),
    "pull": ("pull", "turn off", "lower"),
    "pushed": ("pushed", "on", "high"),
    "pulled": ("pulled", "off", "low"),
    "grey": ("grey", "amber", "round"),  # an active lever
    "white": ("white", "blue", "square"),
    "finish": ("push the door", "press the lamp", "strike the seal"),
    "goal": ("the door", "the lamp", "the seal"),
    "locked": ("locked", "without current", "fixed"),
    "unlocked": ("unlocked", "under current", "loose"),
    "closed": ("closed", "dark", "whole"),
    "open": ("open", "lit", "broken"),
    "scene": (
        "You are in a room with {many} and a door, which is locked. A mechanism connects some of "
        "the levers to the lock. Your task is to find out how to open the door.",
        "You stand before a board with {many} and a lamp, which has no current. Wires that you "
        "cannot see connect some of the switches to the lamp. Your task is to find out how to "
        "light the lamp.",
        "Before you is a page with {many} and a seal, which is fixed. A rule that you do not know "
        "connects some of the symbols to the seal. Your task is to find out how to break the seal.",
    ),
    "names": (  # of positions: twelve at least
        "ash birch cedar elm fir hazel larch maple oak pine rowan willow yew",
        "bread cheese honey milk mint olive pepper rice salt sugar tea vanilla",
        "ba do fe gu ki lo mu ne pa ri su ta vo we",
    ),
}
STORIES: dict[str, Any] = {
    words[0]: SimpleNamespace(**dict(zip(_VOCABULARY, words, strict=True)))
    for words in zip(*_VOCABULARY.values(), strict=True)
}
"""The words of each story, by name: ``STORIES["levers"].goal`` is ``the door``."""
_RULES = """\
- Each {thing} is {pulled} or {pushed}, and looks {grey} or {white}. `{push} NAME` makes it \
{pushed}, `{pull} NAME` makes it {pulled}. Not every {thing} can always be moved; some never can.
- {Goal} is {locked} or {unlocked}. When it is {unlocked}, `{finish}` makes it {open}.
- You have {actions} in each attempt. Every action counts as one, also when nothing moves, and \
`{finish}` counts too. After that the {place} goes back to where it began, and the next attempt \
starts.
- A {place} can have several combinations after which {goal} can be made {open}. Find all \
of them; you have at most {attempts} with each {place}.
- You are always told how many combinations, attempts and actions are left.
- The actions are: {choices}."""


@dataclass(frozen=True)
class Wording:
    """A way to describe rooms with P positions.

    Example:
        >>> words = Wording("levers", ("oak", "elm", "fir"), (2, 0, 1))
        >>> words.actions
        ('push oak', 'push elm', 'push fir', 'pull oak', 'pull elm', 'pull fir', 'push the door')
        >>> words.read("**Push fir.**"), words.read("I would rather not")
        (2, None)
        >>> words.outcome([0, 0, 0, 1, 1, 0, 1, 0], [1, 0, 0, 1, 1, 0, 1, 0])
        'Oak is pushed now.'
    """

    story: str  #: name of the story
    names: tuple[str, ...]  #: ``P`` the name of each position
    order: tuple[int, ...]  #: ``P`` the positions in the order in which they are listed

    @classmethod
    def draw(
        cls, positions: int, generator: np.random.Generator, story: StoryName = ANY
    ) -> Wording:
        """A wording drawn at random, in one story or in any.

        Raises:
            OpenLockError: If there is no such story.
        """
        if story != ANY and story not in STORIES:
            raise OpenLockError(
                f"there is no story {story!r}; {nearest(str(story), [ANY, *STORIES])}"
            )
        drawn = [*STORIES][int(generator.integers(len(STORIES)))]  # drawn in any case
        chosen = drawn if story == ANY else story
        pool = STORIES[chosen].names.split()
        names = [pool[i] for i in generator.permutation(len(pool))[:positions].tolist()]
        return cls(chosen, tuple(names), tuple(generator.permutation(positions).tolist()))

    @property
    def _terms(self) -> Any:
        return STORIES[self.story]

    @cached_property
    def actions(self) -> tuple[str, ...]:
        """``2P + 1`` the actions by index."""
        moves = [
            f"{verb} {name}" for verb in (self._terms.push, self._terms.pull) for name in self.names
        ]
        return (*moves, self._terms.finish)

    @property
    def choices(self) -> list[str]:
        """The actions in the order in which they are listed."""
        many = len(self.names)
        places = [*self.order, *(many + place for place in self.order), 2 * many]
        return [self.actions[place] for place in places]

    def read(self, text: str) -> int | None:
        """The index of the action that a text names; ``None`` if it names none.

        The last line with any text counts. It has to be an action and nothing else, apart from
        signs and ``action:`` before it.
        """
        lines = [line for line in map(_plain, text.splitlines()) if line]
        last = lines[-1].removeprefix("action ") if lines else ""
        return self.actions.index(last) if last in self.actions else None

    def instructions(self, action_limit: int, attempt_limit: int) -> str:
        """The text before the first room."""
        terms = self._terms
        rules = _RULES.format(
            **{**vars(terms), "Goal": _capital(terms.goal)},
            actions=counted(action_limit, "action"),
            attempts=counted(attempt_limit, "attempt"),
            choices=", ".join(self.choices),
        )
        many = counted(len(self.names), terms.thing, terms.things)
        return f"{terms.scene.format(many=many)}\n\n{rules}"

    @property
    def no_action(self) -> str:
        """The reply to a text that names no action."""
        listed = ", ".join(self.choices)
        return f"That is no action, and nothing was done. The actions are: {listed}."

    def room(
        self, observation: ArrayLike, console: Mapping[str, int], attempt: int, trial: str
    ) -> str:
        """Text of an observation of a room, and of the console.

        The console has ``solutions_left``, ``attempts_left`` and ``actions_left``; ``attempt``
        counts from 1, and ``trial`` is such as ``1 of 5``.
        """
        bits, many, terms = _bits(observation), len(self.names), self._terms
        lock = terms.locked if bits[-2] else terms.unlocked
        things = "; ".join(
            f"{self.names[place]}: {terms.grey if bits[many + place] else terms.white}, "
            f"{terms.pushed if bits[place] else terms.pulled}"
            for place in self.order
        )
        where = f"{_capital(terms.place)} {trial}, attempt {attempt}"
        return (
            f"{where}. Left: {counted(console['solutions_left'], 'combination')}, "
            f"{counted(console['attempts_left'], 'attempt')}, "
            f"{counted(console['actions_left'], 'action')} in this attempt.\n{things}.\n"
            f"{_capital(terms.goal)} is {lock} and {terms.open if bits[-1] else terms.closed}."
        )

    def outcome(self, before: ArrayLike, after: ArrayLike, new_solution: bool = False) -> str:
        """Text of an action's result, from the observations before it and right after it."""
        old, new, terms = _bits(before), _bits(after), self._terms
        if new[-1] and not old[-1]:
            how = ", by a new combination!" if new_solution else ", but by no new combination."
            return f"{_capital(terms.goal)} is {terms.open}{how}"
        moved = [
            f"{self.names[place]} is {terms.pushed if new[place] else terms.pulled} now"
            for place in self.order
            if new[place] != old[place]
        ]
        if new[-2] != old[-2]:
            moved.append(f"{terms.goal} is {terms.locked if new[-2] else terms.unlocked} now")
        return f"{_capital(joined(moved))}." if moved else "Nothing moved."

    def ending(self, attempt: int, trial_over: bool, solutions_left: int) -> str:
        """The text at the end of this attempt, after the outcome of its last action."""
        if not trial_over:
            return f"The attempt is over; the {self._terms.place} goes back to where it began."
        if solutions_left:
            left = counted(solutions_left, "combination")
            return f"No attempts are left; {left} stayed hidden."
        attempts = counted(attempt, "attempt")
        return f"You found every combination! The {self._terms.place} is over after {attempts}."

    def question(self) -> str:
        """The question after a room: what enables what."""
        terms = self._terms
        return (
            f"You have left this {terms.place}. Which {terms.thing} had to be {terms.pushed} "
            f"before another one could be moved, and which made {terms.goal} {terms.unlocked}? "
            "List every pair of a cause and its effect that you believe in; an effect is a "
            f"{terms.thing} or `{terms.goal}`."
        )

    @property
    def nodes(self) -> tuple[str, ...]:
        """``P + 1`` what can be an effect: the names of the positions, and the goal."""
        return (*self.names, self._terms.goal)


def room_now(words: Wording, view: View, subject: int, trials: int) -> str:
    """Text of a subject's room and console, from a learner's view."""
    console = {name: int(counts[subject]) for name, counts in vars(view.console).items()}
    trial = f"{int(view.trial[subject])} of {trials}"
    return words.room(view.observation[subject], console, int(view.attempt[subject]), trial)


def feedback(words: Wording, step: Step, subject: int, trials: int, *, room: bool = True) -> str:
    """The text after an action: what it did, what ended, and, with ``room``, what comes next."""
    new, trial_over = bool(step.new_solution[subject]), bool(step.trial_over[subject])
    lines = [words.outcome(step.view.observation[subject], step.outcome[subject], new)]
    if step.attempt_over[subject]:
        left = int(step.view.console.solutions_left[subject]) - new
        lines.append(words.ending(int(step.view.attempt[subject]), trial_over, left))
    if room and step.next.playing[subject]:
        lines.append(room_now(words, step.next, subject, trials))
    return "\n".join(lines)


def _bits(observation: ArrayLike) -> list[int]:
    bits: list[int] = np.asarray(observation).astype(int).tolist()
    return bits


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _plain(line: str) -> str:
    """A line without signs and capitals, its words one blank apart."""
    return " ".join(re.sub(r"[^\w\s]|_", " ", line.lower()).split())

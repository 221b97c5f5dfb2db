"""A room to try out by hand, in a notebook or a terminal: it shows itself after every action.

The rules are those of :class:`~causal_openlock.envs.single.OpenLockEnv` with whole trials as
episodes: an attempt that has ended is followed by the next one in the same room, until all
solutions are found or no attempt is left.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causal_openlock.envs.settings import ATTEMPT_LIMIT
from causal_openlock.envs.single import OpenLockEnv
from causal_openlock.errors import OpenLockError
from causal_openlock.files.validation import whole_number
from causal_openlock.render.paint import Panel, ShownAction
from causal_openlock.render.room import room_text
from causal_openlock.schemas.finding import schema as declared
from causal_openlock.schemas.schema import Schema
from causal_openlock.wording import counted
from causal_openlock.world.rewards import PAPER_REWARD
from causal_openlock.world.room import (
    Layout,
    action_index,
    action_names,
    first_layout,
    published_layouts,
)


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture of a room: an observation, next to the console."""

    observation: NDArray[np.int8]
    panel: Panel = field(repr=False)

    def text(self) -> str:
        """The room and the console as plain text."""
        panel, positions = self.panel, len(self.observation) // 2 - 1
        found = [how for how in panel.solutions if how]
        lines = [room_text(self.observation, positions).rstrip()]
        lines.append(
            f"{len(found)} of {counted(len(panel.solutions), 'solution')} found; "
            f"{counted(panel.attempts_left or 0, 'attempt')} and "
            f"{counted(panel.actions_left, 'action')} left"
        )
        return "\n".join([*lines, *(f"found: {how}" for how in found)])


@dataclass(frozen=True, eq=False, repr=False)
class Seen(Picture):
    """Result of an action; its picture is the room right after it, before any reset.

    A learner gets all of this except ``lever``, which is latent, and ``reveal``.

    Attributes:
        observation: ``[2P + 2]`` bits: levers pushed, levers grey, door locked, door open.
        action: The action, such as ``push UPPER``.
        outcome: What came of it, in words.
        reward: The reward of the action, by the paper's rule.
        door_open: Whether the door is open.
        new_solution: Whether a solution was completed that had not been found before.
        attempt_over: Whether the attempt ended with it; the next action begins another.
        trial_over: Whether the trial ended with it.
        solutions_found: How many solutions have been found in the trial.
        attempts_used: How many attempts have been begun in the trial.
        lever: The schema's lever at that position; empty for an inactive one and for the door.
        reveal: Whether the title names that lever.
    """

    action: str
    outcome: str
    reward: float
    door_open: bool
    new_solution: bool
    attempt_over: bool
    trial_over: bool
    solutions_found: int
    attempts_used: int
    lever: str
    reveal: bool

    @property
    def title(self) -> str:
        """The action, its result, and, where it is revealed, the lever's role."""
        done = f"{self.action}: {self.outcome}"
        if self.reveal and self.lever:
            return f"{done} (hidden from learners: this is {self.lever})"
        return done

    def __repr__(self) -> str:
        return f"{self.title}\n{self.text()}"


class PlayableRoom:
    """A room to try out; see :func:`room`.

    Attributes:
        schema: Its schema.
        layout: The positions of its levers.
        actions: The names of all actions, by index.
        solutions_found: The solutions found in this trial, as the positions to push.
    """

    def __init__(
        self, schema: Schema, env: OpenLockEnv, seed: int | None, reveal: bool = True
    ) -> None:
        self.schema, self._env, self._reveal = schema, env, reveal
        self._begin(env.reset(seed=seed))

    def reset(self) -> PlayableRoom:
        """Begin a new trial; with the layout ``random``, in another room. Returns the room."""
        self._begin(self._env.reset())
        return self

    def _begin(self, seen: tuple[NDArray[np.int8], dict[str, Any]]) -> None:
        self._observation, self._info = seen
        where = dict(self._info["latent"]["layout"])
        named = published_layouts(self.schema).values()
        own = Layout.of(self.schema, where, self.positions)
        self.layout = next((layout for layout in named if layout.places == own.places), own)
        self.actions = tuple(name.replace("_", " ") for name in action_names(self.positions))
        self.solutions_found: tuple[tuple[str, ...], ...] = ()
        self._done: list[ShownAction] = []
        self._attempt = 1

    @property
    def positions(self) -> int:
        """Number of positions, P."""
        return len(self._observation) // 2 - 1

    @property
    def over(self) -> bool:
        """Whether the trial is over."""
        return self._env.trial_over

    def step(self, action: str | int) -> Seen:
        """Take one action; returns what was seen, which shows the room right after the action.

        Args:
            action: ``push UPPER``, ``pull UPPER``, or ``push door``, with a space or an underscore;
                ``UPPER`` and ``door`` for short, which push; or an index.

        Raises:
            ExperimentError: If there is no such action.
            OpenLockError: If the trial is over.
        """
        chosen = action_index(action, self.positions)
        if self.over:
            raise OpenLockError("the trial is over; begin another one with reset()")
        before = self._observation
        known = self._info["latent"]["found"]
        self._observation, reward, *ended, self._info = self._env.step(chosen)
        console, latent = self._info["console"], self._info["latent"]
        outcome = self._info.get("outcome", self._observation)
        where = dict(latent["layout"])
        new = [solution for solution in latent["found"] if solution not in known]
        self.solutions_found += tuple(
            tuple(where[lever] for lever in latent["solutions"][solution]) for solution in new
        )
        name = self.actions[chosen]
        shown = ShownAction.of(name, before, outcome, bool(new))
        self._done.append(shown)
        over = "outcome" in self._info
        seen = Seen(
            observation=outcome,
            panel=self._panel(0 if over else console["actions_left"]),
            action=name,
            outcome=shown.outcome,
            reward=float(reward),
            door_open=bool(outcome[-1]),
            new_solution=bool(new),
            attempt_over=over,
            trial_over=any(ended),
            solutions_found=console["solutions_found"],
            attempts_used=self._attempt,
            lever="".join(lever for lever, place in where.items() if name.endswith(f" {place}")),
            reveal=self._reveal,
        )
        if over:
            self._done = []
            self._attempt += 1
        return seen

    def _panel(self, actions_left: int) -> Panel:
        console = self._info["console"]
        return Panel(
            solutions=(*map(", ".join, self.solutions_found), *[""] * console["solutions_left"]),
            attempts_left=console["attempts_left"] if console["solutions_left"] else None,
            actions_left=actions_left,
            actions=tuple(self._done),
        )

    @property
    def picture(self) -> Picture:
        """The room's picture now."""
        left = 0 if self.over else self._info["console"]["actions_left"]
        return Picture(self._observation, self._panel(left))

    def __repr__(self) -> str:
        return f"{self.schema.name} in {self.layout.name}\n{self.picture.text()}"


def room(
    schema: Any,
    layout: str | Mapping[str, str] | Layout | None = None,
    *,
    seed: int | None = 0,
    attempt_limit: int = ATTEMPT_LIMIT,
    action_limit: int | None = None,
    reveal: bool = True,
) -> PlayableRoom:
    """A room to try out by hand; it shows itself, and so does what each action leads to.

    Args:
        schema: Anything that :func:`~causal_openlock.schemas.finding.schema` takes, such as
            ``CC4`` or ``A -> B, C -> door``.
        layout: A published layout such as ``trial7``, ``{lever: position}``, or ``random`` for
            another one in every trial; by default the first published one that fits.
        seed: Decides random layouts, and which actions fail where strengths are below 1.
        attempt_limit: Attempts in a trial.
        action_limit: Actions in an attempt; by default 3, or as many as the schema needs.
        reveal: Whether what is shown of an action names the schema's lever at that position, which
            no learner sees; ``False`` for a room to solve.

    Raises:
        OpenLockError: If there is no such schema, or the layout does not fit it.

    Example:
        >>> cc4 = room("CC4", layout="trial7")
        >>> [cc4.step(action).outcome for action in ("LOWERLEFT", "UPPERRIGHT", "door")]
        ['the lever moves', 'the door unlocks', 'the door opens: a new solution']
        >>> cc4.solutions_found
        (('LOWERLEFT', 'UPPERRIGHT'),)
    """
    found = declared(schema)
    if seed is not None:
        seed = whole_number(seed, "seed")
    attempt_limit = whole_number(attempt_limit, "attempt_limit", 1)
    if action_limit is not None:
        action_limit = whole_number(action_limit, "action_limit", 1)
    env = OpenLockEnv(
        found,
        first_layout(found) if layout is None else layout,
        reward=PAPER_REWARD,
        episode="trial",
        attempt_limit=attempt_limit,
        action_limit=action_limit,
        reveal=True,  # the room shows solutions by their positions, and names its layout
    )
    return PlayableRoom(found, env, seed, reveal)

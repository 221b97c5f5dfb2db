"""A room to try out by hand, in a notebook or a terminal: it shows itself after every action.

The rules are those of :class:`~causal_openlock.envs.single.OpenLockEnv` with whole trials as
episodes: an attempt that has ended is followed by the next one in the same room, until all
solutions are found or no attempt is left.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causal_openlock.envs.settings import ATTEMPT_LIMIT
from causal_openlock.envs.single import OpenLockEnv
from causal_openlock.errors import OpenLockError
from causal_openlock.files.validation import whole_number
from causal_openlock.render.paint import Panel, ShownAction, room_text
from causal_openlock.schemas.finding import schema as declared
from causal_openlock.wording import counted
from causal_openlock.world.rewards import PAPER_REWARD
from causal_openlock.world.room import Layout, action_index, action_names, first_layout


@dataclass(frozen=True, eq=False, repr=False)
class Seen:
    """Result of an action; it shows the room right after the action, before any reset."""

    #: ``[2P + 2]`` bits: levers pushed, levers grey, door locked, door open
    observation: NDArray[np.int8]
    outcome: str  #: what came of the action, in words
    reward: float  #: by the paper's rule
    new_solution: bool  #: whether a solution was completed that had not been found before
    attempt_over: bool  #: whether the attempt ended with it; the next action begins another
    trial_over: bool  #: whether the trial ended with it
    panel: Panel  #: the console then
    #: the action, its result and, where it is revealed, the schema's lever at that position, which
    #: no learner sees
    title: str

    def __repr__(self) -> str:
        return f"{self.title}\n{_text(self.observation, self.panel)}"


def _text(observation: NDArray[np.int8], panel: Panel) -> str:
    """A room and its console as plain text."""
    found = [how for how in panel.solutions if how]
    lines = [
        room_text(observation, len(observation) // 2 - 1).rstrip(),
        f"{len(found)} of {counted(len(panel.solutions), 'solution')} found; "
        f"{counted(panel.attempts_left or 0, 'attempt')} and "
        f"{counted(panel.actions_left, 'action')} left",
    ]
    return "\n".join([*lines, *(f"found: {how}" for how in found)])


class PlayableRoom:
    """A room to try out; see :func:`room`.

    Attributes:
        schema: Its schema.
        positions: Number of positions, P.
        layout: The positions of its levers.
        actions: The names of all actions, by index.
        observation: ``[2P + 2]`` bits, as of :class:`Seen`, of the room now.
        solutions_found: The solutions found in this trial, as the positions to push.
    """

    def __init__(self, env: OpenLockEnv, seed: int | None, reveal: bool) -> None:
        self._env, self._reveal = env, reveal
        self.schema, self.positions = env.settings.schema, env.settings.positions
        self.actions = tuple(name.replace("_", " ") for name in action_names(self.positions))
        self._begin(env.reset(seed=seed))

    def reset(self) -> PlayableRoom:
        """Begin a new trial; with the layout ``random``, in another room. Returns the room."""
        self._begin(self._env.reset())
        return self

    def _begin(self, seen: tuple[NDArray[np.int8], dict[str, Any]]) -> None:
        self.observation, self._info = seen
        self._places = dict(self._info["latent"]["layout"])
        layout = Layout.of(self.schema, self._places, self.positions)
        self.layout = Layout.of(self.schema, layout.places, self.positions)  # with its name
        self.solutions_found: tuple[tuple[str, ...], ...] = ()
        self._done: list[ShownAction] = []

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
        before, known = self.observation, self._info["latent"]["found"]
        self.observation, reward, *_, self._info = self._env.step(chosen)
        seen = self._info.get("outcome", self.observation)  # right after the action
        new = {*self._info["latent"]["found"]} - {*known}
        for index in new:
            found = self.schema.solutions[index]
            self.solutions_found += (tuple(self._places[lever] for lever in found),)
        shown = ShownAction.of(self.actions[chosen], before, seen, bool(new))
        self._done.append(shown)
        title, panel = f"{shown.name}: {shown.outcome}", self.panel
        for lever, place in self._places.items():
            if self._reveal and shown.name.endswith(f" {place}"):
                title += f" (hidden from learners: this is {lever})"
        if attempt_over := "outcome" in self._info:
            panel, self._done = replace(panel, actions_left=0), []
        return Seen(seen, shown.outcome, reward, bool(new), attempt_over, self.over, panel, title)

    @property
    def panel(self) -> Panel:
        """The console now."""
        console = self._info["console"]
        return Panel(
            solutions=(*map(", ".join, self.solutions_found), *[""] * console["solutions_left"]),
            attempts_left=console["attempts_left"] if console["solutions_left"] else None,
            actions_left=0 if self.over else console["actions_left"],
            actions=tuple(self._done),
        )

    def __repr__(self) -> str:
        return f"{self.schema.name} in {self.layout.name}\n{_text(self.observation, self.panel)}"


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
    env = OpenLockEnv(
        found,
        first_layout(found) if layout is None else layout,
        reward=PAPER_REWARD,
        episode="trial",
        attempt_limit=attempt_limit,
        action_limit=action_limit,
        reveal=True,  # the room shows solutions by their positions, and names its layout
    )
    return PlayableRoom(env, None if seed is None else whole_number(seed, "seed"), reveal)

"""A room: the machine of a schema with its levers at positions.

A room has seven positions (larger rooms up to twelve), each with a lever. A *layout* assigns a
position to each active lever of a schema; every other position has an inactive lever, which never
moves. A learner sees positions and colours, never roles: observations and actions are indexed by
position, in the paper's order.

* Observation, ``2P + 2`` bits: for each position whether its lever is pushed, for each position
  whether its lever is grey (active), whether the door is locked, whether it is open.
* Action, one of ``2P + 1``: push the lever at position *p* (index *p*), pull it (``P + p``), or
  push the door (``2P``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from causal_openlock.errors import ExperimentError
from causal_openlock.schemas.fsm import FSM, BoolArray, IntArray, compile_schema
from causal_openlock.schemas.schema import MAX_LEVERS, Schema
from causal_openlock.wording import counted, nearest
from causal_openlock.world.facts import room_facts

PAPER_POSITIONS = ("UPPERRIGHT", "UPPER", "UPPERLEFT", "LEFT", "LOWERLEFT", "LOWER", "LOWERRIGHT")
RANDOM_LAYOUT: Literal["random"] = "random"


def position_names(positions: int) -> tuple[str, ...]:
    """Names of the positions of a room: the paper's for seven, ``P0``... in larger rooms.

    >>> position_names(7)[:3], position_names(8)[:3]
    (('UPPERRIGHT', 'UPPER', 'UPPERLEFT'), ('P0', 'P1', 'P2'))

    Raises:
        ExperimentError: If no room can have this number of positions.
    """
    if positions == len(PAPER_POSITIONS):
        return PAPER_POSITIONS
    if len(PAPER_POSITIONS) < positions <= MAX_LEVERS:
        return tuple(f"P{index}" for index in range(positions))
    raise ExperimentError(
        f"a room has {len(PAPER_POSITIONS)} to {MAX_LEVERS} positions, not {positions}"
    )


def positions_for(schema: Schema) -> int:
    """The size of the smallest room that holds all levers of a schema."""
    return max(len(PAPER_POSITIONS), len(schema.levers))


def action_names(positions: int) -> tuple[str, ...]:
    """Names of the actions by index: pushes, pulls, and the push of the door.

    >>> action_names(7)[0], action_names(7)[-1]
    ('push_UPPERRIGHT', 'push_door')
    """
    names = position_names(positions)
    return (*(f"{verb}_{name}" for verb in ("push", "pull") for name in names), "push_door")


def action_index(action: str | int, positions: int) -> int:
    """An action by its index or its name; a position alone, and the door, are pushed.

    >>> action_index("push_UPPER", 7), action_index("pull UPPER", 7), action_index("door", 7)
    (1, 8, 14)

    Raises:
        ExperimentError: If there is no such action; the message names the nearest.
    """
    names = action_names(positions)
    if isinstance(action, str):
        lower = [name.lower() for name in names]
        asked = "_".join(action.lower().split())
        for name in (asked, f"push_{asked}"):
            if name in lower:
                return lower.index(name)
        written = names if "_" in action else [name.replace("_", " ") for name in names]
        raise ExperimentError(f"there is no action {action!r}; {nearest(action, written)}")
    is_number = isinstance(action, int | np.integer) and not isinstance(action, bool)
    if not is_number or not 0 <= action < len(names):
        raise ExperimentError(f"there is no action {action!r}; actions are 0 to {len(names) - 1}")
    return int(action)


def position_coordinates(positions: int) -> NDArray[np.float64]:
    """``[P, 2]`` centre of each lever in units of one arm link, the arm's base at (0, 0), y up.

    Seven positions are placed as in the paper's Figure 2a, with the door on the right, more on a
    circle with the same gap for the door.

    >>> position_coordinates(8)[0].round(2)
    array([2.42, 2.42])
    """
    if positions == len(PAPER_POSITIONS):
        return np.array([room_facts()["positions"][name] for name in PAPER_POSITIONS], dtype=float)
    position_names(positions)
    angles = math.pi / 4 + np.arange(positions) * (3 * math.pi / 2) / (positions - 1)
    radius = 3.0 * positions / len(PAPER_POSITIONS)
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


@cache
def _published() -> dict[str, tuple[int, ...]]:
    """The layouts that the paper's authors published, by name."""
    layouts = room_facts()["layouts"].items()
    return {name: tuple(map(PAPER_POSITIONS.index, at.values())) for name, at in layouts}


@cache
def published_layouts(schema: Schema) -> dict[str, Layout]:
    """The layouts that the paper's authors published for this number of levers, by name."""
    fitting = [name for name, at in _published().items() if len(at) == len(schema.levers)]
    return {name: Layout.of(schema, name) for name in fitting}


@dataclass(frozen=True)
class Layout:
    """The positions of the active levers.

    Example:
        >>> Layout((0, 1, 2)).name
        'UPPERRIGHT UPPER UPPERLEFT'
    """

    places: tuple[int, ...]  #: position of each lever, in the order of ``schema.levers``
    positions: int = len(PAPER_POSITIONS)  #: how many the room has
    name: str = ""  #: a published name such as ``trial7``; otherwise the positions by name

    def __post_init__(self) -> None:
        names = position_names(self.positions)
        at = [names[i] if 0 <= i < self.positions else str(i) for i in self.places]
        if len({*at} & {*names}) < len(at):
            raise ExperimentError(
                f"each lever has its own position of the {self.positions} in the room, and here "
                f"they are at {', '.join(at)}"
            )
        if not self.name:
            object.__setattr__(self, "name", " ".join(at))

    @classmethod
    def of(cls, schema: Schema, layout: LayoutForm, positions: int | None = None) -> Layout:
        """A layout for a schema, in a room of the given or the least number of positions.

        Args:
            schema: The schema of the levers.
            layout: A published name, ``trial1`` .. ``trial11``, which fits any schema with as many
                levers; ``{lever: position name}``; or the positions of the levers in order, by
                index, or by name in a text, as records have them.
            positions: By default those of the layout, or as many as hold the levers.

        Raises:
            ExperimentError: If it does not fit the schema or puts two levers at one position.

        Example:
            >>> from causal_openlock import find_schema
            >>> Layout.of(find_schema("CC3"), "trial1").as_mapping(find_schema("CC3"))
            {'L0': 'UPPERRIGHT', 'L1': 'LOWERLEFT', 'L2': 'UPPERLEFT'}
        """
        least = layout.positions if isinstance(layout, Layout) else positions_for(schema)
        positions = positions or least
        names, published = position_names(positions), _published()
        places: tuple[int, ...] = ()
        name = ""
        if isinstance(layout, Layout):
            places, name = layout.places, layout.name if layout.name in published else ""
        elif isinstance(layout, str) and layout in published:
            places, name = published[layout], layout
        elif isinstance(layout, str) and {*layout.split()} <= {*names}:
            places = tuple(map(names.index, layout.split()))
        elif isinstance(layout, Mapping) and {*layout} == {*schema.levers}:
            for lever, place in layout.items():
                if place not in names:
                    raise ExperimentError(
                        f"{lever} cannot be at {place!r}; {nearest(str(place), names)}"
                    )
            places = tuple(names.index(layout[lever]) for lever in schema.levers)
        elif isinstance(layout, list | tuple) and all(isinstance(place, int) for place in layout):
            places = tuple(layout)
            name = next((name for name in published if published[name] == places), "")
        if len(places) != len(schema.levers):
            does = f"places {counted(len(places), 'lever')}" if places else "does not"
            fitting = nearest(str(layout), published_layouts(schema))
            raise ExperimentError(
                f"a layout of {schema.name} gives a position to each of "
                f"{', '.join(schema.levers)}, and {layout!r} {does}; write {{lever: position}}, "
                f"{RANDOM_LAYOUT}, or a published one; {fitting}"
            )
        return cls(places, positions, name)

    @classmethod
    def random(
        cls, schema: Schema, generator: np.random.Generator, positions: int | None = None
    ) -> Layout:
        """A layout drawn uniformly from all of a room."""
        positions = positions or positions_for(schema)
        places = generator.permutation(positions)[: len(schema.levers)]
        return cls(tuple(places.tolist()), positions)

    def as_mapping(self, schema: Schema) -> dict[str, str]:
        """The layout as ``{lever: position name}``."""
        names = position_names(self.positions)
        return dict(zip(schema.levers, (names[place] for place in self.places), strict=True))

    def lever_at(self) -> IntArray:
        """``[P]`` the index of the lever at each position; inactive ones come after the active."""
        inactive = [place for place in range(self.positions) if place not in self.places]
        return np.argsort([*self.places, *inactive])

    def role_actions(self) -> IntArray:
        """``[2P + 1]`` the machine's action for each of the room's actions.

        An action on an inactive lever, which never moves anything, maps to the machine's number of
        actions.
        """
        lever, levers = self.lever_at(), len(self.places)
        push, pull = (np.where(lever < levers, lever + n, 2 * levers + 1) for n in (0, levers))
        return np.concatenate([push, pull, [2 * levers]])

    def observations(self, fsm: FSM, states: IntArray) -> NDArray[np.int8]:
        """``[len(states), 2P + 2]`` the observation in each of these states of the machine."""
        lever = self.lever_at()
        grey = np.tile(lever < len(self.places), (len(states), 1))
        pushed = (states[:, None] >> lever & 1) * grey
        door = np.column_stack([~fsm.unlocked[states], fsm.opened[states]])
        return np.hstack([pushed, grey, door]).astype(np.int8)


LayoutForm = str | Mapping[str, str] | Sequence[int] | Layout
"""Forms of a layout that :meth:`Layout.of` takes."""


def first_layout(schema: Schema) -> Layout:
    """The first published layout that fits, or else the levers in their order."""
    in_order = [*range(len(schema.levers))]
    return next(iter(published_layouts(schema).values()), None) or Layout.of(schema, in_order)


@dataclass(frozen=True, eq=False)
class Room:
    """A schema in a layout: the machine's tables by position. S states, P positions.

    Example:
        >>> from causal_openlock import find_schema
        >>> room = Room.of(find_schema("CC3"), "trial1")
        >>> room.action_of(["L0", "L1"])  # push both levers, then the door
        [0, 4, 14]
    """

    schema: Schema
    layout: Layout

    @classmethod
    def of(cls, schema: Schema, layout: LayoutForm, positions: int | None = None) -> Room:
        """Place the levers of a schema; see :meth:`Layout.of`."""
        return cls(schema, Layout.of(schema, layout, positions))

    @property
    def positions(self) -> int:
        """Number of positions, P."""
        return self.layout.positions

    @cached_property
    def fsm(self) -> FSM:
        """The machine."""
        return compile_schema(self.schema)

    @cached_property
    def next_state(self) -> IntArray:
        """``[S, 2P + 1]`` the state after an action that takes effect."""
        stay = np.arange(self.fsm.states)[:, None]
        return np.hstack([self.fsm.next_state, stay])[:, self.layout.role_actions()]

    @cached_property
    def observation(self) -> NDArray[np.int8]:
        """``[S, 2P + 2]`` the observation in each state."""
        return self.layout.observations(self.fsm, np.arange(self.fsm.states))

    @property
    def active(self) -> BoolArray:
        """``[P]`` whether the lever at each position is active (grey)."""
        return self.layout.lever_at() < len(self.schema.levers)

    def action_of(self, levers: Sequence[str]) -> list[int]:
        """The room's actions that push these levers and then the door."""
        places = dict(zip(self.schema.levers, self.layout.places, strict=True))
        return [*(places[lever] for lever in levers), 2 * self.positions]

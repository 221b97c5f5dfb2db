"""A schema's room that is played by movements of the arm.

The room's state is read from the bodies: which levers are beyond the middle of their tracks,
whether the door is open. The schema's machine decides what can move in a state. That is unlocked
and all else is locked, also in the middle of a movement, when a lever passes the middle of its
track.

>>> from causal_openlock import find_schema
>>> from causal_openlock.schemas.fsm import compile_schema
>>> schema = find_schema("CC3")
>>> room = PhysicalRoom(compile_schema(schema), Layout((0, 1, 2), 7))
>>> room.act(0).finished, room.state
(True, 1)
"""

from __future__ import annotations

from causal_openlock.physics.controller import BUDGET, Controller, Movement, Watch
from causal_openlock.physics.geometry import Pose, RoomGeometry
from causal_openlock.physics.world import World
from causal_openlock.schemas.fsm import FSM
from causal_openlock.world.room import Layout


class PhysicalRoom:
    """One room, its bodies included, in which a machine locks and unlocks.

    Attributes:
        geometry: Where everything is.
        world: The bodies of the attempt in progress.
        budget: Steps of the simulation that a movement may take.
        watch: Called with the pose after every step of the simulation, if it is set: the frames
            of a film, 1/120 of a unit of time apart.
    """

    def __init__(self, fsm: FSM, layout: Layout) -> None:
        self._fsm, self._layout = fsm, layout
        self.geometry, self.budget = RoomGeometry.of(layout.positions), BUDGET
        self.watch: Watch | None = None
        self.reset()

    @property
    def state(self) -> int:
        """The state of the machine that the bodies are in."""
        state = int(self.world.door.opened) << self._fsm.levers
        for role, place in enumerate(self._layout.places):
            state |= self.world.levers[place].pushed << role
        return state

    def pose(self) -> Pose:
        """Pose of all bodies, to draw them."""
        return self.world.pose()

    def reset(self) -> None:
        """Put everything back: new bodies, so that no attempt depends on those before."""
        self.world = World(self.geometry, self._layout.places)
        self._controller = Controller(self.world, self._set_locks)
        self._stuck = -1
        self._set_locks()

    def act(self, action: int, yields: bool = True) -> Movement:
        """Carry out one of the room's ``2P + 1`` actions.

        What it aims at gives way if the machine unlocks it and ``yields`` is true; luck decides
        that where a schema leaves something to chance.
        """
        positions = self._layout.positions
        door = action == 2 * positions
        self._stuck = -1 if yields else (positions if door else action % positions)
        self._set_locks()
        movement = self._controller.carry_out(action, self.budget, self.watch)
        self._stuck = -1
        self._set_locks()
        return movement

    def _set_locks(self) -> None:
        """Lock and unlock as the machine says for the state that the bodies are in."""
        state, levers = self.state, self._fsm.levers
        chance = self._fsm.chance[state]
        for role, place in enumerate(self._layout.places):
            # What can move from here: a pulled lever outward, a pushed one inward.
            pushed = state >> role & 1
            free = chance[levers + role if pushed else role] > 0.0
            self.world.levers[place].lock(not free or place == self._stuck)
        unlocked = bool(self._fsm.unlocked[state])
        self.world.indicator = not unlocked
        self.world.door.lock(not unlocked or self._stuck == self._layout.positions)

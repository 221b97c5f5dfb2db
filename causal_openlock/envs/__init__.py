"""The room as a Gymnasium environment, one or thousands at once.

``gymnasium.make("causal_openlock/OpenLock-v0", schema="CC4", layout="trial7")`` gives one room,
``gymnasium.make_vec(..., num_envs=16384, vectorization_mode="vector_entry_point")`` many. Both step
:mod:`causal_openlock.world.rooms`.

An *episode* is either one attempt or a whole trial:

* ``episode="attempt"``: it terminates when the door opens or no action is left; the attempts that
  follow belong to other episodes. ``reset`` begins the next attempt in the same room; once every
  solution is found or no attempt is left, it begins a new trial.
* ``episode="trial"``: it terminates when every solution is found and is truncated when no attempt
  is left. After each attempt the room is reset, and the observation is that of the room after the
  reset; the one before it is in ``info["outcome"]``.

With ``physics=True`` a single room is simulated: an action is a whole movement of an arm
(:mod:`causal_openlock.physics`), and the observation follows from the simulated levers and door.

:class:`OpenLockTextEnv` has a room in words, as ``causal_openlock/OpenLockText-v0``.

:func:`~causal_openlock.envs.playable.room` gives a room to try out by hand.

``reset(seed=...)`` and ``reset(options={"new_trial": True})`` always begin a new trial. ``info``
holds the console, which people also see. On the console, the present attempt counts as left until
the trial is over. What learners must not see (schema, layout, solutions) is in ``info["latent"]``,
for analysis, only in an environment made with ``reveal=True``.
"""

from __future__ import annotations

from causal_openlock.envs.single import OpenLockEnv
from causal_openlock.envs.text import OpenLockTextEnv
from causal_openlock.envs.vector import OpenLockVectorEnv

__all__ = ["OpenLockEnv", "OpenLockTextEnv", "OpenLockVectorEnv"]

"""The room as a Gymnasium environment, one or thousands at once.

``gymnasium.make("causal_openlock/OpenLock-v0", schema="CC4", layout="trial7")`` gives one room,
``gymnasium.make_vec(..., num_envs=16384, vectorization_mode="vector_entry_point")`` many. Both step
the tables of :mod:`causal_openlock.world.tables`.

An *episode* is either one attempt or a whole trial:

* ``episode="attempt"``: it terminates when the door opens or the actions are spent; nothing
  follows that a learner could value. ``reset`` begins the next attempt in the same room; once
  every solution is found or no attempt is left, it begins a new trial.
* ``episode="trial"``: it terminates when every solution is found and is truncated when no attempt
  is left. After each attempt the room is put back, and what is returned is the room as it then
  stands; how the attempt ended is in ``info["outcome"]``.

With ``physics=True`` the one room has bodies: an action is a whole movement of a simulated arm
(:mod:`causal_openlock.physics`), and what is seen is where the levers and the door then are.

:class:`MixedRoomsEnv` has rooms of several kinds, one of them in each trial: exported data sets of
transfers are recovered with it.

``reset(seed=...)`` and ``reset(options={"new_trial": True})`` always begin a new trial. ``info``
carries the console, which a person sees too, and under the key ``"latent"`` what no learner may
see: it is for analysis. On the console, the present attempt counts as one that is left, until the
trial is over: then none is.
"""

from __future__ import annotations

from causal_openlock.envs.mixed import MixedRoomsEnv
from causal_openlock.envs.single import OpenLockEnv
from causal_openlock.envs.vector import OpenLockVectorEnv

__all__ = ["MixedRoomsEnv", "OpenLockEnv", "OpenLockVectorEnv"]

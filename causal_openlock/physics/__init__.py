"""The room as a body: an arm of five links, levers on tracks and a door, simulated by pymunk.

The symbolic room says what an action leads to; here an action is a whole movement. The arm swings
round, reaches out, grips a lever, pushes or pulls it along its track, lets go and draws back. The
observation is read from where the bodies then are; the schema's machine decides only which locks
are on. ``OpenLockEnv(physics=True)`` is that room as an environment.

From plain numbers to the whole: :mod:`~causal_openlock.physics.geometry` (where everything is),
:mod:`~causal_openlock.physics.kinematics` (which joint angles bring the arm's end to a point),
:mod:`~causal_openlock.physics.world` (the bodies, all in one space, and a
:class:`~causal_openlock.physics.world.Pose` of them to draw),
:mod:`~causal_openlock.physics.controller` (a movement), :mod:`~causal_openlock.physics.room` (a
schema's room that is played by movements). Only these need pymunk, not geometry and kinematics.
"""

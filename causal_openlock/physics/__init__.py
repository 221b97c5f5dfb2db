"""The room as a body: an arm of five links, levers on tracks and a door, simulated by pymunk.

``geometry`` says where everything is, ``kinematics`` which joint angles bring the arm's end to a
point; ``world`` has the bodies, ``controller`` makes a movement of an action, and ``room`` is a
schema's room that is played by movements. Only the last three need pymunk.
"""

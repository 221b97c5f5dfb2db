"""Rooms of a schema, and rewards.

=============== ===================================================================================
``room``        The machine with its levers at positions: layouts, observations, actions.
``rooms``       Many rooms during trials: tables of their schemas, when attempts and trials end.
``kernel``      The compiled step of many rooms.
``events``      What actions led to, and what is paid for it.
``rewards``     The paper's rewards, as terms that add up; presets by name.
``reward_code`` User-defined reward functions.
``randomness``  A random generator for each subject.
``facts``       Published results and the geometry of the paper's room.
=============== ===================================================================================
"""

"""Rooms of a schema, and rewards.

================= =================================================================================
``room``          The machine with its levers at positions: layouts, observations, actions.
``tables``        Many rooms as one table: a step is a lookup.
``batch``         Many rooms during trials: when attempts and trials end.
``kernel``        The compiled step of a batch.
``rewards``       The paper's rewards, as terms that add up; presets by name.
``reward_table``  What actions led to, reward functions, and their values as one table.
``reward_code``   User-defined reward functions.
``randomness``    A random generator for each subject.
``facts``         Published results and the geometry of the paper's room.
================= =================================================================================
"""

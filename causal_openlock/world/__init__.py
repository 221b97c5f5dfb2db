"""The room and what governs it.

================= =================================================================================
``schema``        The directed graph of levers and a door, and the solutions that follow from it.
``fsm``           The finite state machine that a schema compiles into.
``room``          The machine with levers in their places: layouts, positions, actions.
``tables``        Many rooms as one table: a step is a lookup.
``batch``         Many rooms in the midst of trials: when attempts and trials end.
``kernel``        The compiled step of a batch.
``rewards``       The paper's rewards, as terms that add up; presets by name.
``reward_events`` What rewards pay for.
``reward_code``   Rewards as functions in Python.
``reward_table``  Rewards of all rooms as one table.
``randomness``    A random generator for each subject.
``reference``     Published results and the geometry of the paper's room.
================= =================================================================================
"""

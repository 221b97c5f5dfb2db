"""Results for others: the record in other formats, and all of an experiment as one file.

============= ====================================================================================
``as_csv``    The record as CSV, a line for each attempt.
``replay``    What was seen and paid in every step, from the record alone.
``as_minari`` The record as a Minari data set, for offline reinforcement learning.
``croissant`` What a bundle holds, for programs, and a data card for people.
``bundle``    Everything that it takes to run an experiment again, in one file.
============= ====================================================================================

"""

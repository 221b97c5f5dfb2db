"""Results for others: the record in other formats, and all of an experiment as one file.

============= ====================================================================================
``as_csv``    The record as CSV, a line for each attempt.
``data_card`` What a person asks before using data.
``bundle``    Everything that it takes to run an experiment again, in one file.
============= ====================================================================================

"""

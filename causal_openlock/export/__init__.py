"""Results for others: the record as CSV, and all of an experiment as one file."""

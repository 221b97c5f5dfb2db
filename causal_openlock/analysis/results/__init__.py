"""What came of an experiment, as tables of values: counts, scores, people beside the learners."""

"""What a learner is shown and answers, and how it is found by name."""

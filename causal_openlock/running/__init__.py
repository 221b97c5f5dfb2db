"""Running an experiment: its missing cells are played, by any number of processes."""

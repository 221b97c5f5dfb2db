"""Results folders: what is stored of an experiment, checked whenever it is read."""

"""Rooms of a schema, one or many at a time, and what actions in them are paid."""

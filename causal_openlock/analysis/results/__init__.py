"""Tables that are computed from a record, with people, the ideal observer and chance."""

"""A reward of one's own."""


def eager(events):
    """The door pays, the less the more solutions are found, and every action costs."""
    return 50.0 * events.opens / (1 + events.found) - 0.1

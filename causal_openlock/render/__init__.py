"""Pictures: schemas as printed graphs, rooms as pixels or text."""

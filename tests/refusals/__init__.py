"""What is refused: tables of calls and commands, and what their answers must name."""

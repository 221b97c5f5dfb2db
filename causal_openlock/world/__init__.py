"""The room and what governs it: schema, finite state machine, tables of many rooms, rewards."""

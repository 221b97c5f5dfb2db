"""The room CC4 in trial7, by role: the actions that push its levers, and its solutions."""

L0, L1, L2, L3, WHITE, DOOR = 4, 0, 6, 2, 1, 14
SOLUTIONS = [(L0, L1, DOOR), (L0, L2, DOOR), (L0, L3, DOOR)]
NOTHING = (WHITE, WHITE, WHITE)

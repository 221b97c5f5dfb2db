"""The rooms and rewards of the authors' program, written once more in plain Python."""

from dataclasses import dataclass
from itertools import product

from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.schemas.schema import DOOR
from causal_openlock.world.room import PAPER_POSITIONS, Layout

SCHEMAS = bundled_schemas()
LAYOUTS = {"CC3": "trial3", "CE3": "trial1", "CC4": "trial7", "CE4": "trial10"}
"""One of the published rooms of each schema."""


@dataclass(frozen=True)
class Happened:
    """What one action of the authors' program led to; names of actions are positions."""

    so_far: tuple[str, ...]
    white: bool
    changed: bool
    unlocked: bool


def authors_room(name):
    """Every sequence of three actions in a room of the authors, and the room's solutions."""
    common_cause = name.startswith("CC")
    roles = Layout.of(SCHEMAS[name], LAYOUTS[name]).as_mapping(SCHEMAS[name])
    place_of = [roles[role] for role in sorted(roles)]
    root, others = place_of[0], place_of[1:]
    # As the program's: every push, then every pull, then the door.
    names = [f"{verb} {place}" for verb in ("push", "pull") for place in PAPER_POSITIONS]
    names.append("push door")
    sequences = []
    for sequence in product(names, repeat=3):
        out = set()
        steps = []
        for moment, action in enumerate(sequence):
            verb, place = action.split()
            if common_cause:
                free = place == root or (place in others and root in out)
            else:
                free = place in others or (place == root and bool(out & set(others)))
            moves = free and (verb == "push") == (place not in out)
            if moves:
                out ^= {place}
            unlocked = bool(out & set(others)) if common_cause else root in out
            steps.append(
                Happened(
                    so_far=sequence[: moment + 1],
                    white=place != DOOR and place not in place_of,
                    changed=moves or (place == DOOR and unlocked),
                    unlocked=unlocked,
                )
            )
        sequences.append(steps)
    solutions = [
        (f"push {root}", f"push {other}", "push door")
        if common_cause
        else (f"push {other}", f"push {root}", "push door")
        for other in others
    ]
    return sequences, solutions


def authors_reward(mode, happened, solutions, found):
    """The ladder of section 3.1 of the notes on the authors' environment: the first rung pays."""
    so_far = happened.so_far
    if len(so_far) == 3:
        unique = so_far in solutions and so_far not in found
    else:
        unique = all(solution[: len(so_far)] != so_far for solution in found)
    partial = any(solution[: len(so_far)] == so_far for solution in solutions)
    repeat = len(so_far) > 1 and so_far[-1] == so_far[-2]
    opened = happened.unlocked and so_far[-1] == "push door"
    factor = max(1, 1.5 * len(found))
    if mode.endswith("solution_multiplier"):
        if opened:
            return 50 * factor if unique else 50
        if happened.unlocked:
            return 10 * factor if unique else 10
    elif mode.endswith("unique_solutions"):
        if opened and unique:
            return 50
        if happened.unlocked and unique:
            return 10
    elif opened:
        return 50
    elif happened.unlocked:
        return 10
    if "partial_action_seq" in mode and partial:
        return 1
    if mode.startswith("change_state") and happened.changed:
        return 0.5
    if mode.endswith("negative_repeat") and repeat:
        return -0.25
    if mode.startswith("negative_immovable") and happened.white:
        return -0.5
    return 0

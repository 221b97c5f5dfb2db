"""The paper's reward terms, written once more in plain Python."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

from causal_openlock.schemas.schema import DOOR, Schema


def plain_paper_rewards(
    schema: Schema, terms: Sequence[str], words: Sequence[str], found: frozenset[frozenset[str]]
) -> list[float]:
    """Rewards of one attempt in a room that leaves nothing to chance, until it is over."""

    def holds(node: str, pushed: set[str]) -> bool:
        causes = schema.causes(node)
        return not causes or sum(c in pushed for c in causes) >= schema.threshold(node)

    def pushable_first(lever: str) -> bool:
        for solution in schema.solutions:
            for order in permutations(solution):
                done: set[str] = set()
                for step in order:
                    if not holds(step, done):
                        break
                    done.add(step)
                else:
                    if order[0] == lever:
                        return True
        return False

    solutions = [frozenset(solution) for solution in schema.solutions]
    pushed: set[str] = set()
    rewards = []
    for moment, word in enumerate(words):
        locked = not holds(DOOR, pushed)
        lever, pull = word.removeprefix("-"), word.startswith("-")
        opens = word == DOOR and not locked
        changed = opens
        if lever in schema.levers and holds(lever, pushed) and pull == (lever in pushed):
            pushed ^= {lever}
            changed = True
        unlocks = locked and holds(DOOR, pushed)
        stands = frozenset(pushed - set(schema.inert))
        new = (unlocks or opens) and stands in solutions and stands not in found
        begins = moment == 0 and changed and not pull and pushable_first(lever)
        paid = 10.0 * unlocks + 50.0 * opens
        total = 0.0
        for term in terms:
            if term == "basic":
                total += paid
            elif term == "unique_solutions":
                total -= 0 if new else paid
            elif term == "state_change":
                if changed and not (begins and "partial_sequence" in terms):
                    total += 0.5
            elif term == "negative_immovable":
                total -= 0 if changed else 0.5
            elif term == "negative_repeat":
                total -= 0.25 if moment and word == words[moment - 1] else 0
            elif term == "partial_sequence":
                total += 1 if begins else 0
            elif term == "solution_multiplier":
                total += paid * (1.5 ** len(found) - 1) if new else 0
            else:
                raise AssertionError(term)
        rewards.append(total)
        if opens:
            break
    return rewards

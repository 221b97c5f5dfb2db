"""What a plan promises is what it brings: by plain recursion, and by playing it to the end."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np
import pytest

from causal_openlock.belief.hypotheses import RoomSight, Strengths, enumerate_space, strengths
from causal_openlock.belief.planning import Objective, Planner, Situation
from causal_openlock.belief.structures import Hypotheses
from causal_openlock.schemas.schema import Gate, Schema
from support.belief_by_hand import DOOR_SLOT, Outcome, World, entropy, hypothesis_of, plain_of

CERTAIN = strengths(0.0, 1.0, 1.0, 1)
UNSURE = strengths(0.5, 4.0, 1.0, 2)
Belief = dict[int, float]


class Room:
    """Some hypotheses and what each says would happen."""

    def __init__(self, hypotheses: Hypotheses, how: Strengths) -> None:
        self.hypotheses, self.how = hypotheses, how
        self.positions = hypotheses.causes.shape[1] - 1
        self.worlds = [
            World.of(hypotheses, index, float(how.value[hypotheses.strength[index]]))
            for index in range(len(hypotheses))
        ]

    def branches(
        self, belief: Belief, pushed: int, slot: int, found: Sequence[int]
    ) -> dict[Outcome, Belief]:
        """What can come of an action, and what is believed then, in shares of the belief."""
        after: dict[Outcome, Belief] = defaultdict(dict)
        for index, weight in belief.items():
            for outcome, chance in self.worlds[index].outcomes(pushed, slot, found).items():
                after[outcome][index] = weight * chance
        return after

    def value(
        self, belief: Belief, at: Situation, slot: int, information: float, beta: float
    ) -> float:
        """What an action is worth with all that can follow, by definition."""
        after = self.branches(belief, at.pushed, slot, at.found)
        if not any(outcome.took_effect for outcome in after):
            return 0.0
        total = sum(belief.values())
        worth = information * entropy(belief.values())
        for outcome, rest in after.items():
            chance = sum(rest.values()) / total
            worth += chance * (beta * outcome.new - information * entropy(rest.values()))
            if at.left > 1 and not (slot == DOOR_SLOT and outcome.took_effect):
                then = Situation(outcome.pushed, outcome.unlocked, at.left - 1, at.found)
                worth += chance * max(
                    0.0, *(self.value(rest, then, s, information, beta) for s in self.slots(then))
                )
        return worth

    def slots(self, at: Situation) -> list[int]:
        levers = [slot for slot in range(self.positions) if not at.pushed >> slot & 1]
        return [*levers, DOOR_SLOT] if at.unlocked else [*levers, DOOR_SLOT][:-1]

    def values(self, belief: Belief, at: Situation, objective: Objective) -> np.ndarray:
        """The planner's values of this belief."""
        which = np.array(list(belief))
        planner = Planner(self.hypotheses[which], self.how, objective)
        return planner.values(np.array(list(belief.values())), at)

    def moments(self, rng: np.random.Generator, attempts: int, left: int) -> Iterator[
        tuple[Belief, Situation]
    ]:  # fmt: skip
        """What a subject believes, and where it stands, in some attempts of random actions."""
        weights = rng.dirichlet(np.full(len(self.worlds), 0.7))
        belief = dict(enumerate(weights.tolist()))
        truth = int(rng.choice(len(weights), p=weights))
        found: tuple[int, ...] = ()
        for _ in range(attempts):
            at = Situation(0, False, left, found)
            while at.left:
                yield belief, at
                slots = self.slots(at)
                slot = slots[-1] if at.unlocked and rng.random() < 0.6 else int(rng.choice(slots))
                own = self.worlds[truth].outcomes(at.pushed, slot, at.found)
                outcome = list(own)[int(rng.choice(len(own), p=list(own.values())))]
                belief = self.branches(belief, at.pushed, slot, at.found)[outcome]
                if outcome.new:
                    found = (*found, outcome.pushed)
                opened = slot == DOOR_SLOT and outcome.took_effect
                at = Situation(
                    outcome.pushed, outcome.unlocked, 0 if opened else at.left - 1, at.found
                )


def some_room(seed: int, unsure: bool, many: int) -> tuple[Room, np.random.Generator]:
    """Some hypotheses about a few levers of which not all need be active."""
    rng = np.random.default_rng(seed)
    how = UNSURE if unsure else CERTAIN
    sight = [RoomSight(3, 3, 2, 3), RoomSight(3, 2, 1, 3), RoomSight(4, 4, 3, 3)][seed % 3]
    space = enumerate_space(sight, how, 0.7, 20_000)
    chosen = np.sort(rng.choice(len(space), size=min(many, len(space)), replace=False))
    return Room(space.hypotheses[chosen], how), rng


@pytest.mark.parametrize("unsure", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_values_are_those_of_plain_recursion(seed, unsure):
    room, rng = some_room(seed, unsure, many=8)
    for belief, at in room.moments(rng, attempts=2, left=3):
        for information, beta in ((1.0, 3.0), (1.0, 0.0), (0.0, 1.0)):
            ours = room.values(belief, at, Objective(information, beta))
            may = room.slots(at)
            assert np.isneginf(ours).tolist() == [
                slot not in may for slot in [*range(room.positions), DOOR_SLOT]
            ]
            for slot in may:
                expected = room.value(belief, at, slot, information, beta)
                assert ours[slot] == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("unsure", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_a_plan_played_out_brings_the_information_and_the_solutions_it_promises(seed, unsure):
    room, rng = some_room(seed + 100, unsure, many=12)
    objective = Objective(1.0, 2.0)

    def played(belief: Belief, at: Situation) -> tuple[float, float]:
        """Expected entropy in the end, and probability of a new solution."""
        values = room.values(belief, at, objective) if at.left else np.zeros(1)
        total = sum(belief.values())
        if values.max() <= 1e-12:
            return entropy(belief.values()), 0.0
        slot = int(values.argmax())
        slot = DOOR_SLOT if slot == room.positions else slot
        bits = solved = 0.0
        for outcome, rest in room.branches(belief, at.pushed, slot, at.found).items():
            chance = sum(rest.values()) / total
            over = slot == DOOR_SLOT and outcome.took_effect
            then = Situation(outcome.pushed, outcome.unlocked, 0 if over else at.left - 1, at.found)
            of_rest = played(rest, then)
            bits += chance * of_rest[0]
            solved += chance * (outcome.new + of_rest[1])
        return bits, solved

    for belief, at in room.moments(rng, attempts=2, left=3):
        if at.left == 3:
            bits, solved = played(belief, at)
            promised = room.values(belief, at, objective).max()
            gained = entropy(belief.values()) - bits
            assert max(promised, 0) == pytest.approx(gained + 2.0 * solved, abs=1e-7)


@pytest.mark.parametrize("unsure", [False, True])
def test_a_horizon_of_one_looks_at_the_next_action_alone(unsure):
    room, rng = some_room(3, unsure, many=10)
    for belief, at in room.moments(rng, attempts=2, left=3):
        ours = room.values(belief, at, Objective(1.0, 3.0, horizon=1))
        last = Situation(at.pushed, at.unlocked, 1, at.found)
        for slot in room.slots(at):
            assert ours[slot] == pytest.approx(room.value(belief, last, slot, 1.0, 3.0), abs=1e-9)
        far = room.values(belief, at, Objective(1.0, 3.0, horizon=9))
        assert far.tolist() == room.values(belief, at, Objective(1.0, 3.0)).tolist()


def test_the_door_is_worth_its_new_solution_and_what_it_tells():
    # L0 alone opened the door. With L1 pushed too this is the same solution if L1 does nothing,
    # and another one if both are asked for.
    alone = Schema("alone", ["L0", "L1"], {"L0": ["door"]}, inert=["L1"])
    two = Schema("two", ["L0", "L1"], {"L0": ["door"], "L1": ["door"]}, gates={"door": Gate("all")})
    both = [hypothesis_of(plain_of(schema), [0, 1], 2, 0) for schema in (alone, two)]
    room = Room(Hypotheses.joined(both), CERTAIN)
    at = Situation(0b11, True, 1, (0b01,))
    for share in (0.5, 0.2, 1.0):
        belief = {0: 1 - share, 1: share} if share < 1 else {1: 1.0}
        bits = entropy(belief.values())
        assert room.values(belief, at, Objective(1.0, 3.0))[-1] == pytest.approx(bits + 3 * share)
        assert room.values(belief, at, Objective(0.5, 1.0))[-1] == pytest.approx(bits / 2 + share)
        assert room.values(belief, at, Objective(0.0, 1.0))[-1] == pytest.approx(share)


def test_what_nothing_moves_is_worth_nothing_and_what_cannot_be_done_less():
    chain = Schema("chain", ["L0", "L1"], {"L0": ["L1"], "L1": ["door"]})
    room = Room(hypothesis_of(plain_of(chain), [0, 1], 3, 0), CERTAIN)
    values = room.values({0: 1.0}, Situation(0, False, 3, ()), Objective(1.0, 3.0))
    assert values.tolist() == [3.0, 0.0, 0.0, -np.inf]
    values = room.values({0: 1.0}, Situation(0b01, False, 2, ()), Objective(1.0, 3.0))
    assert values.tolist() == [-np.inf, 3.0, 0.0, -np.inf]
    values = room.values({0: 1.0}, Situation(0, False, 2, ()), Objective(1.0, 3.0))
    assert values.tolist() == [0.0, 0.0, 0.0, -np.inf]  # too late

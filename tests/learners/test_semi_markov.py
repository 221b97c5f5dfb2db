"""The semi-Markov DDQN: what it is told of the solutions found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from causal_openlock.experiment.protocol import Condition, Protocol, Trials
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import find_schema
from causal_openlock.world.room import Layout
from openlock_learners.ddqn import DDQN, SemiMarkovDDQN, SemiMarkovDDQNParameters

pytestmark = pytest.mark.slow

CC4 = find_schema("CC4")
ROOM = Condition("room", (Trials(CC4, (Layout.of(CC4, "trial7"),)),))
HUMAN = Protocol("t", attempt_limit=30, stop_when_solved=False)
SMALL = SemiMarkovDDQNParameters(hidden_layers=1, hidden_units=8, batch_size=8)


def begun(
    settings: SemiMarkovDDQNParameters, session: Session, of: type[DDQN] = SemiMarkovDDQN
) -> DDQN:
    learner = of(settings)
    learner.begin(session.brief)
    return learner


def solve(learner: DDQN, session: Session, solutions: list[int]) -> None:
    """Make all subjects open the door in these ways, one after the other."""
    for solution in solutions:
        for action in session.truth.rooms[0].action_of(CC4.solutions[solution]):
            learner.act(session.view)
            learner.learn(session.step(np.full(session.subjects, action)))


@pytest.mark.parametrize("bits", [1, 3, 5])
def test_each_solution_found_sets_one_more_bit_until_all_are_set(bits: int) -> None:
    session = Session(ROOM, HUMAN, 2)
    learner = begun(replace(SMALL, solution_bits=bits), session)
    assert learner.q.online.sizes[0] == 16 + bits
    solve(learner, session, [0, 0, 2, 1, 1])  # those found again do not count
    rows = learner._table.rows[learner._replay.rings[0, 1, :15].astype(int)]
    counts = np.repeat([0, 1, 1, 2, 3], 3)
    assert rows[:, 16:].tolist() == [
        [float(bit < count) for bit in range(bits)] for count in counts
    ]
    assert np.array_equal(rows[0:3, :16], rows[3:6, :16])


def test_the_bits_are_cleared_in_the_next_trial() -> None:
    session = Session(ROOM, replace(HUMAN, attempt_limit=3, baseline_loops=2), 1)
    learner = begun(SMALL, session)
    solve(learner, session, [0, 1, 2, 0])
    rows = learner._table.rows[learner._replay.rings[0, 0, :12].astype(int)]
    assert rows[:, 16:].sum(axis=1).tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2, 0, 0, 0]


@pytest.mark.parametrize("over_attempts", [False, True])
def test_what_follows_a_solution_knows_of_it(over_attempts: bool) -> None:
    session = Session(ROOM, HUMAN, 1)
    learner = begun(replace(SMALL, bootstrap_over_attempts=over_attempts), session)
    solve(learner, session, [0, 1])
    rows = learner._table.rows[learner._replay.rings[2, 0, :6].astype(int)]
    assert rows[:, 16:].sum(axis=1).tolist() == [0, 0, 1, 1, 1, 2]


def test_with_its_count_it_can_value_one_room_in_two_ways() -> None:
    """A room pays until a solution is found, and then no more: only the count tells."""
    session = Session(ROOM, replace(HUMAN, attempt_limit=400), 4, reward="unique_solutions")
    settings = SemiMarkovDDQNParameters(
        hidden_layers=2, hidden_units=32, learning_rate=0.003, batch_size=32
    )
    learner = begun(settings, session)
    attempts = session.truth.rooms[0].action_of(CC4.solutions[0])
    rng = np.random.default_rng(0)
    start = session.view.observation[:1]
    for attempt in range(400):
        for action in attempts if attempt < 3 or rng.random() < 0.3 else rng.integers(15, size=3):
            learner.act(session.view)
            learner.learn(session.step(np.full(4, action)))
    worth = []
    for found in (0, 3):
        seen = learner._network_input(start, np.array([found])).astype(np.float32)
        worth.append(learner.q.online(learner._torch.from_numpy(seen)).amax(2).mean().item())
    assert worth[1] < worth[0] / 2
    assert isinstance(learner, DDQN)


@pytest.mark.parametrize(
    ("of", "reward", "share"),
    [
        (DDQN, "basic", 0),
        # Unlocking and opening pay the first time, and not the second; pushing L0 never pays.
        (DDQN, "unique_solutions", 2 / 3),
        (SemiMarkovDDQN, "unique_solutions", 0),
    ],
)
def test_a_solution_carried_out_twice_pays_another_reward(
    of: type[DDQN], reward: str, share: float
) -> None:
    session = Session(ROOM, HUMAN, 2, reward=reward)
    learner = begun(SMALL, session, of)
    solve(learner, session, [1, 1])
    metrics = learner.metrics()
    assert metrics["differing_pairs"] == metrics["differing_transitions"] == share

"""The DDQN against Stable-Baselines3's DQN: networks, batch and steps of the same size.

Ours trains 20 subjects at once and is asked for more than 1,000 steps of each, so that the cheap
beginning (random actions, no gradient yet) counts for little. The peer trains one agent, whose
cost for a step hardly changes, and needs fewer. Every step of an agent is an action and a gradient
step.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium
from measure import Measurement, Row, in_turns, stopwatch

import causal_openlock
from causal_openlock import Condition, Protocol, Session, find_schema

SUBJECTS = 20
ATTEMPTS = 70  # in each of five trials: 1,050 steps of each subject
PEER_STEPS = 600


def ddqn(repeats: int) -> Iterator[Row]:
    """Steps of agents in a second, on one core."""
    play = _ddqn(ATTEMPTS)
    _ddqn(5)()
    peer = _stable_baselines()
    mine, others = in_turns(play, peer, repeats, warm_up=False)
    yield Row(
        "ddqn",
        f"DDQN, {SUBJECTS} subjects at once",
        "steps/s",
        mine,
        "Stable-Baselines3 DQN" if peer else "",
        others,
        note="" if peer else "install stable-baselines3 to compare with it",
    )


def _ddqn(attempts: int) -> Measurement:
    from learners.ddqn import DDQN

    condition = Condition.named("CC4", find_schema)
    protocol = Protocol("benchmark", attempt_limit=attempts, stop_when_solved=False)

    def measure() -> float:
        session = Session(condition, protocol, SUBJECTS)
        with stopwatch() as seconds:
            record = session.play(DDQN())
            took = seconds()
        return len(record["actions"].combine_chunks().flatten()) / took

    return measure


def _stable_baselines() -> Measurement | None:
    try:
        from stable_baselines3 import DQN
    except ImportError:
        return None
    import torch

    environment: Any = gymnasium.make(
        causal_openlock.ENV_ID, schema="CC4", layout="trial7", reward="paper"
    )

    def measure() -> float:
        torch.set_flush_denormal(False)  # ours sets it, the peer does not
        model = DQN(
            "MlpPolicy",
            environment,
            learning_rate=0.001,
            gamma=0.8,
            buffer_size=2000,
            learning_starts=64,
            batch_size=64,
            train_freq=1,
            gradient_steps=1,
            target_update_interval=100,
            policy_kwargs={"net_arch": [128] * 4},
            device="cpu",
            seed=0,
        )
        with stopwatch() as seconds:
            model.learn(PEER_STEPS)
            return PEER_STEPS / seconds()

    return measure

"""The DDQN against Stable-Baselines3's DQN: networks, batch and steps of the same size.

Every step of an agent is an action and a gradient step on 64 transitions. Ours trains 20 subjects
at once and keeps the record; the peer trains one agent. Each is asked for more than 3,000 steps of
an agent: a beginning is cheap (random actions, no gradient yet), and what slows training down
late, such as moments that have decayed to denormal numbers, would stay hidden in a short run.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium
import torch
from measure import Row, in_turns, stopwatch
from stable_baselines3 import DQN

import causal_openlock as ol
from openlock_learners.ddqn import DDQN, DDQNParameters

SUBJECTS = 20
ATTEMPTS = 210  # in each of five trials: 3,150 steps of each subject
PEER_STEPS = 3150


def ddqn(turns: int) -> Iterator[Row]:
    """Steps of agents in a second of one core."""
    torch.set_num_threads(1)
    ours(5)  # once to compile
    case = f"DDQN, {SUBJECTS} subjects at once"
    yield in_turns(case, "steps/s", ours, "Stable-Baselines3's DQN", peer, turns)


def ours(attempts: int = ATTEMPTS) -> float:
    """Train subjects in a session."""
    condition = ol.find_condition("CC4")
    protocol = ol.Protocol("benchmark", attempt_limit=attempts, stop_when_solved=False)
    session = ol.Session(condition, protocol, SUBJECTS)
    with stopwatch() as seconds:
        record = session.play(DDQN(DDQNParameters()))
        took = seconds()
    return len(record["actions"].combine_chunks().flatten()) / took


def peer() -> float:
    """Train one agent in the environment."""
    environment: Any = gymnasium.make(ol.ENV_ID, schema="CC4", layout="trial7", reward="paper")
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

"""The DDQN against Stable-Baselines3's DQN: networks, batch and steps of the same size.

Every step of an agent is an action and a gradient step on 64 transitions. Ours trains 20 subjects
at once, and the record is kept; the peer trains one agent. Both are asked for more than 3,000 steps
of each agent: a beginning is cheap (random actions, no gradient yet), and what slows training down
late, such as moments that have decayed to denormal numbers, would stay hidden in a short run.

On all cores, as many processes with one thread each train 20 subjects each, against as many
processes of the peer's with one agent each. A cell of few subjects is measured against a large one:
what a step costs whatever the number of agents weighs more in it. Where there is a GPU, it trains
160 subjects at once.

Meta-training of ``rl2`` is measured against the same training whose network is plain torch. Except
on a GPU, seconds are the processor's: other work on the machine counts less.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from functools import partial
from importlib.util import find_spec
from multiprocessing import get_context
from typing import Any
from unittest.mock import patch

from measure import Measurement, Row, Target, in_turns, stopwatch

SUBJECTS = 20
FEW = 5
SUBJECTS_ON_GPU = 160
ATTEMPTS = 210  # in each of five trials: 3,150 steps of each subject
PEER_STEPS = 3150
MOST_TURNS = 3  # each takes half a minute
UPDATES = 3  # of a meta-training, of 23,040 actions each


def ddqn(repeats: int) -> Iterator[Row]:
    """Steps of agents in a second, on one core and on all of them."""
    turns = min(repeats, MOST_TURNS)
    theirs = find_spec("stable_baselines3") is not None
    note = f"median of {turns} turns" if theirs else "install stable-baselines3 to compare with it"
    peer_name = "Stable-Baselines3 DQN" if theirs else ""
    _ours(5)
    mine, others = in_turns(_ours, _peer if theirs else None, turns, warm_up=False)
    yield Row(
        "ddqn",
        f"DDQN, {SUBJECTS} subjects at once",
        "steps/s",
        mine,
        peer_name,
        others,
        Target("at least", 25.0) if theirs else None,
        note=note,
    )
    mine, others = in_turns(partial(_ours, ATTEMPTS, FEW), _ours, turns, warm_up=False)
    yield Row(
        "ddqn",
        f"DDQN, {FEW} subjects at once",
        "steps/s",
        mine,
        f"{SUBJECTS} subjects at once",
        others,
        Target("at least", 0.95),
        note=f"median of {turns} turns; what small cells cost",
    )
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    # Processes of their own: what this one has loaded and set does not come along.
    with ProcessPoolExecutor(cores, get_context("spawn")) as pool:
        mine, others = in_turns(
            _everywhere(pool, _ours, cores or 1),
            _everywhere(pool, _peer, cores or 1) if theirs else None,
            turns,
            warm_up=False,
        )
    yield Row(
        "ddqn",
        f"the same on {cores} cores, {SUBJECTS} subjects on each",
        "steps/s",
        mine,
        f"{cores} processes of it" if theirs else "",
        others,
        Target("at least", 12.0) if theirs else None,
        note=note,
    )
    import torch

    if torch.cuda.is_available():
        _ours(20, SUBJECTS_ON_GPU, "cuda")
        yield Row(
            "ddqn",
            f"DDQN, {SUBJECTS_ON_GPU} subjects at once on a GPU",
            "steps/s",
            [_ours(ATTEMPTS, SUBJECTS_ON_GPU, "cuda") for _ in range(turns)],
            target=Target("at least", 200_000, on="ours"),
            note=torch.cuda.get_device_name(),
        )


def meta_training(repeats: int) -> Iterator[Row]:
    """Actions of all rooms in a second of the processor, rooms and updates included."""
    turns = min(repeats, MOST_TURNS)
    _trained(compiled=True, updates=1)
    mine, others = in_turns(
        partial(_trained, compiled=True), partial(_trained, compiled=False), turns, warm_up=False
    )
    yield Row(
        "meta_training",
        "a network of rl2",
        "actions/s",
        mine,
        "its network in plain torch",
        others,
        Target("at least", 4.0),
        note=f"median of {turns} turns",
    )


def _trained(compiled: bool, updates: int = UPDATES) -> float:
    import torch

    from causal_openlock.schemas.finding import bundled
    from openlock_learners.meta.training import MetaTraining
    from openlock_learners.meta.training_file import read_training
    from openlock_learners.networks.denormals import denormals_flushed
    from openlock_learners.networks.ppo import PPO
    from openlock_learners.networks.recurrent_policy import LeverPolicy

    torch.set_num_threads(1)
    file = bundled("experiments") / "meta_training" / "rl2.yaml"
    plain = patch.multiple(
        "openlock_learners.meta.training", CompiledLeverPolicy=LeverPolicy, CompiledPPO=PPO
    )
    with nullcontext() if compiled else plain:
        training = MetaTraining(read_training(file), file.parent)
    with stopwatch(time.process_time) as seconds, denormals_flushed():
        for _ in range(updates):
            training.update()
        return training.actions / seconds()


def _everywhere(
    pool: ProcessPoolExecutor, measure: Callable[..., float], cores: int
) -> Measurement:
    """What processes that work at the same time do together; each has loaded all it needs."""

    def together() -> float:
        list(pool.map(_warm_up, range(cores)))
        return sum(run.result() for run in [pool.submit(measure) for _ in range(cores)])

    return together


def _warm_up(_: int) -> float:
    return _ours(20)


def _ours(attempts: int = ATTEMPTS, subjects: int = SUBJECTS, device: Any = "cpu") -> float:
    from causal_openlock import Condition, Protocol, Session, find_schema
    from openlock_learners.ddqn import DDQN, DDQNParameters

    condition = Condition.named("CC4", find_schema)
    protocol = Protocol("benchmark", attempt_limit=attempts, stop_when_solved=False)
    session = Session(condition, protocol, subjects)
    with stopwatch(time.process_time if device == "cpu" else time.perf_counter) as seconds:
        record = session.play(DDQN(DDQNParameters(device=device)))
        took = seconds()
    return len(record["actions"].combine_chunks().flatten()) / took


def _peer() -> float:
    import gymnasium
    import torch
    from stable_baselines3 import DQN

    import causal_openlock

    environment: Any = gymnasium.make(
        causal_openlock.ENV_ID, schema="CC4", layout="trial7", reward="paper"
    )
    torch.set_num_threads(1)
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
    with stopwatch(time.process_time) as seconds:
        model.learn(PEER_STEPS)
        return PEER_STEPS / seconds()

"""Checkpoints: whether two are one and the same, and a learner that goes on from one."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import torch

from causal_openlock.contract.learner import Learner
from causal_openlock.experiment.session import Session


def same(one: Any, other: Any) -> bool:
    """Whether two checkpoints, or parts of them, are equal to the last bit."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, torch.Tensor):
        return torch.equal(one, other)
    return bool(np.array_equal(one, other))


def kept_and_resumed(
    first: Learner, second: Learner, sessions: list[Session], steps: int
) -> dict[str, Any]:
    """Let a learner play on from a checkpoint of another, both in sessions of one kind.

    Args:
        first: Plays ``sessions[0]``, is kept after so many steps, and plays to the end.
        second: Goes on from there in ``sessions[1]``, in which the same was done.
        sessions: Two that are alike.
        steps: When it is kept.

    Returns:
        The checkpoint, which nothing has changed since.
    """
    first.begin(sessions[0].brief)
    second.begin(sessions[1].brief)
    for _ in range(steps):
        action = first.act(sessions[0].view)
        first.learn(sessions[0].step(action))
        sessions[1].step(action)
    kept = first.state_dict()
    untouched = copy.deepcopy(kept)
    second.load_state_dict(kept)
    for learner, session in ((first, sessions[0]), (second, sessions[1])):
        while not session.over:
            learner.learn(session.step(learner.act(session.view)))
    assert same(first.state_dict(), second.state_dict())
    assert same(kept, untouched)
    return kept

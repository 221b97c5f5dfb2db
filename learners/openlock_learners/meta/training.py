"""Meta-training of ``rl2``: one recurrent network, trained in very many rooms.

As in RL² (Duan et al., 2016; Wang et al., 2016), a recurrent network is trained by policy gradient
over many tasks. How to find out is learned in its weights; how the room at hand works, it finds out
in its hidden state, while the weights stay as they are. A YAML file declares the rooms it meets::

    causal-openlock train experiments/meta_training/rl2.yaml --out rl2.npz

A solution that is new in the trial earns 1, and every action costs a little. Unlocking the door
earns nothing: where that was rewarded, as by the paper's rewards, the network learned to unlock it
again and again and to open it at the last moment.

Duan et al. and Wang et al. maximise what a whole life earns (``credit: life``): what is found out
in one trial and pays in the next is then worth something. By default returns end with the trial.

The checkpoint holds the weights, the sizes of the network and the YAML file. A second file next to
it lets an interrupted training continue as if it had not been interrupted: run the same command
again.
"""

from __future__ import annotations

import io
import pickle
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from causal_openlock.contract.learner import View
from causal_openlock.errors import ExperimentError, in_short
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.seal import SealError, sealed, unsealed
from causal_openlock.schemas.fsm import BoolArray
from openlock_learners.meta.rooms import MetaRooms
from openlock_learners.meta.training_file import TrainingFile
from openlock_learners.networks.lever_policy_compiled import CompiledLeverPolicy, CompiledPPO
from openlock_learners.networks.network_file import write_network
from openlock_learners.networks.perception import Perception
from openlock_learners.networks.ppo import (
    PPO,
    Floats,
    PPOSettings,
    Rollout,
    log_prob,
    sample_actions,
)
from openlock_learners.networks.recurrent_policy import RecurrentPolicy, make_policy

LOG_EVERY = 10.0
"""Seconds between two lines of progress, and between two checkpoints of the training."""


class MetaTraining:
    """A meta-training, as a file declares it, that can be interrupted after any update.

    Schemas are searched in the folder ``beside`` first.
    """

    def __init__(self, file: TrainingFile, beside: Path = Path()) -> None:
        self.file = file
        weights, rooms, policy, order = np.random.default_rng(file.seed).spawn(4)
        self.rooms = MetaRooms(file.distribution(beside), file.at_once, rooms)
        positions, sizes = self.rooms.brief.positions, file.network
        self.network: RecurrentPolicy = (
            CompiledLeverPolicy(sizes, [weights])
            if sizes.kind == "levers"
            else make_policy(sizes, positions, [weights])
        )
        self.trainer = (CompiledPPO if sizes.kind == "levers" else PPO)(
            self.network,
            PPOSettings(
                learning_rate=file.learning_rate,
                gamma=file.gamma,
                gae_lambda=file.decay,
                clip=file.clip,
                epochs=file.epochs,
                minibatches=file.minibatches,
            ),
        )
        self.perception = Perception(self.rooms.brief)
        size = self.network.state_size(self.rooms.brief.positions)
        self._hidden_state = torch.zeros(1, file.at_once, size)
        self._fresh = np.zeros(file.at_once, dtype=bool)
        self._policy, self._order = policy, order
        self.updates = 0
        # By schema: trials that ended, how many of them were solved, their attempts.
        self.tally = np.zeros((3, len(self.rooms.distribution.schemas)))

    @property
    def actions(self) -> int:
        """Actions taken so far in all rooms together."""
        return self.updates * self.file.steps * self.file.at_once

    @property
    def over(self) -> bool:
        """Whether the training budget is used up."""
        return self.actions >= self.file.actions

    def _evaluate(self, inputs: Floats) -> tuple[Tensor, Tensor, Tensor]:
        """``[1, B, A]`` logits, ``[1, B]`` values and ``[1, B, S]`` the next hidden state."""
        seen, fresh = (torch.from_numpy(part)[None] for part in (inputs, self._fresh))
        return self.network.step(seen, self._hidden_state, fresh)

    def rollout(self) -> Rollout:
        """Play some steps in all rooms."""
        file, rooms = self.file, self.rooms
        state = self._hidden_state
        steps: list[dict[str, Any]] = []
        for _ in range(file.steps):
            view = rooms.view
            inputs = self.perception.inputs(view)
            found, value, self._hidden_state = self._evaluate(inputs)
            logits = found[0].numpy()
            action = sample_actions(logits, self._policy.random(file.at_once))
            step = rooms.step(action)
            self._count(step.trial_over, view)
            steps.append(
                {
                    "inputs": inputs,
                    "fresh": self._fresh,
                    "action": action,
                    "log_prob": log_prob(logits, action),
                    "value": value.numpy()[0],
                    "reward": (step.new_solution - file.action_cost).astype(np.float32),
                    "done": rooms.life_over if file.credit == "life" else step.trial_over,
                }
            )
            self.perception.note(step)
            self.perception.forget(rooms.life_over)
            self._fresh = rooms.life_over
        _, bootstrap, _ = self._evaluate(self.perception.inputs(rooms.view))
        stacked = Rollout.stacked(steps, networks=1)
        mask = torch.ones_like(stacked["done"])
        return Rollout(**stacked, state=state, mask=mask, bootstrap=bootstrap)

    def _count(self, over: BoolArray, view: View) -> None:
        rooms = self.rooms
        for row, worth in enumerate((over, rooms.last_solved & over, over * view.attempt)):
            self.tally[row] += np.bincount(
                rooms.last_schema, weights=worth, minlength=self.tally.shape[1]
            )

    def update(self) -> dict[str, float]:
        """One rollout and the updates by it; returns the means of :meth:`PPO.update`."""
        file = self.file
        course = min(self.actions / file.actions, 1.0)
        entropy = file.entropy_start + (file.entropy_end - file.entropy_start) * course
        for group in self.trainer.optimizer.param_groups:
            group["lr"] = file.learning_rate * (1.0 - 0.9 * course)
        metrics = self.trainer.update(self.rollout(), entropy, self._order)
        self.updates += 1
        return metrics

    def progress(self) -> str:
        """A line on the trials since this was last called."""
        trials, solved, attempts = self.tally.sum(axis=1)
        self.tally[:] = 0.0
        share = f"{self.actions / 1e6:.1f} of {self.file.actions / 1e6:.1f} million actions"
        if not trials:
            return share
        mean = f"{attempts / trials:.2f} attempts a trial"
        return f"{share}: {mean}, {solved / trials:.1%} of trials solved"

    def save(self, path: Path | str) -> None:
        """Write the network, as :mod:`openlock_learners.networks.network_file` reads it."""
        about = {"actions": self.actions, "training": self.file.model_dump()}
        write_network(path, self.network, self.rooms.brief.positions, about)


def resume(training: MetaTraining, path: Path) -> None:
    """Continue an interrupted training, if it was the same one."""
    try:
        file = io.BytesIO(unsealed(path.read_bytes()))
        if same := pickle.load(file) == training.file.model_dump_json():
            vars(training).update(pickle.load(file))
    except Exception as error:  # the code may have changed since
        raise ExperimentError(
            f"{path} cannot be used ({in_short(error)}); remove it to start over"
        ) from None
    if not same:
        raise ExperimentError(
            f"{path} is left from a training by another file; remove it, or choose another --out"
        )


def run_training(training: MetaTraining, out: Path, log: Callable[[str], None]) -> None:
    """Train to the end, and write the network; ``log`` takes lines of progress.

    ``OUT.training`` next to it holds, until the end, the state from which a training continues.

    Raises:
        ExperimentError: If another training was interrupted there, or its file is damaged.
    """
    interrupted = out.with_name(f"{out.name}.training")
    if interrupted.exists():
        resume(training, interrupted)
        log(f"continuing from {interrupted}")
    began = logged = time.monotonic()
    before = training.actions
    while not training.over:
        metrics = training.update()
        now = time.monotonic()
        if now - logged >= LOG_EVERY or training.over:
            logged = now
            speed = (training.actions - before) / (now - began)
            log(f"{training.progress()}, entropy {metrics['entropy']:.2f}, {speed:,.0f} actions/s")
            state = pickle.dumps(training.file.model_dump_json()) + pickle.dumps(vars(training))
            try:
                write_bytes(interrupted, sealed(state))
            except SealError as error:
                log(f"{in_short(error)}; an interrupted training begins again")
    training.save(out)
    interrupted.unlink(missing_ok=True)

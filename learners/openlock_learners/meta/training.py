"""Meta-training of ``rl2``: one recurrent network, trained in very many rooms.

As in RL² (Duan et al., 2016; Wang et al., 2016), a recurrent network is trained by policy gradient
over many tasks. How to find out is learned in its weights; how the room at hand works, it finds out
in its hidden state, while the weights stay as they are. A YAML file declares the rooms it meets::

    causal-openlock train experiments/meta_training/rl2.yaml --out rl2.npz

A solution that is new in the trial earns 1, and every action costs a little. Unlocking the door
earns nothing: where that was rewarded, the network learned to unlock it again and again.

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

import numpy as np
import torch

from causal_openlock.comparison.progress_bar import duration
from causal_openlock.errors import ExperimentError, in_short
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.seal import SealError, sealed, unsealed
from openlock_learners.meta.ppo import Rollout, improve, log_prob, sample_actions
from openlock_learners.meta.rooms import MetaRooms
from openlock_learners.meta.training_file import TrainingFile
from openlock_learners.networks.network_file import write_network
from openlock_learners.networks.perception import Perception
from openlock_learners.networks.recurrent_policy import make_policy

LOG_EVERY = 10.0
"""Seconds between two lines of progress, and between two checkpoints of the training."""


class MetaTraining:
    """A meta-training, as a file declares it, that can be interrupted after any update.

    Schemas are searched in the folder ``beside`` first.
    """

    def __init__(self, file: TrainingFile, beside: Path = Path()) -> None:
        self.file = file
        weights, rooms, policy, order = np.random.default_rng(file.seed).spawn(4)
        self.rooms = MetaRooms(file.rooms, file.schemas(beside), file.at_once, rooms)
        positions = self.rooms.brief.positions
        self.network = make_policy(file.network, weights)
        parameters = self.network.parameters()
        self.optimizer = torch.optim.Adam(parameters, lr=file.learning_rate, eps=1e-5)
        self.perception = Perception(self.rooms.brief)
        self._hidden_state = torch.zeros(file.at_once, self.network.state_size(positions))
        self._fresh = torch.zeros(file.at_once, dtype=torch.bool)
        self._policy, self._order = policy, order
        self.updates = 0
        self.tally = np.zeros(3)
        """Trials that ended, how many of them were solved, and their attempts."""

    @property
    def actions(self) -> int:
        """Actions taken so far in all rooms together."""
        return self.updates * self.file.steps * self.file.at_once

    @property
    def over(self) -> bool:
        """Whether the training budget is used up."""
        return self.actions >= self.file.actions

    @torch.no_grad()
    def rollout(self) -> Rollout:
        """Play some steps in all rooms."""
        file, rooms, before = self.file, self.rooms, self._hidden_state
        steps = []
        for _ in range(file.steps):
            view = rooms.view
            inputs = torch.from_numpy(self.perception.inputs(view))
            state = self._hidden_state * ~self._fresh[:, None]
            logits, value, self._hidden_state = self.network.step(inputs, state)
            action = sample_actions(logits, torch.from_numpy(self._policy.random(file.at_once)))
            step = rooms.step(action.numpy())
            over = step.trial_over
            self.tally += over.sum(), (rooms.last_solved & over).sum(), view.attempt[over].sum()
            reward = torch.from_numpy(step.new_solution - file.action_cost).float()
            done = torch.tensor(rooms.life_over if file.credit == "life" else over)
            chance = log_prob(logits, action)
            steps.append((inputs, self._fresh, action, chance, value, reward, done))
            self.perception.note(step)
            self.perception.forget(rooms.life_over)
            self._fresh = torch.from_numpy(rooms.life_over)
        inputs = torch.from_numpy(self.perception.inputs(rooms.view))
        _, following, _ = self.network.step(inputs, self._hidden_state * ~self._fresh[:, None])
        return Rollout(*[*map(torch.stack, zip(*steps, strict=True)), before, following])

    def update(self) -> float:
        """One rollout and the updates by it; returns the mean entropy of the policy."""
        file = self.file
        course = min(self.actions / file.actions, 1.0)
        entropy = file.entropy_start + (file.entropy_end - file.entropy_start) * course
        for group in self.optimizer.param_groups:
            group["lr"] = file.learning_rate * (1.0 - 0.9 * course)
        rollout = self.rollout()
        self.updates += 1
        return improve(self.network, self.optimizer, rollout, file, entropy, self._order)

    def progress(self) -> str:
        """A line on the trials since this was last called."""
        trials, solved, attempts = self.tally.tolist()
        self.tally[:] = 0.0
        share = f"{self.actions / 1e6:.1f} of {self.file.actions / 1e6:.1f} million actions"
        if not trials:
            return share
        mean = f"{attempts / trials:.2f} attempts a trial"
        return f"{share}: {mean}, {solved / trials:.1%} of trials solved"


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
        entropy = training.update()
        now = time.monotonic()
        if now - logged >= LOG_EVERY or training.over:
            logged = now
            speed = (training.actions - before) / (now - began)
            left = duration(max(training.file.actions - training.actions, 0) / speed)
            pace = f"{speed:,.0f} actions/s, about {left} left"
            log(f"{training.progress()}, entropy {entropy:.2f}, {pace}")
            state = pickle.dumps(training.file.model_dump_json()) + pickle.dumps(vars(training))
            try:
                write_bytes(interrupted, sealed(state))
            except SealError as error:
                log(f"{in_short(error)}; an interrupted training begins again")
    about = {"actions": training.actions, "training": training.file.model_dump()}
    write_network(out, training.network, about)
    interrupted.unlink(missing_ok=True)

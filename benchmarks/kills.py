"""Killed and resumed: does a cell that was killed at random moments end as if nothing had happened?

    python benchmarks/kills.py [--kills 20] [--learner ddqn ...]

Every learner that keeps a state plays a cell with a checkpoint after every step, in a process that
is killed (SIGKILL) at a random moment, begun again, killed again, until it is done. Its record has
to be the one of an undisturbed cell, action for action and reward for reward. Processes are forked
from one that has loaded everything, so that they are killed while they play and not while they
import. Prints one line a learner, and ends with status 1 if any record differs.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

import torch

from causal_openlock import Condition, OneSubjectLearner, Protocol, find_schema
from causal_openlock.contract.registry import learner_class, parse_parameters
from causal_openlock.experiment.experiment import Cell, LearnerSpec
from causal_openlock.running.worker import Watching, play_cell
from causal_openlock.storage.store import Store
from causal_openlock.world.rewards import PAPER_REWARD, find_reward

LONG = Protocol("long", 40, stop_when_solved=True, baseline_trials=2, training_trials=2)
SHORT = replace(LONG, name="short", attempt_limit=12)


class Repeats(OneSubjectLearner):
    """A learner for one subject, which repeats what moved something: its players are pickled."""

    def begin(self) -> None:
        """Nothing is known yet."""
        self.good: list[int] = []

    def act(self, observation: Any) -> int:
        """Something good, or anything."""
        if self.good and self.generator.random() < 0.5:
            return int(self.generator.choice(self.good))
        return int(self.generator.integers(self.brief.actions))

    def learn(self, moment: Any) -> None:
        """Remember what moved something."""
        if (moment.outcome != moment.observation).any():
            self.good.append(moment.action)


@dataclass(frozen=True)
class Case:
    """A learner to kill."""

    learner: str
    parameters: dict[str, Any]
    protocol: Protocol = LONG


CASES = {
    "random": Case("random", {}),
    "ideal": Case("ideal", {}, SHORT),
    "bayes": Case("bayes", {"particles": 200, "planned": 200}, SHORT),
    "theory_based": Case("theory_based", {}, SHORT),
    "posterior_sampling": Case("posterior_sampling", {}, SHORT),
    "associative": Case("associative", {}),
    "win_stay": Case("win_stay", {}),
    "tabular_q": Case("tabular_q", {}),
    "ddqn": Case("ddqn", {}),
    "ddqn prioritised": Case("ddqn", {"prioritised": True, "target_period": 20}),
    "semi_markov_ddqn": Case("semi_markov_ddqn", {}),
    "bayes_net_ddqn": Case("bayes_net_ddqn", {}, SHORT),
    "recurrent": Case("recurrent", {"replay_size": 300}),
    "recurrent lstm": Case("recurrent", {"cell": "lstm", "replay_size": 300, "hidden_units": 13}),
    "rl2": Case("rl2", {}),
    "rl2 learning": Case("rl2", {"learns": True, "unroll": 9}),
    "sb3": Case("sb3", {"algorithm": "A2C", "settings": {"n_steps": 5}}, SHORT),
    "for one subject": Case(f"{Path(__file__).stem}:Repeats", {}),
}


def cell_of(name: str, seed: int) -> Cell:
    """A cell of two subjects."""
    case = CASES[name]
    parameters = vars(parse_parameters(case.learner, case.parameters)).copy()
    entry = LearnerSpec(
        name.replace(" ", "_"),
        case.learner,
        parameters,
        case.protocol,
        find_reward(PAPER_REWARD),
        2,
    )
    return Cell("kills", seed, entry, Condition.named("CC3-CE4", find_schema), 0, 2)


def played(cell: Cell, folder: Path, every: float, after: float | None = None) -> float | None:
    """Play a cell in a process of its own.

    Args:
        cell: The cell.
        folder: Where its record belongs.
        every: Seconds between checkpoints.
        after: Seconds after which the process is killed.

    Returns:
        Seconds it took; ``None`` if it was killed.
    """
    begun = time.perf_counter()
    child = os.fork()
    if not child:
        status = 1
        try:
            warnings = play_cell(cell, str(folder), Watching(checkpoint_every=every))
            for warning in warnings:
                print(warning, file=sys.stderr, flush=True)
            status = 0
        finally:
            os._exit(status)
    while not (ended := os.waitpid(child, os.WNOHANG))[0]:
        if after is not None and time.perf_counter() - begun > after:
            os.kill(child, signal.SIGKILL)
            after = None
        time.sleep(0.002)
    if os.WIFSIGNALED(ended[1]):
        return None
    if os.WEXITSTATUS(ended[1]):
        raise SystemExit(f"{cell.name} failed")
    return time.perf_counter() - begun


def record_of(cell: Cell, folder: Path) -> list[dict[str, Any]]:
    """What was played, but for how long it took."""
    store = Store(folder)
    table = store.read(store.path(cell), cell.identity)
    return table.drop_columns(["wall_time"]).to_pylist()


def killed(name: str, kills: int, luck: random.Random) -> tuple[int, int, int, int]:
    """Kill a learner so often, in as many cells as it takes.

    Returns:
        Kills, cells, cells whose record differs, and attempts on record.
    """
    died = cells = wrong = attempts = 0
    while died < kills:
        cell = cell_of(name, seed=cells)
        with tempfile.TemporaryDirectory() as place:
            quiet, disturbed = Path(place, "quiet"), Path(place, "disturbed")
            for folder in (quiet, disturbed):
                Store(folder).cells.mkdir(parents=True)
            played(cell, quiet, float("inf"))
            shutil.copytree(quiet, Path(place, "timed"))
            Store(Path(place, "timed")).path(cell).unlink()
            takes = played(cell, Path(place, "timed"), 0.0) or 0.0
            while died < kills:
                if played(cell, disturbed, 0.0, luck.uniform(0, takes / 3)) is not None:
                    break
                died += 1
            else:
                played(cell, disturbed, 0.0)
            before, after = record_of(cell, quiet), record_of(cell, disturbed)
            wrong += before != after
            attempts += len(before)
        cells += 1
    return died, cells, wrong, attempts


def main() -> None:
    """Kill every learner and say what came of it."""
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--kills", type=int, default=20, help="of each learner")
    options.add_argument("--learner", nargs="+", choices=list(CASES), default=list(CASES))
    chosen = options.parse_args()
    torch.set_num_threads(1)
    differs = 0
    for name in chosen.learner:
        learner_class(CASES[name].learner)
        with tempfile.TemporaryDirectory() as place:  # what it imports is imported by all
            Store(place).cells.mkdir()
            play_cell(cell_of(name, seed=99), place, Watching(checkpoint_every=float("inf")))
        died, cells, wrong, attempts = killed(name, chosen.kills, random.Random(name))
        differs += wrong
        print(
            f"{name:17} killed {died} times in {cells} cells of {attempts} attempts in all: "
            f"{wrong} differ from the undisturbed cell",
            flush=True,
        )
    sys.exit(1 if differs else 0)


if __name__ == "__main__":
    main()

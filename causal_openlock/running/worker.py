"""A worker plays one cell, from its checkpoint if there is one, and saves the record.

Meanwhile it takes checkpoints, reports its progress, and draws curves if they are wanted. None of
that changes the results.
"""

from __future__ import annotations

import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from causal_openlock.contract.checks import GlobalRandomness
from causal_openlock.contract.learner import Learner
from causal_openlock.contract.registry import create, is_ours, origin
from causal_openlock.errors import (
    LearnerError,
    NotAvailableError,
    OpenLockError,
    in_short,
    is_stop,
    with_kind,
)
from causal_openlock.experiment.declare import Cell, LearnerSpec
from causal_openlock.experiment.session import Session
from causal_openlock.running.checkpoint import Checkpoint, unresumable
from causal_openlock.storage.beside_cell import keep_failure, report_progress
from causal_openlock.storage.store import Store
from causal_openlock.storage.versions import versions
from causal_openlock.usercode.own_files import is_users_own
from causal_openlock.usercode.session_code import unpack
from causal_openlock.world.rewards import OwnReward, reward_source

REPORT_EVERY = 1.0  # seconds between a worker's reports of its progress
MOST_WRITTEN = 20_000  # characters of a traceback
POINTS = 500  # of a curve, at most


@dataclass(frozen=True)
class Watching:
    """What a worker does besides playing."""

    checkpoint_every: float = 60.0  #: seconds between checkpoints; 0: after every step; inf: none
    tensorboard: str | None = None  #: folder for TensorBoard's logs; by default there are none
    awaited: str | None = None  #: a file that is there for as long as the run waits for its cells


class NotAwaitedError(OpenLockError):
    """The run that a cell was played for has been stopped."""


def play_cell(cell: Cell, folder: str, watching: Watching, definitions: bytes = b"") -> list[str]:
    """Play one cell and save its record; returns problems that did not stop it, a sentence each.

    Raises:
        LearnerError: If the learner fails; the reason and traceback are saved in ``errors``.
        NotAwaitedError: If the run has been stopped; there is a checkpoint then.
        OpenLockError: If a file cannot be written.
    """
    store = Store(folder)
    path = store.path(cell)
    made_with = {"identity": cell.identity, **versions()}
    checkpoint = Checkpoint(path, made_with, watching.checkpoint_every)
    in_main_thread = threading.current_thread() is threading.main_thread()
    report_progress(path, 0.0, 0.0)
    try:
        unpack(definitions)
        _require_declared(cell.spec)  # which imports its code, and that may draw random numbers
        with ExitStack() as stack:
            start = None
            if in_main_thread:  # beside a thread, others may draw from these generators
                seeded = GlobalRandomness.seeded(int(cell.identity, 16) % 2**63)
                start = stack.enter_context(seeded)
            session, learner = made(cell)
            if not checkpoint.resume(session, learner):
                if checkpoint.warnings:  # they may have a part of its state
                    session, learner = made(cell)
                session.begin(learner)
            if is_ours(cell.spec.learner) and (torch := sys.modules.get("torch")):
                stack.callback(torch.set_num_threads, torch.get_num_threads())
                torch.set_num_threads(1)
            draw = None
            if watching.tensorboard is not None:
                logs = Path(watching.tensorboard) / cell.name
                draw = stack.enter_context(curves(session, learner, logs))
            due = time.perf_counter() + REPORT_EVERY
            for _ in session.steps(learner):
                checkpoint.keep(session, learner)
                if draw:
                    draw()
                if time.perf_counter() >= due:
                    due = time.perf_counter() + REPORT_EVERY
                    report_progress(path, session.progress, session.seconds)
                    if watching.awaited and _is_gone(watching.awaited):
                        checkpoint.keep(session, learner, now=True)
                        raise NotAwaitedError(f"the run of {cell.in_words} was stopped")
            record, account = session.record(), learner.account()
            cautions = _cautions(start, learner, cell.spec)
        store.write_transcripts(cell, account.transcripts)
    except NotAwaitedError:
        raise
    except BaseException as error:  # a learner can raise anything
        if is_stop(error):
            raise
        raise LearnerError(_record_failure(store, cell, error)) from None
    store.write(cell, record, cautions)
    warnings = [*checkpoint.warnings, *account.remarks]
    return [*cautions, *(f"{cell.spec.name}: {warning}" for warning in warnings)]


@contextmanager
def curves(session: Session, learner: Learner, folder: Path) -> Iterator[Callable[[], None]]:
    """Draw a cell's curves for TensorBoard; yields a function to call after every step.

    Their axis is the mean number of attempts of the cell's subjects. A point is a mean over all
    attempts since the last one, and over the trials decided since then. A cell that continues from
    a checkpoint adds to the logs in ``folder``. Results are computed from the record alone.
    """
    from torch.utils.tensorboard import SummaryWriter

    brief, log = session.brief, session.log
    # In rows of the log: the attempts of all subjects.
    period = max(brief.trials * brief.attempt_limit // POINTS, 1) * brief.subjects
    drawn = log.rows
    purge = drawn // brief.subjects + 1 if drawn else None  # points after the checkpoint

    def draw() -> None:
        nonlocal drawn
        if log.rows - drawn < period and not session.over:
            return
        new, drawn = log.since(drawn), log.rows
        point = {"attempts/reward": new["reward"].mean(), "attempts/opened": new["opened"].mean()}
        complete = new["solutions_found"] == session.solutions[new["subject"], new["visit"]]
        solved = complete & new["new_solution"]
        decided = solved | (~complete & (new["attempt"] == brief.attempt_limit))
        if decided.any():
            point["trials/solved_share"] = solved[decided].mean()
            point["trials/attempts"] = new["attempt"][decided].mean()
        point |= {f"learner/{name}": value for name, value in learner.metrics().items()}
        for name, value in point.items():
            writer.add_scalar(name, float(value), log.rows // brief.subjects)

    with SummaryWriter(str(folder), purge_step=purge, flush_secs=10) as writer:
        yield draw


def _record_failure(store: Store, cell: Cell, error: BaseException) -> str:
    """Save why a cell failed; returns a sentence with the reason."""
    what = in_short(error)
    if not isinstance(error, OpenLockError):
        what = with_kind(error) + _users_line(error)
    trace = "".join(traceback.format_exception(error))
    if len(trace) > MOST_WRITTEN:  # an exception's text may be of any length
        trace = f"{trace[: MOST_WRITTEN // 2]}\n...\n{trace[-MOST_WRITTEN // 2 :]}"
    failures = 0 if isinstance(error, NotAvailableError) else 1
    return keep_failure(store.path(cell), cell, f"failed: {what}", trace, failures)


def _users_line(error: BaseException) -> str:
    """The last line of the user's code that an error passed, such as `` (learners.py:39)``."""
    line = ""
    for frame, number in traceback.walk_tb(error.__traceback__):
        path = Path(frame.f_code.co_filename)
        if path.is_file() and is_users_own(path.resolve()):  # a notebook's cells are in no file
            line = f" ({path.name}:{number})"
    return line


def _cautions(start: GlobalRandomness | None, learner: Learner, spec: LearnerSpec) -> list[str]:
    """What results warn of: no learning, and of a user's learner shared generators or no state."""
    cautions: list[str] = []
    if learner.updates_made() == 0:
        cautions.append(
            f"it never learned, as its trials under protocol {spec.protocol.name} ended before its "
            "first update; give it parameters that learn earlier, or more trials"
        )
    generators = start.differs_from(GlobalRandomness.now()) if start else []
    if generators and not is_ours(spec.learner):
        cautions.append(
            f"it uses or seeds the random numbers of {' and '.join(generators)}, which all code "
            "shares, so no subject is independent of the others in its cell; let it draw from "
            "brief.generators (or self.generator), and seed a torch.Generator from these"
        )
    if not is_ours(spec.learner) and (reason := unresumable(learner)):
        cautions.append(f"a killed cell begins again, as {reason}")
    return [f"{spec.name}: {caution}" for caution in cautions]


def made(cell: Cell) -> tuple[Session, Learner]:
    """A session for a cell, and its learner; neither has begun."""
    return Session.of(cell), create(cell.spec.learner, cell.spec.parameters)


def _require_declared(spec: LearnerSpec) -> None:
    """Raise NotAvailableError if this process has other code than was declared."""
    codes = {}
    if not is_ours(spec.learner):
        codes[spec.learner] = spec.origin.package, origin(spec.learner, imported=True)
    if isinstance(spec.reward, OwnReward):
        codes[spec.reward.name] = spec.reward.source, reward_source(spec.reward.name)
    for name, (declared, present) in codes.items():
        if present != declared:
            raise NotAvailableError(
                f"the code of {name} is {present} in the process that plays, and was declared as "
                f"{declared}: it was changed meanwhile, or is another one there; give the same "
                "command again, in a notebook after a restart of the kernel"
            )


def _is_gone(awaited: str) -> bool:
    """Whether a file is missing; other errors may pass."""
    try:
        Path(awaited).stat()
    except OSError as error:
        return isinstance(error, FileNotFoundError)
    return False

"""Replay of the actions of a file: each is taken in its room, and its result is compared.

The machine of the room decides, not the file. So a record of imported data is one like any other,
and a row that could not have happened is found where it stands: an attempt that continued after its
last action, a trial after the last solution, a lever that moved while nothing enabled it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa

from causal_openlock.contract.learner import Step
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.condition import SHOWN
from causal_openlock.experiment.declare import Cell
from causal_openlock.experiment.plan import Visit, plan
from causal_openlock.experiment.record import with_times
from causal_openlock.experiment.session import Session
from causal_openlock.importing.reading import CLAIMS, Action, fault_at
from causal_openlock.world.room import Layout, action_index, action_names, positions_for


@dataclass(frozen=True, eq=False)
class Replayed:
    """One subject's actions, replayed and checked."""

    cell: Cell  #: that was played, with the rooms where the file names them
    record: pa.Table  #: the attempts of the trials that are over, with the file's times
    done: Sequence[Mapping[str, Any]]  #: the actions, as rows of a table of reaction times
    left_out: int  #: actions of a trial that is not over, which no record has


def replay(actions: Sequence[Action], cell: Cell, drawn: bool = False) -> Replayed:
    """Take the actions of a cell's subject again, in the order of time.

    Layouts that the file names replace those that are drawn; where it names none, the subject met
    the rooms that the seed draws if ``drawn`` says so. Luck is drawn from the seed as well.

    Raises:
        OpenLockError: If no layout is named where several are possible and rooms are not drawn, an
            action could not have been taken then, or something else comes of it.
    """
    condition, protocol = cell.condition, cell.spec.protocol
    visits, other = (plan(condition, protocol, np.random.default_rng(n)) for n in range(2))
    trials = _trials(actions, visits, condition.name)
    rooms = _rooms(actions, trials, visits)
    if not (rooms or drawn) and [v.layout for v in other] != [v.layout for v in visits]:
        raise OpenLockError(
            f"{actions[0].place}: there is no layout, so it is not known where the levers were; "
            "add the column layout, such as trial1, or give --layouts drawn if these were the "
            "rooms that --seed draws"
        )
    known = {cell.first_subject: rooms} if rooms else {}
    cell = replace(cell, condition=replace(condition, rooms=known))
    session, over = Session.of(cell), 0
    done: list[dict[str, Any]] = []
    for action, trial in zip(actions, trials, strict=True):
        with fault_at(action.place):
            index = action_index(action.action, session.brief.positions)
        step = session.step([index])
        moved = bool((step.outcome != step.view.observation).any())
        ended = bool(step.attempt_over[0])
        why = _impossible(action, trial, step, moved)
        if not why and visits[trial - 1].phase == SHOWN and ended and not step.new_solution[0]:
            why = "this attempt is not a new solution, and what is shown is"
        if why:
            hint = f"; rooms were drawn by --seed {cell.seed}" if drawn and not rooms else ""
            raise OpenLockError(f"{action.place}: {why}{hint}")
        at = int(step.view.attempt[0])
        about = {"visit": trial, "attempt": at, "action": index, "time": action.time}
        came = {"moved": moved, "attempt_over": ended}
        done.append({**about, "reaction": action.reaction, **came})
        over += bool(step.trial_over[0])
    left_out = sum(row["visit"] > over for row in done)
    return Replayed(cell, with_times(session.record(), done, over), done, left_out)


def _trials(actions: Sequence[Action], visits: Sequence[Visit], condition: str) -> list[int]:
    """The number of each action's trial in the whole condition, from 1, as the file has it."""
    known = {(visit.phase, visit.loop, visit.trial): n for n, visit in enumerate(visits, start=1)}
    numbers = [0]
    for action in actions:
        key = (action.phase, action.loop, action.trial)
        number = known.get(key, 0) if action.phase else action.trial
        if not 1 <= number <= len(visits):
            named = " ".join(map(str, key)) if action.phase else number
            raise OpenLockError(
                f"{action.place}: {condition} has {len(visits)} trials under this protocol, and "
                f"{named} is none of them; declare others in an experiment file, and name it with "
                "--from"
            )
        if number > (following := numbers[-1] + 1):
            shown = visits[following - 1].phase == SHOWN
            what = f" ({SHOWN}: what the subject saw is data as well)" if shown else ""
            raise OpenLockError(
                f"{action.place}: this is trial {number} of {condition}, and there is no row of "
                f"trial {following}{what}; add its rows, or correct this one"
            )
        numbers.append(number)
    return numbers[1:]


def _rooms(
    actions: Sequence[Action], trials: Sequence[int], visits: Sequence[Visit]
) -> tuple[Layout, ...]:
    """The layouts that the file names, of each trial in order; none if it names none."""
    if not any(action.layout for action in actions):
        return ()
    named: dict[int, str] = {}
    layouts: list[Layout] = []
    for action, trial in zip(actions, trials, strict=True):
        schema, layout = visits[trial - 1].schema, action.layout
        with fault_at(action.place):
            if not layout or named.setdefault(trial, layout) != layout:
                raise OpenLockError(
                    f"trial {trial} has one layout, named in every row; this row says "
                    f"{layout or 'none'}"
                )
            if len(named) > len(layouts):
                layouts.append(Layout.of(schema, layout, positions_for(schema)))
    return tuple(layouts)


def _impossible(action: Action, trial: int, step: Step, moved: bool) -> str:
    """Why an action could not have been taken then, or its different result; empty if it could."""
    view, console = step.view, step.view.console
    if not view.playing[0]:
        return "all trials of this subject were over before this"
    at = int(view.trial[0]), int(view.attempt[0])
    if (trial, action.attempt) != at:
        return (
            f"this says trial {trial}, attempt {action.attempt}, and after the rows before it the "
            f"subject was in trial {at[0]}, attempt {at[1]}, with actions left: "
            f"{int(console.actions_left[0])} and solutions left: {int(console.solutions_left[0])}"
        )
    outcome = step.outcome[0]
    came = (moved, outcome[-2] == 0, outcome[-1] == 1, step.new_solution[0])
    for name, result in zip(CLAIMS, came, strict=True):
        said = getattr(action, name)
        if said not in (None, bool(result)):
            names = action_names(view.observation.shape[1] // 2 - 1)
            return (
                f"{names[int(step.action[0])]} here leads to {name} = {int(result)}, and this row "
                f"says {int(said)}"
            )
    return ""

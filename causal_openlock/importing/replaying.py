"""Replay of the actions of a file: each is taken in its room, and its result is compared.

The machine of the room decides, not the file. So a record of imported data is one like any other,
and a row that could not have happened is found where it stands: an attempt that continued after its
last action, a trial after the last solution, a lever that moved while nothing enabled it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from causal_openlock.contract.learner import Step
from causal_openlock.errors import ExperimentError
from causal_openlock.experiment.declare import SHOWN, Condition
from causal_openlock.experiment.plan import Visit, plan
from causal_openlock.experiment.session import Session
from causal_openlock.importing.imported_actions import ActionEntry, ImportFault
from causal_openlock.play.game import PlayedAction
from causal_openlock.world.room import Layout, action_index, action_names, positions_for

if TYPE_CHECKING:
    import pyarrow as pa

    from causal_openlock.experiment.declare import LearnerSpec


_ROLE = re.compile(r"(push|pull)[_ ](l|inactive)\d", re.IGNORECASE)
"""Actions in the authors' program, whose levers are called l0, l1, inactive0."""


@dataclass(frozen=True, eq=False)
class Checked:
    """One subject's actions, replayed and checked.

    Attributes:
        subject: Its number.
        condition: What it played, with the rooms that it met where the file names them.
        record: The attempts of the trials that are over.
        entries: All its actions, as the file describes them.
        done: The same, as they were taken.
        left_out: How many of them are of a trial that is not over, which no record has.
    """

    subject: int
    condition: Condition
    record: pa.Table
    entries: Sequence[ActionEntry]
    done: Sequence[PlayedAction]
    left_out: int


def play_again(
    entries: Sequence[Sequence[ActionEntry]],
    numbers: Sequence[int],
    condition: Condition,
    spec: LearnerSpec,
    experiment: str,
    seed: int,
    drawn: bool = False,
) -> list[Checked]:
    """Replay the actions of some subjects of one learner in one condition.

    Args:
        entries: The actions of each subject, in the order of time.
        numbers: The subjects' numbers.
        condition: The condition; layouts that the file names replace those that are drawn.
        spec: The learner, with its protocol and reward.
        experiment: Name of the experiment.
        seed: Its seed; rooms that are not named, and luck, are drawn from it.
        drawn: Whether subjects met the rooms that are drawn, where the file names none.

    Raises:
        ImportFault: If no layout is named where several are possible and rooms are not drawn, an
            action could not have been taken then, or something else comes of it.
    """
    visits = plan(condition, spec.protocol, np.random.default_rng(0))
    order = [_visits(own, visits, condition.name) for own in entries]
    rooms = [
        _rooms(own, trials, visits, condition.name)
        for own, trials in zip(entries, order, strict=True)
    ]
    other = plan(condition, spec.protocol, np.random.default_rng(1))
    if not drawn and [one.layout for one in other] != [one.layout for one in visits]:
        for acted in entries:
            if not any(one.layout for one in acted):
                raise acted[0].place.fault(
                    "there is no layout, so it is not known where the levers were; add the column "
                    "layout, such as trial1, or give --layouts drawn if these were the rooms that "
                    "--seed draws"
                )
    given = {number: own for number, own in zip(numbers, rooms, strict=True) if own}
    placed = replace(condition, rooms=given)
    session = Session(
        placed,
        spec.protocol,
        numbers,
        seed=seed,
        reward=spec.reward,
        learner=spec.name,
        experiment=experiment,
    )
    actions = [_indices(own, session.brief.positions) for own in entries]
    faults: dict[int, ImportFault] = {}
    layouts: list[dict[int, str]] = [{} for _ in numbers]
    done: list[list[PlayedAction]] = [[] for _ in numbers]
    whole = np.zeros((len(numbers), 2), dtype=np.int64)  # actions and attempts of ended trials
    ends = [""] * len(numbers)  # how the latest trial of each ended
    attempts = np.zeros(len(numbers), dtype=np.int64)
    for moment, (acts, step) in enumerate(session.following(actions)):
        attempts += step.attempt_over & acts
        over = step.trial_over & acts
        for row in np.flatnonzero(over).tolist():
            ends[row] = _end_of_trial(step, row)
        whole[over] = np.column_stack([np.full(len(numbers), moment + 1), attempts])[over]
        moved = (step.outcome != step.view.observation).any(axis=1)
        for row in np.flatnonzero(acts).tolist():
            if row not in faults:
                one = entries[row][moment]
                trial = int(step.view.trial[row])
                why = _impossible(one, order[row][moment], step, row, bool(moved[row]), ends[row])
                if shown := _was_shown(visits[order[row][moment] - 1], condition.name):
                    if step.attempt_over[row] and not step.new_solution[row]:
                        why = why or "this attempt is not a new solution, and what is shown is"
                    why = why and why + shown
                if why and drawn and not one.layout:
                    why += (
                        f"; the rooms were drawn by --seed {seed}, and this subject may have met "
                        "others"
                    )
                if not why and one.layout != layouts[row].setdefault(trial, one.layout):
                    why = "this trial has had another layout before; a trial has one"
                if why:
                    faults[row] = one.place.fault(why)
                done[row].append(
                    PlayedAction(
                        trial,
                        int(step.view.attempt[row]),
                        int(step.action[row]),
                        bool(moved[row]),
                        one.reaction,
                        one.time,
                        bool(step.attempt_over[row]),
                    )
                )
    record = session.record()
    starts = np.searchsorted(record["subject"].to_numpy(), np.sort(numbers))
    first = dict(zip(sorted(numbers), starts.tolist(), strict=True))
    found = []
    for row, number in enumerate(numbers):
        kept = record.slice(first[number], int(whole[row, 1]))
        if row not in faults and (fault := _different(kept, entries[row], done[row])):
            faults[row] = fault
        left_out = len(entries[row]) - int(whole[row, 0])
        own = replace(placed, rooms={k: v for k, v in placed.rooms.items() if k == number})
        found.append(Checked(number, own, kept, entries[row], done[row], left_out))
    if faults:
        raise min(faults.values(), key=lambda fault: fault.place.line)
    return found


def _visits(own: Sequence[ActionEntry], visits: Sequence[Visit], condition: str) -> list[int]:
    """The number of each action's trial in the whole condition, from 1, as the file has it."""
    known = {(one.phase, one.loop, one.trial): n for n, one in enumerate(visits, start=1)}
    numbers: list[int] = []
    for one in own:
        stated = one.of_attempt
        key = (stated["phase"], stated["loop"], one.trial) if "phase" in stated else None
        number = known.get(key, 0) if key else one.trial
        if not 1 <= number <= len(visits):
            raise one.place.fault(
                f"{condition} has {len(visits)} trials under this protocol, and "
                f"{' '.join(map(str, key)) if key else number} is none of them; declare others in "
                "an experiment file, and name it with --from"
            )
        before = numbers[-1] if numbers else 0
        if number > before + 1:
            raise one.place.fault(
                f"this is trial {number} of {condition}, and there is no row of trial {before + 1}"
                f"{_was_shown(visits[before], condition) or '; add its rows, or correct this one'}"
            )
        numbers.append(number)
    return numbers


def _was_shown(visit: Visit, condition: str) -> str:
    """Remedy for rows of a trial that is shown; empty for one that is played."""
    if visit.phase != SHOWN:
        return ""
    return (
        f"; the trials of {visit.schema.name} in {condition} are shown: before what a subject "
        "played, add rows of what it was shown, with the phase shown"
    )


def _rooms(
    own: Sequence[ActionEntry], order: Sequence[int], visits: Sequence[Visit], condition: str
) -> tuple[Layout, ...]:
    """The layouts that the file names, of each trial in order; none if it names none."""
    named: dict[int, ActionEntry] = {}
    for one, number in zip(own, order, strict=True):
        named.setdefault(number, one)
    if not any(one.layout for one in named.values()):
        return ()
    layouts = []
    for number, one in sorted(named.items()):
        visit = visits[number - 1]
        if not one.layout:
            raise one.place.fault(
                f"trial {number} has no layout and others have; name it in every row, or in none"
            )
        try:
            schema = visit.schema
            layouts.append(Layout.of(schema, one.layout, positions_for(schema)))
        except ExperimentError as error:
            why = f"{error}".partition("; compare again")[0]
            raise one.place.fault(f"{why}{_was_shown(visit, condition)}") from None
    return tuple(layouts)


def _indices(own: Sequence[ActionEntry], positions: int) -> np.ndarray:
    """``[N]`` the actions by index."""
    found = []
    for one in own:
        try:
            found.append(action_index(one.action, positions))
        except ExperimentError as error:
            why = str(error)
            if _ROLE.fullmatch(str(one.action)):
                why = (
                    f"{one.action!r} names a lever by its role, which rooms deal anew; name its "
                    "position, such as push_LEFT"
                )
            raise one.place.fault(why) from None
    return np.array(found, dtype=np.int64)


def _end_of_trial(step: Step, row: int) -> str:
    """End of the trial of a row's subject, for a message."""
    console = step.view.console
    found = int(console.solutions_found[row]) + int(step.new_solution[row])
    why = "the attempts were used up"
    if int(console.solutions_left[row]) == int(step.new_solution[row]):
        why = f"all {found} solutions had been found" if found > 1 else "the solution was found"
    return (
        f"; trial {int(step.view.trial[row])} ended with attempt {int(step.view.attempt[row])}, "
        f"because {why}"
    )


def _impossible(
    one: ActionEntry, number: int, step: Step, row: int, moved: bool, end: str
) -> str | None:
    """Reason why an action could not have been taken then, or its different result.

    ``end`` says how the trial before this one ended; nothing in the first trial.
    """
    view = step.view
    if not view.playing[row]:
        return f"all trials of this subject were over before this{end}"
    trial, attempt = int(view.trial[row]), int(view.attempt[row])
    if (number, one.attempt) != (trial, attempt):
        left = int(view.console.actions_left[row])
        reached = (
            f"this says trial {number}, attempt {one.attempt}, and after the rows before it the "
            f"subject was in trial {trial}, attempt {attempt}, with actions left: {left}"
        )
        if number > trial:
            return f"{reached} and solutions left: {int(view.console.solutions_left[row])}"
        return f"{reached}{end}" if number < trial else reached
    outcome = step.outcome[row]
    came = {
        "moved": moved,
        "unlocked": bool(outcome[-2] == 0),
        "opened": bool(outcome[-1] == 1),
        "new_solution": bool(step.new_solution[row]),
    }
    for name, said in one.claims.items():
        if came[name] != said:
            names = action_names(view.observation.shape[1] // 2 - 1)
            return (
                f"{names[int(step.action[row])]} here leads to {name} = {int(came[name])}, and "
                f"this row says {int(said)}"
            )
    return None


def _different(
    record: pa.Table, own: Sequence[ActionEntry], done: Sequence[PlayedAction]
) -> ImportFault | None:
    """The first attempt of which a file differs from the record."""
    ends = [one for one, taken in zip(own, done, strict=True) if taken.attempt_over]
    for one, row in zip(ends, record.to_pylist(), strict=False):
        stated = {"trial": one.trial, **one.of_attempt} if "phase" in one.of_attempt else {}
        for name, said in stated.items():
            came = row[name]
            same = abs(came - said) < 1e-6 if name == "reward" else came == said
            if not same:
                remedy = "; name the experiment with --from" if name == "reward" else ""
                return one.place.fault(
                    f"{name} of this attempt is {came}, and this row says {said}{remedy}"
                )
    return None

"""A film of a trial: the physical room carries out the actions, next to the console.

A film is a sequence of *shots*. While the arm moves there is one for each frame; before and after a
movement the film pauses, which is one shot of several frames. The record says
what was done and what came of it; the bodies show how.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from causal_openlock.errors import OpenLockError
from causal_openlock.files.atomic import replacing
from causal_openlock.physics.room import PhysicalRoom
from causal_openlock.physics.world import STEP, Pose
from causal_openlock.render.filmed_trial import FilmedAttempt, FilmedTrial
from causal_openlock.render.paint import Bytes, Panel, ShownAction, draw
from causal_openlock.render.room import save_still
from causal_openlock.render.scene import Look
from causal_openlock.render.suffixes import STILLS
from causal_openlock.render.video import load_ffmpeg, write_gif, write_mp4
from causal_openlock.wording import counted, nearest
from causal_openlock.world.room import Room, action_names, published_layouts

FILMS = (".gif", ".mp4")
BEFORE, AFTER, BETWEEN, END = 0.6, 0.5, 1.0, 2.5
"""Seconds for which the film pauses: before an attempt, after an action, after the last
action of an attempt, at the end."""


@dataclass(frozen=True)
class Shot:
    """A picture that is shown for some frames.

    Attributes:
        look: The room.
        panel: The console next to the room.
        frames: Number of frames.
        attempt: Number of the attempt, from 1.
        action: Number of the action in it, from 1; 0 before the first.
        moving: Whether the arm is under way.
    """

    look: Look
    panel: Panel
    frames: int
    attempt: int
    action: int
    moving: bool


def shots(
    trial: FilmedTrial, fps: int = 25, speed: float = 1.0, attempts: int | None = None
) -> Iterator[Shot]:
    """A trial as a film; ``speed`` is in units of simulated time per second."""
    shown = trial.attempts[:attempts]
    room = trial.room
    console = _Console(trial, room)
    grey = tuple(room.active.tolist())
    physical = PhysicalRoom(room.fsm, room.layout)
    poses: list[Pose] = []
    physical.watch = poses.append
    stride = speed / (fps * STEP)  # steps of the simulation in a frame

    def still(seconds: float, attempt: int, action: int, panel: Panel) -> Shot:
        look = Look.of_pose(physical.pose(), grey)
        frames = max(1, round(seconds / speed * fps))
        return Shot(look, panel, frames, attempt, action, moving=False)

    for number, attempt in enumerate(shown, 1):
        physical.reset()
        yield still(BEFORE, number, 0, console.panel(number, 0))
        last = number == len(shown)
        for index, action in enumerate(attempt.actions, 1):
            poses.clear()
            physical.act(action, yields=attempt.moved[index - 1] or trial.schema.deterministic)
            panel = console.panel(number, index - 1, moving=True)
            pressed = action == 2 * trial.layout.positions
            for frame in range(1, math.ceil(len(poses) / stride) + 1):
                pose = poses[min(round(frame * stride), len(poses)) - 1]
                yield Shot(Look.of_pose(pose, grey, pressed), panel, 1, number, index, True)
            ended = index == len(attempt.actions)
            panel = console.panel(number, index)
            if ended and last:
                panel = replace(panel, remark=console.remark(number))
            yield still((END if last else BETWEEN) if ended else AFTER, number, index, panel)


def stills(trial: FilmedTrial, attempts: int | None = None) -> Iterator[Shot]:
    """A trial as pictures: one before each attempt and one after each action, the arm at rest."""
    room, shown = trial.room, trial.attempts[:attempts]
    console = _Console(trial, room)
    for number, attempt in enumerate(shown, 1):
        state, last = 0, number == len(shown)
        for done in range(len(attempt.actions) + 1):
            if done and attempt.moved[done - 1]:
                state = int(room.next_state[state, attempt.actions[done - 1]])
            panel = console.panel(number, done)
            if last and done == len(attempt.actions):
                panel = replace(panel, remark=console.remark(number))
            look = Look.of_observation(room.observation[state], room.positions)
            yield Shot(look, panel, 1, number, done, moving=False)


class _Console:
    """Panels of the console at each point of a trial."""

    def __init__(self, trial: FilmedTrial, room: Room) -> None:
        self._trial, self._room = trial, room
        self._names = [name.replace("_", " ") for name in action_names(trial.layout.positions)]
        name = trial.layout.name
        layout = f" in {name}" if name in published_layouts(trial.schema) else ""
        self._lines = (
            f"{trial.condition}, protocol {trial.protocol.name}, subject {trial.subject}",
            f"{trial.place.capitalize()}: {trial.schema.name}{layout}",
        )

    def panel(self, number: int, done: int, moving: bool = False) -> Panel:
        """The panel after ``done`` actions of an attempt, perhaps during the next action."""
        trial, attempt = self._trial, self._trial.attempts[number - 1]
        over = done == len(attempt.actions)
        ended = trial.attempts[: number if over else number - 1]
        found = [self._pushes(one.solution) for one in ended if one.new]
        missing = len(trial.schema.solutions) - len(found)
        solved = (trial.shown or trial.protocol.stop_when_solved) and not missing
        limit = trial.protocol.attempt_limit
        actions = self._outcomes(attempt)[:done]
        if moving:
            actions.append(ShownAction(self._names[attempt.actions[done]]))
        return Panel(
            solutions=(*found, *[""] * missing),
            attempts_left=None if solved else limit + 1 - number - over,
            actions_left=0 if over else trial.action_limit - done,
            heading=trial.learner,
            lines=(*self._lines, f"Attempt {number} of at most {limit}"),
            actions=tuple(actions),
        )

    def _pushes(self, solution: int) -> str:
        actions = self._room.action_of(self._room.schema.solutions[solution])
        return ", ".join(self._names[a].removeprefix("push ") for a in actions[:-1])

    def _outcomes(self, attempt: FilmedAttempt) -> list[ShownAction]:
        """Result of each action of an attempt, and whether it was progress."""
        seen, state, shown = self._room.observation, 0, []
        for action, moved in zip(attempt.actions, attempt.moved, strict=True):
            before, state = state, int(self._room.next_state[state, action]) if moved else state
            name = self._names[action]
            shown.append(ShownAction.of(name, seen[before], seen[state], attempt.new))
        return shown

    def remark(self, shown: int) -> str:
        """The last line of a film that shows the first ``shown`` attempts."""
        attempts = self._trial.attempts
        left = len(self._trial.schema.solutions) - sum(one.new for one in attempts[:shown])
        if more := len(attempts) - shown:
            return f"{counted(more, 'more attempt')} not shown"
        if left:
            return f"{counted(left, 'solution')} not found"
        what = "shown" if self._trial.shown else "found"
        return f"All solutions {what} in {counted(shown, 'attempt')}"


def check_suffix(path: Path | str) -> Path:
    """A path whose suffix says what to write, and for which everything needed is there.

    Raises:
        OpenLockError: If it is none, or a film cannot be made here.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in FILMS + STILLS:
        raise OpenLockError(
            f"{path}: a film is a .gif or .mp4 and a still a .png or .svg, not {suffix!r}; "
            f"{nearest(suffix, FILMS + STILLS)}"
        )
    if suffix == ".mp4":
        load_ffmpeg()
    return path


def save_film(
    trial: FilmedTrial,
    path: Path | str,
    *,
    size: int = 480,
    fps: int = 25,
    speed: float = 1.0,
    attempts: int | None = None,
    watch: Callable[[int, int], None] = lambda attempt, action: None,
) -> int:
    """Write a film of a trial, or its last picture as a still; the file is replaced in one step.

    Args:
        trial: What was played.
        path: A film if it ends in ``.gif`` or ``.mp4``, a still if in ``.png`` or ``.svg``.
        size: Height in pixels.
        fps: Frames per second; a GIF, which counts in hundredths of a second, comes near it.
        speed: How many times faster than one unit of simulated time per second.
        attempts: How many attempts to show at most.
        watch: Called with the numbers of the attempt and the action that are being drawn.

    Returns:
        How many frames it has, at ``fps``.

    Raises:
        OpenLockError: If the suffix is another or the file cannot be written.
    """
    path = check_suffix(path)
    suffix = path.suffix.lower()
    sequence = shots(trial, fps, speed, attempts)
    if suffix in STILLS:
        *_, last = sequence
        save_still(last.look, path, size, last.panel)
        return 1
    write = write_mp4 if suffix == ".mp4" else write_gif
    frames = 0

    def pictures() -> Iterator[tuple[Bytes, int]]:
        nonlocal frames
        for shot in sequence:
            watch(shot.attempt, shot.action)
            yield draw(shot.look, size, shot.panel), shot.frames
            frames += shot.frames

    with replacing(path) as file:
        write(file, pictures(), fps)
    return frames

"""A film of a trial: the physical room carries out what was done, the console beside it.

A film is a sequence of *shots*. While the arm moves there is one for each frame; before and after a
movement the film stands still for a while, which is one shot of several frames. The record says
what was done and what came of it; the bodies show how.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from causal_openlock.errors import OpenLockError
from causal_openlock.files.atomic import replacing, write_bytes, write_text
from causal_openlock.physics.room import PhysicalRoom
from causal_openlock.physics.world import STEP, Pose
from causal_openlock.render.filmed_trial import FilmedAttempt, FilmedTrial
from causal_openlock.render.panel import Panel, ShownAction, draw
from causal_openlock.render.raster import Bytes
from causal_openlock.render.scene import Look
from causal_openlock.render.svg import room_svg
from causal_openlock.wording import counted, nearest
from causal_openlock.world.room import Room, action_names, published_layouts

FILMS = (".gif", ".mp4")
STILLS = (".png", ".svg")
BEFORE, AFTER, BETWEEN, END = 0.6, 0.5, 1.0, 2.5
"""Seconds for which the film stands still: before an attempt, after an action, after the last
action of an attempt, at the end."""


@dataclass(frozen=True)
class Shot:
    """What is shown for a while.

    Attributes:
        look: The room.
        panel: The console beside it.
        frames: For how many frames.
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
    """A trial as a film.

    Args:
        trial: What was played.
        fps: Frames per second.
        speed: How many times faster than one unit of simulated time per second.
        attempts: How many attempts to show at most; ``None`` shows all.
    """
    shown = trial.attempts[:attempts]
    story = _Story(trial)
    grey = tuple(story.room.active.tolist())
    physical = PhysicalRoom(story.room.fsm, story.room.layout)
    poses: list[Pose] = []
    physical.watch = poses.append
    stride = speed / (fps * STEP)  # steps of the simulation in a frame

    def still(seconds: float, attempt: int, action: int, panel: Panel) -> Shot:
        look = Look.of_pose(physical.pose(), grey)
        frames = max(1, round(seconds / speed * fps))
        return Shot(look, panel, frames, attempt, action, moving=False)

    for number, attempt in enumerate(shown, 1):
        physical.reset()
        yield still(BEFORE, number, 0, story.begin(number))
        last = number == len(shown)
        for index, action in enumerate(attempt.actions, 1):
            poses.clear()
            physical.act(action, yields=attempt.moved[index - 1] or trial.schema.deterministic)
            panel = story.during(action)
            pressed = action == 2 * trial.layout.positions
            for frame in range(1, math.ceil(len(poses) / stride) + 1):
                pose = poses[min(round(frame * stride), len(poses)) - 1]
                yield Shot(Look.of_pose(pose, grey, pressed), panel, 1, number, index, True)
            ended = index == len(attempt.actions)
            panel = story.after(attempt, index)
            if ended and last:
                panel = replace(panel, remark=story.end(len(shown)))
            yield still((END if last else BETWEEN) if ended else AFTER, number, index, panel)


class _Story:
    """What the console shows as a trial goes on."""

    def __init__(self, trial: FilmedTrial) -> None:
        self.room: Room = trial.room
        self._trial = trial
        self._names = [name.replace("_", " ") for name in action_names(trial.layout.positions)]
        self._found: dict[int, str] = {}
        self._state = 0
        self._panel = Panel((), 0, 0)
        layout = trial.layout.name
        self._layout = f" in {layout}" * (layout in published_layouts(trial.schema))

    def begin(self, number: int) -> Panel:
        """Before an attempt."""
        trial = self._trial
        limit = trial.protocol.attempt_limit
        self._state, self._number = 0, number
        self._panel = Panel(
            solutions=self._solutions(),
            attempts_left=self._left(number),
            actions_left=trial.action_limit,
            heading=trial.learner,
            lines=(
                f"{trial.condition}, protocol {trial.protocol.name}, subject {trial.subject}",
                f"Trial {trial.trial} of {trial.trials}: {trial.schema.name}{self._layout}",
                f"Attempt {number} of at most {limit}",
            ),
            actions=(),
        )
        return self._panel

    def during(self, action: int) -> Panel:
        """While an action is carried out."""
        done = (*(self._panel.actions or ()), ShownAction(self._names[action]))
        self._panel = replace(self._panel, actions=done)
        return self._panel

    def after(self, attempt: FilmedAttempt, index: int) -> Panel:
        """After the action of some number in an attempt."""
        action = attempt.actions[index - 1]
        before = self._state
        if attempt.moved[index - 1]:
            self._state = int(self.room.next_state[before, action])
        if index == len(attempt.actions) and attempt.new:
            levers = self.room.schema.solutions[attempt.solution]
            pushes = [self._names[a].removeprefix("push ") for a in self.room.action_of(levers)]
            self._found[attempt.solution] = ", ".join(pushes[:-1])
        outcome, good = self._outcome(attempt, before, self._state)
        *earlier, last = self._panel.actions or ()
        over = index == len(attempt.actions)
        self._panel = replace(
            self._panel,
            solutions=self._solutions(),
            attempts_left=self._left(self._number + over),
            actions_left=0 if over else self._trial.action_limit - index,
            actions=(*earlier, replace(last, outcome=outcome, good=good)),
        )
        return self._panel

    def _outcome(self, attempt: FilmedAttempt, before: int, after: int) -> tuple[str, bool]:
        """What came of an action, and whether it was progress."""
        fsm = self.room.fsm
        if before == after:
            return "nothing moves", False
        if fsm.opened[after]:
            news = "a new solution" if attempt.new else "nothing new"
            return f"the door opens: {news}", attempt.new
        if fsm.unlocked[after] == fsm.unlocked[before]:
            return "the lever moves", False
        unlocked = bool(fsm.unlocked[after])
        return ("the door unlocks" if unlocked else "the door locks again"), unlocked

    def end(self, shown: int) -> str:
        """The last line of the film."""
        more = len(self._trial.attempts) - shown
        if more:
            return f"{counted(more, 'more attempt')} not shown"
        left = len(self.room.schema.solutions) - len(self._found)
        if left:
            return f"{counted(left, 'solution')} not found"
        return f"All solutions found in {counted(shown, 'attempt')}"

    def _left(self, number: int) -> int | None:
        """How many attempts are left before that of some number; none are counted at the end."""
        protocol = self._trial.protocol
        if protocol.stop_when_solved and len(self._found) == len(self.room.schema.solutions):
            return None
        return protocol.attempt_limit + 1 - number

    def _solutions(self) -> tuple[str, ...]:
        missing = len(self.room.schema.solutions) - len(self._found)
        return (*self._found.values(), *[""] * missing)


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
        from causal_openlock.render.mp4 import load_ffmpeg

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
    if suffix == ".mp4":
        from causal_openlock.render.mp4 import write_mp4 as write
    else:
        from causal_openlock.render.gif import write_gif as write
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


def save_still(
    look: Look, path: Path | str, size: int = 600, panel: Panel | None = None, title: str = ""
) -> None:
    """Write a picture of a room, PNG or SVG by the suffix; the file is replaced in one step.

    Raises:
        OpenLockError: If the suffix is another or the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in STILLS:
        raise OpenLockError(
            f"{path}: a picture of a room cannot be saved as {suffix!r}; {nearest(suffix, STILLS)}"
        )
    if suffix == ".svg":
        write_text(path, room_svg(look, panel, title or "An OpenLock room"))
        return
    import io

    from PIL import Image

    content = io.BytesIO()
    Image.fromarray(draw(look, size, panel)).save(content, "png")
    write_bytes(path, content.getvalue())

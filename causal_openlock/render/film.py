"""A film of a trial: the physical room carries out the actions, next to the console.

The trial is played by a learner now, or read from the record of a subject; both ways lead through
the rows of a record, which say what was done and what came of it. The bodies show how. A film is a
sequence of *shots*: while the arm moves there is one for each frame; before and after a movement
the film pauses, which is one shot of several frames. Pillow writes GIFs, and the ffmpeg that
imageio-ffmpeg brings or finds writes MP4s.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from itertools import chain, groupby, pairwise
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
from PIL import Image

from causal_openlock.contract.learner import Learner
from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.condition import SHOWN, Condition
from causal_openlock.experiment.declare import LearnerSpec
from causal_openlock.experiment.plan import check_trial
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.experiment.session import Session
from causal_openlock.files.atomic import replacing
from causal_openlock.physics.geometry import Pose
from causal_openlock.physics.room import PhysicalRoom
from causal_openlock.physics.world import STEP
from causal_openlock.render import STILLS, path_of_picture
from causal_openlock.render.paint import Bytes, Panel, ShownAction, draw, save_still
from causal_openlock.render.scene import Look
from causal_openlock.wording import counted, nearest
from causal_openlock.world.rewards import PAPER_REWARD, RewardFunction
from causal_openlock.world.room import Room, action_names, positions_for, published_layouts

FILMS = (".gif", ".mp4")
# Seconds for which the film pauses: before an attempt, after an action, after the last action of an
# attempt, at the end.
BEFORE, AFTER, BETWEEN, END = 0.6, 0.5, 1.0, 2.5


# -- what was played ------------------------------------------------------------------------------


@dataclass(frozen=True)
class FilmedTrial:
    """One trial of one subject."""

    learner: str  #: label of the learner
    condition: Condition
    protocol: Protocol  #: its budgets
    subject: int  #: its number
    trial: int  #: number of the trial in the whole condition, from 1
    trials: int  #: how many trials the condition has
    attempts: Sequence[dict[str, Any]]  #: the rows of the record that are its attempts

    @property
    def shown(self) -> bool:
        """Whether the subject was shown the trial and did not act itself."""
        return bool(self.attempts[0]["phase"] == SHOWN)

    @property
    def place(self) -> str:
        """Place in the condition: ``trial 1 of 7``, perhaps ``(shown to the subject)``."""
        return f"trial {self.trial} of {self.trials}{' (shown to the subject)' * self.shown}"

    @cached_property
    def room(self) -> Room:
        """The room."""
        schemas = {schema.name: schema for schema in self.condition.schemas}
        positions = max(map(positions_for, schemas.values()))
        return Room.of(schemas[self.attempts[0]["schema"]], self.attempts[0]["layout"], positions)

    @property
    def found(self) -> int:
        """Number of solutions found."""
        return sum(row["new_solution"] for row in self.attempts)


def play_trial(
    learner: Learner,
    condition: Condition,
    protocol: Protocol,
    *,
    trial: int = 1,
    subject: int = 0,
    seed: int = 0,
    reward: RewardFunction | str = PAPER_REWARD,
    label: str = "learner",
) -> FilmedTrial:
    """Let one subject play up to the end of a trial.

    The subject acts as in any :class:`~causal_openlock.experiment.session.Session` with
    the same condition, protocol, number, seed and label. Arguments are those of
    :func:`~causal_openlock.belief.trace.trace_trial`, but for ``recorded``.

    Raises:
        ExperimentError: If there is no such trial, or a schema does not fit the protocol.
    """
    session = Session(condition, protocol, [subject], seed=seed, reward=reward, learner=label)
    trials = session.brief.trials
    check_trial(trial, trials, f"{condition.name} under protocol {protocol.name}")
    session.begin(learner)
    for step in session.steps(learner):
        if step.trial_over[0] and step.view.trial[0] == trial:
            break
    attempts = _trials(session.record())[trial - 1]
    return FilmedTrial(label, condition, protocol, subject, trial, trials, attempts)


def recorded_trial(
    folder: Path | str, learner: str, condition: str, subject: int = 0, trial: int = 1
) -> FilmedTrial:
    """A trial of a recorded subject.

    Trials of the whole condition count from 1, subjects from 0; ``learner`` is a label in the
    experiment.

    Raises:
        StoreError: If the folder does not hold it.
        ExperimentError: If there is no such trial.
    """
    import pyarrow.compute as pc

    from causal_openlock.storage.store import Store

    store = Store(folder)
    experiment = store.experiment()
    spec: LearnerSpec = _named(experiment.learners, learner, f"{folder} holds no learner")
    played: Condition = _named(experiment.conditions, condition, f"{folder} holds no condition")
    wanted = pc.field("subject") == subject
    for column, value in (("learner", learner), ("condition", condition)):
        wanted &= pc.field(column).cast("string") == value
    begins = f"{learner}_{condition}_"
    paths = [store.cells / name for name in experiment.files if name.startswith(begins)]
    records = (store.read(path).filter(wanted) for path in paths if path.exists())
    trials = next(filter(None, map(_trials, records)), [])
    if not trials:
        raise StoreError(
            f"{folder} holds no subject {subject} of {learner} in {condition}; subjects are 0 to "
            f"{spec.subjects - 1}, and compare completes what is missing"
        )
    check_trial(trial, len(trials), f"subject {subject} of {learner} in {condition}")
    attempts = trials[trial - 1]
    return FilmedTrial(learner, played, spec.protocol, subject, trial, len(trials), attempts)


def _named(parts: Sequence[Any], name: str, otherwise: str) -> Any:
    known = {part.name: part for part in parts}
    if name not in known:
        raise StoreError(f"{otherwise} {name!r}; {nearest(name, known)}")
    return known[name]


def _trials(record: pa.Table) -> list[list[dict[str, Any]]]:
    """The attempts of one subject, trial by trial."""
    runs = groupby(record.to_pylist(), key=lambda row: (row["phase"], row["loop"], row["trial"]))
    return [list(run) for _, run in runs]


# -- what is shown -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Shot:
    """A picture that is shown for some frames."""

    look: Look  #: the room
    panel: Panel  #: the console next to the room
    frames: int
    attempt: int  #: number of the attempt, from 1
    action: int  #: number of the action in it, from 1; 0 before the first


def shots(
    trial: FilmedTrial, fps: int = 25, speed: float = 1.0, attempts: int | None = None
) -> Iterator[Shot]:
    """A trial as a film; ``speed`` is in units of simulated time per second."""
    room, film = trial.room, list(pauses(trial, fps, speed, attempts))
    physical, grey, poses = PhysicalRoom(room.fsm, room.layout), room.active.tolist(), list[Pose]()
    physical.watch = poses.append
    stride = speed / (fps * STEP)  # steps of the simulation in a frame
    for before, pause in pairwise([film[0], *film]):
        if pause.action:
            row, index = trial.attempts[pause.attempt - 1], pause.action - 1
            action, moved = row["actions"][index], row["moved"][index]
            poses.clear()
            physical.act(action, yields=moved or room.schema.deterministic)
            *done, last = pause.panel.actions or ()
            panel = replace(before.panel, actions=(*done, ShownAction(last.name)))
            pressed = action == 2 * room.positions
            for frame in range(1, math.ceil(len(poses) / stride) + 1):
                pose = poses[min(round(frame * stride), len(poses)) - 1]
                look = Look.of_pose(pose, grey, pressed)
                yield Shot(look, panel, 1, pause.attempt, pause.action)
        else:
            physical.reset()
        yield replace(pause, look=Look.of_pose(physical.pose(), grey))


def pauses(
    trial: FilmedTrial, fps: int = 25, speed: float = 1.0, attempts: int | None = None
) -> Iterator[Shot]:
    """A shot before each attempt and after each action; nothing is simulated, the arm at rest."""
    room, rows, found = trial.room, trial.attempts[:attempts], list[str]()
    names = [name.replace("_", " ") for name in action_names(room.positions)]
    places = room.layout.as_mapping(room.schema)

    def frames(seconds: float) -> int:
        return max(1, round(seconds / speed * fps))

    for number, row in enumerate(rows, 1):
        state, actions = 0, list[ShownAction]()
        look = Look.of_observation(room.observation[0], room.positions)
        yield Shot(look, _panel(trial, number, actions, found), frames(BEFORE), number, 0)
        for index, (action, moved) in enumerate(zip(row["actions"], row["moved"], strict=True), 1):
            before, state = state, int(room.next_state[state, action]) if moved else state
            seen = room.observation[before], room.observation[state]
            actions.append(ShownAction.of(names[action], *seen, row["new_solution"]))
            over, last = index == len(row["actions"]), number == len(rows)
            if over and row["new_solution"]:
                solution = room.schema.solutions[row["solution"]]
                found.append(", ".join(places[lever] for lever in solution))
            remark = _remark(trial, number, len(found)) if over and last else ""
            panel = _panel(trial, number, actions, found, over, remark)
            seconds = (END if last else BETWEEN) if over else AFTER
            look = Look.of_observation(seen[1], room.positions)
            yield Shot(look, panel, frames(seconds), number, index)


def _panel(
    trial: FilmedTrial,
    number: int,
    actions: Sequence[ShownAction],
    found: Sequence[str],
    over: bool = False,
    remark: str = "",
) -> Panel:
    """The console in an attempt, after these actions."""
    schema, name = trial.room.schema, trial.room.layout.name
    missing = len(schema.solutions) - len(found)
    solved = (trial.shown or trial.protocol.stop_when_solved) and not missing
    limit = trial.protocol.attempt_limit
    layout = f" in {name}" if name in published_layouts(schema) else ""
    return Panel(
        solutions=(*found, *[""] * missing),
        attempts_left=None if solved else limit + 1 - number - over,
        actions_left=0 if over else trial.protocol.actions_for(schema) - len(actions),
        heading=trial.learner,
        lines=(
            f"{trial.condition.name}, protocol {trial.protocol.name}, subject {trial.subject}",
            f"{trial.place.capitalize()}: {schema.name}{layout}",
            f"Attempt {number} of at most {limit}",
        ),
        actions=tuple(actions),
        remark=remark,
    )


def _remark(trial: FilmedTrial, shown: int, found: int) -> str:
    """The last line of a film that shows the first ``shown`` attempts."""
    if more := len(trial.attempts) - shown:
        return f"{counted(more, 'more attempt')} not shown"
    if missing := len(trial.room.schema.solutions) - found:
        return f"{counted(missing, 'solution')} not found"
    what = "shown" if trial.shown else "found"
    return f"All solutions {what} in {counted(shown, 'attempt')}"


# -- files ----------------------------------------------------------------------------------------


def check_suffix(path: Path | str) -> Path:
    """A path whose suffix says what to write, and for which everything needed is there.

    Raises:
        OpenLockError: If it is none, or a film cannot be made here.
    """
    path = path_of_picture(path, FILMS + STILLS, "a film")
    if path.suffix.lower() == ".mp4":
        _ffmpeg()
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
        path: A film if it ends in ``.gif`` or ``.mp4``, a still if in ``.png`` or ``.svg``. A GIF
            takes about a byte of memory for each pixel of each frame while it is written.
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
    film = list(shots(trial, fps, speed, attempts))
    if path.suffix.lower() in STILLS:
        save_still(film[-1].look, path, size, film[-1].panel)
        return 1

    def pictures() -> Iterator[Bytes]:
        for shot in film:
            watch(shot.attempt, shot.action)
            yield draw(shot.look, size, shot.panel)

    frames = [shot.frames for shot in film]
    with replacing(path) as file:
        if path.suffix.lower() == ".mp4":
            _write_mp4(file, pictures(), frames, fps)
        else:
            # All frames share the colours of a few of them.
            sample = [*film[:: len(film) // 8 + 1], film[-1]]
            colours = np.vstack([draw(shot.look, size, shot.panel) for shot in sample])
            _write_gif(file, pictures(), frames, fps, Image.fromarray(colours))
    return sum(frames)


def _write_gif(
    file: BinaryIO, pictures: Iterator[Bytes], frames: list[int], fps: int, sample: Image.Image
) -> None:
    palette = sample.quantize(128, Image.Quantize.MAXCOVERAGE)
    images = (
        Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE)
        for picture in pictures
    )
    # In hundredths of a second, rounded from the beginning, so that errors do not add up.
    times = np.diff(np.rint(np.cumsum([0, *frames]) * 100 / fps)).clip(2, 65535) * 10
    next(images).save(
        file, "gif", save_all=True, append_images=images, duration=times.tolist(), loop=0
    )


def _ffmpeg() -> Any:
    """The module ``imageio_ffmpeg``; OpenLockError if it is missing or has no ffmpeg."""
    try:
        module = import_module("imageio_ffmpeg")
        module.get_ffmpeg_exe()
    except (ImportError, RuntimeError):
        raise OpenLockError(
            "an .mp4 needs ffmpeg, which is not installed; run pip install "
            "'causal-openlock[film]', or choose a .gif"
        ) from None
    return module


def _write_mp4(file: BinaryIO, pictures: Iterator[Bytes], frames: list[int], fps: int) -> None:
    ffmpeg = _ffmpeg()
    # The usual coding of colours has half the resolution, and so needs even sizes.
    even = (
        np.pad(picture, [(0, length % 2) for length in picture.shape[:2]] + [(0, 0)], mode="edge")
        for picture in pictures
    )
    first = next(even)
    film = ffmpeg.write_frames(
        file.name,
        first.shape[1::-1],
        fps=fps,
        codec="libx264",
        quality=None,
        macro_block_size=1,
        ffmpeg_log_level="error",
        output_params=["-crf", "18", "-movflags", "+faststart", "-f", "mp4"],
    )
    try:
        with closing(film):
            next(film)  # it waits for pictures now
            for picture, many in zip(chain([first], even), frames, strict=True):
                for _ in range(many):
                    film.send(picture.tobytes())
        # imageio-ffmpeg does not report whether ffmpeg succeeded; the film shows it.
        if ffmpeg.count_frames_and_secs(file.name)[0] != sum(frames):
            raise RuntimeError
    except (OSError, RuntimeError) as error:
        raise OpenLockError(
            f"ffmpeg ({ffmpeg.get_ffmpeg_exe()}) cannot make the film, for the reason that it "
            "has printed; choose a .gif, or install another ffmpeg"
        ) from error

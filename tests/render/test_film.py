"""Films: what they show against the record, how long they last, and how they are asked for."""

from __future__ import annotations

import math
import stat
import sys
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from causal_openlock.cli import main
from causal_openlock.contract.registry import create
from causal_openlock.errors import OpenLockError, ProtocolError, StoreError
from causal_openlock.experiment.building import Changes
from causal_openlock.experiment.file import find_experiment, read_experiment
from causal_openlock.experiment.session import Session
from causal_openlock.physics.room import PhysicalRoom
from causal_openlock.render.film import AFTER, BEFORE, BETWEEN, END, Shot, save_film, shots
from causal_openlock.render.filmed_trial import FilmedTrial, play_trial, recorded_trial
from causal_openlock.render.panel import draw
from causal_openlock.render.scene import Look, frame
from causal_openlock.render.video import _palette, write_gif
from causal_openlock.running.runner import run
from causal_openlock.world.room import Layout
from support.session_play import HUMAN, RL, Curious, named, one_room

pytestmark = pytest.mark.slow

FPS = 20


class Here(Executor):
    """Does what it is given at once."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(fn(*args, **kwargs))
        return done


@pytest.fixture(scope="module")
def trial() -> FilmedTrial:
    """The oracle in CC3: two attempts."""
    return play_trial(create("oracle"), named("CC3"), HUMAN, label="oracle")


@pytest.fixture(scope="module")
def film(trial: FilmedTrial) -> list[Shot]:
    return list(shots(trial, FPS))


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A comparison of two learners in two conditions, two subjects a cell."""
    folder = tmp_path_factory.mktemp("results") / "r"
    file = folder.parent / "small.yaml"
    file.write_text(
        "name: small\nseed: 5\nsubjects: 3\ncell_size: 2\nprotocol: short\n"
        "conditions: [CC3-CC4, noisy_CC3]\nlearners: [oracle, {learner: random, name: chance}]\n"
        "protocols:\n  short: {based_on: human, attempt_limit: 4, layouts: random}\n",
        encoding="utf-8",
    )
    run(read_experiment(find_experiment(str(file)), Changes()), folder, executor=Here())
    return folder


def command(*words: object, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> tuple[int, str, str]:
    monkeypatch.setattr(sys, "argv", ["causal-openlock", *map(str, words)])
    try:
        main()
        status = 0
    except SystemExit as end:
        status = int(end.code or 0)
    told = capsys.readouterr()
    return status, told.out, told.err


# -- what was played ------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "number"), [("CC3", 1), ("CC3", 4), ("CC3-CE4", 7)])
def test_a_subject_plays_as_in_a_session(name: str, number: int) -> None:
    played = play_trial(
        Curious(), named(name), HUMAN, trial=number, subject=3, seed=9, label="curious"
    )
    session = Session(named(name), HUMAN, [3], seed=9, learner="curious")
    record = session.play(Curious()).to_pylist()
    trials = [
        list(rows)
        for _, rows in groupby(record, key=lambda row: (row["phase"], row["loop"], row["trial"]))
    ]
    rows = trials[number - 1]
    assert [list(one.actions) for one in played.attempts] == [row["actions"] for row in rows]
    assert [list(one.moved) for one in played.attempts] == [row["moved"] for row in rows]
    assert [one.new for one in played.attempts] == [row["new_solution"] for row in rows]
    assert (played.schema.name, played.layout.name) == (rows[0]["schema"], rows[0]["layout"])
    assert (played.trial, played.trials) == (number, len(trials))
    assert played.found == rows[-1]["solutions_found"]


@pytest.mark.parametrize("condition", ["CC3-CC4", "noisy_CC3"])
@pytest.mark.parametrize("label", ["oracle", "chance"])
def test_a_recorded_subject_is_the_one_that_plays(
    results: Path, label: str, condition: str
) -> None:
    chosen = read_experiment(find_experiment(str(results.parent / "small.yaml")), Changes())
    entry = next(one for one in chosen.learners if one.name == label)
    played = next(one for one in chosen.conditions if one.name == condition)
    for number in (1, 5):
        recorded = recorded_trial(results, label, condition, subject=2, trial=number)
        live = play_trial(
            create(entry.learner, entry.parameters),
            played,
            entry.protocol,
            trial=number,
            subject=2,
            seed=chosen.seed,
            reward=entry.reward,
            label=label,
        )
        assert recorded == live


@pytest.mark.parametrize("suffix", ["gif", "svg"])
def test_the_film_of_a_recorded_subject_is_the_live_one_byte_for_byte(
    results: Path, tmp_path: Path, suffix: str
) -> None:
    recorded = recorded_trial(results, "oracle", "CC3-CC4", subject=1, trial=7)
    chosen = read_experiment(find_experiment(str(results.parent / "small.yaml")), Changes())
    live = play_trial(
        create("oracle"),
        chosen.conditions[0],
        chosen.learners[0].protocol,
        trial=7,
        subject=1,
        seed=5,
        label="oracle",
    )
    for played, name in ((recorded, "a"), (live, "b")):
        save_film(played, tmp_path / f"{name}.{suffix}", size=120, fps=5, speed=4.0)
    assert (tmp_path / f"a.{suffix}").read_bytes() == (tmp_path / f"b.{suffix}").read_bytes()


def test_what_is_not_in_the_record_is_said(results: Path, tmp_path: Path) -> None:
    with pytest.raises(StoreError, match=r"no learner 'oracel'; did you mean oracle\?"):
        recorded_trial(results, "oracel", "CC3-CC4")
    with pytest.raises(StoreError, match=r"no condition 'CC4'.*known: CC3-CC4, noisy_CC3"):
        recorded_trial(results, "oracle", "CC4")
    with pytest.raises(StoreError, match=r"no subject 3 of oracle in CC3-CC4; subjects are 0 to 2"):
        recorded_trial(results, "oracle", "CC3-CC4", subject=3)
    with pytest.raises(ProtocolError, match=r"has no trial 8; choose one from 1 to 7"):
        recorded_trial(results, "oracle", "CC3-CC4", trial=8)
    with pytest.raises(ProtocolError, match=r"CC4 under protocol human has no trial 6"):
        play_trial(create("oracle"), named("CC4"), HUMAN, trial=6)
    with pytest.raises(StoreError, match="holds no results"):
        recorded_trial(tmp_path, "oracle", "CC3")


def test_a_room_that_is_larger_for_another_schemas_sake_is_filmed_as_it_was_played() -> None:
    schema = one_room("seven", Layout((6, 5, 4, 3, 2, 1, 0))).train[0].schema
    played = play_trial(create("oracle"), one_room(schema, Layout((6, 5, 4, 3, 2, 1, 0))), HUMAN)
    assert played.layout.places == (6, 5, 4, 3, 2, 1, 0)
    assert played.action_limit == schema.least_action_limit


# -- what is shown --------------------------------------------------------------------------------


def observed(look: Look) -> list[int]:
    """A look as an observation: what its bodies come to."""
    return [*(slid > 0.5 for slid in look.levers), *look.grey, look.locked, look.door > 0.5]


def check_against_record(played: FilmedTrial, sequence: list[Shot]) -> None:
    """Whenever the arm stands still, the room is as the record says, and so is the console."""
    room, found = played.room, 0
    stills = iter([moment for moment in sequence if not moment.moving])
    for number, attempt in enumerate(played.attempts, 1):
        state = 0
        first = next(stills)
        assert (first.attempt, first.action) == (number, 0)
        assert observed(first.look) == room.observation[0].tolist()
        assert first.panel.actions == ()
        for index, (action, moved) in enumerate(
            zip(attempt.actions, attempt.moved, strict=True), 1
        ):
            before = state
            state = int(room.next_state[state, action]) if moved else state
            moment = next(stills)
            assert (moment.attempt, moment.action) == (number, index)
            assert observed(moment.look) == room.observation[state].tolist()
            assert moment.panel.actions is not None
            said = moment.panel.actions[-1].outcome
            opened, was = room.observation[state, -1], room.observation[before]
            last = index == len(attempt.actions)
            found += attempt.new and last
            if not moved:
                assert said == "nothing moves"
            elif opened:
                assert (
                    said == f"the door opens: {'a new solution' if attempt.new else 'nothing new'}"
                )
            elif was[-2] != room.observation[state, -2]:
                assert said == ("the door locks again" if not was[-2] else "the door unlocks")
            else:
                assert said == "the lever moves"
            assert len(moment.panel.actions) == index
            assert moment.panel.actions_left == (0 if last else played.action_limit - index)
            assert sum(map(bool, moment.panel.solutions)) == found
            assert len(moment.panel.solutions) == len(room.schema.solutions)
            limit = played.protocol.attempt_limit
            won = found == len(room.schema.solutions) and played.protocol.stop_when_solved
            assert moment.panel.attempts_left == (None if won else limit + 1 - number - last)
    assert next(stills, None) is None


def test_a_film_shows_what_the_record_says(trial: FilmedTrial, film: list[Shot]) -> None:
    check_against_record(trial, film)
    assert trial.found == 2
    assert film[-1].panel.remark == "All solutions found in 2 attempts"
    assert all(not moment.panel.remark for moment in film[:-1])


def failures(played: FilmedTrial) -> list[int]:
    """Attempts, from 0, in which something was possible and did not happen."""
    found = []
    for number, attempt in enumerate(played.attempts):
        state = 0
        for action, moved in zip(attempt.actions, attempt.moved, strict=True):
            if not moved and played.room.chance[state, action] > 0:
                found.append(number)
            state = int(played.room.next_state[state, action]) if moved else state
    return found


@pytest.mark.parametrize("name", ["noisy_CC3", "CE4"])
def test_a_film_of_chance_and_mistakes_shows_what_the_record_says(name: str) -> None:
    played = play_trial(Curious(), named(name), HUMAN, subject=1, seed=2)
    first = 0
    if name == "noisy_CC3":
        first = failures(played)[0]
    else:
        assert not failures(played)
        assert not all(moved for attempt in played.attempts[:8] for moved in attempt.moved)
    short = replace(played, attempts=played.attempts[first : first + 8])
    check_against_record(short, list(shots(short, fps=2)))


def test_solutions_are_ticked_off_by_how_they_were_found(
    trial: FilmedTrial, film: list[Shot]
) -> None:
    names = trial.layout.as_mapping(trial.schema)
    expected = [
        ", ".join(names[lever] for lever in trial.schema.solutions[attempt.solution])
        for attempt in trial.attempts
    ]
    assert list(film[-1].panel.solutions) == expected
    ticked = [sum(map(bool, moment.panel.solutions)) for moment in film]
    assert ticked == sorted(ticked)
    assert ticked[0] == 0


def test_the_button_is_pressed_while_the_door_is_pushed(film: list[Shot]) -> None:
    for moment in film:
        assert moment.panel.actions is not None
        door = moment.moving and moment.panel.actions[-1].name == "push door"
        assert moment.look.pressed == door


# -- how long it lasts ----------------------------------------------------------------------------


@pytest.mark.parametrize(("fps", "speed"), [(20, 1.0), (25, 1.0), (10, 2.5), (3, 20.0)])
def test_a_film_lasts_as_long_as_its_movements_and_the_pauses(
    trial: FilmedTrial, fps: int, speed: float
) -> None:
    sequence = list(shots(trial, fps, speed))
    physical = PhysicalRoom(trial.room.fsm, trial.room.layout)

    def pause(seconds: float) -> int:
        return max(1, round(seconds / speed * fps))

    for number, attempt in enumerate(trial.attempts, 1):
        physical.reset()
        mine = [moment for moment in sequence if moment.attempt == number]
        assert mine[0].frames == pause(BEFORE)
        for index, action in enumerate(attempt.actions, 1):
            of_it = [moment for moment in mine if moment.action == index]
            steps = physical.act(action).steps
            assert len(of_it) == math.ceil(steps / 120 * fps / speed) + 1
            assert all(moment.frames == 1 for moment in of_it[:-1])
            assert [moment.moving for moment in of_it] == [True] * (len(of_it) - 1) + [False]
            over = index == len(attempt.actions)
            last = over and number == len(trial.attempts)
            assert of_it[-1].frames == pause(END if last else BETWEEN if over else AFTER)
            # It ends where the movement ends.
            assert of_it[-1].look.joints == of_it[-2].look.joints == physical.pose().joints


def test_a_film_can_be_cut_short(trial: FilmedTrial) -> None:
    cut = list(shots(trial, FPS, attempts=1))
    assert {moment.attempt for moment in cut} == {1}
    assert cut[-1].panel.remark == "1 more attempt not shown"
    assert len(list(shots(trial, FPS, attempts=99))) > len(cut)


# -- as GIF ---------------------------------------------------------------------------------------


def frames_of(path: Path) -> list[tuple[np.ndarray, int]]:
    with Image.open(path) as gif:
        assert gif.info["loop"] == 0
        found = []
        for index in range(gif.n_frames):
            gif.seek(index)
            found.append((np.asarray(gif.convert("RGB")), int(gif.info["duration"])))
        return found


def test_the_frames_of_a_gif_are_those_of_the_film(
    trial: FilmedTrial, film: list[Shot], tmp_path: Path
) -> None:
    path = tmp_path / "film.gif"
    count = save_film(trial, path, size=160, fps=FPS)
    assert count == sum(moment.frames for moment in film)
    shown = frames_of(path)
    assert sum(duration for _, duration in shown) == 1000 * count / FPS
    # What looks the same is one frame that lasts longer; all others are there, in order.
    time, at = 0.0, 0
    starts = np.cumsum([0, *(duration for _, duration in shown)])
    for moment in film:
        while starts[at + 1] <= time + 1e-6:
            at += 1
        picture = draw(moment.look, 160, moment.panel).astype(int)
        assert np.abs(shown[at][0] - picture).mean() < 1.0
        time += 1000 * moment.frames / FPS
    assert len(shown) > 0.8 * len(film)
    assert [path.name for path in tmp_path.iterdir()] == ["film.gif"]


def test_colours_of_the_figure_stay_what_they_are_in_a_gif(
    trial: FilmedTrial, tmp_path: Path
) -> None:
    save_film(trial, tmp_path / "a.gif", size=240, fps=5, attempts=1)
    last, _ = frames_of(tmp_path / "a.gif")[-1]

    def pixel(point: tuple[float, float]) -> list[int]:
        column, row = frame(7, 240).pixel(point)
        return last[int(row), int(column)].tolist()

    assert pixel((4.2, 1.6)) == [80, 235, 111]
    assert pixel((3.6, 1.0)) == [255, 0, 0]
    assert pixel((3.6 + math.sin(math.pi / 3), 1.0 - math.cos(math.pi / 3))) == [153, 153, 153]
    assert pixel((0.0, 0.0)) == [255, 0, 0]
    grey = {place: place in trial.layout.places for place in (1, 3, 5)}
    for place, (x, y) in {1: (0.8, 3.0), 3: (-3.0, 0.8), 5: (0.8, -3.0)}.items():
        pushed = place in [action for action in trial.attempts[0].actions if action < 7]
        x, y = (
            x * (1 + pushed * 0.4 / 3 * (abs(x) > 2)),
            y * (1 + pushed * 0.4 / 3 * (abs(y) > 2)),
        )
        assert pixel((x, y)) == ([153] * 3 if grey[place] else [229] * 3)


def test_every_colour_of_the_palette_stays_what_it_is() -> None:
    palette = np.reshape(_palette().getpalette(), (1, -1, 3)).astype(np.uint8)
    assert palette.shape[1] > 50
    shown = Image.fromarray(palette).quantize(palette=_palette(), dither=Image.Dither.NONE)
    assert (np.asarray(shown.convert("RGB")) == palette).all()


def test_times_in_a_gif_do_not_drift(tmp_path: Path) -> None:
    path = tmp_path / "a.gif"
    picture = np.zeros((20, 30, 3), np.uint8)

    def shots() -> Iterator[tuple[np.ndarray, int]]:
        for index in range(300):
            picture[index % 20, index % 30] = 255 - picture[index % 20, index % 30]
            yield picture, 1

    with path.open("wb") as file:
        write_gif(file, shots(), fps=30)
    durations = [duration for _, duration in frames_of(path)]
    assert len(durations) == 300
    assert set(durations) == {30, 40}
    assert sum(durations) == 10_000


def test_a_picture_that_does_not_change_is_one_frame(tmp_path: Path) -> None:
    path = tmp_path / "a.gif"
    with path.open("wb") as file:
        write_gif(file, [(np.full((8, 8, 3), 153, np.uint8), 1)] * 7, fps=10)
    ((picture, _),) = [(np.asarray(Image.open(path).convert("RGB")), 0)]
    assert (picture == 153).all()
    assert Image.open(path).info["duration"] == 700


# -- as MP4 ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "body",
    [
        "sys.stdin.buffer.read(); sys.exit('Unknown encoder libx264')",
        "sys.exit('Unknown encoder libx264')",
        "sys.stdin.buffer.read(); print('Unknown encoder libx264', file=sys.stderr)",
    ],
)
def test_an_ffmpeg_that_fails_says_why_and_the_old_film_stays(
    trial: FilmedTrial,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    body: str,
) -> None:
    fake = tmp_path / "ffmpeg"
    fake.write_text(f"#!{sys.executable}\nimport sys\n{body}\n", encoding="utf-8")
    fake.chmod(fake.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(fake))
    path = tmp_path / "film.mp4"
    path.write_bytes(b"old")
    with pytest.raises(OpenLockError, match=r"ffmpeg \(.*\) cannot make the film"):
        save_film(trial, path, size=120, fps=4, attempts=1)
    assert "Unknown encoder libx264" in capfd.readouterr().err
    assert path.read_bytes() == b"old"
    assert sorted(one.name for one in tmp_path.iterdir()) == ["ffmpeg", "film.mp4"]


@pytest.mark.parametrize("size", [160, 161])
def test_an_mp4_is_made_of_every_frame(trial: FilmedTrial, tmp_path: Path, size: int) -> None:
    count = save_film(trial, tmp_path / "film.mp4", size=size, fps=10, attempts=1)
    assert count == sum(moment.frames for moment in shots(trial, 10, attempts=1))
    assert (tmp_path / "film.mp4").read_bytes()[4:8] == b"ftyp"
    facts, *frames = imageio_ffmpeg.read_frames(tmp_path / "film.mp4")
    last = list(shots(trial, 10, attempts=1))[-1]
    expected = draw(last.look, size, last.panel)
    height, width = (length + length % 2 for length in expected.shape[:2])
    assert (facts["size"], facts["fps"]) == ((width, height), 10.0)
    assert len(frames) == count
    shown = np.frombuffer(frames[-1], np.uint8).reshape(height, width, 3)
    apart = shown[: expected.shape[0], : expected.shape[1]].astype(int) - expected
    assert np.abs(apart).mean() < 6


# -- the commands ---------------------------------------------------------------------------------


def test_the_command_films_a_learner_and_a_recorded_subject(
    results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    small = ("--size", 120, "--fps", 4, "--speed", 5)
    path = tmp_path / "a.gif"
    status, out, _ = command(
        "film", "CC3", "-l", "oracle", *small, "-o", path, monkeypatch=monkeypatch, capsys=capsys
    )
    assert status == 0
    assert f"{path} written" in out
    assert "2 of 2 solutions found" in out
    assert len(frames_of(path)) > 10
    path = tmp_path / "b.gif"
    words = ("film", "noisy_CC3", "--from", results, "-l", "chance", "--subject", 2, "--trial", 3)
    status, out, _ = command(
        *words, "--attempts", 2, *small, "-o", path, monkeypatch=monkeypatch, capsys=capsys
    )
    assert status == 0
    assert "the first 2 of 4 attempts (--attempts shows more)" in out
    assert len(frames_of(path)) > 10


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_the_commands_draw_stills(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    film, room = tmp_path / f"film{suffix}", tmp_path / f"room{suffix}"
    words: tuple[object, ...] = ("film", "CC3", "-l", "oracle", "--size", 120, "-o", film)
    assert command(*words, monkeypatch=monkeypatch, capsys=capsys)[0] == 0
    words = ("room", "CC4", "--layout", "trial7", "-a", "push_LOWERLEFT", "--part", 0.5)
    assert command(*words, "-o", room, monkeypatch=monkeypatch, capsys=capsys)[0] == 0
    if suffix == ".png":
        assert Image.open(film).size[1] == 120
        assert Image.open(room).size[1] == 600
    else:
        assert "All solutions found in 2 attempts" in film.read_text(encoding="utf-8")
        assert "<title>CC4 in trial7, push_LOWERLEFT</title>" in room.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("film", "CC4", "-o", "a.giv"), "not '.giv'; did you mean .gif?"),
        (("film", "CC9", "-o", "a.gif"), "no schema 'CC9'"),
        (("film", "CC4", "-l", "oracel", "-o", "a.gif"), "did you mean oracle?"),
        (("film", "CC4", "-l", "oracle", "--trial", "6", "-o", "a.gif"), "has no trial 6"),
        (("film", "CC4", "--protocol", "humn", "-o", "a.gif"), "humn"),
        (("film", "CC4", "--from", "nowhere", "-o", "a.gif"), "nowhere holds no results"),
        (("film", "CC4", "--from", "x", "--seed", "1", "-o", "a.gif"), "leave out --seed"),
        (("film", "CC4", "-o", "a.mp4"), "an .mp4 needs ffmpeg, which is not installed"),
        (("film", "CC3", "-l", "oracle", "-o", "/proc/a/b.gif"), "cannot be written"),
        (("room", "CC4", "--layout", "trial1"), "layouts that fit: trial7"),
        (("room", "CC4", "-a", "push_UPER"), "did you mean push_UPPER?"),
        (("room", "CC4", "-o", "a.gif"), "a picture of a room cannot be saved as '.gif'"),
    ],
)
def test_mistakes_are_answered_with_one_sentence(
    words: tuple[str, ...],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Any,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", "")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    status, _, err = command(*words, monkeypatch=monkeypatch, capsys=capsys)
    errors = [line for line in err.splitlines() if line.startswith("error: ")]
    assert status == 2
    assert len(errors) == 1, err
    assert said in errors[0]
    assert not list(tmp_path.iterdir())


def test_a_trial_of_the_long_protocol_is_found_among_many() -> None:
    """The number of a trial counts over all loops."""
    protocol = type(RL)(**{**vars(RL), "attempt_limit": 2, "baseline_loops": 3})
    for trials in (1, 2):
        condition = one_room("CC3", "trial2", trials=trials)
        played = play_trial(Curious(), condition, protocol, trial=3)
        assert (played.trial, played.trials, len(played.attempts)) == (3, 3 * trials, 2)

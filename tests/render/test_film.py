"""Films: what they show against the record, how long they last, and how they are asked for."""

import math
import stat
import sys
from dataclasses import replace

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from causal_openlock.contract.registry import create
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.making import Changes, find_experiment, read_experiment
from causal_openlock.physics.room import PhysicalRoom
from causal_openlock.render.film import (
    AFTER,
    BEFORE,
    BETWEEN,
    END,
    pauses,
    play_trial,
    recorded_trial,
    save_film,
    shots,
)
from causal_openlock.render.paint import draw
from causal_openlock.render.scene import frame
from causal_openlock.world.room import Layout
from support.command import at_once
from support.session_play import HUMAN, RL, Curious, named, one_room

pytestmark = pytest.mark.slow

FPS = 20


@pytest.fixture(scope="module")
def trial():
    """The oracle in CC3: two attempts."""
    return play_trial(create("oracle"), named("CC3"), HUMAN, label="oracle")


@pytest.fixture(scope="module")
def film(trial):
    return list(shots(trial, FPS))


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A comparison of two learners in two conditions, two subjects a cell."""
    folder = tmp_path_factory.mktemp("results")
    (folder / "small.yaml").write_text(
        "name: small\nseed: 5\nsubjects: 3\ncell_size: 2\nprotocol: short\n"
        "conditions: [CC3-CC4, noisy_CC3]\nlearners: [oracle, {learner: random, name: chance}]\n"
        "protocols:\n  short: {based_on: human, attempt_limit: 4, layouts: random}\n",
        encoding="utf-8",
    )
    assert at_once("compare", "small.yaml", "--out", "r", cwd=folder).status == 0
    return folder / "r"


def played_live(results, learner, condition, **where):
    """What a subject of the experiment in ``small.yaml`` does, played now."""
    chosen = read_experiment(find_experiment(str(results.parent / "small.yaml")), Changes())
    (entry,) = [one for one in chosen.learners if one.name == learner]
    (rooms,) = [one for one in chosen.conditions if one.name == condition]
    where |= {"seed": chosen.seed, "reward": entry.reward, "label": learner}
    return play_trial(create(entry.learner, entry.parameters), rooms, entry.protocol, **where)


def played_the_same(trial, other):
    """Whether two trials are the same but for the time that they took."""
    one, two = (
        replace(each, attempts=[{**row, "wall_time": 0, "experiment": ""} for row in each.attempts])
        for each in (trial, other)
    )
    return one == two


# -- what was played ------------------------------------------------------------------------------


@pytest.mark.parametrize("condition", ["CC3-CC4", "noisy_CC3"])
@pytest.mark.parametrize("label", ["oracle", "chance"])
def test_a_recorded_subject_is_the_one_that_plays(results, label, condition):
    for number in (1, 5):
        recorded = recorded_trial(results, label, condition, subject=2, trial=number)
        live = played_live(results, label, condition, trial=number, subject=2)
        assert played_the_same(recorded, live)


def test_a_room_that_is_larger_for_another_schemas_sake_is_filmed_as_it_was_played():
    layout = Layout((6, 5, 4, 3, 2, 1, 0))
    played = play_trial(create("oracle"), one_room("seven", layout), HUMAN)
    assert played.room.layout.places == layout.places
    assert len(played.attempts[0]["actions"]) == played.room.schema.least_action_limit


def test_the_number_of_a_trial_counts_over_all_loops():
    protocol = type(RL)(**{**vars(RL), "attempt_limit": 2, "baseline_loops": 3})
    for trials in (1, 2):
        condition = one_room("CC3", "trial2", trials=trials)
        played = play_trial(Curious(), condition, protocol, trial=3)
        assert (played.trial, played.trials, len(played.attempts)) == (3, 3 * trials, 2)


# -- what is shown --------------------------------------------------------------------------------


def moving(shot):
    """Whether an action is being carried out."""
    return bool(shot.panel.actions) and not shot.panel.actions[-1].outcome


def check_against_record(played, sequence):
    """Whenever the arm stands still, the room is as the record says, and so is the console."""
    room, solutions = played.room, len(played.room.schema.solutions)
    limit, found = played.protocol.attempt_limit, 0
    actions = played.protocol.actions_for(room.schema)
    rests = iter([shot for shot in sequence if not moving(shot)])
    for number, attempt in enumerate(played.attempts, 1):
        state = 0
        for index in range(len(attempt["actions"]) + 1):
            shot, last = next(rests), index == len(attempt["actions"])
            moved, before = bool(index) and attempt["moved"][index - 1], state
            if moved:
                state = int(room.next_state[state, attempt["actions"][index - 1]])
            assert (shot.attempt, shot.action) == (number, index)
            look, now, was = shot.look, room.observation[state], room.observation[before]
            seen = [*(slid > 0.5 for slid in look.levers), *look.grey, look.locked, look.door > 0.5]
            assert seen == now.tolist()
            assert len(shot.panel.actions) == index
            if index:
                said = shot.panel.actions[-1].outcome
                assert ("door opens" in said) == (moved and bool(now[-1]))
                assert ("new solution" in said) == (last and attempt["new_solution"])
                assert ("lock" in said) == (was[-2] != now[-2])
                assert ("again" in said) == (not was[-2] and bool(now[-2]))
                assert ("nothing moves" in said) == (not moved)
            found += attempt["new_solution"] and last
            assert shot.panel.actions_left == (0 if last else actions - index)
            assert [bool(how) for how in shot.panel.solutions].count(True) == found
            assert len(shot.panel.solutions) == solutions
            won = found == solutions and played.protocol.stop_when_solved
            assert shot.panel.attempts_left == (None if won else limit + 1 - number - last)
    assert next(rests, None) is None


def test_a_film_shows_what_the_record_says(trial, film):
    check_against_record(trial, film)
    assert trial.found == 2
    assert film[-1].panel.remark == "All solutions found in 2 attempts"
    assert all(not shot.panel.remark for shot in film[:-1])
    names = trial.room.layout.as_mapping(trial.room.schema)
    solutions = [trial.room.schema.solutions[attempt["solution"]] for attempt in trial.attempts]
    assert list(film[-1].panel.solutions) == [
        ", ".join(names[lever] for lever in levers) for levers in solutions
    ]
    for shot in film:  # the green button is held down while the door is pushed
        at_the_door = moving(shot) and shot.panel.actions[-1].name == "push door"
        assert shot.look.pressed == at_the_door


@pytest.mark.parametrize("name", ["noisy_CC3", "CE4"])
def test_a_film_of_chance_and_mistakes_shows_what_the_record_says(name):
    played = play_trial(Curious(), named(name), HUMAN, subject=1, seed=2)
    failures = []  # attempts in which something was possible and did not happen
    for number, attempt in enumerate(played.attempts):
        state = 0
        for action, moved in zip(attempt["actions"], attempt["moved"], strict=True):
            if not moved and played.room.next_state[state, action] != state:
                failures.append(number)
            state = int(played.room.next_state[state, action]) if moved else state
    assert bool(failures) == (name == "noisy_CC3")
    first = failures[0] if failures else 0
    short = replace(played, attempts=played.attempts[first : first + 8])
    assert not all(moved for attempt in short.attempts for moved in attempt["moved"])
    check_against_record(short, list(shots(short, fps=2)))
    check_against_record(short, list(pauses(short)))


# -- how long it lasts ----------------------------------------------------------------------------


@pytest.mark.parametrize(("fps", "speed"), [(20, 1.0), (10, 2.5), (3, 20.0)])
def test_a_film_lasts_as_long_as_its_movements_and_the_pauses(trial, fps, speed):
    sequence = list(shots(trial, fps, speed))
    physical = PhysicalRoom(trial.room.fsm, trial.room.layout)

    def pause(seconds):
        return max(1, round(seconds / speed * fps))

    for number, attempt in enumerate(trial.attempts, 1):
        physical.reset()
        mine = [shot for shot in sequence if shot.attempt == number]
        assert mine[0].frames == pause(BEFORE)
        for index, action in enumerate(attempt["actions"], 1):
            of_it = [shot for shot in mine if shot.action == index]
            steps = physical.act(action).steps
            assert len(of_it) == math.ceil(steps / 120 * fps / speed) + 1
            assert all(shot.frames == 1 for shot in of_it[:-1])
            assert [moving(shot) for shot in of_it] == [True] * (len(of_it) - 1) + [False]
            over = index == len(attempt["actions"])
            last = over and number == len(trial.attempts)
            assert of_it[-1].frames == pause(END if last else BETWEEN if over else AFTER)
            # It ends where the movement ends.
            assert of_it[-1].look.joints == of_it[-2].look.joints == physical.pose().joints


def test_a_film_can_be_cut_short(trial, film):
    cut = list(shots(trial, FPS, attempts=1))
    assert [shot.look for shot in cut] == [shot.look for shot in film if shot.attempt == 1]
    assert cut[-1].panel.remark == "1 more attempt not shown"


# -- as GIF and MP4 -------------------------------------------------------------------------------


def frames_of(path):
    """The pictures of a GIF, each with its milliseconds."""
    with Image.open(path) as gif:
        assert gif.info["loop"] == 0
        pictures = []
        for index in range(gif.n_frames):
            gif.seek(index)
            pictures.append((np.asarray(gif.convert("RGB")), int(gif.info["duration"])))
        return pictures


def test_the_frames_of_a_gif_are_those_of_the_film(trial, film, tmp_path):
    path = tmp_path / "film.gif"
    count = save_film(trial, path, size=160, fps=FPS)
    assert count == sum(shot.frames for shot in film)
    pictures = frames_of(path)
    assert sum(duration for _, duration in pictures) == 1000 * count / FPS
    # What looks the same is one frame that lasts longer; all others are there, in order.
    time, at = 0.0, 0
    starts = np.cumsum([0, *(duration for _, duration in pictures)])
    for shot in film:
        while starts[at + 1] <= time + 1e-6:
            at += 1
        picture = draw(shot.look, 160, shot.panel).astype(int)
        assert np.abs(pictures[at][0] - picture).mean() < 1.0
        time += 1000 * shot.frames / FPS
    assert len(pictures) > 0.8 * len(film)
    assert [path.name for path in tmp_path.iterdir()] == ["film.gif"]
    for x, y, colour in (
        *((4.2, 1.6, [80, 235, 111]), (3.6, 1.0, [255, 0, 0]), (0.0, 0.0, [255, 0, 0])),
        (3.6 + math.sin(math.pi / 3), 1.0 - math.cos(math.pi / 3), [153, 153, 153]),
    ):  # the button, the hinge, the arm's base, the open door
        column, row = frame(7, 160).pixel((x, y))
        assert np.abs(np.subtract(pictures[-1][0][int(row), int(column)], colour)).max() < 8


@pytest.mark.parametrize("size", [160, 161])
def test_an_mp4_is_made_of_every_frame(trial, tmp_path, size):
    count = save_film(trial, tmp_path / "film.mp4", size=size, fps=10, attempts=1)
    sequence = list(shots(trial, 10, attempts=1))
    assert count == sum(shot.frames for shot in sequence)
    facts, *frames = imageio_ffmpeg.read_frames(tmp_path / "film.mp4")
    expected = draw(sequence[-1].look, size, sequence[-1].panel)
    height, width = (length + length % 2 for length in expected.shape[:2])
    assert (facts["size"], facts["fps"]) == ((width, height), 10.0)
    assert len(frames) == count
    shown = np.frombuffer(frames[-1], np.uint8).reshape(height, width, 3)
    apart = shown[: expected.shape[0], : expected.shape[1]].astype(int) - expected
    assert np.abs(apart).mean() < 6


def test_an_ffmpeg_that_fails_is_named_and_the_old_film_stays(trial, tmp_path, monkeypatch, capfd):
    fake, path = tmp_path / "ffmpeg", tmp_path / "film.mp4"
    fake.write_text(f"#!{sys.executable}\nimport sys\nsys.exit('Unknown encoder')\n")
    fake.chmod(fake.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(fake))
    path.write_bytes(b"old")
    with pytest.raises(OpenLockError, match=str(fake)):
        save_film(trial, path, size=120, fps=4, attempts=1)
    assert "Unknown encoder" in capfd.readouterr().err
    assert path.read_bytes() == b"old"
    assert sorted(one.name for one in tmp_path.iterdir()) == ["ffmpeg", "film.mp4"]


# -- the commands ---------------------------------------------------------------------------------


def test_the_command_films_a_recorded_subject(results, tmp_path):
    small = ("--size", 120, "--fps", 4, "--speed", 5)
    words = ("--from", results, "-l", "chance", "--subject", 2, "--trial", 3, "--attempts", 2)
    done = at_once("film", "noisy_CC3", *words, *small, "-o", "b.gif", cwd=tmp_path)
    assert done.status == 0
    assert "the first 2 of 4 attempts" in done.stdout
    assert len(frames_of(tmp_path / "b.gif")) > 10


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_the_commands_draw_stills(suffix, tmp_path):
    film, room = (tmp_path / f"{name}.{suffix}" for name in ("film", "room"))
    assert at_once("film", "CC3", "-l", "oracle", "--size", 120, "-o", film).status == 0
    words = ("CC4", "--layout", "trial7", "-a", "push_LOWERLEFT", "--part", 0.5, "-o", room)
    assert at_once("room", *words).status == 0
    if suffix == "png":
        assert (Image.open(film).size[1], Image.open(room).size[1]) == (120, 600)
    else:
        assert "All solutions found in 2 attempts" in film.read_text(encoding="utf-8")
        assert "<title>CC4 in trial7, push_LOWERLEFT</title>" in room.read_text(encoding="utf-8")


def test_without_ffmpeg_an_mp4_is_refused_before_anything_is_played(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    done = at_once("film", "CC4", "-o", "a.mp4", cwd=tmp_path)
    assert done.status == 2
    assert "causal-openlock[film]" in done.stderr
    assert not list(tmp_path.iterdir())

"""rl2 as it is shipped: it solves rooms that it never saw, with its memory."""

from __future__ import annotations

import io
import json
import os
import tempfile
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from causal_openlock.contract.learner import View
from causal_openlock.contract.registry import create
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.protocol import PROTOCOLS, Condition, Protocol
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import bundled, find_schema
from openlock_learners.meta.training_file import TrainingFile, read_training
from openlock_learners.networks.network_file import BUNDLED, read_network, write_network
from openlock_learners.networks.recurrent_policy import Sizes, make_policy
from openlock_learners.rl2 import RL2, RL2Parameters
from support.small_policies import weights_of

pytestmark = pytest.mark.slow

PROTOCOL = Protocol("t", attempt_limit=12, stop_when_solved=False, baseline_trials=3)


@pytest.fixture(autouse=True)
def one_thread() -> None:
    torch.set_num_threads(1)


def attempts(learner: Any, name: str, subjects: int = 60) -> dict[Any, float]:
    """Mean attempts by phase and trial, where a trial not solved counts as the limit."""
    session = Session(Condition.named(name, find_schema), PROTOCOLS["human"], subjects, seed=1)
    record = session.play(learner).to_pandas()
    last = record.groupby(["subject", "phase", "trial"]).last()
    needed = last["attempt"].where(last["solutions_found"] == last["solutions"], 30)
    means: dict[Any, float] = needed.groupby(["phase", "trial"]).mean().to_dict()
    return means


def test_what_is_shipped_was_trained_by_what_is_shipped() -> None:
    _, about = read_network(BUNDLED)
    file = read_training(bundled("experiments") / "meta_training" / "rl2.yaml")
    assert TrainingFile.model_validate(about["training"]) == file
    assert about["actions"] >= file.actions
    assert BUNDLED.stat().st_size < 1_000_000


# The ideal observer needs 3.75 to 4 attempts in a room of four levers and 2.7 in one of three.
@pytest.mark.parametrize("reward", ["paper", "unique_solutions", "authors_2018"])
def test_the_shipped_network_solves_rooms_it_never_saw(reward: str) -> None:
    for name, most in (("CC4", 4.5), ("CE4", 4.5)):
        condition = Condition.named(name, find_schema)
        session = Session(condition, PROTOCOLS["human"], 40, seed=2, reward=reward)
        record = session.play(create("rl2")).to_pandas()
        last = record.groupby(["subject", "trial"]).last()
        assert (last["solutions_found"] == last["solutions"]).mean() >= 0.98
        assert last["attempt"].mean() < most


def test_it_carries_a_schema_to_the_next_rooms_unless_its_memory_is_reset() -> None:
    gained = {}
    for reset in ("condition", "trial"):
        means = attempts(create("rl2", {"reset": reset}), "CE4")
        later = np.mean([means["train", trial] for trial in (2, 3, 4, 5)])
        gained[reset] = means["train", 1] - later
    assert gained["condition"] > 0.1
    assert abs(gained["trial"]) < 0.05
    congruent, incongruent = (
        attempts(create("rl2"), name, 150)["test", 1] for name in ("CC3-CC4", "CE3-CC4")
    )
    assert incongruent - congruent > 0.1


class Forgetful(RL2):
    """The control: its memory is empty before every action."""

    def act(self, view: View) -> Any:
        self._hidden_state[:] = 0
        return super().act(view)


def test_without_its_memory_it_is_lost() -> None:
    assert min(attempts(Forgetful(), "CC4", 20).values()) > 15


def test_its_weights_are_frozen_unless_it_learns() -> None:
    for learns in (False, True):
        session = Session(Condition.named("CC3", find_schema), PROTOCOL, 2)
        learner = RL2(RL2Parameters(learns=learns, unroll=9))
        learner.begin(session.brief)
        before = [weights_of(learner.network, n) for n in range(2 if learns else 1)]
        while not session.over:
            learner.learn(session.step(learner.act(session.view)))
        after = [weights_of(learner.network, n) for n in range(len(before))]
        changed = [not torch.equal(*pair) for pair in zip(before, after, strict=True)]
        assert changed == [learns] * len(before)
        if learns:  # each from its own experience
            assert not torch.equal(after[0], after[1])


@pytest.mark.parametrize("learns", [False, True])
def test_a_subject_is_exactly_as_it_would_be_alone(learns: bool) -> None:
    settings = RL2Parameters(learns=learns, unroll=7, reset="trial" if learns else "condition")
    courses = []
    for subjects in ([0, 1, 2, 3, 4], [1], [2, 3, 1]):
        session = Session(Condition.named("CC3", find_schema), PROTOCOL, subjects)
        learner = RL2(settings)
        learner.begin(session.brief)
        me = subjects.index(1)
        course = []
        while not session.over:
            learner.act(session.view)
            course += [*learner._logits[me], *learner._next_hidden_state[me]]
            learner.learn(session.step(np.full(len(subjects), len(course) % 15)))
        courses.append([*course, *weights_of(learner.network, me)])
    assert all(course == courses[0] for course in courses)


@pytest.fixture(scope="module")
def small() -> bytes:
    """The file of a small network."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "net.npz"
        network = make_policy(Sizes(lever=2, room=3, reader=2), 7, [np.random.default_rng(0)])
        write_network(path, network, 7, {"trained": "not at all"})
        return path.read_bytes()


def refused(path: Path, content: bytes) -> str:
    """Why a file is refused, in one line; nothing if it is read."""
    path.write_bytes(content)
    said = ""
    try:
        read_network(path)
    except LearnerError as error:
        said = str(error)
    assert not said or said.startswith(f"{path} is not a checkpoint of rl2 (")
    assert "\n" not in said
    return said


def mutated(content: bytes, generator: np.random.Generator) -> bytes:
    """A file in which some bits or bytes are others, or a piece is missing, doubled or moved."""
    changed = bytearray(content)
    places = generator.integers(len(content), size=generator.integers(1, 5))
    how = generator.integers(4)
    for place in places.tolist():
        if how == 0:
            changed[place] ^= 1 << int(generator.integers(8))
        elif how == 1:
            changed[place] = int(generator.integers(256))
        elif how == 2:
            del changed[place : place + int(generator.integers(1, 40))]
            break
        else:
            piece = changed[place : place + int(generator.integers(1, 40))]
            other = int(generator.integers(len(content)))
            changed[other : other + len(piece) * int(generator.integers(2))] = piece
    return bytes(changed)


def test_a_damaged_network_is_refused_in_a_sentence_or_is_the_same(
    small: bytes, tmp_path: Path
) -> None:
    generator = np.random.default_rng(5)
    path = tmp_path / "net.npz"
    path.write_bytes(small)
    whole = read_network(path)[0].state_dict()
    told = [refused(path, mutated(small, generator)) for _ in range(300)]
    assert sum(map(bool, told)) > 200
    for _ in range(20):
        if not refused(path, mutated(small, generator)):
            held = read_network(path)[0].state_dict()
            assert all(torch.equal(held[name], whole[name]) for name in whole)


def forged(**changes: Any) -> bytes:
    """A file that says what it likes of itself; arrays may be replaced."""
    network = make_policy(Sizes(lever=2, room=3, reader=2), 7, [np.random.default_rng(0)])
    told: dict[str, Any] = {"format": 1, "sizes": network.sizes.model_dump(), "positions": 7}
    told.update(changes.pop("about", {}))
    arrays = {name: tensor[0].numpy() for name, tensor in network.state_dict().items()}
    file = io.BytesIO()
    np.savez_compressed(file, **{"about": np.array(json.dumps(told)), **arrays, **changes})
    return file.getvalue()


SIZES = {"kind": "levers", "lever": 2, "room": 3, "reader": 2}


@pytest.mark.parametrize(
    "changes",
    [
        {"about": {"format": 2}},
        {"about": {"format": "x" * 10**5}},
        {"about": {"sizes": {**SIZES, "room": 10**9}}},
        {"about": {"sizes": {**SIZES, "room": 1024, "lever": 1024, "reader": 1024}}},
        {"about": {"sizes": {**SIZES, "room": -3}}},
        {"about": {"sizes": {**SIZES, "room": True}}},
        {"about": {"sizes": {**SIZES, "room": 3.0}}},
        {"about": {"sizes": {**SIZES, "kind": "other"}}},
        {"about": {"sizes": {**SIZES, "more": 1}}},
        {"about": {"sizes": [1, 2]}},
        {"about": {"sizes": None}},
        {"about": {"positions": 10**9}},
        {"about": {"positions": "7"}},
        {"about": {"positions": None}},
        {"about": {"much": "x" * 10**6}},
        {"about": np.array(b"\xff\xfe")},
        {"about": np.array("[" * 10**5)},
        {"about": np.array("[1, 2]")},
        {"about": np.array("7" * 5000)},
        {"about": np.zeros(3)},
        {"room.input_weight": np.zeros((15, 9))},
        {"room.input_weight": np.full((15, 9), np.nan, np.float32)},
        {"room.input_weight": np.zeros((9, 15), np.float32)},
        {"room.input_weight": np.zeros((15_000_000, 2), np.float32)},
        {"room.input_weight": np.array([None])},
        {"more": np.zeros(20_000_000, np.float32)},
    ],
    ids=str,
)
def test_a_forged_network_is_refused_before_memory_is_taken(
    tmp_path: Path, changes: dict[str, Any]
) -> None:
    if isinstance(changes.get("about"), np.ndarray):
        told = {"about": {}, **{key: value for key, value in changes.items() if key != "about"}}
        content = forged(**told)
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            held = {name: archive.read(name) for name in archive.namelist()}
        about = io.BytesIO()
        np.save(about, changes["about"])
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, kept in {**held, "about.npy": about.getvalue()}.items():
                archive.writestr(name, kept)
        content = out.getvalue()
    else:
        content = forged(**changes)
    tracemalloc.start()
    try:
        assert refused(tmp_path / "net.npz", content)
        assert tracemalloc.get_traced_memory()[1] < 4_000_000
    finally:
        tracemalloc.stop()


def test_what_is_no_file_is_not_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path, Path("/dev/zero")):
        with pytest.raises(LearnerError, match="is not a checkpoint of rl2"):
            read_network(path)
        with pytest.raises(LearnerError, match="is not a checkpoint of rl2"):
            RL2.artifact_hash(RL2Parameters(checkpoint=str(path)))


@pytest.mark.parametrize(
    ("content", "says"),
    [(None, "there is no checkpoint"), (b"nonsense", "is not a checkpoint of rl2")],
)
def test_a_wrong_checkpoint_is_one_clear_sentence(
    tmp_path: Path, content: bytes | None, says: str
) -> None:
    path = tmp_path / "net.npz"
    if content:
        path.write_bytes(content)
    session = Session(Condition.named("CC3", find_schema), PROTOCOL, 1)
    with pytest.raises(LearnerError, match=says):
        create("rl2", {"checkpoint": str(path)}).begin(session.brief)

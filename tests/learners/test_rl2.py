"""rl2 as it is shipped: it solves rooms that it never saw, with its memory."""

import json
import os
import runpy
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import torch

from causal_openlock.contract.registry import create
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.condition import find_condition
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import bundled
from openlock_learners.meta.training_file import TrainingFile, read_training
from openlock_learners.networks.network_file import read_network, write_network
from openlock_learners.networks.recurrent_policy import Sizes, make_policy
from openlock_learners.rl2 import RL2, RL2Parameters
from openlock_learners.trained_file import BUNDLED
from support.places import ROOT

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def one_thread():
    torch.set_num_threads(1)


def attempts(learner, name, subjects=60, **session):
    """Mean attempts by phase and trial, where a trial not solved counts as the limit."""
    given = {"seed": 1, **session}
    session = Session(find_condition(name), PROTOCOLS["human"], subjects, **given)
    record = session.play(learner).to_pandas()
    last = record.groupby(["subject", "phase", "trial"]).last()
    needed = last["attempt"].where(last["solutions_found"] == last["solutions"], 30)
    return needed.groupby(["phase", "trial"]).mean().to_dict()


def test_what_is_shipped_was_trained_by_what_is_shipped():
    _, about = read_network(BUNDLED)
    file = read_training(bundled("experiments") / "meta_training" / "rl2.yaml")
    assert TrainingFile.model_validate(about["training"]) == file
    assert about["actions"] >= file.actions
    assert BUNDLED.stat().st_size < 1_000_000


# The ideal observer needs 3.75 to 4 attempts in a room of four levers and 2.7 in one of three.
@pytest.mark.parametrize("reward", ["paper", "unique_solutions", "authors_2018"])
def test_the_shipped_network_solves_rooms_it_never_saw(reward):
    for name in ("CC4", "CE4"):
        needed = attempts(create("rl2"), name, 40, seed=2, reward=reward)
        assert np.mean([*needed.values()]) < 4.7


def test_it_carries_a_schema_to_the_next_rooms_unless_its_memory_is_reset():
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


def test_a_probe_reads_the_structure_off_its_memory(capsys):
    runpy.run_path(str(ROOT / "examples" / "probe_rl2.py"))
    memory, untrained = (
        float(line.split()[1]) for line in capsys.readouterr().out.split("\n")[2:4]
    )
    assert memory < 0.5 < 1 < untrained


SIZES = Sizes(lever=2, room=3, reader=2)


def network():
    return make_policy(SIZES, np.random.default_rng(0))


def refused(path, content):
    """Why a file is refused, in one line; nothing if it is read."""
    path.write_bytes(content)
    try:
        read_network(path)
    except LearnerError as error:
        said = str(error)
        assert str(path) in said
        assert "\n" not in said
        return said
    return ""


def mutated(content, generator):
    """A file with a bit flipped, and in half of the cases without what follows it."""
    changed, place = bytearray(content), int(generator.integers(len(content)))
    changed[place] ^= 1 << int(generator.integers(8))
    return bytes(changed[: place + 1] if generator.random() < 0.5 else changed)


def test_a_damaged_network_is_refused_or_is_the_same(tmp_path):
    generator, path = np.random.default_rng(5), tmp_path / "net.npz"
    write_network(path, network(), {"trained": "not at all"})
    whole, content = read_network(path)[0].state_dict(), path.read_bytes()
    times = 0
    for _ in range(200):
        if refused(path, mutated(content, generator)):
            times += 1
        else:
            held = read_network(path)[0].state_dict()
            assert all(torch.equal(held[name], whole[name]) for name in whole)
    assert times > 120


def forged(path, about, arrays):
    """A file that says what it likes of itself; arrays may be replaced."""
    write_network(path, network(), {})
    held = dict(np.load(path))
    if isinstance(about, dict):
        about = json.dumps({"format": 1, "sizes": SIZES.model_dump()} | about)
    np.savez_compressed(path, **{**held, "about": np.array(about), **arrays})
    return path.read_bytes()


@pytest.mark.parametrize(
    ("about", "arrays"),
    [
        ({"format": 2}, {}),
        ({"format": "x" * 10**5}, {}),
        ({"sizes": SIZES.model_dump() | {"room": 10**9}}, {}),
        ({"sizes": SIZES.model_dump() | {"room": 1024, "lever": 1024, "reader": 1024}}, {}),
        ({"sizes": SIZES.model_dump() | {"room": -3}}, {}),
        ({"sizes": SIZES.model_dump() | {"kind": "flat"}}, {}),
        ({"sizes": SIZES.model_dump() | {"more": 1}}, {}),
        ({"sizes": None}, {}),
        (b"\xff\xfe", {}),
        ("[" * 10**5, {}),
        ("[1, 2]", {}),
        ("7" * 5000, {}),
        (np.zeros(3), {}),
        ({}, {"room.input_weight": np.zeros((15, 9))}),
        ({}, {"room.input_weight": np.full((15, 9), np.nan, np.float32)}),
        ({}, {"room.input_weight": np.array([None])}),
        ({}, {"more": np.zeros(40_000_000, np.float32)}),
    ],
    ids=range(17),
)
def test_a_forged_network_is_refused_before_memory_is_taken(tmp_path, about, arrays):
    content = forged(tmp_path / "forged.npz", about, arrays)
    assert not refused(tmp_path / "good.npz", forged(tmp_path / "good.npz", {}, {}))
    tracemalloc.start()
    try:
        assert refused(tmp_path / "net.npz", content)
        assert tracemalloc.get_traced_memory()[1] < 4_000_000
    finally:
        tracemalloc.stop()


def test_what_is_no_file_is_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path, Path("/dev/zero")):
        with pytest.raises(LearnerError):
            read_network(path)
        with pytest.raises(LearnerError):
            RL2.artifact_hash(RL2Parameters(checkpoint=str(path)))

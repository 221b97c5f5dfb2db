"""Meta-training of rl2: the rooms it draws, and that it trains and goes on where it was."""

import pickle

import numpy as np
import pytest
import torch

from causal_openlock.contract.registry import create
from causal_openlock.envs import OpenLockEnv
from causal_openlock.errors import ExperimentError, Interrupted
from causal_openlock.experiment.condition import find_condition
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.experiment.session import Session
from causal_openlock.files.seal import sealed
from causal_openlock.schemas.finding import find_schema
from causal_openlock.world.facts import room_facts
from causal_openlock.world.kernel import PAYER
from causal_openlock.world.room import PAPER_POSITIONS, Layout
from openlock_learners.meta.command import train
from openlock_learners.meta.ppo import improve
from openlock_learners.meta.random_schemas import random_schemas
from openlock_learners.meta.rooms import MetaRooms
from openlock_learners.meta.training import MetaTraining
from openlock_learners.meta.training_file import RoomsFile, TrainingFile, read_training
from openlock_learners.networks.network_file import read_network

pytestmark = pytest.mark.slow

CC3, CE4 = find_schema("CC3"), find_schema("CE4")
PROTOCOL = Protocol("t", attempt_limit=12, stop_when_solved=False, baseline_trials=3)


@pytest.fixture(autouse=True)
def one_thread():
    torch.set_num_threads(1)


def rng(seed=0):
    return np.random.default_rng(seed)


REWARDS = ["unique_solutions", "paper", "negative_repeat"]


def levers_of(rooms):
    """``[B, 7]`` which lever is at each position; those that its schema lacks are inactive."""
    return rooms._rooms.state.column[:, :7].copy()


def test_its_rooms_are_as_the_environment_in_the_same_layouts():
    schemas = (CC3, CE4, *random_schemas(4, [3, 4], seed=2))
    declared = RoomsFile(rewards=REWARDS, attempt_limit=4, trials=[1, 3])
    rooms, generator = MetaRooms(declared, dict.fromkeys(schemas, 1.0), 30, rng()), rng(1)

    def beside(room):
        schema, levers = schemas[rooms._schema[room]], levers_of(rooms)[room].tolist()
        places = [levers.index(lever) for lever in range(len(schema.levers))]
        reward = REWARDS[rooms._rooms.state.situation[room, PAYER]]
        env = OpenLockEnv(schema, Layout(tuple(places)), reward, "trial", attempt_limit=4)
        observation, _ = env.reset(seed=0)
        assert observation.tolist() == rooms.view.observation[room].tolist()
        return env

    envs = [beside(room) for room in range(30)]
    found = solved = 0
    for _ in range(400):
        grey = rooms.view.observation[:, 7:14]
        scores = generator.random((30, 15))
        scores[:, :7] += grey * 1.0  # pushes of grey levers, and the door, more often
        scores[:, 14] += 0.8
        action = scores.argmax(axis=1)
        step = rooms.step(action)
        for room, env in enumerate(envs):
            seen, reward, terminated, truncated, info = env.step(int(action[room]))
            over = terminated or truncated
            outcome = info.get("outcome", seen)
            assert outcome.tolist() == step.outcome[room].tolist()
            assert reward == pytest.approx(step.reward[room])
            assert over == step.trial_over[room]
            assert ("outcome" in info) == step.attempt_over[room]
            solved += terminated
            if over:
                envs[room] = beside(room)
            else:
                assert seen.tolist() == step.next.observation[room].tolist()
                shown = {name: int(of[room]) for name, of in vars(step.next.console).items()}
                assert info["console"] == shown
        found += step.new_solution.sum()
    assert found > 100
    assert solved > 10


def test_no_room_has_its_levers_where_a_published_layout_has_them():
    published = {
        frozenset(PAPER_POSITIONS.index(place) for place in layout.values())
        for layout in room_facts()["layouts"].values()
    }
    declared = RoomsFile(rewards=REWARDS, attempt_limit=1)
    rooms, met = MetaRooms(declared, {CC3: 1.0, CE4: 1.0}, 300, rng()), set()
    for _ in range(60):
        rooms.step(np.full(300, 14))
        met |= {
            frozenset(np.flatnonzero(grey).tolist()) for grey in rooms.view.observation[:, 7:14]
        }
    # All other sets of three and of four of the seven positions are met: 35 and 35.
    assert met.isdisjoint(published)
    assert len(met) == 70 - len(published)


def test_a_life_keeps_its_schema_unless_it_changes():
    for change, expected in ((0.0, 0.0), (1.0, 0.5)):
        declared = RoomsFile(rewards=REWARDS, attempt_limit=1, trials=[3, 3], change=change)
        rooms = MetaRooms(declared, {CC3: 1.0, CE4: 1.0}, 400, rng())
        changed, ends = [], []
        for number in range(1, 19):
            before, levers = rooms._schema.copy(), levers_of(rooms)
            for _ in range(3):
                step = rooms.step(np.full(400, 14))
            assert step.trial_over.all()
            assert (levers_of(rooms) != levers).any(axis=1).mean() > 0.9
            ends.append(rooms.life_over.all())
            assert rooms.life_over.all() == rooms.life_over.any() == (number % 3 == 0)
            if not ends[-1]:
                changed.append((rooms._schema != before).mean())
        assert np.mean(changed) == pytest.approx(expected, abs=0.05)


def test_random_schemas_are_different_and_can_be_solved():
    schemas = random_schemas(40, [3, 4], seed=3)
    assert len({str(schema.as_dict() | {"name": ""}) for schema in schemas}) == 40
    assert all(schema.least_action_limit <= 3 for schema in schemas)
    assert {len(schema.levers) for schema in schemas} == {3, 4}
    assert {len(schema.solutions) for schema in schemas} >= {1, 2, 3}
    assert [s.as_dict() for s in random_schemas(40, [3, 4], seed=3)] == [
        s.as_dict() for s in schemas
    ]


SMALL = """\
rooms:
  schemas: {{CC3: 1}}
  random_schemas: {{number: 5, levers: [3]}}
  attempt_limit: 4
  trials: [1, 3]
  rewards: [paper, basic]
at_once: 16
steps: 6
actions: {actions}
network: {{lever: 5, room: 6, reader: 7}}
minibatches: 2
"""


def small(tmp_path, actions=960):
    path = tmp_path / "small.yaml"
    path.write_text(SMALL.format(actions=actions))
    return path


def test_an_interrupted_training_ends_with_the_same_weights(tmp_path, monkeypatch):
    file, whole, parts = small(tmp_path), tmp_path / "whole.npz", tmp_path / "parts.npz"
    train(file, whole)

    monkeypatch.setattr("openlock_learners.meta.training.LOG_EVERY", 0.0)
    update = MetaTraining.update

    def interrupted(self):
        if self.updates == 4:
            raise KeyboardInterrupt
        return update(self)

    monkeypatch.setattr(MetaTraining, "update", interrupted)
    with pytest.raises(Interrupted):
        train(file, parts)
    assert not parts.exists()
    with pytest.raises(ExperimentError, match="left from a training by another file"):
        train(file, parts, seed=9)
    monkeypatch.setattr(MetaTraining, "update", update)
    train(file, parts)
    one, other = (read_network(path)[0].state_dict() for path in (whole, parts))
    assert one.keys() == other.keys()
    assert all(torch.equal(one[name], other[name]) for name in one)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *("parts.npz", "small.yaml", "whole.npz")
    ]


def test_a_trained_network_plays(tmp_path):
    out = tmp_path / "net.npz"
    train(small(tmp_path, 96), out)
    assert np.array(1e-310) / 10 > 0  # denormal numbers are there again
    session = Session(find_condition("CC3"), PROTOCOL, 3)
    assert session.play(create("rl2", {"checkpoint": str(out)})).num_rows == 3 * 3 * 12


def test_returns_end_with_the_trial_or_with_the_life(tmp_path):
    declared = read_training(small(tmp_path))
    ends = {}
    for credit in ("trial", "life"):
        training = MetaTraining(declared.model_copy(update={"credit": credit, "steps": 60}))
        ends[credit] = training.rollout().done.numpy()
    # Both play the same: nothing is learned before the first update.
    assert ends["life"].any()
    assert (ends["trial"] >= ends["life"]).all()
    assert ends["trial"].sum() > ends["life"].sum()


def test_schemas_can_be_drawn_by_the_seed_of_the_training(tmp_path):
    path = small(tmp_path)
    path.write_text(path.read_text().replace("levers: [3]}", "levers: [3], seed: null}"))
    declared = read_training(path)
    drawn = [declared.model_copy(update={"seed": seed}).schemas(tmp_path) for seed in (1, 2)]
    assert [*drawn[0]][1:] == random_schemas(5, [3], 1)
    assert [*drawn[1]][1:] == random_schemas(5, [3], 2) != [*drawn[0]][1:]


def test_meta_training_improves_its_play():
    rooms = {"schemas": {"CC3": 1}, "attempt_limit": 10, "trials": [1, 1], "rewards": ["basic"]}
    network = {"lever": 12, "room": 12, "reader": 12}
    given = {"at_once": 64, "steps": 15, "learning_rate": 0.01, "minibatches": 2}
    training = MetaTraining(
        TrainingFile.model_validate({"rooms": rooms, "network": network} | given)
    )
    earned = []
    for _ in range(40):
        rollout = training.rollout()
        earned.append(float((rollout.reward > 0).sum()))
        improve(training.network, training.optimizer, rollout, training.file, 0.01, rng())
    assert sum(earned[-10:]) > 10 * sum(earned[:10]) + 50, earned


def test_a_spoiled_state_of_a_training_is_named(tmp_path):
    path, left = small(tmp_path), tmp_path / "net.npz.training"
    kept = sealed(pickle.dumps("a file") + pickle.dumps({}))
    for spoiled in (b"", kept[:-1], kept[:40], pickle.dumps("a file"), sealed(b"")):
        left.write_bytes(spoiled)
        with pytest.raises(ExperimentError, match=r"net\.npz\.training"):
            train(path, tmp_path / "net.npz")

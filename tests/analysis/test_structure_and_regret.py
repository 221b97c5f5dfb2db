"""What subjects know of a room's structure, and what their attempts were worth."""

from dataclasses import replace

import networkx as nx
import numpy as np
import pyarrow as pa
import pytest
from matplotlib.figure import Figure

from causal_openlock import Layout, Session, find_schema
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.topic import sections_of
from causal_openlock.analysis.topics.regret import WORTH, regret, regret_by_condition
from causal_openlock.analysis.topics.structure_recovery import (
    plot_structure_recovery,
    structure_distance,
    structure_recovery,
)
from causal_openlock.belief.observer import Observer, observer_of
from causal_openlock.belief.placements import TooLargeError
from causal_openlock.contract.learner import Structure
from causal_openlock.contract.registry import create
from causal_openlock.errors import LearnerError, StoreError
from causal_openlock.experiment.beside_record import read_answers, write_answers
from causal_openlock.experiment.condition import find_condition
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.checksums import read_table, table_bytes
from causal_openlock.schemas.schema import DOOR, Schema
from support.fabricated_records import table, trial_rows
from support.made_up_experiments import experiment_of
from support.played_results import played
from support.topics import topics_called

NOT_SAID = np.full(8, np.nan)


def edges_of(schema, places):
    found = find_schema(schema)
    at = {**dict(zip(found.levers, places, strict=True)), DOOR: 7}
    edges = np.zeros((7, 8))
    for cause, effect in found.graph.edges:
        edges[at[cause], at[effect]] = 1.0
    return edges


def test_distances_are_those_of_a_plain_count():
    """Against graphs of networkx, over random beliefs."""
    rng = np.random.default_rng(0)
    schema, layout = find_schema("CE4"), Layout((5, 1, 0, 3))
    grey = [*layout.places, 7]
    true = {*nx.DiGraph([*zip(*np.nonzero(edges_of("CE4", layout.places)), strict=True)]).edges}
    for _ in range(30):
        edges = rng.random((7, 8)) ** 2
        found = structure_distance(Structure(edges, NOT_SAID), schema, layout)
        pairs = [(a, b) for a in layout.places for b in grey if a != b]
        said = {pair for pair in pairs if edges[pair] > 0.5}
        turned = [(a, b) for a, b in said - true if (b, a) in true - said]
        assert found["shd"] == len(said ^ true) - len(turned)
        assert found["f1"] == pytest.approx(2 * len(said & true) / (len(said) + len(true)))
        errors = [(edges[pair] - (pair in true)) ** 2 for pair in pairs]
        assert found["brier"] == pytest.approx(np.mean(errors))


def test_gates_are_judged_where_they_are_said():
    schema, layout = find_schema("CC3"), Layout((0, 1, 2))
    said = Structure(edges_of("CC3", layout.places), np.array([np.nan] * 7 + [0.25]))
    assert structure_distance(said, schema, layout)["gate_brier"] == pytest.approx(0.0625)


@pytest.mark.parametrize("learner", ["bayes", "ideal", "theory_based"])
def test_who_solves_a_room_comes_to_know_it(learner):
    recovered = structure_recovery(played([learner], ["CC3-CC4"], 3))
    assert len(recovered) == 3 * 7
    assert (recovered["brier"].between(0, 1) & recovered["f1"].between(0, 1)).all()
    assert recovered["gate_brier"].isna().all() == (learner == "theory_based")
    if learner == "ideal":
        assert recovered[["shd", "brier"]].to_numpy().max() == pytest.approx(0.0, abs=1e-9)
    else:
        assert recovered["f1"].mean() > 0.8
        assert recovered["brier"].mean() < 0.1


@pytest.mark.parametrize("learner", ["bayes", "ideal", "theory_based"])
def test_asking_for_the_structure_changes_no_action_and_is_possible_within_a_room(learner):
    condition = find_condition("CE3-CC4")
    records = []
    for asks in (False, True):
        session = Session(condition, PROTOCOLS["human"], 2, seed=8, learner=learner)
        one = create(learner)
        session.begin(one)
        for number, _ in enumerate(session.steps(one)):
            if asks:
                said = [one.structure(subject) for subject in range(2)]
                assert number == 0 or all(part is not None for part in said)
                for part in filter(None, said):
                    assert part.edges.shape == (7, 8)
                    assert part.edges.min() >= -1e-12
                    assert part.edges.max() <= 1 + 1e-9
        records.append(session.record().drop_columns(["wall_time"]))
    assert records[0].equals(records[1])


@pytest.mark.parametrize(
    ("edges", "gates", "fault"),
    [
        (np.zeros((7, 7)), NOT_SAID, "7, 7"),
        (np.full((7, 8), 1.5), NOT_SAID, "from 0 to 1"),
        (np.full((7, 8), np.nan), NOT_SAID, "from 0 to 1"),
        (np.zeros((7, 8)), np.full(8, -1.0), "from 0 to 1"),
        (np.zeros((7, 8)), np.zeros(7), "7,"),
    ],
)
def test_a_structure_has_probabilities_of_edges_and_gates(edges, gates, fault):
    with pytest.raises(ValueError, match=fault):
        Structure(edges, gates)


@pytest.mark.parametrize("wrong", [Structure(np.zeros((6, 7)), NOT_SAID[:7]), "a -> b"])
def test_what_is_no_structure_is_refused_with_the_learners_name(monkeypatch, wrong):
    results = played(["ideal"], ["CC3"], 1)
    monkeypatch.setattr("openlock_learners.ideal.Ideal.structure", lambda *_: wrong)
    with pytest.raises(LearnerError, match="the learner ideal fails"):
        structure_recovery(results)


def test_a_learner_whose_parameters_are_no_more_is_left_out():
    results = played(["bayes"], ["CC4"], 1)
    (spec,) = results.experiment.learners
    old = replace(spec, recorded=spec.origin, parameters={**spec.parameters, "particles": 500})
    experiment = replace(results.experiment, learners=(old,))
    assert structure_recovery(replace(results, experiment=experiment)).empty


def test_the_figure_has_the_means_of_the_table():
    material = played(["bayes"], ["CC3-CC4"], 3)
    means = structure_recovery(material).groupby("visit")["shd"].mean()
    axes = plot_structure_recovery(material, ax=Figure())
    (line,) = axes.lines
    assert dict(zip(*line.get_data(), strict=True)) == pytest.approx(means.to_dict())
    nothing = played(["random"], ["CC3"], 1)
    assert sections_of(nothing, topics_called("structure_recovery")) == []


def test_what_people_say_is_kept_and_compared(tmp_path):
    material = played(["oracle"], ["CC3"], 2)
    row = material.trials.query("subject == 1").iloc[2]
    layout = Layout.of(find_schema("CC3"), row["layout"])
    edges = edges_of("CC3", layout.places)
    asked = {"learner": "oracle", "condition": "CC3", "subject": 1}
    said = [
        {**asked, "visit": visit, "time": time, "cause": cause, "effect": effect,
         "enables": visit == 3 and edges[cause, effect] == 1}
        for visit, time in ((3, 12.5), (4, 20.0))
        for cause in sorted(layout.places)
        for effect in (*sorted(layout.places), 7)
        if cause != effect
    ]  # fmt: skip
    path = tmp_path / "structures" / "one.parquet"
    write_answers(path, said)
    recovered = structure_recovery(replace(material, folders=(tmp_path,)))
    assert recovered["visit"].tolist() == [3, 4]
    assert recovered["shd"].tolist() == [0, 4]
    assert recovered["f1"].tolist() == [1.0, 0.0]
    whole = path.read_bytes()
    for name, value in (("enables", None), ("learner", None), ("cause", -300)):
        rows = read_table(whole).to_pylist()
        rows[2][name] = value
        write_bytes(path, table_bytes(pa.Table.from_pylist(rows)))
        with pytest.raises(StoreError, match=r"one\.parquet is damaged"):
            read_answers(tmp_path)


def test_the_ideal_observer_wastes_nothing_and_random_actions_nearly_everything():
    ideal = regret(played(["ideal"], ["CC3-CE4", "CE4"], 6))
    assert ideal["regret"].max() == 0.0
    trials = ideal.groupby(["condition", "subject", "phase", "trial"], observed=True)
    # What is gained in a trial of the ideal observer is what it did not know, or it had luck.
    assert (trials["gained"].sum() <= 2.0 + 1e-9).all()
    random = regret(played(["random"], ["CC3-CE4"], 6))
    row = regret_by_condition(random).iloc[0]
    assert row["subjects"] == 6
    by_trial = random.groupby(["subject", "phase", "trial"], observed=True)["regret"].sum()
    assert row["regret"] == pytest.approx(by_trial.groupby("subject").mean().mean())
    assert row["ci_low"] < row["regret"] < row["ci_high"]
    shares = random.groupby("subject")[["useless", "gained", "used"]].sum()
    for column, name in (("useless", "useless"), ("information", "gained")):
        assert row[column] == pytest.approx((shares[name] / shares["used"]).mean())
    assert row["regret"] > 20
    assert row["useless"] > 0.8
    assert (random["useless"] <= random["used"]).all()


def test_rooms_that_cannot_be_judged_are_left_out():
    shaky = Schema("shaky", ["a", "b"], {"a": {"b": 0.5}, "b": ["door"]})
    assert observer_of(shaky, 3) is None
    chain = Schema("long", [f"l{n}" for n in range(9)], {f"l{n}": ["door"] for n in range(9)})
    assert observer_of(chain, 2) is not None
    record = table(trial_rows([0, 1, 2, 3], layout="nowhere"))
    left = regret(Material.of(record, experiment_of(record)))
    assert left.empty
    assert regret_by_condition(left).empty


def test_a_schema_that_play_leads_out_of_reach_is_left_out_whole(monkeypatch):
    material = played(["random"], ["CC3", "CE3"], 6)
    whole = regret(material)
    trial, asked = Observer.trial, []

    def out_of_reach(self, *given):
        asked.append(self)
        if self is observer_of(find_schema("CC3"), 3) and asked.count(self) == 2:
            raise TooLargeError("more than 20,000 states")
        return trial(self, *given)

    monkeypatch.setattr(Observer, "trial", out_of_reach)
    left = regret(replace(material))
    expected = whole[whole["schema"] == "CE3"].reset_index(drop=True)
    assert not left.empty
    assert (left[WORTH] == expected[WORTH]).all(axis=None)
    assert set(left["schema"]) == {"CE3"}

"""Understanding: what is believed of a room, beside what it is."""

from __future__ import annotations

from pathlib import Path

import networkx as nx
import numpy as np
import pyarrow as pa
import pytest
from matplotlib.figure import Figure

from causal_openlock import Condition, Layout, Session, find_schema
from causal_openlock.analysis.topics.structure_recovery import plot_structure_recovery
from causal_openlock.analysis.topics.structure_recovery import structure_recovery
from causal_openlock.analysis.results.structure_errors import structure_distance
from causal_openlock.analysis.topic import sections_of
from causal_openlock.contract.learner import Structure
from causal_openlock.contract.registry import create
from causal_openlock.errors import LearnerError, StoreError
from causal_openlock.experiment.answers import Answer, answers_schema, read_answers, write_answers
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.checksums import read_table, table_bytes
from causal_openlock.schemas.schema import DOOR
from support.played_material import played
from support.topics import topics_called

NOT_SAID = np.full(8, np.nan)


def edges_of(schema: str, places: tuple[int, ...]) -> np.ndarray:
    found = find_schema(schema)
    at = {**dict(zip(found.levers, places, strict=True)), DOOR: 7}
    edges = np.zeros((7, 8))
    for cause, effect in found.graph.edges:
        edges[at[cause], at[effect]] = 1.0
    return edges


def test_distances_are_those_of_a_plain_count() -> None:
    """Against graphs of networkx, over random beliefs."""
    generator = np.random.default_rng(0)
    schema, layout = find_schema("CE4"), Layout((5, 1, 0, 3))
    grey = [*layout.places, 7]
    truth = nx.DiGraph([*zip(*np.nonzero(edges_of("CE4", layout.places)), strict=True)])
    for _ in range(30):
        edges = generator.random((7, 8)) ** 2
        found = structure_distance(Structure(edges, NOT_SAID), schema, layout)
        pairs = [(a, b) for a in layout.places for b in grey if a != b]
        said = {pair for pair in pairs if edges[pair] > 0.5}
        true = set(truth.edges)
        wrong = {frozenset(pair) for pair in said ^ true}
        # A pair of levers is one fault, whether its edge is missing, turned or too much.
        assert found["shd"] - len(wrong) in range(0, len(pairs))
        assert found["f1"] == pytest.approx(2 * len(said & true) / (len(said) + len(true)))
        errors = [(edges[pair] - (pair in true)) ** 2 for pair in pairs]
        assert found["brier"] == pytest.approx(np.mean(errors))


def test_one_fault_is_one_whatever_it_is() -> None:
    schema, layout = find_schema("CC3"), Layout((0, 1, 2))
    right = edges_of("CC3", layout.places)
    for change, distance in [
        ({}, 0), ({(0, 1): 0}, 1), ({(1, 2): 1}, 1), ({(0, 1): 0, (1, 0): 1}, 1),
        ({(6, 7): 1, (3, 4): 1}, 0), ({(0, 7): 1, (1, 7): 0}, 2), ({(1, 0): 1}, 1),
    ]:  # fmt: skip
        edges = right.copy()
        for pair, value in change.items():
            edges[pair] = value
        assert structure_distance(Structure(edges, NOT_SAID), schema, layout)["shd"] == distance, (
            change
        )
    both = Structure(right, np.array([np.nan] * 7 + [0.25]))
    assert structure_distance(both, schema, layout)["gate_brier"] == pytest.approx(0.0625)


@pytest.mark.parametrize("learner", ["bayes", "ideal", "theory_based"])
def test_who_solves_a_room_comes_to_know_it(learner: str) -> None:
    table = structure_recovery(played(learner, "CC3-CC4", subjects=3))
    assert len(table) == 3 * 7
    assert (table["brier"].between(0, 1) & table["f1"].between(0, 1)).all()
    assert table["gate_brier"].isna().all() == (learner == "theory_based")
    if learner == "ideal":
        assert table[["shd", "brier"]].to_numpy().max() == pytest.approx(0.0, abs=1e-9)
    else:
        assert table["f1"].mean() > 0.8
        assert table["brier"].mean() < 0.1


@pytest.mark.parametrize("learner", ["bayes", "ideal", "theory_based"])
def test_to_be_asked_changes_nothing_and_is_possible_within_a_room(learner: str) -> None:
    condition = Condition.named("CE3-CC4", find_schema)
    records = []
    for asks in (False, True):
        session = Session(condition, PROTOCOLS["human"], 2, seed=8, learner=learner)
        one = create(learner)
        session.begin(one)
        for number, _ in enumerate(session.steps(one)):
            if asks:
                told = [one.structure(subject) for subject in range(2)]
                assert number == 0 or all(part is not None for part in told)
                for part in filter(None, told):
                    assert part.edges.shape == (7, 8)
                    assert part.edges.min() >= -1e-12
                    assert part.edges.max() <= 1 + 1e-9
        records.append(session.record().drop_columns(["wall_time"]))
    assert records[0].equals(records[1])


@pytest.mark.parametrize(
    ("name", "value", "why"),
    [
        ("enables", None, "values are missing"),
        ("learner", None, "values are missing"),
        ("cause", -300, "positions are below 0"),
    ],
)
def test_damaged_answers_are_one_sentence(
    tmp_path: Path, name: str, value: object, why: str
) -> None:
    path = tmp_path / "structures" / "one.parquet"
    write_answers(path, [Answer("oracle", "CC3", 1, 3, (0, 1, 2), frozenset(), 12.5)], 7)
    rows = read_table(path.read_bytes()).to_pylist()
    rows[2][name] = value
    write_bytes(path, table_bytes(pa.Table.from_pylist(rows, schema=answers_schema())))
    with pytest.raises(StoreError, match=rf"one\.parquet is damaged \({why}\)"):
        read_answers(tmp_path)


@pytest.mark.parametrize(
    "wrong",
    [
        Structure(np.zeros((7, 7)), NOT_SAID),
        Structure(np.full((7, 8), 1.5), NOT_SAID),
        Structure(np.zeros((7, 8)), np.zeros(7)),
        Structure([[0.0] * 8] * 7, NOT_SAID),  # type: ignore[arg-type]
        "a -> b",
    ],
)
def test_what_is_no_structure_is_named(monkeypatch: pytest.MonkeyPatch, wrong: object) -> None:
    results = played("ideal", "CC3", subjects=1)
    monkeypatch.setattr("openlock_learners.ideal.Ideal.structure", lambda *_: wrong)
    with pytest.raises(LearnerError, match="the structure of ideal is not a Structure"):
        structure_recovery(results)


def test_the_figure_and_the_section_have_the_means_of_the_table() -> None:
    material = played("bayes", "CC3-CC4", subjects=3)
    means = structure_recovery(material).groupby("visit")["shd"].mean()
    axes = plot_structure_recovery(material, ax=Figure())
    (line,) = axes.lines
    assert dict(zip(*line.get_data(), strict=True)) == pytest.approx(means.to_dict())
    (section,) = sections_of(material, topics_called("structure_recovery"))
    (row,) = section.tables[0].frame.to_dict("records")
    assert (row["subjects"], row["rooms"]) == (3, 7)
    assert row["first room"] == pytest.approx(means[1])
    assert row["last room"] == pytest.approx(means[7])
    assert (
        sections_of(played("random", "CC3", subjects=1), topics_called("structure_recovery")) == []
    )


def test_what_people_say_is_kept_and_compared(tmp_path: Path) -> None:
    material = played("oracle", "CC3", subjects=2)
    row = material.trials.query("subject == 1").iloc[2]
    layout = Layout.of(find_schema("CC3"), row["layout"])
    edges = frozenset(map(tuple, np.argwhere(edges_of("CC3", layout.places)).tolist()))
    levers = tuple(sorted(layout.places))
    said = [
        Answer("oracle", "CC3", 1, 3, levers, edges, 12.5),
        Answer("oracle", "CC3", 1, 4, levers, frozenset(), 20.0),
    ]
    write_answers(tmp_path / "structures" / "one.parquet", said, 7)
    assert read_answers(tmp_path) == said
    table = structure_recovery(material, said)
    assert table["visit"].tolist() == [3, 4]
    assert table["shd"].tolist() == [0, 4]
    assert table["f1"].tolist() == [1.0, 0.0]

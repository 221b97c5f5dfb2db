"""What docs/recurrent_policy.md says of the rooms that networks are trained in, counted."""

from __future__ import annotations

import re

from causal_openlock.schemas.finding import find_schema
from openlock_learners.meta.random_schemas import behaviour
from openlock_learners.meta.rooms import Distribution
from openlock_learners.meta.training_file import read_training
from support.places import ROOT

TRAININGS = ROOT / "experiments" / "meta_training"
TEXT = re.sub(r"\s+", " ", (ROOT / "docs" / "recurrent_policy.md").read_text(encoding="utf-8"))
PAPERS = [find_schema(name) for name in ("CC3", "CE3", "CC4", "CE4")]
TESTED, TRAINED = (4, 3), (3, 2)  # levers and solutions of four-lever and three-lever rooms


def distribution(name: str) -> Distribution:
    path = TRAININGS / f"{name}.yaml"
    return read_training(path).distribution(path.parent)


def test_rooms_that_look_like_a_test_are_nearly_all_of_its_schemas() -> None:
    rooms = distribution("rl2")
    papers = {behaviour(schema) for schema in PAPERS}
    alike = [
        (behaviour(schema) in papers, weight)
        for schema, weight in zip(rooms.schemas, rooms.weights, strict=True)
        if (len(schema.levers), len(schema.solutions)) == TESTED
    ]
    share = sum(weight for own, weight in alike if own) / sum(weight for _, weight in alike)
    others = [weight for own, weight in alike if not own]
    assert f"`{share:.0%}` *are* CC4 or CE4" in TEXT
    assert f"only `{len(others)}` of the random schemas have that shape" in TEXT


def test_matched_schemas_have_the_shape_of_the_tests_and_act_otherwise() -> None:
    """Over ten seconds: schemas are drawn until three hundred of them match."""
    schemas = distribution("matched_schemas").schemas
    papers = {behaviour(schema) for schema in PAPERS}
    forms: dict[tuple[int, int], set[tuple[int, ...]]] = {}
    for schema in schemas:
        shape = len(schema.levers), len(schema.solutions)
        forms.setdefault(shape, set()).add(behaviour(schema))
    assert set(forms) == {TESTED, TRAINED}
    assert not papers & set.union(*forms.values())
    assert f"has `{len(schemas)}` whose consoles look like those of the tests" in TEXT
    assert f"(`{len(forms[TESTED])}` distinct behaviours in the draw of seed `0`)" in TEXT
    assert f"three levers and two (`{len(forms[TRAINED])}`)" in TEXT

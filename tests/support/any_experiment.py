"""A Hypothesis strategy for experiments: any schemas, conditions, protocol and settings."""

from hypothesis import strategies as st

import causal_openlock as ol
from causal_openlock.experiment.condition import Condition, Trials
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.testing import layouts, schemas
from causal_openlock.world.rewards import PRESETS

FEW = st.integers(1, 3)
PROTOCOLS = st.builds(
    Protocol,
    st.just("drawn"),
    attempt_limit=st.integers(1, 12),
    stop_when_solved=st.booleans(),
    **dict.fromkeys(("baseline_trials", "training_trials", "test_trials"), FEW),
    **dict.fromkeys(("baseline_loops", "train_loops", "test_loops"), st.integers(1, 2)),
    layouts=st.just("random"),
)
SHARE = st.floats(0, 1, allow_subnormal=False, exclude_max=True)
LEARNERS = (
    st.just(ol.learner("random"))
    | st.builds(lambda lapse, noise: ol.learner("bayes", lapse=lapse, noise=noise), SHARE, SHARE)
    | st.builds(lambda g, n: ol.learner("ddqn", gamma=g, batch_size=n), SHARE, st.integers(1, 9))
)


@st.composite
def experiments(draw):
    """An experiment of one to three conditions and learners, in random layouts or given ones."""
    known = [_named(draw(schemas(4, True)), f"drawn{index}") for index in range(draw(FEW))]
    conditions = [
        Condition(
            f"condition{index}",
            tuple(draw(st.lists(_trials(known), min_size=1, max_size=2), label="train")),
            tuple(draw(st.lists(_trials(known), max_size=1), label="test")),
        )
        for index in range(draw(FEW))
    ]
    players = [{**draw(LEARNERS), "name": f"learner{index}"} for index in range(draw(FEW))]
    return ol.make_experiment(
        conditions,
        players,
        name=draw(st.from_regex(r"[a-z][a-z0-9_.-]{0,15}", fullmatch=True), label="name"),
        title=draw(
            st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), max_size=20)
        ),
        seed=draw(st.integers(0, 2**63 - 1), label="seed"),
        protocol=draw(PROTOCOLS),
        subjects=draw(st.integers(1, 5), label="subjects"),
        cell_size=draw(st.integers(1, 5), label="cell size"),
        reward=draw(st.sampled_from([*PRESETS]), label="reward"),
    )


@st.composite
def _trials(draw, known):
    schema = draw(st.sampled_from(known))
    if draw(st.booleans(), label="random layouts"):
        return Trials(schema, "random", draw(st.none() | FEW))
    given = draw(
        st.lists(layouts(schema), min_size=1, max_size=3, unique_by=lambda one: one.places)
    )
    number = draw(st.none() | st.integers(1, len(given)))
    return Trials(schema, tuple(given), number, draw(st.booleans()))


def _named(schema, name):
    return ol.schema({**schema.as_dict(), "name": name})

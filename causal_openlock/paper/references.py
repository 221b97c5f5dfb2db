"""The paper's people, the published model and the DDQN of 2018 as references.

People and the model are compared with learners that played under the same protocol, ``human``, in
the same rooms: a schema of one's own may also be called ``CC4``, so rooms and budgets are compared
with the paper's, and where they differ, nothing published is shown. The DDQN is compared with
learners in the paper's rooms under protocols with many attempts in a trial.
"""

from __future__ import annotations

import pandas as pd

from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import POINT_COLUMNS, Reference
from causal_openlock.experiment.condition import Condition
from causal_openlock.experiment.declare import LearnerSpec
from causal_openlock.experiment.protocol import HUMAN_PROTOCOL, PROTOCOLS
from causal_openlock.paper import published
from causal_openlock.world import facts

PEOPLE = "people"


def people() -> Reference:
    """Return the paper's people."""
    return Reference(
        PEOPLE,
        published.people(),
        did_what_people_did,
        title="People",
        detail="published",
        source="Edmonds et al., 2018",
        prefix="human",
        minutes=facts.results()["cogsci2018"]["human"]["minutes"],
    )


def published_model() -> Reference:
    """Return the theory-based model of AAAI 2020."""
    return Reference(
        "published model",
        published.model(),
        did_what_people_did,
        title="Published model",
        detail="theory-based",
        source="Edmonds et al., 2020",
        prefix="model",
        in_leaderboard=False,
    )


def ddqn_2018() -> Reference:
    """Return the paper's DDQN, of which the categories of attempts are published."""
    return Reference(
        "DDQN of the paper",
        pd.DataFrame(columns=POINT_COLUMNS),
        _in_the_papers_rooms,
        detail="published counts",
        source="Edmonds et al., 2018",
        in_leaderboard=False,
        categories=published.paper_ddqn(),
    )


def people_beside(results: Material) -> Reference:
    """Return the paper's people, with the learners that did what they did."""
    return next((one for one in results.references if one.name == PEOPLE), people())


def did_what_people_did(spec: LearnerSpec, condition: Condition) -> bool:
    """Whether a learner plays as people did: their rooms, the same number, in random order."""
    human = PROTOCOLS[HUMAN_PROTOCOL]
    train = human.training_trials if condition.test else human.baseline_trials
    return (
        spec.protocol == human
        and condition.is_of_paper
        and all(
            trials.layouts in (None, "published")
            and trials.number in (None, number)
            and trials.shuffle
            for group, number in ((condition.train, train), (condition.test, human.test_trials))
            for trials in group
        )
    )


def _in_the_papers_rooms(spec: LearnerSpec, condition: Condition) -> bool:
    return spec.protocol.name != HUMAN_PROTOCOL and condition.is_of_paper

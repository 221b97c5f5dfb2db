"""A person as a learner: what experiments and reports know people by."""

from __future__ import annotations

from typing import NoReturn

from causal_openlock.contract.learner import Brief, Learner, View
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.declare import PERSON as LEARNER

__all__ = ["LABEL", "LEARNER", "Person"]

LABEL = "person"


class Person(Learner):
    """A person who plays in a browser.

    It takes part in no comparison, since nobody can be asked to act here: ``causal-openlock play``
    lets people play, and a report then shows them next to learners.
    """

    def begin(self, brief: Brief) -> None:
        """People are not played; see the class."""
        _refuse()

    def act(self, view: View) -> NoReturn:
        """People are not played; see the class."""
        _refuse()


def _refuse() -> NoReturn:
    raise LearnerError("a person plays in the browser; start causal-openlock play")

"""Estimates of what learners will cost in a room, from counts of their work.

A learner whose work grows with the room estimates it in a class method::

    @classmethod
    def expected_cost(cls, parameters, schema, action_limit) -> Cost | None: ...

The seconds are an order of magnitude, not a measurement: counted work times the time of a step on a
typical core. No result depends on them, but one: where they are infinite, the learner is not
applicable, and a comparison does not let it play.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from causal_openlock.contract.registry import learner_class, parse_parameters

if TYPE_CHECKING:
    from causal_openlock.schemas.schema import Schema

WORTH_SAYING = 1.0
"""Seconds a trial above which a cost is mentioned."""
MUCH_MEMORY = 500.0
"""Megabytes above which memory is mentioned."""


@dataclass(frozen=True)
class Cost:
    """Expected cost of a trial of one subject.

    Attributes:
        seconds: On one core; infinite if it cannot be played at all.
        work: What is counted, in words.
        megabytes: Memory beyond that of every learner, roughly at most.

    Example:
        >>> str(Cost(120.0, "40 structures"))
        'takes about 2 minutes a trial and subject on one core (an estimate: 40 structures)'
    """

    seconds: float
    work: str
    megabytes: float = 0.0

    @property
    def applicable(self) -> bool:
        """Whether the learner can play there at all."""
        return self.seconds < math.inf

    def __str__(self) -> str:
        """The cost as a clause to follow the name of the learner."""
        if not self.applicable:
            return f"cannot play it: {self.work}"
        time = f"{self.seconds:.0f} s" if self.seconds < 90 else f"{self.seconds / 60:.0f} minutes"
        memory = f" and up to {self.megabytes / 1000:.1f} GB a process"
        return (
            f"takes about {time} a trial and subject on one core"
            f"{memory if self.megabytes >= MUCH_MEMORY else ''} (an estimate: {self.work})"
        )


def expected_cost(
    learner: str, parameters: dict[str, Any], schema: Schema, action_limit: int
) -> Cost | None:
    """Expected cost of a learner in rooms of a schema; None if it is unknown or small.

    Raises:
        LearnerError: If there is no such learner.
    """
    ask = getattr(learner_class(learner), "expected_cost", None)
    cost: Cost | None = ask and ask(parse_parameters(learner, parameters), schema, action_limit)
    large = cost and (cost.seconds >= WORTH_SAYING or cost.megabytes >= MUCH_MEMORY)
    return cost if large else None

"""Parameters of the prior, shared by all learners that hold beliefs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from causal_openlock.contract.parameters import Count, OpenShare, Positive, Share

EFFORT = 8_000


@dataclass(frozen=True)
class Prior:
    """Parameters of the prior and of memory; learners add their own."""

    concentration: Annotated[
        Positive, "how many rooms the prior over schema classes is worth (Dirichlet)"
    ] = 1.0
    simplicity: Annotated[
        float, Field(ge=0), "cost of each part of a schema's description, in nats"
    ] = math.log(2.0)
    free_form: Annotated[
        OpenShare, "prior probability that a schema is of no class of the grammar"
    ] = 0.1
    by_colour: Annotated[OpenShare, "prior probability that colour marks the active levers"] = 0.5
    by_white: Annotated[Share, "if colour does, probability that it is the white ones"] = 0.1
    noise: Annotated[
        float,
        Field(ge=0, lt=1),
        "prior probability that levers may fail to move; at 0, only if nothing else is possible",
    ] = 0.0
    strength_alpha: Annotated[Positive, "first parameter of the strength's Beta prior"] = 4.0
    strength_beta: Annotated[Positive, "second parameter of it"] = 1.0
    hypothesis_limit: Annotated[Count, "about how many hypotheses are enumerated for a room"] = (
        20_000
    )
    particles: Annotated[
        Count, "hypotheses sampled where a room has too many levers to enumerate every structure"
    ] = 500
    effort: Annotated[
        Count,
        "structures looked at, at most, each time that hypotheses are sampled for a room of eight "
        "levers and more",
    ] = EFFORT
    directness: Annotated[
        float, "how much levers are expected to act on the door themselves, in nats for each"
    ] = 0.0
    forgetting: Annotated[Share, "share of a trial's evidence lost with every attempt"] = 0.0
    forgets: Annotated[
        Literal["everything", "failures"],
        "what is lost: all evidence, or only that of attempts that found nothing new",
    ] = "everything"

"""Types of hyper-parameters with ranges, which are checked in experiment files.

>>> from typing import Annotated
>>> from dataclasses import dataclass
>>> @dataclass(frozen=True)
... class Parameters:
...     lapse: Annotated[Share, "share of actions that are random"] = 0.0
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

Share = Annotated[float, Field(ge=0, le=1)]
OpenShare = Annotated[float, Field(gt=0, lt=1)]
"""A share other than 0 and 1."""
Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]

"""What a learner is told in a session: copies, and nothing that is latent."""

from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest

from causal_openlock.contract.learner import Brief, Console, Step, View
from causal_openlock.experiment.session import Session
from support.session_play import HUMAN, Curious, named

PLAIN = (bool, int, float, str, type(None), np.generic, np.random.Generator)
TOLD = (Brief, View, Console, Step)


def reachable(thing, path=""):
    """Everything that can be reached from a thing, and by which path."""
    yield path, thing
    if is_dataclass(thing):
        for field in fields(thing):
            yield from reachable(getattr(thing, field.name), f"{path}.{field.name}")
    elif isinstance(thing, tuple | list):
        for index, part in enumerate(thing):
            yield from reachable(part, f"{path}[{index}]")
    elif isinstance(thing, np.ndarray) and thing.base is not None:
        yield from reachable(thing.base, f"{path}.base")
    elif hasattr(thing, "__dict__") and not isinstance(thing, PLAIN):
        yield from reachable(vars(thing), f"{path}.__dict__")


class Nosy(Curious):
    """Has a method to be informed, but no right to be."""

    def inform(self, truth):
        raise AssertionError("it was told the truth")


@pytest.mark.parametrize("condition", ["CC3-CE4", "noisy_CC3"])
def test_nothing_that_a_learner_is_given_leads_to_what_is_latent(condition):
    learner = Nosy()
    session = Session(named(condition), replace(HUMAN, attempt_limit=3), 4)
    session.play(learner)
    latent = [value for value in session._tables if isinstance(value, np.ndarray)]
    assert latent
    for told in (session.brief, *learner.steps):
        for path, thing in reachable(told, type(told).__name__):
            assert isinstance(thing, (*PLAIN, *TOLD, tuple, np.ndarray)), path
            if isinstance(thing, np.ndarray):
                assert thing.dtype.kind in "biuf", path
                assert path.endswith(".base") or not thing.flags.writeable, path
                assert not any(np.shares_memory(thing, table) for table in latent), path
            if isinstance(thing, tuple):
                assert path in ("Brief.action_names", "Brief.generators"), path

"""The grammar of schema classes: each class once, and what it generates."""

from collections import defaultdict
from itertools import permutations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from causal_openlock.belief.grammar import (
    GATES,
    MAX_LENGTH,
    MAX_ROLES,
    Role,
    SchemaClass,
    assigned,
    class_prior,
    outlines,
    schema_classes,
)
from support.belief_arrays import class_structures, keys_of


def described(kind):
    """What is equal for classes that differ in the order of their roles alone."""

    def in_order(order):
        place = {old: new for new, old in enumerate(order)}
        return tuple(
            (role.many, role.gate, frozenset(place[i] for i in place if role.causes >> i & 1))
            for role in (*(kind.roles[old] for old in order), kind.door)
        )

    return frozenset(map(in_order, permutations(range(len(kind.roles)))))


LISTED = {described(kind) for kind in schema_classes()}


def test_no_class_is_listed_under_two_names():
    assert len(LISTED) == len(schema_classes())
    assert len({str(kind) for kind in schema_classes()}) == len(schema_classes())


@st.composite
def any_class(draw):
    """Up to four roles, anyhow, in any order that puts causes first."""
    count = draw(st.integers(1, MAX_ROLES))
    roles = []
    for index in range(count + 1):
        is_door = index == count
        causes = draw(st.integers(1 if is_door else 0, (1 << index) - 1))
        many = not is_door and draw(st.booleans())
        most = sum(3 if roles[i].many else 1 for i in range(index) if causes >> i & 1)
        gates = GATES if most > 2 else GATES[:2] if most > 1 else GATES[:1]
        roles.append(Role(many, causes, draw(st.sampled_from(gates))))
    kind = SchemaClass(tuple(roles[:-1]), roles[-1])
    assume(kind.length <= MAX_LENGTH)
    return kind


@settings(max_examples=150, deadline=None)
@given(any_class())
def test_every_class_that_can_be_written_is_listed(kind):
    assert described(kind) in LISTED


def test_a_description_is_as_long_as_its_parts_and_the_prior_falls_with_it():
    lengths = [
        len(kind.roles)
        + sum(role.causes.bit_count() + (role.gate != "any") for role in (*kind.roles, kind.door))
        for kind in schema_classes()
    ]
    assert lengths == sorted(lengths)
    prior = class_prior(0.7, 0.1)
    assert prior[-1] == pytest.approx(0.1)
    assert prior.sum() == pytest.approx(1.0)
    expected = np.exp(-0.7 * np.array(lengths))
    assert prior[:-1] == pytest.approx(0.9 * expected / expected.sum())
    assert class_prior(0.0, 0.2)[:-1] == pytest.approx(0.8 / len(schema_classes()))


@pytest.mark.parametrize("levers", [1, 2, 3, 4])
def test_a_class_generates_what_dealing_out_its_roles_gives(levers):
    ours, (structures, *pairs) = defaultdict(float), assigned(*outlines(levers))
    for key, kind, chance in zip(keys_of(structures), *map(np.ndarray.tolist, pairs), strict=True):
        ours[kind, key] += chance
    # Dealing four levers out by hand takes long: every class of up to three, one in forty of four.
    chosen = range(0, len(schema_classes()), 40 if levers == 4 else 1)
    expected = {
        (kind, key): chance
        for kind in chosen
        for key, chance in class_structures(schema_classes()[kind], levers).items()
    }
    ours = {pair: chance for pair, chance in ours.items() if pair[0] in chosen}
    assert ours.keys() == expected.keys()
    for pair, chance in expected.items():
        assert ours[pair] == pytest.approx(chance, abs=1e-12)

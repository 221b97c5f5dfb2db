"""The strength of causes: certain, or Beta-distributed.

Each of m pushed causes transmits independently with probability s, and a push takes effect if at
least k of them transmit, k being the threshold of the gate (a noisy-OR for k = 1, a noisy-AND for
all):

    P(takes effect) = sum over j >= k of C(m, j) s^j (1 - s)^(m - j)

This is a polynomial in s, so integrals over a Beta prior are sums over G Gauss-Jacobi nodes, exact
up to degree 2G - 1, that is for about 2G pushes; beyond that the nodes approximate the conjugate
Beta posterior.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from causal_openlock.belief.structures import NEVER
from causal_openlock.world.fsm import FloatArray
from causal_openlock.world.schema import MAX_LEVERS


@dataclass(frozen=True, eq=False)
class Strengths:
    """The possible strengths; the first is certainty.

    Attributes:
        value: ``[G]`` the strengths.
        prior: ``[G]`` their probabilities.
        chance: ``[G, P + 1, 16]`` probability that at least so many causes transmit: by strength,
            by how many causes are pushed, by threshold.
    """

    value: FloatArray
    prior: FloatArray
    chance: FloatArray

    @property
    def typical(self) -> float:
        """The mean strength if levers may fail to move; 1 if they may not."""
        if len(self) == 1:
            return 1.0
        return float(np.average(self.value[1:], weights=self.prior[1:]))

    def __len__(self) -> int:
        return len(self.value)


@cache
def strengths(noise: float, alpha: float, beta: float, nodes: int) -> Strengths:
    """Certainty, and the nodes of a Beta prior.

    Args:
        noise: Prior probability that levers may fail to move; at 0 there is certainty alone.
        alpha: First parameter of the Beta prior of the strength.
        beta: Second parameter.
        nodes: Gauss-Jacobi nodes.

    Example:
        >>> strengths(0.5, 4.0, 1.0, 2).value.round(2).tolist()
        [1.0, 0.53, 0.9]
    """
    value, prior = np.ones(1), np.ones(1)
    if noise > 0:
        from scipy.special import roots_sh_jacobi

        at, weight = roots_sh_jacobi(nodes, alpha + beta - 1, alpha)
        value = np.concatenate([value, at])
        prior = np.concatenate([[1.0 - noise], noise * weight / weight.sum()])
    return Strengths(value, prior, np.stack([at_least(s) for s in value]))


def at_least(strength: float) -> FloatArray:
    """``[P + 1, 16]`` probability that at least ``k`` of ``m`` pushed causes transmit.

    >>> at_least(0.5)[2, :3].tolist()  # of two causes none, one, both
    [1.0, 0.75, 0.25]
    """
    exactly = np.zeros((MAX_LEVERS + 1, int(NEVER) + 1))
    exactly[0, 0] = 1.0
    for pushed in range(MAX_LEVERS):
        exactly[pushed + 1] = exactly[pushed] * (1.0 - strength)
        exactly[pushed + 1, 1:] += exactly[pushed, :-1] * strength
    more: FloatArray = exactly[:, ::-1].cumsum(axis=1)[:, ::-1]
    return np.clip(more, 0.0, 1.0)

"""Attribution of subjects to one of several groups, from the evidence of each group.

The evidence of a learner for a subject (:func:`~causal_openlock.fitting.group.evidence_of`) is that
of parameters drawn from the learner's group. The means and spreads of the group were chosen in the
light of it, which has a price: that of the BIC, half a logarithm of the number of all actions for
each, of which those who follow the learner bear their shares (the integrated BIC of Huys et al.
2011). Who follows it depends on the price and the price on who follows it, so both are repeated
until they stay. The fewer follow a learner, the higher is the price of each, so that one or the
other of several answers may stay: it is the one that is reached from equal shares. How frequent
learners are is inferred as in :mod:`~causal_openlock.scoring.model_selection`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.scoring.model_selection import frequencies_of

MIXTURE = "mixture"
"""Learner of the fit of all groups together."""
ROUNDS, ENOUGH = 1000, 1e-6


@dataclass(frozen=True)
class Mixture:
    """Attribution of S subjects to M groups.

    Attributes:
        followed: ``[S, M]`` probability that each subject is of each group; for one without
            actions, their frequencies.
        frequencies: ``[M]`` expected share of subjects.
        bic: ``[S, M]`` integrated BIC, the price included; 0 without actions.
        evidence: Log evidence of the whole, at these frequencies, less all prices.
    """

    followed: FloatArray
    frequencies: FloatArray
    bic: FloatArray
    evidence: float


def mixture_of(evidence: FloatArray, actions: IntArray, parameters: IntArray) -> Mixture:
    """Attribute subjects to groups.

    Args:
        evidence: ``[S, M]`` log evidence, in nats.
        actions: ``[S]`` how many each subject has.
        parameters: ``[M]`` how many means and spreads each group has.

    Example:
        The first three subjects are of the first group, and the fourth of the other.

        >>> evidence = np.array([[-10.0, -30.0], [-12.0, -30.0], [-9.0, -30.0], [-40.0, -30.0]])
        >>> found = mixture_of(evidence, np.full(4, 25), np.array([2, 0]))
        >>> found.followed.round(2)[:, 0].tolist(), found.frequencies.round(2).tolist()
        ([1.0, 1.0, 1.0, 0.0], [0.67, 0.33])
    """
    known = actions > 0
    evidence, many = np.maximum(evidence, -1e6), evidence.shape[1]
    if not known.any():
        flat = np.full(many, 1.0 / many)
        return Mixture(np.tile(flat, (len(actions), 1)), flat, np.zeros_like(evidence), 0.0)
    each = parameters / 2 * np.log(actions.sum())
    counts, shares = np.ones(many), np.full((int(known.sum()), many), 1.0 / many)
    for _ in range(ROUNDS):
        price = each / np.maximum(shares.sum(axis=0), 1)
        counts, found = frequencies_of(evidence[known] - price)
        moved = np.abs(found - shares).max()
        shares = (shares + found) / 2  # half of the way, so that groups do not take turns
        if moved < ENOUGH:
            break
    frequencies = counts / counts.sum()
    followed = np.tile(frequencies, (len(actions), 1))
    followed[known] = shares
    return Mixture(
        followed,
        frequencies,
        np.where(known[:, None], 2 * (price - evidence), 0.0),
        float(logsumexp(evidence[known] - price, axis=1, b=frequencies).sum()),
    )

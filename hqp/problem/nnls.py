"""Non-negative least squares, the test of optimality conditions with multipliers of one sign."""

from __future__ import annotations

import numpy as np

from hqp.arrays import Mask, Mat, Vec

DEPENDENT = 1e-13
"""Singular values of the passive columns below this fraction of the largest add no direction."""


def nonnegative_least_squares(G: Mat, b: Vec) -> Vec:
    """min ||G mu - b|| over mu >= 0, ``(k,)``, by the active set of Lawson and Hanson (1974), chapter 23.

    Columns may be dependent or zero.  Stopping early leaves a feasible mu, so a residual is never too small.
    """
    k = G.shape[1]
    mu = np.zeros(k)
    passive = np.zeros(k, dtype=bool)
    tried = np.zeros(k, dtype=bool)  # entered without a decrease that can be seen: another column may show one
    enough = 1e-15 * float(np.abs(b).max(initial=0.0))
    Q = np.zeros((b.size, 0))
    for _ in range(3 * (k + b.size)):
        pull = G.T @ _rest(b, Q)
        pull[passive | tried] = 0.0
        entering = int(np.argmax(pull)) if k else 0
        if not k or pull[entering] <= enough:
            break
        passive[entering] = True
        before = float(np.linalg.norm(b - G @ mu))
        Q = _restore(G, b, mu, passive)
        if float(np.linalg.norm(b - G @ mu)) < before:
            tried[:] = False
        else:
            tried[entering] = True
    return mu


def _rest(b: Vec, Q: Mat) -> Vec:
    """Return the part of b outside the span of Q, by projection: b - G mu is as rounded as mu is large."""
    rest = b - Q @ (b @ Q)
    return np.asarray(rest - Q @ (rest @ Q))


def _restore(G: Mat, b: Vec, mu: Vec, passive: Mask) -> Mat:
    """Move mu to the least squares over the passive set, dropping entries that turn negative; a basis of the set's
    span."""
    while passive.any():
        chosen = np.flatnonzero(passive)
        columns = G[:, chosen]
        U, sigma, Vt = np.linalg.svd(columns, full_matrices=False)
        kept = sigma > DEPENDENT * sigma[0]
        Q, back = U[:, kept], Vt[kept] / sigma[kept, None]
        aim = b @ Q @ back
        aim += (b - columns @ aim) @ Q @ back  # columns of unlike lengths
        if np.all(aim > 0.0):
            mu[:] = 0.0
            mu[chosen] = aim
            return Q
        blocked = aim <= 0.0
        here = mu[chosen]
        step = float(np.min(here[blocked] / np.maximum(here[blocked] - aim[blocked], 1e-300)))
        moved = here + min(1.0, step) * (aim - here)
        drop = blocked & (moved <= 1e-14 * (1.0 + np.abs(here)))
        if not drop.any():
            drop = blocked & (moved == moved[blocked].min())
        mu[chosen] = np.where(drop, 0.0, np.maximum(moved, 0.0))
        passive[chosen[drop]] = False
    return np.zeros((b.size, 0))

"""min ||M z - e|| + c/2 |z|^2 by the singular values of M: the equation behind a priced level without inequalities."""

from __future__ import annotations

import numpy as np

from hqp.arrays import Mat, Vec


def least_unmet(M: Mat, e: Vec, price: float, cut: float) -> tuple[Vec, Mat]:
    """z ``(r,)``, and an orthonormal basis ``(r, rank)`` of the directions that M ``(m, r)`` sees.

    With M = U S V': z_i = s_i u_i'e / (s_i^2 + mu), mu = 0 where sum (u_i'e)^2 / s_i^4 <= 1 / c^2 (the level is met for
    its price, and e in the range of M), else the root of sum (u_i'e)^2 / (s_i^2 + mu)^2 = 1 / c^2.
    price: c, 0 for the pseudo-inverse.  cut: singular values below it are no directions.
    """
    U, sigma, Vt = np.linalg.svd(M, full_matrices=False)
    rank = int(np.count_nonzero(sigma > cut))
    parts = e @ U
    inside, square = parts[:rank], np.square(sigma[:rank])
    outside = e - U[:, :rank] @ inside
    mu = 0.0
    if price > 0.0:
        in_range = float(np.sqrt(outside @ outside)) <= 1e-13 * float(np.sqrt(e @ e))
        if not in_range or float(np.square(inside / square).sum()) > 1.0 / price**2:
            mu = _root(np.append(inside, np.sqrt(outside @ outside)), np.append(square, 0.0), price)
    return np.asarray(Vt[:rank].T @ (sigma[:rank] * inside / (square + mu))), np.asarray(Vt[:rank].T)


def _root(parts: Vec, square: Vec, price: float) -> float:
    """mu with sum (parts / (square + mu))^2 = 1 / price^2: Newton on the inverse root, halving where it leaves."""
    low = max(float(np.max(np.abs(parts) * price - square)), 0.0)
    high = price * float(np.sqrt(parts @ parts))
    mu = max(low, 1e-300)
    for _ in range(100):
        inverse = 1.0 / (square + mu)
        terms = np.square(parts * inverse)
        phi, slope = float(terms.sum()), float(terms @ inverse)
        psi = phi**-0.5
        low, high = (mu, high) if psi < price else (low, mu)
        step = mu + (price - psi) * phi / (psi * slope)
        following = step if low < step < high else 0.5 * (low + high)
        if abs(following - mu) <= 1e-15 * mu:
            return following
        mu = following
    return mu

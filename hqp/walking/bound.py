"""The largest push that any controller could survive without a step: a linear programme on the pendulum."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from hqp.declare.reference import numbers
from hqp.errors import DeclarationError
from hqp.numbers import number


def largest_push(corners: ArrayLike, start: ArrayLike, direction: ArrayLike, seconds: float, omega: float) -> float:
    """The largest impulse over mass [m/s] of a steady push at the CoM after which the DCM can be held in the support.

    With d xi/dt = omega (xi - p) + F / (m omega) the DCM comes in ``seconds`` from ``start`` ``(2,)`` [m], at rest, to

        xi = e start - (e - 1) p + (e - 1) / (omega^2 seconds) j u,     e = exp(omega seconds),

    p a mean of the ZMP, u the direction ``(2,)`` as a unit vector: the largest j for which p and xi are in the hull of
    ``corners`` ``(m, 2)`` [m].  A CoM at one height, no angular momentum, feet that stay.  Raises DeclarationError for
    invalid arguments and for a start outside the hull (Koolen et al. 2012).
    """
    from scipy.optimize import linprog

    seconds = number("push", "seconds", seconds, 0.0, strict=True, unit="s")
    omega = number("push", "omega", omega, 0.0, strict=True, unit="1/s")
    support = numbers("push", "corners", corners, (*np.shape(corners)[:1], 2))
    x, u = numbers("push", "start", start, (2,)), numbers("push", "direction", direction, (2,))
    if not np.isfinite([*support, x, u]).all() or not np.any(u) or len(support) < 3:
        raise DeclarationError("push", "bad corners, start or direction", allowed="three or more corners, a direction")
    m, e = len(support), math.exp(omega * seconds)
    pushed = (e - 1.0) / (omega**2 * seconds) * u / np.linalg.norm(u)
    A = np.zeros((4, 1 + 2 * m))  # j, then the weights of the corners in p and in xi
    A[:2, 0], A[:2, 1 : 1 + m], A[:2, 1 + m :] = pushed, -(e - 1.0) * support.T, -support.T
    A[2, 1 : 1 + m] = A[3, 1 + m :] = 1.0
    found = linprog(np.eye(1 + 2 * m)[0] * -1.0, A_eq=A, b_eq=[*(-e * x), 1.0, 1.0], bounds=(0.0, None))
    if not found.success:
        raise DeclarationError("push", "no ZMP holds the start", value=x.tolist(), allowed="a start within the hull")
    return float(found.x[0])

"""Bound on pushes: in closed form for a box, and never exceeded by a controller that searches for the best ZMP."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hqp.errors import DeclarationError
from hqp.walking import largest_push

OMEGA, SECONDS = 3.4, 0.1
BOX = np.array([(-0.05, -0.1), (0.15, -0.1), (0.15, 0.1), (-0.05, 0.1)])


def test_along_a_box_it_is_the_pendulum_with_its_zmp_at_the_edge() -> None:
    """(xi - x) e = b - x with xi = e x - (e - 1) b + k j: j = e (b - x) / k, and omega (b - x) for a blow."""
    e = math.exp(OMEGA * SECONDS)
    k = (e - 1.0) / (OMEGA**2 * SECONDS)
    for u, way in (((1.0, 0.0), 0.14), ((-1.0, 0.0), 0.06), ((0.0, -2.0), 0.1)):
        assert largest_push(BOX, (0.01, 0.0), u, SECONDS, OMEGA) == pytest.approx(e * way / k)
    assert largest_push(BOX, (0.01, 0.0), (1.0, 0.0), 1e-6, OMEGA) == pytest.approx(OMEGA * 0.14, rel=1e-4)


@pytest.mark.long
def test_no_zmp_of_many_holds_more_and_one_holds_nearly_as_much() -> None:
    """Pendulums integrated with drawn ZMPs in the support and pushes in any direction."""
    rng, u = np.random.default_rng(1), np.array([0.6, -0.8])
    most = largest_push(BOX, (0.03, 0.02), u, SECONDS, OMEGA)
    held = []
    for share in (0.97, 1.03):
        steps = 20
        push = share * most * u / SECONDS / OMEGA
        ends = []
        for _ in range(3000):
            p = rng.dirichlet(np.full(4, 0.15)) @ BOX
            e = math.exp(OMEGA * SECONDS / steps)
            xi = np.array([0.03, 0.02])
            for _ in range(steps):
                xi = p - push / OMEGA + e * (xi - p + push / OMEGA)
            ends.append(xi)
        inside = (np.array(ends) >= BOX.min(axis=0)) & (np.array(ends) <= BOX.max(axis=0))
        held.append(bool(inside.all(axis=1).any()))
    assert held == [True, False]


def test_what_is_none_is_refused() -> None:
    with pytest.raises(DeclarationError, match="no ZMP holds"):
        largest_push(BOX, (1.0, 0.0), (1.0, 0.0), SECONDS, OMEGA)
    with pytest.raises(DeclarationError, match="direction"):
        largest_push(BOX, (0.0, 0.0), (0.0, 0.0), SECONDS, OMEGA)
    with pytest.raises(DeclarationError, match="seconds"):
        largest_push(BOX, (0.0, 0.0), (1.0, 0.0), 0.0, OMEGA)

from __future__ import annotations

import math

import pytest

from hqp.declare.law import PD, P
from hqp.errors import DeclarationError


def test_orders_and_defaults() -> None:
    assert P(2.0).order == 1
    assert PD(100.0).order == 2
    assert PD(100.0).kd == 20.0
    assert PD((100.0, 4.0)).kd == (20.0, 4.0)
    assert P([1.0, 2.0]).gain == (1.0, 2.0)  # type: ignore[arg-type]


@pytest.mark.parametrize("gain", [math.nan, math.inf, -1.0, "2", True, (1.0, math.nan)])
def test_bad_gains_are_named(gain: object) -> None:
    with pytest.raises(DeclarationError, match=r"P\.gain.*given.*allowed: a finite"):
        P(gain)  # type: ignore[arg-type]
    with pytest.raises(DeclarationError, match=r"PD\.kd"):
        PD(1.0, gain)  # type: ignore[arg-type]


@pytest.mark.parametrize("bound", [0.0, -1.0, math.nan])
def test_bad_bounds_are_named(bound: float) -> None:
    with pytest.raises(DeclarationError, match="max_velocity"):
        P(1.0, max_velocity=bound)
    with pytest.raises(DeclarationError, match="max_acceleration"):
        PD(1.0, max_acceleration=bound)


def test_laws_are_values() -> None:
    assert P(2.0) == P(2.0)
    assert hash(PD(1.0, 2.0)) == hash(PD(1.0, 2.0))

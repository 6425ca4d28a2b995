"""Blocked hands in closed loop: clearances of all pairs kept, commands calm, balance exact."""

from __future__ import annotations

import importlib.util

import pytest

import hqp
from tests.scenes.calm.goals import misses
from tests.scenes.collision import scenes, table

NEAREST = -5e-4
"""Least distance minus clearance [m]."""

BLOCKED = [
    ("panda", "velocity", "torso"),
    pytest.param("panda", "velocity", "table", marks=pytest.mark.slow),
    ("panda", "torque", "torso"),
    pytest.param("talos", "velocity", "torso", marks=pytest.mark.slow),
    pytest.param("talos", "velocity", "table", marks=pytest.mark.slow),
    pytest.param(
        "talos",
        "velocity",
        "other hand",
        marks=[
            pytest.mark.slow,
            pytest.mark.xfail(strict=True, reason="5 reversals/s, more with tighter capsules"),
        ],
    ),
    pytest.param("talos", "acceleration", "torso", marks=pytest.mark.slow),
    pytest.param("talos", "torque", "other hand", marks=pytest.mark.slow),
    pytest.param("talos", "acceleration", "other hand", marks=pytest.mark.slow),
    pytest.param("talos", "torque", "torso", marks=pytest.mark.slow),
    pytest.param("talos", "torque", "table", marks=pytest.mark.slow),
    ("g1", "velocity", "torso"),
    ("g1", "acceleration", "other hand"),
    pytest.param("g1", "velocity", "table", marks=pytest.mark.slow),
    pytest.param("g1", "velocity", "other hand", marks=pytest.mark.slow),
    pytest.param("g1", "torque", "torso", marks=pytest.mark.slow),
]


def need(name: str) -> None:
    if name not in hqp.robots.names():
        pytest.skip("needs example-robot-data")


@pytest.mark.parametrize(("name", "formulation", "scene"), BLOCKED)
def test_blocked(name: str, formulation: str, scene: str) -> None:
    need(name)
    figures = scenes.run(scenes.scenes(name, formulation)[scene](), every=20).figures()
    assert figures["margin"] > NEAREST, figures["nearest"]
    assert not list(misses(formulation, figures)), figures
    assert "NOT_CERTIFIED" not in figures["statuses"]
    assert figures["error_end"] > 0.02  # it is blocked


@pytest.mark.slow
@pytest.mark.parametrize("formulation", ["velocity", "acceleration"])
@pytest.mark.parametrize(("name", "scene"), [("talos", "table"), ("talos", "torso"), ("g1", "table"), ("cbi", "table")])
def test_blocked_for_eight_seconds(name: str, formulation: str, scene: str) -> None:
    """Long enough for a posture to bring capsules flat on a face, so that their nearest point jumps from end to end."""
    need(name)
    figures = scenes.run(scenes.scenes(name, formulation)[scene](), ticks=4000, every=10).figures()
    assert figures["margin"] > NEAREST, figures["nearest"]
    assert not list(misses(formulation, figures)), figures


@pytest.mark.long
@pytest.mark.parametrize("name", ["panda", pytest.param("talos", marks=pytest.mark.slow), "g1"])
def test_from_inside_it_comes_out_at_the_recovery_speed(name: str) -> None:
    need(name)
    blocked = scenes.scenes(name, "velocity")["inside"]()
    figures = scenes.run(blocked, ticks=1200, every=20).figures()
    assert figures["margin"] < -0.09
    assert figures["margin_end"] > NEAREST
    assert figures["above"] < 1e-9
    assert figures["contact"] < 1e-5
    if name != "panda":  # the ball is in the very middle between its fingers
        assert "CONSTRAINTS_VIOLATED" not in figures["statuses"]


@pytest.mark.long
@pytest.mark.skipif(importlib.util.find_spec("mujoco") is None, reason="needs MuJoCo")
@pytest.mark.parametrize("name", ["panda", pytest.param("cbi", marks=pytest.mark.slow)])
def test_around_a_table_in_mujoco_nothing_is_touched(name: str) -> None:
    need(name)
    found = table.around(name)
    assert not found.touched
    assert found.nearest > 0.5 * table.CLEARANCE
    assert found.error < 0.01
    assert table.around(name, avoid=False, seconds=2.5).touched  # the straight path crosses it

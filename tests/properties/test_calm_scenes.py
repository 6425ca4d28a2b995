"""Hand targets out of reach and a walking hand: calm with prices, restless without, and figures that separate both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.scenes.calm import arrival, drawn, goals
from tests.scenes.calm.loop import Run, figures, run
from tests.scenes.calm.scenes import DT, scenes
from tests.scenes.calm.variants import EXACT, PRICED, Variant
from tests.scenes.calm.walking import walking


def loop(robot: str, formulation: str, name: str, variant: Variant, ticks: int = 700) -> dict[str, float | str]:
    return figures(run(scenes(robot, formulation, variant.limits)[name](), variant, ticks))


@pytest.mark.long
@pytest.mark.parametrize("scene", ["edge", "beyond"])
@pytest.mark.parametrize("formulation", ["velocity", "acceleration"])
def test_out_of_reach_an_arm_is_calm(formulation: str, scene: str) -> None:
    priced, exact = (loop("ur5", formulation, scene, variant, 1500) for variant in (PRICED, EXACT))
    assert not set(goals.misses(formulation, priced))
    assert {"jump", "reversals", "acceleration_p99"} <= set(goals.misses(formulation, exact))  # control


@pytest.mark.slow
@pytest.mark.parametrize("formulation", ["velocity", "acceleration"])
@pytest.mark.parametrize("robot", ["talos", "g1"])
def test_out_of_reach_a_humanoid_is_calm(robot: str, formulation: str) -> None:
    priced = loop(robot, formulation, "beyond", PRICED, 1500)
    assert not {"jump", "reversals", "above"} & set(goals.misses(formulation, priced))
    assert float(priced["acceleration_p99"]) < 40.0  # goal 30: Talos misses it at velocity level
    assert float(priced["contact"]) < 2e-4
    assert float(priced["over"]) < 1e-9
    assert "reversals" in set(goals.misses(formulation, loop(robot, formulation, "beyond", EXACT, 1500)))


@pytest.mark.long
def test_within_reach_a_price_costs_nothing() -> None:
    priced, exact = (loop("panda", "velocity", "circle within", v) for v in (PRICED, replace(PRICED, priced=False)))
    assert not goals.loses(priced, exact)


@pytest.mark.slow
def test_the_default_limits_keep_a_walking_hand_on_its_feet() -> None:
    """Torque control with friction, also with exact levels: limits held, feet loaded, CoM in place."""
    variant = Variant("exact", priced=False)
    told = figures(run(walking("talos", variant.limits), variant, 1200))
    assert float(told["over"]) < 1e-9
    assert float(told["load"]) > 20.0 - 1e-6
    assert float(told["com"]) < 1e-3
    assert "CONSTRAINTS_VIOLATED" not in str(told["statuses"])


def test_figures_of_known_commands() -> None:
    """One joint that alternates, one that drifts: reversals per second, jumps and accelerations by hand."""
    scene = scenes("ur5", "velocity", {})["within"]()
    ticks = 400
    commands = np.zeros((ticks, 6))
    commands[::2, 0] = 0.5  # a change of 0.5 every tick, 499 turns a second
    commands[:, 1] = 1e-6 * (-1.0) ** np.arange(ticks)  # below the threshold of a noticeable change
    accelerations = np.zeros((ticks, 6))
    accelerations[ticks // 2 :, 3] = 7.0
    data = Run.empty(scene, ticks)
    data = replace(data, commands=commands, accelerations=accelerations, scale=np.full(6, 2.0))
    data.error[:], data.times[:] = 0.1, 1e-4
    told = figures(data)
    assert told["jump"] == pytest.approx(0.5)
    assert told["jump_share"] == pytest.approx(0.25)
    assert told["reversals"] == pytest.approx((ticks // 2 - 2) / (ticks // 2 * DT))
    assert told["acceleration_p50"] == pytest.approx(7.0)
    assert told["error"] == pytest.approx(0.1)
    assert told["tick_p50"] == pytest.approx(100.0)
    assert list(goals.misses("velocity", told)) == ["jump", "reversals", "acceleration_p50"]


@pytest.mark.slow
def test_a_seed_draws_the_same_loop_twice() -> None:
    first, again = (list(drawn.loops("velocity", [3])) for _ in range(2))
    times = {"tick_p50", "tick_p99", "tick_max"}
    assert [{k: v for k, v in r.items() if k not in times} for r in first] == [
        {k: v for k, v in r.items() if k not in times} for r in again
    ]
    assert "seed 3" in first[0]["scene"]
    assert "| velocity | 1 |" in drawn.table(first)


@pytest.mark.long
@pytest.mark.parametrize(("seed", "asked"), [(716, True), (640, False)])
def test_a_path_asks_for_what_calm_exact_levels_need(seed: int, asked: bool) -> None:
    """An exact answer at the limits of its acceleration window (640) gives no information on the path."""
    (found,) = drawn.loops("velocity", [seed])
    assert found["misses"] == ["acceleration_p50"]
    assert found["asked"] is asked


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "fate"), [(96, "later"), (2, "saddle"), (73, "rest")])
def test_where_a_goal_ends_that_exact_levels_alone_reach(seed: int, fate: str) -> None:
    """UR5 passes a stretched arm slowly, rests at a fold until the elbow opens, or rests for good."""
    assert arrival.fate(arrival.case("ur5", seed), PRICED) == fate

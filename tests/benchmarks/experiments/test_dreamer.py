"""Dreamer's experiments, shortened: onto the slope and no further."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.sentis2012.experiments.compliance import Compliance
from benchmarks.sentis2012.experiments.dreamer_run import Outing
from benchmarks.sentis2012.experiments.human import Walk
from benchmarks.sentis2012.experiments.measures import measure
from benchmarks.sentis2012.experiments.scene import Scene
from benchmarks.sentis2012.experiments.variants import refusal

UP = Scene(walk=Walk(speed=0.33, distance=0.55, start=0.5, easing=1.0, back=False), seconds=3.6)


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["dreamer", "dreamer_rollers"])
def test_pulled_onto_the_slope(plant: str) -> None:
    run = Outing(replace(UP, plant=plant), Compliance(), "nullspace").run()
    m = measure(run, since=0.3)
    assert math.isnan(m.fell)
    assert math.degrees(run.log["base"][-1, 4]) > 6.5  # all three wheels are on the slope
    assert m.com_up < 6.0
    assert m.hand_pulled < 40.0
    assert m.hand_rest < 1.0
    assert m.posture < 32.0
    assert m.coupling < 0.02
    assert m.unloaded == 0.0
    assert m.wheel_torque < 10.0
    assert m.pull < 50.0


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["dreamer", "dreamer_rollers"])
def test_wheels_of_both_plants_sink_in_alike(plant: str) -> None:
    run = Outing(Scene(plant=plant, slope=0.0, seconds=0.5), Compliance(), "nullspace").run()
    assert run.log["base"][-1, 2] == pytest.approx(-0.7e-3, abs=0.5e-4)


@pytest.mark.slow
def test_led_aside_it_turns_and_the_com_stays() -> None:
    scene = replace(UP, heading=math.radians(60.0), walk=replace(UP.walk, distance=0.9), seconds=4.2)
    assert Outing(scene, Compliance(), "nullspace").run().fallen
    turned = Outing(scene, Compliance(turn=0.6), "nullspace").run()
    assert math.degrees(turned.log["base"][-1, 4]) > 5.5
    assert measure(turned, since=0.3).com_up < 6.0


@pytest.mark.slow
def test_same_run_same_numbers_and_same_for_the_qp() -> None:
    short = replace(UP, seconds=1.2)
    first, second = (Outing(short, Compliance(), "nullspace").run() for _ in range(2))
    np.testing.assert_array_equal(first.log["torque"], second.log["torque"])
    other = Outing(short, Compliance(), "lexicographic").run()
    np.testing.assert_allclose(other.log["torque"], first.log["torque"], atol=1e-5)
    noisy = [Outing(replace(short, seed=s, seconds=0.2), Compliance(), "nullspace").run() for s in (0, 1)]
    np.testing.assert_array_equal(noisy[0].log["torque"], noisy[1].log["torque"])  # no noise, no seed


@pytest.mark.slow
def test_absolute_jacobians_fall_and_absolute_damping_lags() -> None:
    literal = Outing(UP, Compliance(absolute_jacobians=True), "nullspace").run()
    assert literal.fallen
    lagging = measure(Outing(UP, Compliance(absolute_damping=True), "nullspace").run())
    assert lagging.com_up > 25.0  # 2 v / sqrt(kp) = 35 mm


@pytest.mark.slow
def test_unsaturated_com_task_falls_from_a_start_out_of_place() -> None:
    scene = Scene(out_of_place=1.0, walk=Walk(start=5.0), seconds=1.5)
    assert Outing(scene, Compliance(com_acceleration=math.inf), "nullspace").run().fallen
    assert not Outing(scene, Compliance(), "nullspace").run().fallen


@pytest.mark.slow
def test_a_push_aside_of_60_newtons_is_borne_within_the_joints_range() -> None:
    scene = Scene(slope=0.0, push=(0.0, 60.0, 0.0), seconds=3.0)
    bounded = Compliance(limits=True, com_acceleration=math.inf, least_load=90.0, normals="base")
    outing = Outing(scene, bounded, "lexicographic").run()
    assert not outing.fallen
    assert measure(outing).com_up < 10.0
    robot, angles = outing.robot, outing.log["posture"] + outing.posture
    joints = robot.joints("upper_body")
    assert np.all(angles > robot.lower[joints])
    assert np.all(angles < robot.upper[joints])


def test_rolling_along_the_axle_is_refused_with_the_ranks() -> None:
    assert "rank [J_constr; U] = 18 of 19" in refusal(Compliance(axle_rolling=True))
    assert not refusal(Compliance())

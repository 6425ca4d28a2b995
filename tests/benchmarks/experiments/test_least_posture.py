"""Posture: the least error that the levels above leave, and Lyapunov's function in physics; CBi by inverse dynamics."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.lab.setting import Setting
from benchmarks.mistry2008.experiments import dynamics
from benchmarks.sentis2012.experiments import lyapunov
from benchmarks.sentis2012.experiments.compliance import COM_GOAL, Compliance
from benchmarks.sentis2012.experiments.dreamer_run import Outing
from benchmarks.sentis2012.experiments.least_posture import least_posture_error, rms
from benchmarks.sentis2012.experiments.scene import Scene
from hqp.tasks import Com

SETTING = Setting(solver="nullspace")


def test_the_least_posture_error_keeps_com_and_hand_and_cannot_be_bettered() -> None:
    run = Outing(Scene(slope=0.0, seconds=0.01), Compliance(), "nullspace")
    q = run.robot.home.copy()
    tilt = math.radians(7.0)
    q[3:7] = 0.0, -math.sin(0.5 * tilt), 0.0, math.cos(0.5 * tilt)
    before, least = least_posture_error(run, q)
    assert np.abs(before).max() < 1e-12  # in the posture, hence with a distant CoM
    assert 5.0 < rms(least) < 20.0
    upper = run.robot.joints("upper_body")
    q[run.robot.positions(upper)] = run.posture + least
    q[run.robot.positions(run.robot.joints(("torso_thorax",)))] = q[
        run.robot.positions(run.robot.joints(("torso_hip",)))
    ]
    com = Com(axes="xy", subtree="torso_yaw", relative_to="base", heading=True)
    np.testing.assert_allclose(com.value(run.robot.state(q)), COM_GOAL, atol=1e-8)
    again, same = least_posture_error(run, q)
    np.testing.assert_allclose(same, again, atol=1e-6)


@pytest.mark.slow
def test_lyapunovs_function_falls_at_twice_the_gain_in_physics() -> None:
    t, V = lyapunov.followed(SETTING, 2.0)
    on = (t >= lyapunov.FROM) & (t <= lyapunov.TO)
    assert -np.polyfit(t[on], np.log(V[on]), 1)[0] == pytest.approx(4.0, rel=0.05)


@pytest.mark.slow
def test_cbi_by_inverse_dynamics_on_its_own_sensing() -> None:
    run = dynamics.swing(Setting(solver="lexicographic"), 1.5)
    assert math.isnan(run.fell)
    assert np.abs(run.error).max() < 1.5
    assert run.torque_share < 0.5

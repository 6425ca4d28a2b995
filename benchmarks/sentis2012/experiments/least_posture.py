"""Least posture error under the constraints of CoM, hand and coupling, at the tilt of the base."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.sentis2012.experiments.compliance import COM_GOAL, HAND_GOAL
from benchmarks.sentis2012.experiments.dreamer_run import Outing
from hqp.arrays import Mat, Vec
from hqp.tasks import Com, Position

STEPS, TOLERANCE = 200, 1e-10


def least_posture_error(run: Outing, q: Vec) -> tuple[Vec, Vec]:
    """The posture errors of a configuration and the least ones near it, joint by joint ``(9,)`` [rad].

    min |e|^2 / 2 over the joints of the upper body such that CoM and hand are at their goals, the thorax bends as much
    as the hip, and the base has its pose in q.  Newton's method on the tangent space, de = -P e - C^+ c, with
    P = I - C^+ C the directions that keep the constraints, ends at P e = 0 and c = 0, a local minimum.
    """
    robot = run.robot.copy()
    upper = robot.joints("upper_body")
    places = robot.positions(upper)
    assert places is not None
    com = Com(axes="xy", subtree="torso_yaw", relative_to="base", heading=True, name="com")
    hand = Position(frame="hand_point", relative_to="base", heading=True, name="hand")
    spread = np.zeros((robot.nv, upper.size))
    spread[upper, range(upper.size)] = 1.0
    (hip,) = np.flatnonzero(upper == robot.joints(("torso_hip",))[0])
    spread[robot.joints(("torso_thorax",)), hip] = 1.0
    before = q[places] - run.posture
    for _ in range(STEPS):
        state = robot.state(q)
        c = np.concatenate((com.value(state) - COM_GOAL, hand.value(state) - HAND_GOAL))
        C: Mat = np.vstack((com.jacobian(state), hand.jacobian(state))) @ spread
        e = q[places] - run.posture
        inverse = np.linalg.pinv(C, rcond=1e-6)
        step = -(e - inverse @ (C @ e)) - inverse @ c
        size = float(np.abs(step).max())
        if size < TOLERANCE:
            break
        step *= min(1.0, 0.1 / size)  # small turns: CoM and hand are far from linear in them
        q = robot.integrate(q, spread @ step, 1.0)
    return before, np.asarray(q[places] - run.posture)


def rms(e: Vec) -> float:
    """Root mean square of joint errors [deg]."""
    return math.degrees(math.sqrt(float(e @ e) / e.size))

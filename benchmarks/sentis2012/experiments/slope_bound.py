"""Bound by statics: the steepest slope on which Dreamer can stand on rollers, for any controller."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.lab.outcome import Table, table
from benchmarks.sentis2012.experiments.compliance import COM_GOAL, HAND_GOAL
from hqp.arrays import Vec
from hqp.robots import load

FLATTEST, STEEPEST = 0.0, 60.0
"""Range of slopes [deg]."""


def stands(slope: float, friction: float = 0.8, pull: float = 0.0, least_load: float = 0.0) -> bool:
    """Return true if forces exist that hold the robot at rest, facing a slope [rad], its CoM task at the goal.

    A linear programme in the wheels' normal forces, their traction (rollers bear force along the rim only, within
    friction and the motor's torque), and a pull up the slope at the hand of at most ``pull`` [N]: six equations of
    equilibrium.
    The base lies in the slope; the upper body's CoM is at the CoM task's goal, in the heading's axes.  least_load: on
    every wheel [N].
    """
    from scipy.optimize import linprog

    robot = load("dreamer")
    state = robot.state(robot.home)
    base, whole = state.position("base"), robot.mass
    upper, at = _upper_body(robot.home)
    rest = (whole * (state.com() - base) - upper * (at - base)) / (whole - upper)
    c, s = math.cos(slope), math.sin(slope)
    R = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    com = ((whole - upper) * (R @ rest) + upper * np.array([*COM_GOAL, (R @ (at - base))[2]])) / whole
    weight = np.array([0.0, 0.0, -9.81 * whole])
    wrenches: list[Vec] = []
    bounds: list[tuple[float | None, float | None]] = []
    slips: list[tuple[int, int]] = []

    def add(force: Vec, place: Vec, low: float | None, high: float | None) -> int:
        wrenches.append(np.concatenate((force, np.cross(place, force))))
        bounds.append((low, high))
        return len(wrenches) - 1

    contacts = robot.landmarks["wheel_contacts"]
    for wheel, joint, frame in zip(robot.wheels.values(), robot.joints("wheels"), contacts, strict=True):
        place, rim = R @ (state.position(frame) - base), R @ np.cross(wheel.axle, (0.0, 0.0, 1.0))
        most = float(robot.effort_limit[joint]) / wheel.radius
        pressed = add(R[:, 2], place, least_load, None)
        slips.append((add(rim, place, -most, most), pressed))
    add(R[:, 0], R @ np.array(HAND_GOAL), 0.0, pull)
    rows = np.zeros((2 * len(slips), len(wrenches)))
    for k, (traction, pressed) in enumerate(slips):
        rows[2 * k : 2 * k + 2, traction], rows[2 * k : 2 * k + 2, pressed] = (1.0, -1.0), -friction
    known = np.concatenate((weight, np.cross(com, weight)))
    cost, columns = np.zeros(len(wrenches)), np.array(wrenches).T
    return bool(linprog(cost, rows, np.zeros(len(rows)), columns, -known, bounds, method="highs").status == 0)


def _upper_body(q: Vec) -> tuple[float, Vec]:
    """Mass [kg] and CoM ``(3,)`` [m] of the bodies on the torso's yaw joint."""
    import pinocchio as pin

    model = load("dreamer").model
    data = model.createData()
    pin.centerOfMass(model, data, q)
    joint = model.getJointId("torso_yaw")
    return float(data.mass[joint]), np.asarray(data.oMi[joint].act(data.com[joint]))


def steepest(friction: float = 0.8, pull: float = 0.0, least_load: float = 0.0) -> float:
    """The steepest slope [deg] by bisection."""
    low, high = FLATTEST, STEEPEST
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stands(math.radians(middle), friction, pull, least_load) else (low, middle)
    return low


def slopes() -> Table:
    """The steepest slope by friction: alone, under a pull of 120 N, and with at least 60 N on every wheel."""
    rows = []
    for friction in (0.8, 0.5, 0.3, 0.25, 0.2, 0.15):
        found = (steepest(friction), steepest(friction, pull=120.0), steepest(friction, least_load=60.0))
        rows.append((f"{friction:g}", *(f"{degrees:.1f}" for degrees in found)))
    header = ("friction", "steepest slope [deg]", "pulled by up to 120 N", "60 N kept on every wheel")
    return table("Rollers on a slope: what statics allows", header, rows)

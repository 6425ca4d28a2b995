"""Requirement of statics on Dreamer's rollers at a step: least shift of the CoM to climb it."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.lab.outcome import Table, number, table
from benchmarks.sentis2012.experiments.compliance import HAND_GOAL
from hqp.arrays import Vec
from hqp.robots import load

RING, TUBE = 0.088, 0.013
"""Rim of the rollers: radius of the ring through their middles, and their radius around it [m] (``robots/dreamer``)."""

FRICTION, CAP = 0.8, 120.0
"""Friction of the ground, and largest pull of the human [N]."""


def meeting(rise: float, askew: float) -> tuple[float, float]:
    """Contact of a wheel on the ground with an edge: distance ahead of the wheel's lowest point [m], and inclination of
    the normal from the vertical [rad].

    The rim, seen along the edge, is an ellipse with semi-axes RING cos(askew) and RING, thickened by TUBE; askew: angle
    between the wheel's rolling direction and the normal of the edge [rad].  A wheel that moves along its axle meets the
    edge with one roller.
    """
    along = RING * math.cos(askew)
    turn = np.linspace(0.0, 0.5 * math.pi, 100_001)
    normal = np.array([RING * np.sin(turn), along * np.cos(turn)])
    size = np.hypot(*normal)
    if along < 1e-9:  # a half circle
        ahead, height, slope = TUBE * np.sin(turn), TUBE * (1.0 - np.cos(turn)), turn
    else:
        ahead = along * np.sin(turn) + TUBE * normal[0] / size
        height = RING + TUBE - RING * np.cos(turn) - TUBE * normal[1] / size
        slope = np.arctan2(*normal)
    i = int(np.argmin(np.abs(height - rise)))
    return float(ahead[i]), float(slope[i])


def least_shift(rise: float, heading: float = 0.0, friction: float = FRICTION) -> float:
    """Least shift of the CoM from the posture goal's, ahead or aside, with which the front wheels bear on the edge
    alone [m]; inf if there is none.

    A linear programme in the wheels' normal forces, their traction (a roller bears force along its own axis only,
    within friction and the motor's torque), pulls ahead and aside of at most CAP each at the hand, and the CoM's
    place: six equations of equilibrium.  rise [m]; the step rises towards azimuth 0, heading of the robot [rad].
    """
    from scipy.optimize import linprog

    robot = load("dreamer")
    state = robot.state(robot.home)
    c, s = math.cos(heading), math.sin(heading)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    weight = np.array([0.0, 0.0, -9.81 * robot.mass])
    places = [turn @ state.position(frame) for frame in robot.landmarks["wheel_contacts"]]
    foremost = max(place[0] for place in places)
    wrenches: list[Vec] = []
    bounds: list[tuple[float | None, float | None]] = []
    unequal: list[tuple[int, int, float]] = []  # |x_i| <= share x_j

    def add(force: Vec, at: Vec, low: float | None, high: float | None) -> int:
        wrenches.append(np.concatenate((force, np.cross(at, force))))
        bounds.append((low, high))
        return len(wrenches) - 1

    for wheel, joint, place in zip(robot.wheels.values(), robot.joints("wheels"), places, strict=True):
        rim, normal = turn @ np.cross(wheel.axle, (0.0, 0.0, 1.0)), np.array([0.0, 0.0, 1.0])
        if place[0] > foremost - 1e-6:
            ahead, slope = meeting(rise, math.acos(min(1.0, abs(float(rim[0])))))
            place = place + np.array([ahead, 0.0, rise])
            normal = np.array([-math.sin(slope), 0.0, math.cos(slope)])
            rim = rim - (rim @ normal) * normal
            rim = rim / np.linalg.norm(rim)
        most = float(robot.effort_limit[joint]) / wheel.radius
        pressed = add(normal, place, 0.0, None)
        unequal.append((add(rim, place, -most, most), pressed, friction))
    hand = turn @ np.array(HAND_GOAL)
    pull = add(np.array([1.0, 0.0, 0.0]), hand, 0.0, CAP)
    unequal.append((add(np.array([0.0, 1.0, 0.0]), hand, None, None), pull, 1.0))
    com = turn @ state.com()
    known = np.concatenate((weight, np.cross(com, weight)))
    room = len(wrenches)
    wrenches.append(np.zeros(6))
    bounds.append((0.0, None))
    for axis in np.eye(3)[:2]:  # moment of the shifted weight
        wrenches.append(np.concatenate((np.zeros(3), np.cross(axis, weight))))
        bounds.append((None, None))
        unequal.append((len(wrenches) - 1, room, 1.0))
    rows = np.zeros((2 * len(unequal), len(wrenches)))
    for k, (i, j, share) in enumerate(unequal):
        rows[2 * k : 2 * k + 2, i], rows[2 * k : 2 * k + 2, j] = (1.0, -1.0), -share
    found = linprog(
        np.eye(len(wrenches))[room], rows, np.zeros(len(rows)), np.array(wrenches).T, -known, bounds, method="highs"
    )
    return float(found.fun) if found.status == 0 else math.inf


def steps() -> Table:
    """Steps by height and heading: the normal on the edge, and the least shift of the CoM."""
    rows = []
    for heading, askew in ((0.0, 90.0), (30.0, 60.0), (60.0, 30.0)):
        for rise in (0.002, 0.003, 0.004, 0.005, 0.006, 0.01):
            slope = math.degrees(meeting(rise, math.radians(askew))[1])
            shift = 1e3 * least_shift(rise, math.radians(heading))
            rows.append((f"{heading:g}", f"{1e3 * rise:g}", f"{slope:.0f}", number(shift)))
    header = ("heading [deg]", "step [mm]", "normal on the edge [deg]", "the CoM has to stand off by [mm]")
    return table("Rollers at a step: what statics asks", header, rows)

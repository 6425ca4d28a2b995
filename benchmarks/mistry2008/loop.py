"""The paper's two experiments as closed kinematic loops: CoG from side to side, the right hand on a figure-8."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import hqp
from hqp import P, Stack
from hqp.arrays import Mat, Vec
from hqp.declare.robot import Robot
from hqp.estimation.rotations import quaternion_of, rotation_of
from hqp.solvers.base import Solver
from hqp.tasks import Com, Position
from tests.scenes.mistry2008 import HZ, paper_stack, roles

DT = 1.0 / HZ

HAND_PERIOD, HAND_Y, HAND_Z = 10.0, 0.10, 0.06
"""Figure-8 in the frontal plane: 0.1 Hz, +-10 cm across, +-6 cm up [s, m, m]."""

COG_PERIOD, COG_Y = 5.0, 0.04
"""Side to side: 0.2 Hz, +-4 cm [s, m]."""

Path = Callable[[float], Vec]
"""Offset from the start at a time [s]."""


def figure_eight(t: float) -> Vec:
    """Offset of the hand ``(3,)`` [m]."""
    w = 2.0 * np.pi / HAND_PERIOD
    return np.array([0.0, HAND_Y * np.sin(w * t), HAND_Z * np.sin(2.0 * w * t)])


def side_to_side(t: float) -> Vec:
    """Offset of the CoG over the ground ``(2,)`` [m]."""
    return np.array([0.0, COG_Y * np.sin(2.0 * np.pi / COG_PERIOD * t)])


def still(t: float) -> Vec:
    """No motion of the CoG ``(2,)``."""
    return np.zeros(2)


def rest(t: float) -> Vec:
    """No motion of the hand ``(3,)``."""
    return np.zeros(3)


@dataclass(frozen=True)
class Trace:
    """Samples of a run, one each tick.

    t ``(T,)`` [s]; com, com_target ``(T, 2)``; hand, hand_target ``(T, 3)``; feet ``(T,)``: distance of the farther
    sole from its place at the start [m].  q: the last configuration.
    """

    t: Vec
    com: Mat
    com_target: Mat
    hand: Mat
    hand_target: Mat
    feet: Vec
    q: Vec

    @property
    def hand_rms(self) -> float:
        """sqrt(mean |e|^2) of the hand [m]."""
        return float(np.sqrt(np.mean(np.sum((self.hand - self.hand_target) ** 2, axis=1))))

    @property
    def com_error(self) -> float:
        """Largest distance of the CoG from its target over the ground [m]."""
        return float(np.linalg.norm(self.com - self.com_target, axis=1).max())

    @property
    def slip(self) -> float:
        """Largest distance of a sole from its place at the start [m]."""
        return float(self.feet.max())


def run(
    robot: Robot,
    solver: str | Solver,
    seconds: float,
    *,
    stack: Stack | None = None,
    hand: Path = figure_eight,
    com: Path = still,
    feedforward: bool = True,
    contact_gain: float = 20.0,
    dt: float = DT,
    q: Vec | None = None,
    anchored: bool = False,
    seen: Callable[[hqp.Session], None] = lambda session: None,
) -> Trace:
    """Integrate eq. (19) with the base carried along exactly.

    feedforward: the target's mean velocity over the coming period.  contact_gain [1/s] feeds the feet's pose back;
    0 is eq. (19) alone.  anchored: only the joints are integrated, and the base follows from the fixed left sole;
    else the base is integrated too.  q: the first configuration, home by default.  seen: called after each tick.
    """
    stack = stack or paper_stack(roles(robot))
    frames = roles(robot)
    formulation = hqp.Velocity(contact_law=P(contact_gain))
    session = hqp.Controller(stack, formulation, solver=solver, price=0, deadline=math.inf).session(robot, dt)
    com_task, hand_task = stack.find("com_xy", Com), stack.find("hand", Position)
    q, v = (robot.home if q is None else q).copy(), np.zeros(robot.nv)
    state = robot.state(q, v)
    soles = [state.position(frames.left), state.position(frames.right)]
    rotation_0 = state.rotation(frames.left)
    com_0, hand_0 = state.com()[:2].copy(), state.position(frames.hand)
    steps = round(seconds / dt)
    trace = Trace(
        dt * np.arange(steps), *(np.zeros((steps, k)) for k in (2, 2, 3, 3)), np.zeros(steps), q
    )  # fmt: skip
    for i in range(steps):
        goal, aim = com_0 + com(i * dt), hand_0 + hand(i * dt)
        rate = (com(i * dt + dt) - com(i * dt)) / dt if feedforward else None
        speed = (hand(i * dt + dt) - hand(i * dt)) / dt if feedforward else None
        state = robot.state(q, v)
        tick = session.step(
            state,
            com_task.at(goal, velocity=rate),
            hand_task.at(aim, velocity=speed),
        )
        seen(session)
        trace.com[i], trace.com_target[i] = state.com()[:2], goal
        trace.hand[i], trace.hand_target[i] = state.position(frames.hand), aim
        trace.feet[i] = max(
            float(np.linalg.norm(state.position(f) - p))
            for f, p in zip((frames.left, frames.right), soles, strict=True)
        )
        q, v = tick.advance()
        if anchored:
            q = _anchor(robot, q, frames.left, soles[0], rotation_0)
    trace.q[:] = q
    return trace


def _anchor(robot: Robot, q: Vec, frame: str, position: Vec, rotation: Mat) -> Vec:
    """Move the base, with fixed joints, so that a frame has this pose."""
    state = robot.state(q)
    turn = rotation @ state.rotation(frame).T
    moved = q.copy()
    moved[:3] = position + turn @ (q[:3] - state.position(frame))
    moved[3:7] = quaternion_of(turn @ rotation_of(q[3:7]))
    return moved


def response(trace: Trace) -> tuple[float, float]:
    """Amplitude ratio and lag [s] of the CoG's side to side motion in its last period."""
    last = trace.t >= trace.t[-1] - COG_PERIOD + 1e-9
    w = 2.0 * np.pi / COG_PERIOD
    wave = np.exp(-1j * w * trace.t[last])
    actual = np.mean((trace.com[last, 1] - trace.com_target[0, 1]) * wave)
    wanted = np.mean((trace.com_target[last, 1] - trace.com_target[0, 1]) * wave)
    ratio = actual / wanted
    return float(abs(ratio)), float(-np.angle(ratio) / w)

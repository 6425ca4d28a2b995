"""The last pass: joints no quicker than a person's, with feet and hands where those joints have them."""

from __future__ import annotations

from typing import Any

import numpy as np

from hqp.arrays import Mat
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot
from hqp.tasks import Orientation

from .clip import EDGE, low_pass
from .holds import turns
from .joints import SIDES
from .tracker import Pass, Tracker

LIVELY = 6.0
"""Cutoff for joints, base, hands and moving feet [Hz]; it contains nearly all motion of a walking person (Winter
2009)."""


def smoothed(tracker: Tracker, found: Pass) -> Pass:
    """Track a pass once more, its configurations low-passed at ``LIVELY``.

    Strict levels can change within a frame if a limb is nearly straight, a limit is met or a foot comes down. Filtered
    joints alone would let feet slide and links meet: limits, standing feet, then moving feet and hands come before
    them.
    """
    if len(found.q) <= EDGE:
        return found
    return tracker.run(found.q[0], np.zeros(tracker.robot.nv), 0, len(found.q) - 1, Course(tracker, found.q))


class Course:
    """References of a last pass: places of hands, toes and heels, the pelvis and the joints, with their rates.

    q ``(T, nq)``: the pass before.  own: true to leave hands and feet to the person.
    """

    carries = False
    """True for the stack of a planned CoM."""

    def __init__(self, tracker: Tracker, q: Mat, *turning: Orientation, own: bool = False) -> None:
        robot, stacks, fps = tracker.robot, tracker.stacks, tracker.targets.fps
        self.first = q[0]
        points = [task for _, task in stacks.edges] + [stacks.points[f"{side}_hand"] for side in SIDES]
        points = [] if own else points
        places = {task.name: np.empty((len(q), 3)) for task in points}
        axes = {task.name: np.empty((len(q), 3, 3)) for task in turning}
        base = np.empty((len(q), 4, 4))
        self._heights = {side: np.empty((len(q), 2)) for side in SIDES}
        for i, at in enumerate(q):
            state = robot.state(at)
            for side, heights in self._heights.items():
                heights[i] = [stacks.down(side, end).value(state)[2] for end in (1, -1)]
        calm = filtered(robot, q, fps)
        for i, at in enumerate(calm):
            state = robot.state(at)
            base[i] = stacks.base.value(state)
            for task in points:
                places[task.name][i] = task.value(state)
            for turned in turning:
                axes[turned.name][i] = state.rotation(turned.frame)
        twists: Any = np.hstack((np.diff(base[:, :3, 3], axis=0), turns(base[:, :3, :3])))
        self._motion: dict[str, tuple[Any, Any]] = {name: (x, fps * np.diff(x, axis=0)) for name, x in places.items()}
        self._motion |= {name: (R, fps * turns(R)) for name, R in axes.items()}
        self._motion[stacks.base.name] = base, fps * twists
        self._follow_joints(tracker, calm)

    def _follow_joints(self, tracker: Tracker, calm: Mat) -> None:
        """Take the joints of low-passed configurations ``(T, nq)``."""
        robot, joints = tracker.robot, tracker.stacks.joints
        angles: Any = np.unwrap(np.array([joints.value(robot.state(at)) for at in calm]), axis=0)
        self._motion[joints.name] = angles, tracker.targets.fps * np.diff(angles, axis=0)

    def heights(self, side: str, i: int) -> tuple[float, float]:
        """Offsets of toe and heel, in frame i of the pass before [m]."""
        toe, heel = self._heights[side][i].tolist()
        return toe, heel

    def references(self, i: int) -> dict[str, Reference]:
        """By name, of frame i, with the rates that lead to the next."""
        return {name: Reference(name, x[i], u[i]) for name, (x, u) in self._motion.items()}


def filtered(robot: Robot, q: Mat, fps: float) -> Mat:
    """Configurations ``(T, nq)`` below ``LIVELY``."""
    signs = np.cumprod(np.concatenate(([1.0], np.where(np.sum(q[1:, 3:7] * q[:-1, 3:7], axis=1) < 0.0, -1.0, 1.0))))
    turned = low_pass(q[:, 3:7] * signs[:, None], LIVELY, fps)
    angles: Any = np.unwrap(np.array([robot.state(at).angles for at in q]), axis=0)
    angles = low_pass(angles, LIVELY, fps)
    found = np.array([robot.configuration(each) for each in angles])
    found[:, :3] = low_pass(q[:, :3], LIVELY, fps)
    found[:, 3:7] = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    return found

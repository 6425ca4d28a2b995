"""Motion of shapes in a collision scene: rates of distances by the world's motion, and their drift."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import Mat, Vec, cross
from hqp.declare.robot import State

from .collision_rows import Near

if TYPE_CHECKING:
    from .collision_scene import Scene

STEP = 1e-5
"""Time by which bodies are moved to find how the rate of a distance changes [s]."""
JUMP, TURN = 0.01, 0.9
"""A nearest point that moves farther in that time [m], or normals of a smaller product, have jumped."""
FORESIGHT = 3.0
"""A pair beyond the influence has a row if it closes at more than its largest speed over this."""
SLIDE = 2.0
"""Times the acceleration with which a way out sets in: the most that sliding along capsules side by side adds."""


class Motions:
    """Velocities of a scene's shapes and their rates at zero acceleration, ``(6,)`` at the world's origin.

    poses ``(n, 6, 4)`` of the world's shapes, with their velocities.
    """

    def __init__(self, state: State, own: Scene, poses: Mat) -> None:
        robot, bodies = state.robot, state.robot.bodies
        self._own, self._poses = own, poses
        v = moving(state)
        velocity, rate = np.zeros((2, len(bodies), 6))
        for i, (parent, first, count, *_) in enumerate(bodies[1:], start=1):
            moved = robot.joint_twists[:, first : first + count] @ v[first : first + count]
            velocity[i] = V = velocity[parent] + moved
            turn = np.concatenate((cross(V[3:], moved[:3]) + cross(V[:3], moved[3:]), cross(V[3:], moved[3:])))
            rate[i] = rate[parent] + turn
        places = [own.body(k) for k in range(own.links)]
        still = np.zeros(3)
        self._velocity = [velocity[b] for b in places]
        self._rate = [rate[b] for b in places]
        for pose in poses:
            origin, u, omega = pose[:3, 3], pose[4, :3], pose[5, :3]
            self._velocity.append(np.concatenate((u - cross(omega, origin), omega)))
            self._rate.append(np.concatenate((-cross(omega, u), still)))

    def speed(self, row: int, normal: Vec, point: Vec) -> float:
        """Rate of the distance of a row with this normal and nearest point [m/s]."""
        one, two = self._own.pair(row)
        return float(normal @ _at(self._velocity[two] - self._velocity[one], point))

    def fastest(self, k: int, centre: Vec, size: float) -> float:
        """Largest speed of the points of a link's capsule with this centre and half length [m/s]."""
        V = self._velocity[k]
        return float(np.linalg.norm(_at(V, centre)) + size * np.linalg.norm(V[3:]))

    def carried(self, found: Near) -> float:
        """Rate of a pair's distance by the motion of the world [m/s]."""
        two = self._own.pair(found.pair)[1]
        return 0.0 if two < self._own.links else float(found.normal @ _at(self._velocity[two], found.point))

    def drift(self, found: Near) -> float:
        """Change of the rate of a pair's distance at zero acceleration [m/s^2], by differences over 2 STEP.

        The feature of a hull is the one that is nearest now.  If the nearest point or the normal jumps in between, use
        the drift of the points that are nearest now.
        """
        sliding = self._sliding(found)
        return self._held(found) if sliding is None else sliding

    def _sliding(self, found: Near) -> float | None:
        """The drift with a nearest point that slides, None where it jumps."""
        one, two = self._own.pair(found.pair)
        ends, feature = [], self._own.feature(found.pair)
        for h in (STEP, -STEP):
            moved = [self._moved(k, h) if k < self._own.links else None for k in (one, two)]
            _, normal, point = self._own.measure(found.pair, self._world(h), *moved, feature=feature)
            twist = self._velocity[two] - self._velocity[one] + h * (self._rate[two] - self._rate[one])
            ends.append((normal, point, float(normal @ _at(twist, point))))
        (n, p, fast), (m, q, slow) = ends
        if float((p - q) @ (p - q)) <= JUMP * JUMP and float(n @ m) >= TURN:
            return (fast - slow) / (2.0 * STEP)
        return None

    def counted(self, found: Near, outset: float) -> float:
        """The drift that a row counts with; for capsules side by side

            e + clip(d - e, 2 w SLIDE outset (1 / beside - 1)),

        d and e the drifts of the pair and of the nearest end, w the way of the nearest points from that end over the
        length of its axis, beside the share of the rows of the ends.  The nearest point may slide from end to end in
        one tick; the ends have rows of their own, which see it.  At an end the drift is its row's, so that it does not
        jump as the point leaves the end.
        """
        if found.beside == 0.0:
            return self.drift(found)
        end, way = self._own.nearest_end(found.pair, self._world(0.0))
        drift, most = self._sliding(found), 2.0 * way * SLIDE * outset * (1.0 / found.beside - 1.0)
        at_end = self._sliding(found._replace(pair=end))
        at_end = self._held(found) if at_end is None else at_end
        return at_end if drift is None else at_end + min(max(drift - at_end, -most), most)

    def _held(self, found: Near) -> float:
        one, two = self._own.pair(found.pair)
        apart = self._point_drift(two, found.point) - self._point_drift(one, found.point)
        return float(found.normal @ apart)

    def _point_drift(self, k: int, p: Vec) -> Vec:
        V, A = self._velocity[k], self._rate[k]
        return np.asarray(_at(A, p) + cross(V[3:], _at(V, p)))

    def _moved(self, k: int, h: float) -> tuple[Vec, Vec]:
        V, (a, b) = self._velocity[k], self._own.placed(k)
        if self._own.is_hull(k):  # position and rotation
            return a + h * _at(V, a), b + h * cross(V[3:], b.T).T
        return a + h * _at(V, a), b + h * _at(V, b)

    def _world(self, h: float) -> Mat:
        """The world's shapes a time h later."""
        poses = self._poses.copy()
        for pose in poses:
            pose[:3, 3] += h * pose[4, :3]
            pose[:3, :3] += h * cross(pose[5, :3], pose[:3, :3].T).T
        return poses


def moving(state: State) -> Vec:
    """Velocity that bounds stand around: sent last at velocity level, measured at others ``(nv,)``."""
    return state.v if state.commanded is None else state.commanded


def _at(twist: Vec, p: Vec) -> Vec:
    """Velocity of a body's point."""
    return np.asarray(twist[:3] + cross(twist[3:], p))

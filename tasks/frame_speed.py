"""Limits of a frame's speed: Euclidean norms of its velocity and angular velocity, as rows along many directions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np

from hqp.arrays import Mat, Vec, cross
from hqp.declare import plans
from hqp.declare.element import Inequality
from hqp.declare.robot import Robot, State

from .fields import check_frame, set_number
from .twists import twist_derivatives

INNER = 0.98
"""Distance of the polytope's faces from zero over the limit; its corners then lie at 0.998 of the limit."""


@cache
def directions() -> Mat:
    """Unit vectors ``(81, 3)`` of which, with their opposites, one is within 10.8 degrees of any vector.

    Faces of an icosahedron, each edge divided by four, projected onto the sphere.
    """
    golden = (1.0 + math.sqrt(5.0)) / 2.0
    corners = np.array([np.roll((0.0, a, b * golden), k) for k in range(3) for a in (1, -1) for b in (1, -1)])
    near = np.isclose(np.linalg.norm(corners[:, None] - corners[None], axis=-1), 2.0)
    found: dict[tuple[float, ...], Vec] = {}
    for i, j, k in combinations(range(12), 3):
        if near[i, j] and near[j, k] and near[i, k]:
            for a in range(5):
                for b in range(5 - a):
                    point = a * corners[i] + b * corners[j] + (4 - a - b) * corners[k]
                    unit = point / np.linalg.norm(point)
                    key = tuple((np.round(unit, 9) + 0.0).tolist())
                    if key > (0.0, 0.0, 0.0):  # its opposite has the same row
                        found[key] = unit
    return np.array([found[key] for key in sorted(found)])


@dataclass(frozen=True, kw_only=True)
class FrameVelocityLimits(Inequality):
    """Speed of a frame in the world: |v| <= linear [m/s] and |omega| <= angular [rad/s], Euclidean norms.

    The ball is replaced by a polytope inside it, fixed in the frame's axes, with unit normals n_i and R the rotation:

        |n_i . R^T v| <= b,    b = 0.98 linear,    162 faces;    corners at 0.998 linear,

    so that no direction loses more than 2 %, and as much for omega.  With s_i = n_i . R^T v of the present, at velocity
    level that of the command sent last, J_i = n_i . R^T J, d_i = dJ_i/dt v, and k the rate, at most 1/dt,

        J_i x <= k (b - s_i) - d_i    for accelerations,
        J_i x + dt/2 d_i <= b + (1 - k dt) max(s_i - dt/2 d_i - b, 0)    for velocities: means over the tick.

    frame: a frame of the robot.  linear, angular: infinite for no limit, one of them finite.  rate [1/s]: k, at which
    an excess decays and, for accelerations, at which a speed nears its limit.  Raises DeclarationError for fields,
    FrameNotFound on binding.
    """

    frame: str
    linear: float = 0.25
    angular: float = math.inf
    rate: float = 20.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_frame(self, "frame", self.frame)
        for name in ("linear", "angular"):
            set_number(self, name, 0.0, strict=True, infinite=True)
        if self.linear == self.angular == math.inf:
            raise self.invalid("limits", (self.linear, self.angular), "a finite linear [m/s] or angular [rad/s]")
        set_number(self, "rate", 0.0, strict=True)

    def _limits(self) -> list[tuple[slice, float]]:
        """Part of a twist and its limit, for each that is finite."""
        both = (slice(0, 3), self.linear), (slice(3, 6), self.angular)
        return [(part, limit) for part, limit in both if limit < math.inf]

    def rows(self, robot: Robot) -> int:
        """81 for each finite limit; raises FrameNotFound."""
        robot.frame(self.frame)
        return len(directions()) * len(self._limits())

    def jacobian(self, state: State) -> Mat:
        """n_i^T R^T J ``(m, nv)``, m = 81 or 162."""
        J, normals = state.jacobian(self.frame), directions() @ state.rotation(self.frame).T
        return np.concatenate([normals @ J[part] for part, _ in self._limits()])

    def drift(self, state: State) -> Vec:
        """n_i^T d(R^T J)/dt v ``(m,)`` [m/s^2], of omega [rad/s^2]."""
        return self._drift(state, state.v)

    def _drift(self, state: State, v: Vec) -> Vec:
        """The drift at a velocity v ``(nv,)``: drift of the body's motion; R turns with it."""
        own = plans.frame(state.robot, self.frame)
        linear, angular = twist_derivatives(state, v)[1][own.body].reshape(2, 3)
        drift = np.concatenate((linear + cross(angular, state.position(self.frame)), angular))
        normals = directions() @ state.rotation(self.frame).T
        return np.concatenate([normals @ drift[part] for part, _ in self._limits()])

    def bounds(self, state: State) -> tuple[float, float]:
        """No bounds on where the frame is."""
        return -math.inf, math.inf

    def step_bounds(self, state: State, dt: float, order: int) -> tuple[Vec, Vec]:
        """(lower, upper) ``(m,)`` of the velocity along the normals, or of the part of its rate that J x adds."""
        v = state.v if order == 2 or state.commanded is None else state.commanded
        speed, share = self.jacobian(state) @ v, min(1.0, self.rate * dt)
        most = np.repeat([INNER * limit for _, limit in self._limits()], len(directions()))
        drift = self._drift(state, v)
        if order == 1:
            turn = 0.5 * dt * drift  # from a configuration to the mean over the tick before it or after it
            mean = speed - turn
            over = np.sign(mean) * (1.0 - share) * np.maximum(np.abs(mean) - most, 0.0)
            return np.minimum(over, 0.0) - most - turn, np.maximum(over, 0.0) + most - turn
        return share / dt * (-most - speed) - drift, share / dt * (most - speed) - drift

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """Speed or turn, and the direction in the frame's axes."""
        names = {0: "speed", 3: "turn"}
        return tuple(
            f"{names[part.start]} along ({', '.join(f'{x:.2f}' for x in n + 0.0)})"
            for part, _ in self._limits()
            for n in directions()
        )

    def plan(self, robot: Robot) -> plans.FrameSpeed:
        """The native operation."""
        normals = tuple(map(tuple, directions().tolist()))
        return plans.FrameSpeed(
            plans.frame(robot, self.frame), normals, INNER * self.linear, INNER * self.angular, self.rate
        )

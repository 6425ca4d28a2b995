"""Collision avoidance: links of the robot kept apart from each other and from shapes of the world."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from hqp import shapes
from hqp.arrays import Mat, Vec, cross
from hqp.declare import plans
from hqp.declare.element import Inequality
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.numbers import whole

from . import collision_world
from .collision_motion import FORESIGHT, STEP, Motions, moving
from .collision_rows import Near
from .collision_scene import scene
from .fields import set_names, set_number

HELD = 0.5
"""Share of the rate at which pairs inside are let go while a deeper one comes out."""


@dataclass(frozen=True, kw_only=True)
class CollisionAvoidance(Inequality):
    """Distances d of pairs of shapes kept at a clearance: with h = d - clearance, each row is J v >= -a(h),

        a^2 / 2 = integral of D from 0 to h,    D(h) = rate^2 h + (braking - rate^2 L) (h / L)^3, braking beyond L,
        L = min(influence - clearance, braking / rate^2)    outside,    a(h) = -b(h)  inside,

    J v = n. (v_b - v_a) at the nearest points, n from a to b.  On a(h) a pair slows down by D, at most ``braking``, and
    near the clearance at the rate: a = rate h.  Inside, a pair alone comes out at b = min(rate |h|,
    recovery).  Several may exclude each other: among those with a common body or shape the deepest, at H, comes out so,
    at b(H), and the others at b(h) = b(H) - rate (h - H) / 2, not above rate |h| nor below -rate |h|.  For
    accelerations, J a >= -approach (a(h) + J v) - a'(h) J v - dJ/dt v with the rate at which the nearest points slide
    (capsules side by side slide from end to end at once: this counts with a bound).  Pairs have
    a row within the influence, and beyond it if they close at more than a(h) / 3, so that rows of fast links come in
    without a jump.  d is between the robot's capsules (``robot.capsules``, of moving links) and
    those of its other links, or the shapes of ``world``, such as a fixed base.

    ``at`` moves shapes of the world: with w the rate of the distance by that, each row is J v >= -a(h) - w.

    pairs: ``"auto"``, all links that may touch by accident (``may_touch``), without those that the SRDF of the robot's
    URDF disables; or pairs of names, each a link, a joint group or a shape of the world; or the path of
    another SRDF; ``"world"``, links against the world only.  joints: these or groups must carry a link of each pair;
    None for all pairs.  world: shapes of ``hqp.shapes``, which ``at`` moves.
    clearance [m]: for two links at most 0.8 of their distance at home, and less for those of "auto" that pass each
    other more closely by design (``may_touch``).  If capsules fitted to two links overlap there,
    the convex hulls of the shapes of one of them take their place; if these overlap too, capsules of "auto" may overlap
    by 1 mm more than at home, and names of links that all overlap are refused.  influence [m]: largest d at which a
    slow pair has a row, above the clearance.  rate [1/s].  braking [m/s^2]: deceleration of a distance that links can
    provide.  recovery [m/s]: fastest way out of a collision.  acceleration [m/s^2]: with which it sets in, rate *
    recovery by default.  approach [1/s]: rate at which accelerations lead to a(h), 4 rate by default.  slots: rows, the
    most pairs that are near at once (a pair keeps its row while it is near, and those with the least h less braking
    distance have one); by default 64 more than at home.
    Capsules side by side have rows for their ends as well, which fade out from 10 to 20 degrees.  In ``subject_to``
    rows stand below contacts and joint limits, so that a pair that cannot be kept apart does not cost the feet; in
    a level they are kept if its priority allows.  Raises DeclarationError for fields and for pairs that name
    nothing, ModelError for a robot without shapes.
    """

    steered: ClassVar[bool] = True

    pairs: Any = "auto"
    joints: str | Sequence[str] | None = None
    world: tuple[shapes.Shape, ...] = ()
    clearance: float = 0.01
    influence: float = 0.1
    rate: float = 5.0
    braking: float = 10.0
    recovery: float = 0.1
    acceleration: float | None = None
    approach: float | None = None
    slots: int = 0

    def __post_init__(self) -> None:
        if isinstance(self.world, shapes.Shape):
            object.__setattr__(self, "world", (self.world,))
        if not isinstance(self.world, (tuple, list)):
            raise self.invalid("world", self.world, "a tuple of shapes of hqp.shapes")
        object.__setattr__(self, "world", tuple(shapes.checked(s) for s in self.world))
        if not isinstance(self.pairs, str):
            object.__setattr__(self, "pairs", self._checked_pairs())
        set_names(self, "joints")
        super().__post_init__()
        names = [s.name for s in self.world]
        if len(set(names)) < len(names):
            raise self.invalid("world", names, "shapes with distinct names")
        for what in ("clearance", "rate", "braking", "recovery"):
            set_number(self, what, 0.0, strict=what != "clearance")
        set_number(self, "influence", self.clearance, strict=True)
        if self.acceleration is not None:
            set_number(self, "acceleration", 0.0, strict=True, infinite=True)
        if self.approach is not None:
            set_number(self, "approach", 0.0, strict=True)
        object.__setattr__(self, "slots", whole(self.owner, "slots", self.slots, 0))

    def _checked_pairs(self) -> tuple[tuple[str, str], ...]:
        try:
            pairs = tuple((str(one), str(two)) for one, two in self.pairs)
        except (TypeError, ValueError, OverflowError):
            pairs = ()
        if not pairs:
            raise self.invalid(
                "pairs", self.pairs, '"auto", "world", the path of an SRDF, or (("link", "other link"), ...)'
            )
        return pairs

    def default_name(self) -> str:
        """collision."""
        return "collision"

    def rows(self, robot: Robot) -> int:
        """Number of slots; raises DeclarationError, ModelError."""
        return len(scene(self, robot).slots)

    def remark(self, robot: Robot) -> str:
        """Pairs whose capsules overlap at home, links that may touch without a row, and links that pass closely."""
        own, texts = scene(self, robot), []
        if own.overlapping:
            pairs = ", ".join(own.overlapping)
            texts.append(f"capsules of {robot.name} overlap at home, kept as far apart as there: {pairs}")
        if own.unseparated:
            pairs = ", ".join(own.unseparated)
            texts.append(f"links of {robot.name} may touch, since no fitted shapes keep them apart: {pairs}")
        if own.lowered:
            pairs = ", ".join(own.lowered)
            least = f"keep less than {self.clearance:g} m"
            texts.append(f"links of {robot.name} that pass each other closely {least}: {pairs}")
        return f"{self.name}: {'; '.join(texts)}" if texts else ""

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The pairs that have the rows now, such as "left_elbow - torso"; "free" for a slot without one."""
        return scene(self, robot).row_names()

    def poses(self, value: Mat | None = None) -> Mat:
        """The world's shapes ``(n, 6, 4)``, declared at rest, or as given."""
        return collision_world.poses(self.world, value)

    def hold(self, state: State) -> Reference:
        """The world as it was declared."""
        return Reference(self.name, self.poses())

    def at(self, poses: Mapping[str, Any], velocity: Mapping[str, Any] | None = None) -> Reference:
        """Shapes of the world at poses ``(4, 4)`` or positions ``(3,)`` [m], by name; the others as declared.

        velocity: velocity of moving shapes, ``(3,)`` of the origin [m/s], or ``(6,)`` with the angular velocity
        [rad/s], world axes; it does not change within the tick.  Raises DeclarationError for an unknown name or an
        invalid pose or velocity.
        """
        return Reference(
            self.name, collision_world.moved(self, self.world, poses, {} if velocity is None else velocity)
        )

    def near(self, state: State, value: Mat | None = None) -> list[Near | None]:
        """Content of each slot: its pair or end, distance, normal and nearest point; None for a free slot."""
        return scene(self, state.robot).update(state, self.poses(value))

    def distance(self, state: State, value: Mat | None = None) -> Vec:
        """Distances ``(m,)`` [m] of the pairs in the slots, infinite in a free one."""
        return np.array([math.inf if n is None else n.distance for n in self.near(state, value)])

    def jacobian(self, state: State, value: Mat | None = None) -> Mat:
        """n . (J_b - J_a) at the nearest points, ``(m, nv)``, zero in a free slot."""
        near, J = self.near(state, value), np.zeros((self.rows(state.robot), state.robot.nv))
        own = scene(self, state.robot)
        for row, found in zip(J, near, strict=True):
            if found is not None:
                wrench = np.concatenate((found.normal, cross(found.point, found.normal)))
                row[:] = own.difference(found.pair) * (wrench @ state.robot.joint_twists)
        return J

    def drift(self, state: State, value: Mat | None = None) -> Vec:
        """dJ/dt v ``(m,)``: change of each distance rate at zero acceleration, nearest points sliding."""
        motions, drift = self._motions(state, value), np.zeros(self.rows(state.robot))
        for i, found in enumerate(self.near(state, value)):
            if found is not None:
                drift[i] = motions.drift(found)
        return drift

    def carried(self, state: State, value: Mat | None = None) -> Vec:
        """Rates of the distances ``(m,)`` [m/s] by the motion of the world's shapes."""
        motions, near = self._motions(state, value), self.near(state, value)
        return np.array([0.0 if found is None else motions.carried(found) for found in near])

    def _motions(self, state: State, value: Mat | None) -> Motions:
        return Motions(state, scene(self, state.robot), self.poses(value))

    @property
    def outset(self) -> float:
        """The acceleration with which a way out sets in [m/s^2]."""
        return self.rate * self.recovery if self.acceleration is None else self.acceleration

    @property
    def fast(self) -> float:
        """The rate at which accelerations lead to a(h) [1/s]."""
        return 4.0 * self.rate if self.approach is None else self.approach

    def least_rate(self, found: Near, speed: float, dt: float) -> float:
        """-a(h) of one pair: the least rate of its distance [m/s], which changes at ``speed`` now."""
        h = found.distance - found.clearance
        if h < 0.0:
            most = speed + dt * self.outset + min(1.0, dt * (self.fast + self.rate)) * max(-speed, 0.0)
            return min(self._back(found)[0], most) - self._loose(found)
        return -self.closing(h)[0] - self._loose(found)

    def closing(self, h: float) -> tuple[float, float]:
        """a(h) [m/s] and its slope [1/s], for h >= 0."""
        L, curvature = self.curve()
        within = min(h, L)
        root = math.sqrt(self.rate**2 + curvature * within**2)
        if h < L:
            return h * root, (self.rate**2 + 2.0 * curvature * h * h) / root
        speed = math.sqrt((L * root) ** 2 + 2.0 * self.braking * (h - L))
        return speed, self.braking / speed

    def curve(self) -> tuple[float, float]:
        """L [m] and (braking - rate^2 L) / (2 L^3) [1/(m s)^2], so that a(h)^2 = h^2 (rate^2 + this h^2) up to L."""
        L = min(self.influence - self.clearance, self.braking / self.rate**2)
        return L, (self.braking - self.rate**2 * L) / (2.0 * L**3)

    def counts(self, distance: float, clearance: float, speed: float) -> bool:
        """Return true if a pair has a row whose distance changes at this speed [m/s]."""
        return distance < self.influence or FORESIGHT * -speed > self.closing(max(distance - clearance, 0.0))[0]

    def _back(self, found: Near) -> tuple[float, float]:
        """The speed [m/s] with which one pair comes out, and that of the deepest pair it shares something with."""
        h, H = found.distance - found.clearance, found.deepest
        most = min(-self.rate * H, self.recovery)
        return min(-self.rate * h, max(self.rate * h, most - HELD * self.rate * (h - H))), most

    def _loose(self, found: Near) -> float:
        """Offset of the bound of a fading row below that of a full row [m/s]."""
        return self.rate * self.influence * (1.0 / found.fade - 1.0)

    def least_acceleration(self, found: Near, speed: float) -> float:
        """The least acceleration of one pair's distance [m/s^2], before the drift."""
        h, fast = found.distance - found.clearance, self.fast
        if h < 0.0:
            back, deepest = self._back(found)
            least = fast * (back - speed) - self.rate * (speed - (deepest if deepest >= self.recovery else 0.0))
            return min(least, self.outset + (fast + self.rate) * max(-speed, 0.0)) - fast * self._loose(found)
        most, slope = self.closing(h)
        return -slope * speed - fast * (most + speed + self._loose(found))

    def bounds(self, state: State, value: Mat | None = None) -> tuple[Vec, float]:
        """(clearance - d, inf): remaining decrease of each distance ``(m,)`` [m], -inf in a free slot."""
        near = self.near(state, value)
        return np.array([-math.inf if n is None else n.clearance - n.distance for n in near]), math.inf

    def step_bounds(self, state: State, dt: float, order: int, value: Mat | None = None) -> tuple[Vec, Vec]:
        """(lower, upper) ``(m,)`` of J x; upper is infinite."""
        near, carried = self.near(state, value), self.carried(state, value)
        v = moving(state)
        speeds = self.jacobian(state, value) @ v + carried
        if order == 1:
            least = [-math.inf if n is None else self.least_rate(n, u, dt) for n, u in zip(near, speeds, strict=True)]
            lower = np.array(least) - carried
        else:
            least = [
                -math.inf if n is None else self.least_acceleration(n, u) for n, u in zip(near, speeds, strict=True)
            ]
            motions = self._motions(state, value)
            drift = [0.0 if n is None else motions.counted(n, self.outset) for n in near]
            lower = np.array(least) - np.array(drift)
        return lower, np.full(lower.size, math.inf)

    def plan(self, robot: Robot) -> plans.Collision | None:
        """The native operation; none where the world has meshes, whose distances are coal's."""
        if any(shape.is_mesh for shape in self.world):
            return None
        own = scene(self, robot)
        shape = (len(self.world), 6, 4) if self.world else ()
        rates = self.rate, self.braking, self.recovery, self.outset, self.fast
        return plans.Collision(*own.tables(), own.slots, self.influence, *self.curve(), *rates, FORESIGHT, STEP, shape)

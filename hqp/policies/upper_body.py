"""Arms above legs that another controller moves: limits, self-collision, centre of mass, hands, trunk, posture."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Index, Mat, Vec, cross
from hqp.declare.element import Element
from hqp.declare.law import PD, P
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.declare.stack import Level, Stack
from hqp.errors import DeclarationError
from hqp.estimation import RateObserver
from hqp.loop.controller import Controller
from hqp.loop.session import Session, Tick
from hqp.numbers import set_numbers
from hqp.policies.acceleration import Acceleration
from hqp.policies.servo import Gains, Servos
from hqp.programs.formulation import Velocity
from hqp.robots.soles import sole
from hqp.tasks import (
    CollisionAvoidance,
    Com,
    JointLimits,
    JointLoad,
    Orientation,
    Payload,
    Pose,
    Position,
    Posture,
    PrescribedMotion,
    SupportPolygon,
    TorqueLimits,
    Within,
)
from hqp.tasks.collision_pairs import candidates
from hqp.tasks.pose import homogeneous
from hqp.tasks.relative import View
from hqp.torque import Torque
from hqp.torque.joint_friction import JointFriction

Output = Literal["positions", "velocities", "torques"]


@dataclass(frozen=True, kw_only=True)
class UpperBody:
    """Control all joints but ``legs``, with legs and base as measured (``PrescribedMotion``):

        limits, self-collision > centre of mass over the soles > near its place over the base
            > places of the hands > their orientations > trunk > posture.

    legs: joints or groups of the other controller.  hands: frames with a Pose each, the robot's palms for None.
    trunk: frame with a fixed orientation, or "".  reach [m]: largest distance of the centre of mass from its place at
    the first tick, or from ``balance.at``, along x and y of the base's heading; inf without a bound.  margin [m]: of
    the centre of mass within the hull of the soles on the ground, as measured in each tick (``SupportPolygon``); None
    without that bound.  soles: their frames, the robot's for None.
    clearance, influence [m]: distances of the arms' links from all others.  output: "velocities" are commands of
    ``Velocity``, integrated from the first measured posture, for velocity and position servos; "torques" are commands
    of ``Torque`` on measured joints; "positions" are targets of servos with kp [N m/rad] and kd [N m s/rad], whose
    torque is that of ``Torque``, so that limits and distances hold for the joints.  speed: largest of the hands [m/s].
    joint_speed: largest of the joints [rad/s], at most their limits.
    With torques base and legs keep their acceleration, by ``Acceleration`` unless a reference of ``legs`` has one, and
    the friction that the robot's file has in its joints is overcome (``JointFriction``); with a bandwidth
    [1/s] noise of measured rates above it does not reach the torques (``estimation.RateObserver``).
    Payloads: ``step`` takes the mass in each hand.  Raises DeclarationError for fields.
    """

    legs: str | Sequence[str]
    hands: Sequence[str] | None = None
    trunk: str = ""
    reach: float = 0.05
    margin: float | None = None
    soles: Sequence[str] | None = None
    clearance: float = 0.02
    influence: float = 0.12
    speed: float = 1.5
    joint_speed: float | None = None
    output: Output = "positions"
    kp: Gains | None = None
    kd: Gains | None = None
    bandwidth: float = math.inf

    def __post_init__(self) -> None:
        if self.output not in ("positions", "velocities", "torques"):
            raise DeclarationError(
                "UpperBody", "output", value=self.output, allowed='"positions", "velocities" or "torques"'
            )
        if self.output == "positions" and (self.kp is None or self.kd is None):
            raise DeclarationError("UpperBody", "kp and kd", value=(self.kp, self.kd), allowed="gains of the servos")
        set_numbers(self, "UpperBody", ("reach", "speed", "bandwidth"), 0.0, strict=True, infinite=True)
        if self.margin is not None:
            set_numbers(self, "UpperBody", ("margin",), 0.0)

    def feet(self, robot: Robot) -> dict[str, Mat]:
        """Corners of each sole in the axes of its frame ``(n, 3)`` [m]; raises DeclarationError without soles."""
        frames = tuple(self.soles) if self.soles is not None else tuple(robot.landmarks.get("soles", ()))
        if not frames:
            raise DeclarationError("UpperBody", "soles", value=self.soles, allowed="frames; the robot names no soles")
        return {f: np.pad(np.array(sole(robot, f)), ((0, 0), (0, 1))) for f in frames}

    def joints(self, robot: Robot) -> tuple[str, ...]:
        """The controlled joints; raises DeclarationError if none is left, JointNotFound."""
        legs = set(robot.joints(self.legs).tolist())
        found = tuple(robot.joint_name(int(c)) for c in robot.actuated if int(c) not in legs)
        if not found:
            raise DeclarationError("UpperBody", "legs", value=self.legs, allowed="fewer than all actuated joints")
        return found

    def controller(self, robot: Robot, *, deadline: float | None = None) -> Controller:
        """Its stack, whose hands have a Position above their Pose.

        Names: ``legs``, ``support``, ``balance``, ``place 0``, ``hand 0``, ..., ``trunk``, ``posture``, ``load 0``,
        ``friction``.
        """
        joints, torque = self.joints(robot), self.output != "velocities"
        columns = robot.joints(joints)
        frames = tuple(self.hands) if self.hands is not None else tuple(robot.landmarks.get("palms", ()))
        if not frames:
            raise DeclarationError("UpperBody", "hands", value=self.hands, allowed="frames; the robot names no palms")
        law = PD(400.0, 40.0, max_velocity=self.speed) if torque else P(12.0, max_velocity=self.speed)
        slow = PD(40.0, 13.0) if torque else P(3.0)
        levels: list[Level] = []
        if self.margin is not None:
            corners = polygon(robot.state(robot.home), self.feet(robot))
            hull = SupportPolygon(polygon=tuple(map(tuple, corners.tolist())), margin=self.margin, name="support")
            levels.append(Level(hull, name="support"))
        if math.isfinite(self.reach):
            com = Com(axes="xy", relative_to=_base(robot), heading=robot.floating)
            levels.append(Level(Within(com, lower=-self.reach, upper=self.reach, name="balance"), name="balance"))
        levels.append(
            Level(*(Position(frame=f, law=law, name=f"place {k}") for k, f in enumerate(frames)), name="places")
        )
        levels.append(Level(*(Pose(frame=f, law=law, name=f"hand {k}") for k, f in enumerate(frames)), name="hands"))
        if self.trunk:
            levels.append(Level(Orientation(frame=self.trunk, law=slow, name="trunk"), name="trunk"))
        levels.append(Level(Posture(joints=joints, law=slow, name="posture"), name="posture"))
        subject_to: list[Element] = [
            PrescribedMotion(joints=self.legs, name="legs"),
            JointLimits(joints=joints, speed=self.joint_speed),
            *((TorqueLimits(),) if torque else ()),
            *self._apart(robot, joints),
            *(Payload(frame=f, name=f"load {k}") for k, f in enumerate(frames)),
            *((JointLoad(joints=joints, name="friction"),) if torque and JointFriction.of(robot, columns) else ()),
        ]
        return Controller(
            Stack(*levels, subject_to=subject_to), Torque(holding=None) if torque else Velocity(), deadline=deadline
        )

    def _apart(self, robot: Robot, joints: tuple[str, ...]) -> tuple[CollisionAvoidance, ...]:
        """Distances from links that these joints move to all that they may touch."""
        every = CollisionAvoidance(joints=joints, clearance=self.clearance, influence=self.influence)
        return (every,) if candidates(every, robot, (), "auto", self.clearance, joints).pairs else ()

    def session(
        self, robot: Robot, dt: float, *, deadline: float | None = None, max_age: float | None = None
    ) -> UpperBodySession:
        """Compile for a robot at a control period dt [s]; max_age: see ``Controller.session``.

        Raises DeclarationError, ModelError before the loop.
        """
        session = self.controller(robot, deadline=deadline).session(robot, dt, max_age=max_age, stuck=False)
        return UpperBodySession(self, session)


def placed(hand: Reference) -> Reference:
    """Reference of the Position of a hand, from that of its Pose."""
    rate, change = (None if given is None else given[:3] for given in (hand.velocity, hand.acceleration))
    value = None if hand.value is None else np.asarray(hand.value)[:3, 3]
    return Reference(hand.name.replace("hand", "place"), value, rate, change, on=hand.on)


def polygon(state: State, feet: Mapping[str, Mat], standing: Collection[str] | None = None) -> Mat:
    """Corners of the standing feet in the world, of all for None ``(n, 2)`` [m]; some repeat for feet in the air."""
    down = feet if standing is None else [f for f in feet if f in standing]
    corners = np.concatenate([state.position(f) + feet[f] @ state.rotation(f).T for f in down])
    return np.resize(corners[:, :2], (sum(map(len, feet.values())), 2))


def _base(robot: Robot) -> str:
    """The base's frame: the robot's landmark, or the first frame of its first body."""
    own = [name for name in robot.frame_names if robot.body(robot.frame(name)) == (1 if robot.floating else 0)]
    return str((robot.landmarks.get("base") or own)[0])


@dataclass(frozen=True, eq=False)
class UpperBodyTick:
    """Commands of the controlled joints ``(k,)`` in the order of ``UpperBodySession.joints``.

    positions [rad]: targets of servos with the declared gains; without gains the joints one period later.  velocities
    [rad/s]: one period later.  torques [N m]: None for output "velocities".  tick: the stack's tick.
    """

    positions: Vec
    velocities: Vec
    torques: Vec | None
    tick: Tick


class UpperBodySession:
    """Arms of one robot; ``hands``, ``balance``, ``posture`` and ``trunk`` make references."""

    def __init__(self, declared: UpperBody, session: Session) -> None:
        self.declared, self.session, self.robot = declared, session, session.robot
        self.joints, self._base = declared.joints(self.robot), _base(self.robot)
        self.columns: Index = self.robot.joints(self.joints)
        """Tangent coordinates of ``joints``."""
        motors = self.robot.actuated.tolist()
        self._motors = [motors.index(c) for c in self.columns.tolist()]
        self._servos = None
        if declared.kp is not None and declared.kd is not None:
            self._servos = Servos.of("UpperBody", self.robot, self.columns, declared.kp, declared.kd, session.dt)
        stack = session.stack
        self.hands: tuple[Any, ...] = tuple(e for e in stack if isinstance(e, Pose))
        self._hands = {hand.name for hand in self.hands}
        self.loads: tuple[Any, ...] = tuple(e for e in stack if isinstance(e, Payload))
        self.balance, self.trunk, self.posture = (
            (stack.find(name) if name in stack else None) for name in ("balance", "trunk", "posture")
        )
        self.legs: Any = stack.find("legs")
        moved: Index = np.array(self.legs.selection(self.robot))
        self._acceleration, self._still = Acceleration(moved, session.dt), np.zeros(moved.size)
        self._support: Any = stack.find("support") if "support" in stack else None
        self._feet = {} if self._support is None else declared.feet(self.robot)
        self._friction = JointFriction.of(self.robot, self.columns)
        self._rubbing: Any = stack.find("friction") if "friction" in stack else None
        self._planned: Vec = np.zeros(self.columns.size)
        self._rates: RateObserver | None = None
        if declared.output != "velocities" and math.isfinite(declared.bandwidth):
            self._rates = RateObserver(self.robot, session.dt, bandwidth=declared.bandwidth)
        self._sent: tuple[Vec, Vec] | None = None
        self._home: Vec = self.robot.state(self.robot.home).angles[self.columns].copy()

    def step(
        self, state: State, *references: Reference, loads: Mapping[str, float] | Sequence[float] = (),
        standing: Collection[str] | None = None, now: float | None = None,
    ) -> UpperBodyTick:  # fmt: skip
        """One tick of a measured state, with references of its elements, such as ``follow.reference(state)``.

        loads: mass in each hand [kg], in order or by frame.  standing: frames of the soles on the ground, all for None;
        without any the centre of mass has no bound by the soles.  Without a valid state the joints sent last come to
        rest, and their torque holds them.  Raises DeclarationError for a frame that is no sole, otherwise as
        ``Session.step``.
        """
        support = self._supported(state, standing)
        carried = loads if isinstance(loads, Mapping) else dict(zip((e.frame for e in self.loads), loads, strict=False))
        places = [placed(r) for r in references if r.name in self._hands]
        given = [*references, *places, *support, *(e.at(carried[e.frame]) for e in self.loads if e.frame in carried)]
        torque = self.declared.output != "velocities"
        if not torque:
            state = self._commanded(state)
        else:
            state = self._observed(state)
            if all(r.name != "legs" for r in references):
                given.append(Reference("legs", self._still, None, self._acceleration.update(state)))
            given += self._rubbed(state)
        tick = self.session.step(state, *given, now=now)
        if tick.refused:
            angles, _ = self._last(state)
            v = np.zeros(angles.size) if torque else tick.x[self.columns]
            angles = angles + self.session.dt * v
        else:
            q, v = tick.advance()
            if self._rates is not None:
                self._rates.expect(v)
            angles, v = self.robot.state(q, v).angles[self.columns], v[self.columns]
        self._sent = (angles, v)
        planned = np.zeros(v.size) if tick.refused else (v - state.v[self.columns]) / self.session.dt
        self._planned = self._planned + min(self.session.dt / JointFriction.SOON, 1.0) * (planned - self._planned)
        if not torque:
            return UpperBodyTick(angles, v, None, tick)
        tau = tick.command[self._motors]
        servos = self._servos
        return UpperBodyTick(angles if servos is None else servos.target(tau, angles, v), v, tau, tick)

    def over_base(
        self,
        state: State,
        hand: Pose,
        place: ArrayLike,
        velocity: ArrayLike | None = None,
        base: ArrayLike | None = None,
    ) -> Reference:
        """Reference of one of ``hands`` for a place that base and heading carry:

            p = p_b + R p_place,  v = R (v_b + omega_b x p_place + v_place),  omega = R (omega_b + omega_place).

        R: axes of the base's heading.  place: homogeneous matrix ``(4, 4)`` in these axes, from the base's origin.
        velocity ``(6,)``: [v_place; omega_place] in these axes [m/s, rad/s], zero for None.  base ``(6,)``:
        [v_b; omega_b] in these axes, zero for None.  Take the velocity that the controller of the base plans, such as
        the command of a walk: the measured one lets hands add to every sway.  An invalid state keeps the hold value.
        """
        if not state.valid:
            return Reference(hand.name)
        view = View(state, self._base, heading=self.robot.floating)
        rate, T = np.zeros(6) if velocity is None else np.array(velocity, float), np.asarray(place, float)
        if base is not None:
            moved = np.asarray(base, float)
            rate += np.concatenate((moved[:3] + cross(moved[3:], T[:3, 3]), moved[3:]))
        goal = homogeneous(view.origin + view.rotation @ T[:3, 3], view.rotation @ T[:3, :3])
        return hand.at(goal, velocity=(rate.reshape(2, 3) @ view.rotation.T).ravel())

    def _supported(self, state: State, standing: Collection[str] | None) -> list[Reference]:
        """Reference of the support polygon."""
        unknown = sorted(set(standing or ()) - self._feet.keys())
        if unknown:
            raise DeclarationError("UpperBody", "standing", value=unknown, allowed=", ".join(self._feet) or "no soles")
        if self._support is None or not state.valid:
            return []
        if standing is not None and not standing:
            return [self._support.off()]
        return [self._support.at(polygon(state, self._feet, standing))]

    def _observed(self, state: State) -> State:
        """The state with rates of joints without their noise."""
        if self._rates is None or not state.valid:
            return state
        return self.robot.state(state.q, self._rates.correct(state.v), time=state.time)

    def _rubbed(self, state: State) -> list[Reference]:
        """Reference of the friction that the torques overcome, at the rates that the last tick planned."""
        if self._rubbing is None or not state.valid:
            return []
        return [self._rubbing.at(-self._friction.torque(state.v[self.columns], self._planned))]

    def _commanded(self, state: State) -> State:
        """The measured state with the controlled joints as last commanded; at first as measured, at rest."""
        if not state.valid:
            return state
        angles, v = np.array(state.angles), np.array(state.v)
        angles[self.columns], v[self.columns] = self._last(state)
        q = self.robot.configuration(angles)
        if self.robot.floating:
            q[:7] = state.q[:7]
        return self.robot.state(q, v, time=state.time)

    def _last(self, state: State) -> tuple[Vec, Vec]:
        """Joints as last commanded; at first as measured, home for those that are not finite, at rest."""
        if self._sent is not None:
            return self._sent
        angles = np.array(state.angles[self.columns])
        return np.where(np.isfinite(angles), angles, self._home), np.zeros(angles.size)

    def begin(self) -> None:
        """Hand over at the next tick: the first command continues from the measured joints."""
        self._sent = None
        self._planned = np.zeros(self.columns.size)
        self._acceleration.begin()
        if self._rates is not None:
            self._rates.forget()


__all__ = ["UpperBody", "UpperBodySession", "UpperBodyTick"]

"""A biped that walks under torque control: footsteps, plan of the DCM, swing feet, and the stacks that follow them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hqp.angles import wrapped
from hqp.arrays import Vec
from hqp.declare.price import Priced
from hqp.declare.reference import Reference
from hqp.declare.robot import State
from hqp.declare.safety import Braking
from hqp.errors import DeclarationError
from hqp.estimation.rotations import about_vertical, yaw_of
from hqp.loop.controller import Controller
from hqp.loop.tick import Tick
from hqp.tasks import JointLimits
from hqp.torque.program import Torque
from hqp.walking.adjustment import Landing, adjust
from hqp.walking.feet import feet_of
from hqp.walking.footsteps import RIGHT, Command, Foothold, Footsteps, rotation
from hqp.walking.gait import Gait, Reach
from hqp.walking.pendulum import DcmPlan, Piece, capture_point, natural_frequency
from hqp.walking.plan import Walk, predict
from hqp.walking.preview import Ability
from hqp.walking.stacks import BOTH, Laws, Stacks
from hqp.walking.stance import standing
from hqp.walking.swing import Swing, within

TOUCH = 0.05
"""Share of the weight on a swing foot above which it has landed."""

HELD, DOWN = 5e-3, 0.02
"""Largest distance of a landed foot below its path, or height of its path above the goal [m]; else a loaded foot has
scuffed and rises again."""

EARLY = 0.55
"""Share of the swing time before which a foot does not land."""

LATE = 0.015
"""Share of the weight that confirms a landing after the swing time: on a slope, the toe of a light foot carries no more
(AHEAD)."""

FADE = 0.08
"""Fade time of a torque jump at a switch of phase, for a joint's largest torque [s]."""

TAKE = 0.06
"""Shortest time in which a foot's share of the load changes from 0 to 1 [s]."""

INTEGRAL, MOST = 0.5, 0.03
"""Gain of the integral of the DCM error in the ZMP [1/s], and the integral's limit [m s]."""

LEAST = 0.015
"""DCM error above which a step corrects its foothold and time [m]."""

PLANNED = 0.8
"""Share of the reach for planned steps; the rest is for corrections."""

CLEAR = 0.02
"""Least gap between two soles side by side [m]."""

CORRECTION, CREEPS = 1.5, 0.2
"""Largest speed of a swing foot's goal, and shortly before its landing [m/s]: a sole that lands sliding has no grip."""

LAST, LONGEST, HURRY = 0.08, 1.6, 3.0
"""Remaining time below which the landing time is fixed [s]; its limit as a share of the swing time; largest rate of its
change [s/s]."""

AHEAD = 0.02
"""Largest error of a blocked swing foot's reference, which bounds its push [m]."""

SOONEST = 0.05
"""Time after lift-off, and shortest time to landing, of a correction [s]."""

WEIGHS, SAG = 2.0, 0.02
"""Gain of the integral of the CoM's height error [1/s], and its limit [m]: masses are not known exactly."""

WEIGHING, HEAVIER = 2.0, 0.25
"""Time constant of the mean load of the feet [s], and the largest relative change of torques by it."""

LIMITS = JointLimits(acceleration=1000.0, braking=200.0)


class Walker:
    """Walks after ``go``, stands after ``stop``; ``step`` is one tick.  ``session.stop`` ends the walk, then holds.

    robot: a biped with a free base, that starts standing on both feet; with ``load(name, rotors=True)`` it knows the
    inertia that its motors have in a Plant, without which light feet are controlled badly.  dt [s]: period of a tick.
    gait, reach, laws: parameters of the walk; a reach for None follows from how it stands.  soles: frames of the left
    and the right sole, those of the catalogue for None.  friction: mu of the ground.  limits: limits of joints, of all
    but those of the legs if it names none, None for none.  price, deadline: arguments of Controller.  max_age: that of
    ``Controller.session``.  Without a usable answer it goes on with the next one, ``Braking(resume="auto")``: a biped
    that waits for a person falls.  Raises DeclarationError for a robot that is no biped, and the errors of
    ``Controller.session``.
    """

    def __init__(
        self,
        robot: Any,
        gait: Gait | None = None,
        *,
        dt: float = 0.002,
        reach: Reach | None = None,
        laws: Laws | None = None,
        soles: Sequence[str] | None = None,
        friction: float = 0.4,
        limits: JointLimits | None = LIMITS,
        price: Priced = None,
        deadline: float | None = None,
        max_age: float | None = None,
    ) -> None:
        self.robot, self.gait, self.dt = robot, gait or Gait(), dt
        self._declared: dict[str, Any] = {"gait": gait, "dt": dt, "reach": reach, "laws": laws, "soles": soles}
        self._declared |= {"friction": friction, "limits": limits, "price": price}
        self.feet = feet_of(robot, soles)
        self.start = standing(robot, self.feet, self.gait.lower)
        """Standing configuration before the walk ``(nq,)``; it may start from elsewhere."""
        home = robot.copy().state(self.start)
        self.holds = [foot.placed(home) for foot in self.feet]
        """Present or last footholds."""
        self.height = float(home.com()[2]) - 0.5 * (self.holds[0].z + self.holds[1].z)
        """Height of the CoM above the ground [m]."""
        self.omega = natural_frequency(self.height, -robot.gravity[2])
        self.weight = -float(robot.mass * robot.gravity[2])
        """[N]"""
        width = abs(float((self.holds[0].turn.T @ (self.holds[0].xy - self.holds[1].xy))[1]))
        if reach is None:
            across = max(float(np.ptp([y for _, y in foot.corners])) for foot in self.feet) + CLEAR
            least = min(max(across, 0.5 * width), 0.7 * width)
            reach = Reach(forward=0.5 * self.height, least=least, most=width + 0.15 * self.height)
        self.footsteps = Footsteps(period=self.gait.period, width=width, reach=reach)
        self.ability = Ability(
            gait=self.gait,
            reach=replace(reach, forward=PLANNED * reach.forward),
            width=width,
            height=self.height,
            gravity=-float(robot.gravity[2]),
        )
        laws = laws or Laws()
        self.stacks = Stacks(robot, self.feet, self.height, friction, laws, limits)
        formulation = Torque(contact_law=laws.contact, holding=None)
        controller = Controller(self.stacks.stack, formulation, price=price, braking=Braking(resume="auto"))
        if deadline is not None:
            controller = replace(controller, deadline=deadline)
        self.session = controller.session(robot, dt, max_age=max_age)
        self.max_age = max_age
        """Oldest state that is accepted [s], None for any."""
        self.session.ending = self._end
        self._upright = np.array(home.rotation(self.stacks.trunk.frame))
        self._upright = about_vertical(-yaw_of(self._upright)) @ self._upright
        self.support = BOTH
        """The phase of the stack: names of the standing feet."""
        self.command = Command()
        self.why: tuple[str, ...] = ()
        """Reasons for each difference of ``command`` from the latest ``go``."""
        self._pace = Command()
        self.walking = False
        self.phase = "stand"
        """stand, shift (both feet, the ZMP on its way to the next stance foot) or swing."""
        self.event = ""
        """Event of this tick: a phase, "" for nothing."""
        self.time = 0.0
        self.stance = RIGHT
        self.edge = False
        """True if the support bounds the ZMP in this tick."""
        self.capture_point: Vec = np.zeros(2)
        self._started = False
        self.heavier = 1.0
        """Weight of the robot over that of its model, by the loads of its feet."""
        self._limit = robot.effort_limit[robot.actuated]
        self._fading = self._limit * dt / FADE
        self._rest: Vec = np.zeros(len(self._limit))
        self._sent: Vec | None = None

    # ------------------------------------------------------------------------------------------- commands

    def go(self, forward: float = 0.0, left: float = 0.0, turn: float = 0.0) -> None:
        """Walk at a velocity in the axes of the heading [m/s, m/s, rad/s]; zeros step in place.

        The velocity changes by a bounded amount from step to step.  ``command`` is the nearest velocity that steps can
        follow, ``why`` has the reasons.  A session that is stopped stands.
        """
        if why := self.session.stopping or self.session.stopped:
            self.command, self.why = Command(), (f"stopped ({why}): call session.resume()",)
            return
        self.command, self.why = self.ability.allowed(Command(forward, left, turn))
        self.walking = True

    def stop(self) -> None:
        """Come to stand with the feet side by side, over as many steps as it takes."""
        if self.walking:
            self.command, self.walking = Command(), False

    def _end(self) -> bool:
        """End the walk; return true if it takes time."""
        self.stop()
        return self._started and not self._stands

    @property
    def _stands(self) -> bool:
        return self.phase == "stand" and self._t >= self._T

    @property
    def stopping_time(self) -> float:
        """Longest time from ``stop`` to standing [s]."""
        steps = len(self.ability.paces(self._pace, Command())) + 1
        return steps * self.gait.period + 2.0 * self.gait.first

    def plan(self, seconds: float, fps: float = 50.0) -> Walk:
        """A reference motion: the walk at the velocity of ``go`` from ``start``, by the model alone, and a stop.

        Frames fps [1/s] apart; ``save(path)`` writes them.  This walker stays as it is.  Raises DeclarationError.
        """
        twin = Walker(self.robot.copy(), deadline=math.inf, **self._declared)
        if self.walking:
            twin.go(self.command.forward, self.command.left, self.command.turn)
        return predict(twin, seconds, fps)

    # ----------------------------------------------------------------------------------------------- loop

    def step(self, state: State, loads: Sequence[float] | Vec | None = None, *, now: float | None = None) -> Tick:
        """One tick: the torques for a state.

        loads: normal force on the left and on the right foot [N]; without them a foot has landed when its time is up.
        now: time of the control loop, as in ``Session.step`` [s].
        Raises DeclarationError for another number of loads.
        """
        if not self._started:
            self._start(state)
        if self.session.stopping and self._stands:
            self.session.stop(self.session.stopping, at_once=True)
        self.event = ""
        felt = None if loads is None else np.asarray(loads, dtype=np.float64)
        if felt is not None and felt.shape != (2,):
            allowed = "one for each foot; a Plant measures them with watched=[foot.frame for foot in walker.feet]"
            raise DeclarationError("walker", "loads", value=felt.tolist(), unit="N", allowed=allowed)
        self._advance(state, felt)
        references = self._references(state)
        tick = self.session.step(state, *references, now=now, phase=self.support)
        if felt is not None:
            self._weigh(sum(felt.tolist()))
        self._bound(tick.command)
        self._t += self.dt
        if self.phase != "swing" or self._t < self._T:  # later the plan waits for the foot
            self._since += self.dt
        self.time += self.dt
        return tick

    def positions(self, state: State, tick: Tick, kp: Vec, delay: float = 0.0) -> tuple[Vec, Vec]:
        """Joint angles and rates for position servos in place of the torques ``tick.command``, ``(n_actuated,)`` each.

        Servos with torque = kp (angle - q) + kv (rate - dq/dt): the target is the model's pose in the middle of the
        period in which they act, plus an offset for the torque, q + s v + s^2 a / 2 + tau / kp, so that tau is their
        mean.  A stiff servo that is aimed sooner or later acts as a damper of the wrong size or sign.  state: state of
        the tick.  kp [N m/rad].  delay: from the state to where they begin to act [s], s = delay + dt / 2.  Raises as
        ``Tick.advance``.
        """
        _, v = tick.advance()
        motors, s = self.robot.actuated, delay + 0.5 * self.dt
        change = s / self.dt * (v - state.v)[motors]
        rates = state.v[motors]
        return state.angles[motors] + s * (rates + 0.5 * change) + tick.command / kp, rates + change

    def _bound(self, command: Vec) -> None:
        """Scale torques by the weight felt; after a switch of phase go on from those before it, within the limits."""
        command *= self.heavier
        if self.event and self._sent is not None:
            self._rest = self._sent - command
        self._rest -= self._rest.clip(-self._fading, self._fading)
        command += self._rest
        command.clip(-self._limit, self._limit, out=command)
        self._sent = command.copy()

    def _weigh(self, load: float) -> None:
        """A robot heavier than its model needs so much more torque: estimate it by the mean load of the feet."""
        share = load / self.weight
        if abs(share - 1.0) < 0.5:  # no blow, no flight, no switch
            follow = self.dt / min(max(self.time, self.dt), WEIGHING)
            self._mean += follow * (share - self._mean)
            self.heavier = min(max(self._mean, 1.0 - HEAVIER), 1.0 + HEAVIER)

    def _start(self, state: State) -> None:
        self._started = True
        self.holds = [foot.placed(state) for foot in self.feet]
        com = state.com()
        self._z = float(com[2])
        self._raised, self._mean = 0.0, 1.0
        self._sunk = [0.0, 0.0]
        self._zmp = com[:2].copy()
        self._sum = np.zeros(2)
        self._share = 0.5
        self._yaw = self._mean_yaw()
        self._swing: Swing | None = None
        self._nominal = self._target = self.holds[0]
        self._t, self._T = 0.0, self.gait.first
        self._plan()

    def _advance(self, state: State, loads: Vec | None) -> None:
        """Take the next phase where this one is over."""
        if self.phase == "stand" and self.walking and self._t >= self._T:
            self.stance = RIGHT
            self._enter("shift", self.gait.first, state)
        elif self.phase == "shift" and self._t >= self._T:
            self._pace = self.ability.paced(self._pace, self.command)
            self._enter("swing", self._haste * self.gait.single, state)
        elif self.phase == "swing" and self._landed(state, loads):
            side = 1 - self.stance
            self.holds[side] = self.feet[side].placed(state)
            assert self._swing is not None
            hangs = float(state.position(self.feet[side].frame)[2]) - float(self._swing.x[2])
            self._sunk[side] = min(max(self._sunk[side] + 0.7 * hangs, -SAG), SAG)
            self.stance = side
            self._share = float(1 - side)  # the other foot still bears it all
            last = not self.walking and self._pace == Command()
            self._enter("stand" if last else "shift", self._double(self._pace, last), state)

    def _landed(self, state: State, loads: Vec | None) -> bool:
        """Return true if the swing foot stands: its time is up, or it bears load near its path or its goal."""
        if loads is None:
            return self._t >= self._T
        assert self._swing is not None
        least = TOUCH if self._t < self._T else LATE
        if loads[1 - self.stance] > least * self.weight and self._t > EARLY * self._T:
            z, path = float(state.position(self.feet[1 - self.stance].frame)[2]), float(self._swing.x[2])
            if z > path - HELD or path < float(self._swing.goal[2]) + DOWN:
                return True
            self._swing.clear(z)
        return self._t > self._T + self.gait.patience

    def _enter(self, phase: str, duration: float, state: State) -> None:
        self.phase, self.event, self._t, self._T = phase, phase, 0.0, duration
        self.support = self.feet[self.stance].name if phase == "swing" else BOTH
        if phase == "swing":
            self.holds[self.stance] = self.feet[self.stance].placed(state)  # after it has settled
            foot = self.feet[1 - self.stance]
            p, yaw = state.position(foot.frame), yaw_of(state.rotation(foot.frame))
            self._nominal = self._target = self._next(self.holds[self.stance], self._pace)
            self._swing = Swing(np.array([*p, yaw]), self._goal(), duration, self.gait.height, search=self.gait.search)
        self._plan()
        if phase == "swing":
            offset = self._dcm.at(duration)[1] - self._nominal.xy
            self._planned = Landing(
                stance=self.holds[self.stance], foothold=self._nominal, offset=offset, left=duration
            )

    # ----------------------------------------------------------------------------------------------- plan

    def _plan(self) -> None:
        """ZMP and DCM from now on, three steps ahead."""
        gait, holds, stance = self.gait, list(self.holds), self.stance
        pieces: list[Piece] = []
        at = self._zmp

        def to(duration: float, where: Vec) -> None:
            nonlocal at
            pieces.append(Piece(duration, at, where))
            at = where if duration > 0.0 else at

        if self.phase == "stand":
            to(max(self._T - self._t, self.dt), 0.5 * (holds[0].xy + holds[1].xy))
        else:
            if self.phase == "shift":
                to(max(self._T - self._t, self.dt), holds[stance].xy)
            swings, paces = self.phase == "swing", self.ability.paces(self._pace, self.command)
            if self.walking:
                paces = (paces + 3 * [self.command])[: 3 - swings]
            elif swings and self._pace == Command():
                paces = []
            for k, pace in enumerate([self._pace, *paces] if swings else paces):
                under_way = swings and k == 0
                left = self._T - self._t if under_way else self.ability.haste(pace) * gait.single
                to(max(left, self.dt), holds[stance].xy)
                holds[1 - stance] = self._nominal if under_way else self._next(holds[stance], pace)
                stance = 1 - stance
                last = not self.walking and k == len(paces) - 1 + swings
                to(self._double(pace, last), 0.5 * (holds[0].xy + holds[1].xy) if last else holds[stance].xy)
            if self.walking:
                to(self.ability.haste(self.command) * gait.single, holds[stance].xy)
        to(0.5, at)
        self._dcm, self._since = DcmPlan(pieces, self.omega), 0.0

    @property
    def _haste(self) -> float:
        return self.ability.haste(self._pace)

    def _double(self, pace: Command, last: bool) -> float:
        """Time of both feet on the ground after a step [s]."""
        return self.gait.first if last else self.ability.haste(pace) * self.gait.double

    def _next(self, stance: Foothold, pace: Command) -> Foothold:
        return replace(self.footsteps, period=self.ability.haste(pace) * self.gait.period).next(stance, pace)

    def _goal(self) -> Vec:
        target = self._target
        xy = self.feet[target.side].origin(target.xy, target.yaw)
        return np.array([*xy, self.holds[self.stance].z, target.yaw])

    # ----------------------------------------------------------------------------------------- references

    def _references(self, state: State) -> list[Reference]:
        stacks, omega = self.stacks, self.omega
        zmp, dcm = self._dcm.at(self._since)
        self._zmp = zmp
        self.capture_point = capture_point(state, omega)
        error = self.capture_point - dcm
        reference = np.concatenate((zmp + INTEGRAL * self._sum, dcm))
        reached, wanted = stacks.supports[self.support].zmp(state, reference)
        self.edge = math.dist(reached, wanted) > 1e-6
        if not self.edge or float(error @ self._sum) < 0.0:
            self._sum = within(self._sum + self.dt * omega * error, MOST)
        found = [
            stacks.balance.at(reference[:2], reference[2:]),
            stacks.height.at([self._height(float(state.com()[2]))]),
        ]
        if self.phase == "swing":
            found.append(self._swing_reference(state, error, reached - zmp))
        else:
            found.append(stacks.share.at(self._next_share(reached)))
        found.append(stacks.trunk.at(about_vertical(self._next_yaw()) @ self._upright))
        stands = (self.stance,) if self.phase == "swing" else (0, 1)
        found += [stacks.soles[side].at(normal=state.rotation(self.feet[side].frame)[:, 2]) for side in stands]
        return found

    def _height(self, com: float) -> float:
        """Height of the CoM in the world, at bounded speed, raised by its recent deficit [m]."""
        holds = self.holds
        ground = holds[self.stance].z if self.phase == "swing" else 0.5 * (holds[0].z + holds[1].z)
        most = 0.05 * self.height * self.dt
        self._z += min(max(ground + self.height - self._z, -most), most)
        self._raised = min(max(self._raised + WEIGHS * self.dt * (self._z - com), -SAG), SAG)
        return self._z + self._raised

    def _next_yaw(self) -> float:
        """Yaw of the trunk: between the feet, with a swing foot where it is to be [rad]."""
        most = 0.8 * self.dt
        off = wrapped(self._mean_yaw() - self._yaw)
        self._yaw += min(max(off, -most), most)
        return self._yaw

    def _mean_yaw(self) -> float:
        one = self.holds[self.stance].yaw
        other = self._target.yaw if self.phase == "swing" else self.holds[1 - self.stance].yaw
        return one + 0.5 * wrapped(other - one)

    def _next_share(self, zmp: Vec) -> float:
        """Share of the right foot: by where the ZMP is between the feet, at the end of a shift all on the stance
        foot."""
        one, other = self.holds
        x, y = other.x - one.x, other.y - one.y
        along = (float(zmp[0]) - one.x) * x + (float(zmp[1]) - one.y) * y
        share = min(max(along / (x * x + y * y), 0.0), 1.0)
        if self.phase == "shift":
            left = self._T - self._t
            if left < 2.0 * TAKE:
                share += (self.stance - share) * min(1.0, (2.0 * TAKE - left) / TAKE)
        most = self.dt / TAKE
        self._share += min(max(share - self._share, -most), most)
        return self._share

    def _adjust(self, error: Vec, ankle: Vec) -> None:
        """Move the landing of the swing foot, in place and time, to where the DCM is met."""
        assert self._swing is not None
        single, swing, planned = self._haste * self.gait.single, self._swing, self._planned
        speed = CORRECTION if self._T - self._t > LAST else CREEPS
        self._target, left = planned.foothold, max(self._T - self._t, 0.0)
        if self.edge:  # inside the sole the ankle leads every error back
            now = swing.x[:2] + rotation(swing.x[3]) @ np.array(self.feet[planned.foothold.side].middle)
            self._target, left = adjust(
                replace(planned, left=left), self.footsteps, error, ankle, self.omega, now=now,
                soonest=SOONEST, latest=LONGEST * single - self._t, usual=single - self._t, speed=speed,
                least=LEAST,
            )  # fmt: skip
        swing.retarget(self._goal(), speed, self.dt)
        later = self._t + left - self._T
        if abs(later) > self.dt and self._T - self._t > LAST:
            self._T += math.copysign(min(HURRY * self.dt, abs(later)), later)
            swing.duration = self._T
            self._plan()

    def _swing_reference(self, state: State, error: Vec, pushed: Vec) -> Reference:
        """Pose of the swing foot; its goal moves to where the error of the DCM is met."""
        assert self._swing is not None
        side = 1 - self.stance
        if self._t > SOONEST:
            self._adjust(error, pushed)
        path, v, a = self._swing.step(self.dt)
        yaw, here = path.tolist()[3], state.position(self.feet[side].frame)
        x, y = (here[:2] + within(path[:2] - here[:2], AHEAD)).tolist()
        z = max(float(path[2]), float(here[2]) - AHEAD)
        self._swing.x[:3] = x, y, z
        z -= self._sunk[side] * min(1.0, self._t / (0.3 * self._T))
        target = np.eye(4)
        target[:3, :3], target[:3, 3] = about_vertical(yaw), (x, y, z)
        rates, more = ([*u[:3], 0.0, 0.0, u[3]] for u in (v.tolist(), a.tolist()))
        return self.stacks.swing[side].at(target, velocity=rates, acceleration=more)

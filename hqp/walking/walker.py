"""A biped that walks under torque control: footsteps, plan of the DCM, swing feet, and the stacks that follow them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np

from hqp import _session
from hqp.angles import wrapped
from hqp.arrays import Vec
from hqp.declare.law import PD
from hqp.declare.price import Priced
from hqp.declare.reference import Reference, numbers
from hqp.declare.robot import State
from hqp.declare.safety import Braking
from hqp.estimation.feet import feet_tree
from hqp.estimation.rotations import about_vertical
from hqp.kinds import require, require_robot, require_state
from hqp.loop.controller import Controller
from hqp.loop.file import write
from hqp.loop.tick import Tick
from hqp.numbers import number
from hqp.tasks import JointLimits
from hqp.torque.joint_friction import JointFriction
from hqp.torque.program import Torque
from hqp.walking.feet import feet_of
from hqp.walking.footsteps import Command, Foothold, Footsteps, routed
from hqp.walking.gait import GAIT, REACH, Gait, Reach
from hqp.walking.pendulum import natural_frequency
from hqp.walking.plan import Walk, predict
from hqp.walking.preview import QUICK, Ability
from hqp.walking.stacks import Laws, Stacks
from hqp.walking.stance import overloaded, standing, weakest

TOUCH, TAKE = _session.Walker.TOUCH, _session.Walker.TAKE
"""Share of the weight on a swing foot above which it has landed; shortest time in which a foot's share of the load
changes from 0 to 1 [s].  The other numbers of a walk are in cpp/walking/walker.hpp."""

PLANNED = 0.8
"""Share of the reach for planned steps; the rest is for corrections."""

CLEAR = 0.02
"""Least gap between two soles side by side [m]."""

LIFT = 0.1
"""Largest clearance of a swing foot without a gait of the user's, as a share of the CoM's height: OP3, whose CoM is at
0.23 m, fell with 50 mm, since its joints brake fast knees."""

REGAINS = 0.5
"""Time on both feet as a share of the time on one, if a step overloads a joint: the body that a weak hip lets fall
there is thrown back on both feet.  With 0.25 a biped falls within 4 s whose hips lack 8 % of the torque."""

PHASES = "stand", "shift", "swing"

STEEPEST = 0.5
"""Steepest ground, as a share of the angle of friction: a steeper sole has rolled over an edge, and its normal would
keep the weight out of the friction cone."""

BANDWIDTH = 40.0
"""Bandwidth with which rates follow measured ones [1/s]: at 30 iCub's torques reverse 24 times a second in place of 18,
at 100 noise of 0.02 rad/s shows in them."""

LIMITS = JointLimits(acceleration=60.0, braking=60.0, noise=0.06)
"""Limits above the legs: at 1000 rad/s^2 waist and arms are thrown about if a sole bounds the balance; without noise
the torque of a finger at its stop reverses 25 times a second."""


LOADS = "one for each foot; a Plant measures them with watched=[foot.frame for foot in walker.feet]"


class Walker:
    """Walks after ``go``, stands after ``stop``; ``step`` is one tick.  ``session.stop`` ends the walk, then holds.

    robot: a biped with a free base, that starts standing on both feet; with ``load(name, rotors=True)`` it knows the
    inertia that its motors have in a Plant, without which light feet are controlled badly; torques overcome friction
    of joints from its file (``robot.model.damping``, ``.friction``).  dt [s]: period of a tick.
    gait, reach, laws: parameters of the walk; a reach for None follows from how it stands, a gait for None lifts feet
    by LIFT of the CoM's height at most, and stands shorter on one foot if a joint bears too much there.  soles: frames
    of the left and the right sole, those of the catalogue for None.  friction: mu of the ground.  limits: limits of
    joints, of all but those of the legs if it names none, None for none.  bandwidth: noise of measured rates above it
    does not reach the torques, inf for rates as measured [1/s].  price, deadline: arguments of Controller.  max_age:
    argument of ``Controller.session``.  Without a usable answer it goes on with the next one,
    ``Braking(resume="auto")``: a biped that waits for a person falls.  Raises DeclarationError for a robot that is no
    biped, and the errors of ``Controller.session``.
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
        bandwidth: float = BANDWIDTH,
        deadline: float | None = None,
        max_age: float | None = None,
    ) -> None:
        require_robot("walker", robot)
        for field, given, kind, allowed in (
            ("gait", gait, Gait, GAIT),
            ("reach", reach, Reach, REACH),
            ("laws", laws, Laws, "Laws(...)"),
            ("limits", limits, JointLimits, "JointLimits(...)"),
        ):
            require("walker", field, given, (kind, type(None)), f"{allowed} or None")
        bandwidth = number("walker", "bandwidth", bandwidth, 0.0, strict=True, infinite=True, unit="1/s")
        dt = number("walker", "dt", dt, 0.0, strict=True, unit="s")
        self.robot, self.gait, self.dt = robot, gait or Gait(), dt
        self._declared: dict[str, Any] = {"gait": gait, "dt": dt, "reach": reach, "laws": laws, "soles": soles}
        self._declared |= {"friction": friction, "limits": limits, "price": price}
        self._keeps = math.exp(-bandwidth * dt)
        self.feet = feet_of(robot, soles)
        self.start = standing(robot, self.feet, self.gait.lower)
        """Standing configuration before the walk ``(nq,)``; it may start from elsewhere."""
        self._reasons = [foot.why for foot in self.feet if foot.why]
        if hard := [why for foot in self.feet for why in overloaded(robot, foot, self.start)]:
            self._reasons += hard
            if gait is None:
                usual, quick = self.gait.period, self.gait.quicker(QUICK)
                self.gait = replace(quick, double=REGAINS * quick.single)
                times = f"{self.gait.period:.2f} s, not {usual:.2f}, {self.gait.double:.2f} s of it on both feet"
                self._reasons.append(f"steps take {times}, so that no joint bears that for long")
        self._weakest = weakest(robot, self.feet, self.start, self.gait)
        home = robot.copy().state(self.start)
        self._first = one, other = self.feet[0].placed(home), self.feet[1].placed(home)
        self.height = float(home.com()[2]) - 0.5 * (one.z + other.z)
        """Height of the CoM above the ground [m]."""
        if gait is None:
            self.gait = replace(self.gait, height=min(self.gait.height, LIFT * self.height))
        self.omega = natural_frequency(self.height, -robot.gravity[2])
        self.weight = -float(robot.mass * robot.gravity[2])
        """[N]"""
        width = abs(float((one.turn.T @ (one.xy - other.xy))[1]))
        if reach is None:
            across = max(foot.breadth for foot in self.feet) + CLEAR
            nearer = self.feet[0].inwards + self.feet[1].inwards
            apart = width + nearer
            least = min(max(across, 0.5 * apart), 0.7 * apart) - nearer
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
        self.stacks = stacks = Stacks(robot, self.feet, self.height, friction, laws, limits, self.start)
        formulation = Torque(contact_law=laws.contact, loop_law=PD(0.0, 0.0), holding=None)  # gears hold by themselves
        controller = Controller(self.stacks.stack, formulation, price=price, braking=Braking(resume="auto"))
        if deadline is not None:
            controller = replace(controller, deadline=deadline)
        self.session = controller.session(robot, dt, max_age=max_age)
        self.max_age = max_age
        """Oldest state that is accepted [s], None for any."""
        self.session.ending = self._end
        self._swings = tuple(pose.name for pose in stacks.swing)
        self._soles = tuple(sole.name for sole in stacks.soles)
        parts = stacks.balance, stacks.height, stacks.trunk, stacks.share
        self._elements = *(part.name for part in parts), *self._swings, *self._soles
        self._laws, self._twin = laws, robot.copy()  # native kinematics write its arrays
        self._native = _session.Walker(self.tree(self._twin))
        self._state = self._native.state

    def tree(self, robot: Any) -> dict[str, Any]:
        """Parts of the native walker over the arrays of a copy of the robot."""
        home = robot.state(self.start)
        one, other = (foot.placed(home).yaw for foot in self.feet)
        upright = about_vertical(-one - 0.5 * wrapped(other - one)) @ home.rotation(self.stacks.trunk.frame)
        feet = feet_tree(robot, [foot.frame for foot in self.feet])
        soles = [
            {"frame": frame, "middle": foot.aim, "yaw": foot.yaw, "corners": foot.support}
            for foot, frame in zip(self.feet, feet.pop("feet"), strict=True)
        ]
        return {
            **feet, "soles": soles, "half": max(foot.half for foot in self.feet),
            "why": self._reasons, "weakest": self._weakest[0], "bears": self._weakest[1:],
            "dt": self.dt, "gait": self.gait.numbers,
            "reach": astuple(self.footsteps.reach), "planned": self.ability.reach.forward,
            "width": self.footsteps.width, "height": self.height, "gravity": self.ability.gravity,
            "omega": self.omega, "pendulum": self.stacks.balance.omega(home),
            "start": self.start.tolist(), "elements": self._elements, "k": self._laws.balance.k,
            "weight": self.weight, "keeps": self._keeps, "upright": upright.ravel().tolist(),
            "steepest": STEEPEST * math.atan(self._declared["friction"]),
            "limits": robot.effort_limit[robot.actuated].tolist(), "friction": _friction(robot),
        }  # fmt: skip

    # --------------------------------------------------------------------------------------------- state

    @property
    def walking(self) -> bool:
        """True from ``go`` to ``stop``, from ``follow`` to its last foothold."""
        return self._state.walking

    @property
    def command(self) -> Command:
        """Velocity that is followed, the nearest one to that of the latest ``go``."""
        return Command(*self._state.command)

    @property
    def ahead(self) -> tuple[Foothold, ...]:
        """Footholds of the latest ``follow`` that no foot has left for yet, as they will be stepped on."""
        return tuple(Foothold(*one) for one in self._native.ahead)

    @property
    def why(self) -> tuple[str, ...]:
        """Reasons for each difference from the latest ``go`` or ``follow``, for a ZMP beside the middle of a sole, for
        joints that steps overload, and for masses that the load of the feet scales (``heavier``)."""
        return tuple(self._native.why)

    @property
    def phase(self) -> str:
        """stand, shift (both feet, the ZMP on its way to the next stance foot) or swing."""
        return PHASES[self._state.phase]

    @property
    def event(self) -> str:
        """The phase that this tick has entered, "" for none."""
        return self.phase if self._state.entered else ""

    @property
    def support(self) -> str:
        """The phase of the stack: names of the standing feet."""
        return self._native.support

    @property
    def stance(self) -> int:
        """LEFT or RIGHT, the foot that stands in a swing."""
        return self._state.stance

    @property
    def holds(self) -> tuple[Foothold, Foothold]:
        """Present or last footholds."""
        if not self._state.started:
            return self._first
        left, right = self._state.holds
        return Foothold(*left), Foothold(*right)

    @property
    def time(self) -> float:
        """Time since the first tick [s]."""
        return self._state.time

    @property
    def edge(self) -> bool:
        """True if the support bounds the ZMP in this tick."""
        return self._state.edge

    @property
    def capture_point(self) -> Vec:
        """xi ``(2,)`` [m], see ``pendulum.capture_point``."""
        return np.array(self._state.capture_point)

    @property
    def heavier(self) -> float:
        """Weight of the robot over that of its model, by the loads of its feet."""
        return self._state.heavier

    # ------------------------------------------------------------------------------------------- commands

    def go(self, forward: float = 0.0, left: float = 0.0, turn: float = 0.0) -> None:
        """Walk at a velocity in the axes of the heading [m/s, m/s, rad/s]; zeros step in place.

        The velocity changes by a bounded amount from step to step.  ``command`` is the nearest velocity that steps can
        follow, ``why`` has the reasons.  A session that is stopped stands.  So does a robot if a joint of its legs
        lacks so much torque under the measured weight that the body would fall; on its way it stops.
        """
        self._order(self._native.go, astuple(Command(forward, left, turn)))

    def follow(self, footholds: Sequence[Foothold]) -> None:
        """Step on footholds in the world, LEFT and RIGHT in turn, then stand on the last two.

        Steps take the gait's time.  A foothold out of reach of the one before gives way to the nearest within reach,
        0.8 of ``Reach.forward`` ahead, as does one above or below it by more than the CoM follows in a step,
        0.05 ``height`` in a second; ``why`` has the reasons, ``ahead`` the footholds that are left.  If the other foot
        has to go first, it steps in place.  A push moves footholds, the next ones stay.  A session that is stopped
        stands.  Raises DeclarationError for two of one foot in turn, and for numbers that are not finite.
        """
        self._order(self._native.follow, routed(footholds))

    def _order(self, order: Callable[[Any], None], given: Any) -> None:
        """Give the native walker an order, unless the session is stopped."""
        if why := self.session.stopping or self.session.stopped:
            self._native.refuse(why)
        else:
            order(given)

    def stop(self) -> None:
        """Come to stand with the feet side by side, over as many steps as it takes."""
        self._native.stop()

    def _end(self) -> bool:
        """End the walk; return true if it takes time."""
        self.stop()
        return self._state.started and not self._native.stands

    @property
    def stopping_time(self) -> float:
        """Longest time from ``stop`` to standing [s]."""
        return self._native.stopping_time

    def plan(self, seconds: float, fps: float = 50.0) -> Walk:
        """A reference motion: the walk at the velocity of ``go`` or over ``ahead`` from ``start``, and a stop.

        The model alone moves.

        Frames fps [1/s] apart; ``save(path)`` writes them.  This walker stays as it is.  Raises DeclarationError.
        """
        twin = Walker(self.robot.copy(), bandwidth=math.inf, deadline=math.inf, **self._declared)
        if self.ahead:
            twin.follow(self.ahead)
        elif self.walking:
            twin.go(*astuple(self.command))
        return predict(twin, seconds, fps, self.why)

    def export(self, path: str | Path, *, key: bytes | None = None) -> None:
        """Write walker and session to a file: for C++ without Python (``WalkingSession``) and for ``Walkers.load``.

        key: see ``Session.export``, with its errors.
        """
        write(self.session, path, key=key, more={"walker": self.tree(self.robot.copy())})

    # ----------------------------------------------------------------------------------------------- loop

    def step(self, state: State, loads: Sequence[float] | Vec | None = None, *, now: float | None = None) -> Tick:
        """One tick: the torques for a state.

        Rates are those that the last tick's torques lead to, corrected by measured ones at ``bandwidth`` and
        within 0.06 rad/s of them, except for the velocity of the base; ``tick.state`` has them.
        loads: normal force on the left and on the right foot [N]; without them a foot has landed when its time is up.
        now: time of the control loop, as in ``Session.step`` [s].
        Raises DeclarationError for another number of loads.
        """
        if self.session.stopping and self._native.stands and self._state.started:
            self.session.stop(self.session.stopping, at_once=True)
        felt = None if loads is None else numbers("walker", "loads", loads, (2,), LOADS)
        rates = np.empty(self.robot.nv)
        require_state("step", state)
        self._native.observe(state.v, rates)
        state = self.robot.state(state.q, rates, time=state.time)
        self._native.step(state.q, state.v, felt)
        self.session.weigh(self.heavier)
        tick = self.session.step(state, *self._references(), now=now, phase=self.support)
        self._native.moves(self.session.acceleration(tick.x) if tick.status.solved else None)
        self._native.finish(tick.command, felt)
        return tick

    def _references(self) -> list[Reference]:
        native, stacks = self._native, self.stacks
        found = [
            Reference(stacks.balance.name, native.balance.copy()),
            Reference(stacks.height.name, np.array([native.height])),
        ]
        stands: tuple[int, ...] = (0, 1)
        if self.phase == "swing":
            stands = (self.stance,)
            rates = native.swing_velocity.copy(), native.swing_acceleration.copy()
            found.append(Reference(self._swings[1 - self.stance], native.swing.reshape(4, 4).copy(), *rates))
        else:
            found.append(Reference(stacks.share.name, np.array([native.share])))
        found.append(Reference(stacks.trunk.name, native.trunk.reshape(3, 3).copy()))
        normals = native.normals
        return found + [Reference(self._soles[side], normal=normals[side].copy()) for side in stands]

    def positions(self, tick: Tick, kp: Vec, delay: float = 0.0) -> tuple[Vec, Vec]:
        """Joint angles and rates for position servos in place of the torques ``tick.command``, ``(n_actuated,)`` each.

        Servos with torque = kp (angle - q) + kv (rate - dq/dt): the target is the model's pose in the middle of the
        period in which they act, plus an offset for the torque, q + s v + s^2 a / 2 + tau / kp, so that tau is their
        mean.  A stiff servo that is aimed sooner or later acts as a damper of the wrong size or sign.  kp [N m/rad].
        delay: from the state of the tick to where they begin to act [s], s = delay + dt / 2.  Raises as
        ``Tick.advance``.
        """
        require("positions", "tick", tick, Tick, "a tick of walker.step")
        kp = numbers("positions", "kp", kp, tick.command.shape)
        delay = number("positions", "delay", delay, 0.0, unit="s")
        _, v = tick.advance()
        state, motors, s = tick.state, self.robot.actuated, delay + 0.5 * self.dt
        change = s / self.dt * (v - state.v)[motors]
        rates = state.v[motors]
        return state.angles[motors] + s * (rates + 0.5 * change) + tick.command / kp, rates + change


def _friction(robot: Any) -> list[dict[str, Any]]:
    """Friction of the joints by motor, ``JointFriction``, without joints that have none."""
    columns = np.arange(robot.nv)[robot.actuated]
    found = JointFriction.of(robot, columns)
    parts = zip(columns.tolist(), found.viscous.tolist(), found.dry.tolist(), strict=True)
    rows = ({"motor": i, "column": c, "viscous": d, "dry": f} for i, (c, d, f) in enumerate(parts))
    return [row for row in rows if row["viscous"] + row["dry"]]

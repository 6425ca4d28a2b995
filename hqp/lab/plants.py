"""Plants: the exact integrator, or MuJoCo under servos or torques."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from hqp.arrays import Vec
from hqp.errors import DeclarationError
from hqp.loop.session import Session, Tick

PLANTS = ("integrator", "mujoco")


class LoopPlant(Protocol):
    """Gives the state that the session sees and takes its tick."""

    def state(self) -> tuple[Vec, Vec]: ...
    def carry_out(self, tick: Tick) -> None: ...


def plant(name: str, session: Session) -> LoopPlant:
    """A plant by name; raises DeclarationError for another, ModelError where MuJoCo has no model of the robot."""
    if name == "integrator":
        return Integrator(session)
    if name == "mujoco":
        return Simulated(session)
    raise DeclarationError("bench", "unknown plant", value=name, allowed=", ".join(PLANTS))


class Integrator:
    """Every command is carried out exactly (Mistry 2008, eqs. 19 to 22)."""

    def __init__(self, session: Session) -> None:
        self._q, self._v = session.robot.home.copy(), np.zeros(session.robot.nv)

    def state(self) -> tuple[Vec, Vec]:
        """Present state of the robot."""
        return self._q, self._v

    def carry_out(self, tick: Tick) -> None:
        """Move one period on."""
        if tick.solution is not None:
            self._q, self._v = tick.advance()


class Simulated:
    """MuJoCo: torques at torque level, position servos otherwise; the base is measured, joints as commanded.

    A servo gets the commanded joint position and rate; the session integrates from its own commands, so that the lag of
    the servos is no error of the stack.
    """

    def __init__(self, session: Session) -> None:
        from hqp.robots.on_mujoco import Plant

        robot: Any = session.robot
        self._robot, self._dt = robot, session.dt
        self._torque = type(session.controller.formulation).__name__ == "Torque"
        step = session.dt / max(1, round(session.dt / 0.001))
        self._steps = round(session.dt / step)
        self._plant = Plant(robot, actuation="torque" if self._torque else "position", timestep=step)
        self._plant.reset(robot.home)
        q, v = self._plant.state()
        self._angles = robot.state(q).angles[robot.actuated].copy()
        self._rates = np.zeros(self._angles.size)
        self._q, self._v = q, v
        self._order = session.controller.formulation.order

    def state(self) -> tuple[Vec, Vec]:
        """State for the session."""
        return self._q, self._v

    def carry_out(self, tick: Tick) -> None:
        """Hold the command for one period."""
        robot = self._robot
        if self._torque:
            self._plant.step(tick.command, steps=self._steps)
            self._q, self._v = self._plant.state()
            return
        rates = tick.command if self._order == 1 else self._rates + self._dt * tick.command
        self._rates = rates.copy()
        self._angles = self._angles + self._dt * rates
        self._plant.step(self._angles, rates, steps=self._steps)
        q, v = self._plant.state()
        measured = robot.state(q).angles[robot.actuated]
        step = np.zeros(robot.nv)
        step[robot.actuated] = self._angles - measured
        self._q, self._v = robot.integrate(q, step, 1.0), v.copy()
        self._v[robot.actuated] = rates

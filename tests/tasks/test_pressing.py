"""UR5 on position servos presses a table with its flange in MuJoCo: a force along one axis, at velocity level."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

import hqp.robots
from hqp import Level, P, Stack
from hqp.estimation import MomentumObserver
from hqp.tasks import Admittance, JointLimits, Orientation, Position, Posture, Within

DT, FRAME, FORCE = 0.002, "tool0", 20.0
START = np.array([0.0, -1.3, 1.7, -1.97, -1.57, 0.0])
DAMPING = 2000.0
"""Damping of the admittance [N s/m]: table and servos give 15 kN/m, so the force settles within 0.13 s."""

BELOW, LOWEST = 0.02, 0.04
"""Distance of the table below the flange, and of the lowest allowed flange position [m]."""


@dataclass
class Press:
    """Records of the table's load, the flange's motion and the commands."""

    there: bool = True
    observed: bool = False
    loads: list[float] = field(default_factory=list)
    down: list[float] = field(default_factory=list)
    commands: list[Any] = field(default_factory=list)
    statuses: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        from hqp.robots.on_mujoco import Noise, Plant, Sensors, Servo

        self.robot = robot = hqp.robots.load("ur5")
        start = robot.state(START).position(FRAME)
        self.press = Admittance(frame=FRAME, axes="z", stiffness=0.0, damping=DAMPING, name="press")
        aside, turn = Position(frame=FRAME, axes="xy", name="aside"), Orientation(frame=FRAME, name="turn")
        deep = Within(Position(frame=FRAME, axes="z"), lower=-LOWEST, name="deep")
        self.deep, self.start = deep.at([start[2]]), start
        stack = Stack(Level(self.press, aside, turn), Level(Posture()), subject_to=[JointLimits(), deep])
        self.session = hqp.Controller(stack, hqp.Velocity(law=P(5.0)), deadline=np.inf).session(robot, DT)

        def table(spec: Any) -> None:
            import mujoco

            box = spec.worldbody.add_geom(name="table", pos=start - [0.0, 0.0, BELOW + 0.05], size=[0.3, 0.3, 0.05])
            box.type, box.solref, box.priority = mujoco.mjtGeom.mjGEOM_BOX, [0.006, 1.0], 2

        self.plant = Plant(
            robot,
            watched=(FRAME,),
            edit=table if self.there else None,
            actuation="position",
            servo=Servo(other=4000.0, damping_time=0.01),
            sensors=Sensors(force=Noise(0.3)),
        )
        self.observer = MomentumObserver(robot, FRAME, tuple(robot.joint_names), DT) if self.observed else None
        self.q, self.v = self.plant.reset(START.copy())

    def go(self, seconds: float, bears: float) -> None:
        for _ in range(round(seconds / DT)):
            reading = self.plant.measure()
            force = reading.contacts.force[0]
            if self.observer is not None:
                force = self.observer.update(self.robot.state(*self.plant.state()), self.plant.torque)
            tick = self.session.step(
                self.robot.state(self.q, self.v), self.press.at(force=force[2:], bears=[bears]), self.deep
            )
            self.q, self.v = tick.advance()
            self.plant.step(self.q[self.robot.actuated], self.v[self.robot.actuated], steps=2)
            self.loads.append(float(self.plant.contacts().load[0]))
            self.down.append(float(self.start[2] - self.plant.place(FRAME)[0][2]))
            self.commands.append(tick.command.copy())
            self.statuses.add(tick.status.name)

    @property
    def jump(self) -> float:
        """Largest change of a joint's commanded velocity in a tick, once it moves [rad/s]."""
        return float(np.abs(np.diff(self.commands, axis=0)).max())


@pytest.mark.long
@pytest.mark.parametrize(("observed", "off", "jump"), [(False, 0.5, 0.03), (True, 1.5, 0.03)])
def test_it_comes_to_bear_what_is_asked_without_a_bounce(observed: bool, off: float, jump: float) -> None:
    """Use a sensor with 0.3 N of noise, or the motor torques; start in the air above a hard table."""
    press = Press(observed=observed)
    press.go(1.0, bears=0.0)  # servos sag under the arm's weight
    assert max(press.loads) == 0.0
    press.go(4.0, bears=FORCE)
    loads = np.array(press.loads)
    first = int(np.argmax(loads > 0.0))
    assert (loads[first:] > 0.0).all()
    assert loads.max() < 1.3 * FORCE
    np.testing.assert_allclose(loads[-250:], FORCE, atol=off)
    assert press.jump < jump
    assert press.statuses == {"OPTIMAL"}


@pytest.mark.long
def test_without_a_table_it_stops_where_it_may_go_no_further() -> None:
    """It descends at f_ref / D and rests at the bound."""
    press = Press(there=False)
    press.go(1.0, bears=0.0)
    sag = press.down[-1]
    press.go(1.0, bears=FORCE)
    assert press.down[-1] - sag == pytest.approx(1.0 * FORCE / DAMPING, abs=1e-3)
    press.go(5.0, bears=FORCE)
    assert press.down[-1] - sag == pytest.approx(LOWEST, abs=1e-3)
    assert max(press.down) - sag < LOWEST + 1e-3
    assert press.jump < 0.03
    assert press.statuses == {"OPTIMAL"}

"""Impedance and admittance in MuJoCo: a force is reached, a spring has its stiffness, contact causes no jump."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

import hqp.robots
from hqp import PD, Level, P, Stack, serial
from hqp.errors import DeclarationError
from hqp.tasks import Admittance, ExternalWrench, Impedance, JointLimits, Orientation, Posture, TorqueLimits

DT, STIFF, MASS = 0.002, 1000.0, 4.0
HEIGHT = 0.40
"""Height of the table [m]."""
HANDS = {"panda": "panda_hand", "ur5": "tool0"}


def table(timeconst: float) -> Any:
    """Box under the hand, soft by MuJoCo's time constant of contacts [s]."""
    import mujoco

    def edit(spec: Any) -> None:
        box = spec.worldbody.add_geom(name="table", pos=[0.5, 0.0, HEIGHT - 0.05], size=[0.4, 0.5, 0.05])
        box.type, box.solref, box.priority, box.friction = (
            mujoco.mjtGeom.mjGEOM_BOX,
            [timeconst, 1.0],
            2,
            [0.3, 5e-3, 1e-4],
        )

    return edit


@dataclass
class Loop:
    """Hand that presses on the table, with its records."""

    level: str
    damping: float = 400.0
    softness: float = 0.006
    stiffness: tuple[float, float, float] = (STIFF, STIFF, 0.0)
    delay: float = 0.0
    noise: float = 0.0
    loads: list[float] = field(default_factory=list)
    commands: list[Any] = field(default_factory=list)
    statuses: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        from hqp.robots.on_mujoco import Noise, Plant, Sensors, Servo

        self.robot = robot = hqp.robots.load("panda")
        self.frame = frame = HANDS[robot.name]
        spring: dict[str, Any] = {"frame": frame, "name": "hand", "stiffness": self.stiffness}
        self.felt = ExternalWrench(frame=frame, name="felt")
        within: list[Any] = [JointLimits()]
        formulation: Any
        if self.level == "velocity":
            self.hand: Any = Admittance(**spring, damping=(200.0, 200.0, self.damping))
            formulation = hqp.Velocity(law=P(5.0))
        else:
            critical = 2.0 * math.sqrt(STIFF * MASS)
            self.hand = Impedance(**spring, mass=MASS, damping=(critical, critical, self.damping))
            formulation = hqp.Acceleration(law=PD(100.0)) if self.level == "acceleration" else hqp.Torque(law=PD(100.0))
        if self.level == "torque":
            within += [TorqueLimits(), self.felt]
        stack = Stack(Level(self.hand, Orientation(frame=frame, name="turn")), Level(Posture()), subject_to=within)
        self.session = hqp.Controller(stack, formulation, deadline=np.inf).session(robot, DT)
        self.plant = Plant(
            robot,
            watched=(frame,),
            edit=table(self.softness),
            actuation="torque" if self.level == "torque" else "position",
            servo=Servo(other=4000.0, damping_time=0.01),
            delay=self.delay,
            sensors=Sensors(force=Noise(self.noise)),
        )
        self.q, self.v = self.plant.reset(robot.home.copy())
        self.start = robot.state(self.q, self.v).position(frame).copy()

    def go(self, seconds: float, bears: Any = (0.0, 0.0, 0.0), push: Any = (0.0, 0.0, 0.0)) -> None:
        """Run for a time [s]; push: external force on the hand, also measured by the sensor."""
        for _ in range(round(seconds / DT)):
            reading = self.plant.measure()
            force = reading.contacts.force[0] + push
            asked = [self.hand.at(self.start, force=force, bears=bears)]
            self.plant.push(self.frame, np.asarray(push))
            if self.level == "torque":
                asked.append(self.felt.at([*force, 0.0, 0.0, 0.0]))
                tick = self.session.step(self.robot.state(reading.q, reading.v), *asked)
                self.plant.step(tick.command, steps=2)
            else:  # servos follow the commanded robot
                tick = self.session.step(self.robot.state(self.q, self.v), *asked)
                self.q, self.v = tick.advance()
                motors = self.robot.actuated
                self.plant.step(self.q[motors], self.v[motors], steps=2)
            self.loads.append(float(self.plant.contacts().load[0]))
            self.commands.append(tick.command.copy())
            self.statuses.add(tick.status.name)

    @property
    def moved(self) -> Any:
        return self.plant.place(self.frame)[0] - self.start

    @property
    def jumps(self) -> Any:
        return np.abs(np.diff(self.commands, axis=0)).max(axis=1)[2:]


@pytest.mark.long
@pytest.mark.parametrize("softness", [0.004, 0.02])
@pytest.mark.parametrize(
    ("level", "damping", "most"), [("velocity", 500.0, 0.1), ("acceleration", 400.0, 30.0), ("torque", 400.0, 12.0)]
)
def test_a_table_is_pressed_with_twenty_newtons(level: str, damping: float, most: float, softness: float) -> None:
    """From the air onto a hard and a soft table, within 1 N; bounded change of the command per tick."""
    pytest.importorskip("mujoco")
    loop = Loop(level, damping, softness)
    loop.go(3.0, bears=(0.0, 0.0, 20.0))
    loads = np.array(loop.loads)
    assert loads[0] == 0.0
    np.testing.assert_allclose(loads[-200:], 20.0, atol=1.0)
    assert loop.jumps.max() <= most + 1e-9  # at velocity level, the JointLimits bound the change
    assert loop.statuses <= {"OPTIMAL", "RANK_UNCERTAIN"}


@pytest.mark.slow
def test_a_table_is_pressed_by_noisy_sensors_with_delay() -> None:
    pytest.importorskip("mujoco")
    loop = Loop("torque", delay=0.004, noise=0.5)
    loop.go(3.0, bears=(0.0, 0.0, 20.0))
    assert np.abs(np.array(loop.loads[-200:]) - 20.0).max() < 1.0


@pytest.mark.long
@pytest.mark.parametrize("level", ["velocity", "acceleration", "torque"])
def test_a_spring_is_as_stiff_as_asked(level: str) -> None:
    """With a push of 15 N the hand rests at F / K; without it the hand returns."""
    pytest.importorskip("mujoco")
    push = np.array([9.0, -12.0, 6.0])
    loop = Loop(level, 126.0, stiffness=(STIFF, STIFF, STIFF))
    loop.go(0.5)
    rest = loop.moved
    loop.go(2.0, push=push)
    moved = loop.moved - rest
    if level != "torque":  # servos are compliant, too
        moved = loop.robot.state(loop.q, loop.v).position(loop.frame) - loop.start
    np.testing.assert_allclose(moved, push / STIFF, atol=2e-4)
    loop.go(2.0)
    np.testing.assert_allclose(loop.moved, rest, atol=2e-4)
    assert loop.statuses <= {"OPTIMAL", "RANK_UNCERTAIN"}


def test_springs_are_laws_and_forces_feedforward() -> None:
    """(f - f_ref) / M adds to a_ref, (f - f_ref) / D to v_ref; 2 sqrt(K M) is the default damping."""
    mass = Impedance(frame="hand", axes="xz", stiffness=(100.0, 0.0), damping=(20.0, 8.0), mass=2.0)
    assert mass.law == PD((50.0, 0.0), (10.0, 4.0))
    found: Any = mass.at(force=[3.0, 5.0], bears=[1.0, 1.0], acceleration=[0.5, 0.0])
    np.testing.assert_allclose(found.acceleration, [1.5, 2.0])
    assert found.value is None
    assert found.velocity is None
    assert mass.at([0.1, 0.2]).acceleration is None
    damper: Any = Admittance(frame="hand", stiffness=100.0, damping=50.0)
    assert damper.law == P((2.0, 2.0, 2.0))
    np.testing.assert_allclose(damper.at(bears=[0.0, 0.0, 10.0]).velocity, [0.0, 0.0, -0.2])
    assert Impedance(frame="hand", stiffness=400.0, mass=4.0).damping == 80.0
    for element in (mass, damper):
        stack = Stack(Level(element))
        assert serial.loads(serial.dumps(stack)) == stack


@pytest.mark.parametrize(
    ("kind", "fields", "word"),
    [
        (Impedance, {"stiffness": -1.0}, "stiffness"),
        (Impedance, {"stiffness": (1.0, 2.0)}, "stiffness"),
        (Impedance, {"mass": 0.0}, "mass"),
        (Impedance, {"stiffness": "stiff"}, "stiffness"),
        (Impedance, {"stiffness": 0.0}, "damping"),
        (Impedance, {"law": PD(3.0)}, "law"),
        (Admittance, {"damping": 0.0}, "damping"),
        (Admittance, {"damping": math.nan}, "damping"),
    ],
)
def test_springs_that_are_none_are_refused(kind: Any, fields: dict[str, Any], word: str) -> None:
    with pytest.raises(DeclarationError, match=word):
        kind(**{"frame": "hand", **({"damping": 1.0} if kind is Admittance else {}), **fields})
    with pytest.raises(DeclarationError, match="force"):
        kind(frame="hand", damping=1.0).at(force=[1.0])

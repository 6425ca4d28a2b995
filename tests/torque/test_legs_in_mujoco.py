"""Robots on point feet in MuJoCo, with the frames of their files: they stand, shift, lift each foot, step."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

import hqp
from hqp import PD, Level, Stack
from hqp.errors import DeclarationError
from hqp.robots.on_mujoco import Plane, Plant, Ramp, Terrain
from hqp.tasks import Com, FixedContact, FrictionCone, Orientation, PointContact, Position, Posture, TorqueLimits

DT = 0.002
MU = 0.6
CATALOGUE = ("go2", "solo12", "anymal")
SLOPE = math.radians(15.0)


def legged(path: Path, legs: int, tilt: tuple[float, float, float]) -> hqp.robots.Robot:
    """Round trunk with three-joint legs on spheres; ``foot`` frames have roll, pitch, yaw [rad]."""
    links, joints = [], []
    inertia = '<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/>'
    light = '<inertia ixx="2e-3" ixy="0" ixz="0" iyy="2e-3" iyz="0" izz="2e-3"/>'
    links.append(f'<link name="trunk"><inertial><mass value="6"/>{inertia}</inertial></link>')
    for k in range(legs):
        yaw = 2.0 * math.pi * (k + 0.5) / legs
        x, y = 0.2 * math.cos(yaw), 0.2 * math.sin(yaw)
        chain = (("hip", "0 0 1", f"{x} {y} 0", f"0 0 {yaw}"), ("thigh", "0 1 0", "0.05 0 0", "0 0 0"),
                 ("shank", "0 1 0", "0.2 0 0", "0 0 0"))  # fmt: skip
        parent = "trunk"
        for part, axis, xyz, rpy in chain:
            name = f"{part}_{k}"
            ball = '<collision><origin xyz="0.25 0 0"/><geometry><sphere radius="0.02"/></geometry></collision>'
            links.append(
                f'<link name="{name}"><inertial><origin xyz="0.1 0 0"/><mass value="0.4"/>{light}</inertial>'
                f"{ball if part == 'shank' else ''}</link>"
            )
            joints.append(
                f'<joint name="{name}_joint" type="revolute"><parent link="{parent}"/><child link="{name}"/>'
                f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
                '<limit lower="-2.5" upper="2.5" effort="60" velocity="20"/></joint>'
            )
            parent = name
        links.append(f'<link name="foot_{k}"/>')
        joints.append(
            f'<joint name="foot_{k}_joint" type="fixed"><parent link="shank_{k}"/><child link="foot_{k}"/>'
            f'<origin xyz="0.25 0 0" rpy="{tilt[0]} {tilt[1]} {tilt[2]}"/></joint>'
        )
    path.write_text(f'<robot name="legs">{"".join(links)}{"".join(joints)}</robot>')
    robot = hqp.robots.load(path, floating=True)
    angles = robot.state().angles.copy()
    for k in range(legs):
        angles[robot.joints([f"hip_{k}_joint", f"thigh_{k}_joint", f"shank_{k}_joint"])] = 0.0, -0.6, 1.8
    q = robot.configuration(angles)
    q[:3], q[3:7] = 0.0, (0.0, 0.0, 0.0, 1.0)
    robot.set_home(q)
    return robot


class Stance:
    """Robot on point feet under torque control in MuJoCo; phases name the feet in the air."""

    def __init__(self, robot: Any, feet: tuple[str, ...], slope: float = 0.0, lifts: tuple[tuple[str, ...], ...] = ()):
        self.robot, self.feet, self.slope = robot, feet, slope
        self.turn = np.array([[math.cos(slope), 0, -math.sin(slope)], [0, 1, 0], [math.sin(slope), 0, math.cos(slope)]])
        q = robot.home.copy()
        if slope:
            half = 0.5 * slope
            x, y, z, w = q[3:7]
            s, c = -math.sin(half), math.cos(half)  # about -y
            q[3:7] = c * x + s * z, c * y + s * w, c * z - s * x, c * w - s * y
        terrain: Terrain = Ramp(start=-1.0, angle=slope, friction=MU) if slope else Plane(friction=MU)
        self.plant = Plant(robot, terrain=terrain, watched=feet)
        import mujoco

        for up in np.arange(0.0, 1.5, 0.001):  # lower it to the ground, the lowest sphere first
            q[2] = 1.2 - up
            self.plant.reset(q)
            mujoco.mj_forward(self.plant.model, self.plant.data)
            if self.plant.data.ncon:
                break
        self.q0, _ = self.plant.state()
        state = robot.state(self.q0)
        base = robot.landmarks["base"][0] if "base" in robot.landmarks else next(
            f.name for f in robot.model.frames if f.parentJoint == 1 and f.type.name == "BODY"
        )  # fmt: skip
        phases = {"all": (), **{"+".join(feet): feet for feet in lifts}}
        self.com, self.trunk = Com(law=PD(60.0, 14.0)), Orientation(frame=base, law=PD(60.0, 14.0))
        self.swings, contacts = {}, []
        for foot in feet:
            on = tuple(name for name, up in phases.items() if foot not in up)
            off = tuple(name for name, up in phases.items() if foot in up)
            contacts.append(PointContact(frame=foot, name=foot, when=on, law=PD(0.0, 40.0)))
            if off:
                self.swings[foot] = Position(frame=foot, name=f"{foot}_up", law=PD(300.0, 34.0), when=off)
        cones = [FrictionCone(contact=foot, mu=0.8 * MU) for foot in feet]
        levels = [Level(self.com, self.trunk), Level(Posture(law=PD(20.0, 9.0)))]
        if self.swings:
            levels.insert(1, Level(*self.swings.values()))
        stack = Stack(*levels, subject_to=[*contacts, *cones, TorqueLimits()])
        self.session = hqp.Controller(stack, hqp.Torque(), deadline=math.inf).session(robot, DT)
        self.start, self.places = state.com().copy(), {foot: state.position(foot).copy() for foot in feet}
        self.upright = state.rotation(base).copy()
        self.slip, self.statuses = 0.0, set[str]()

    def run(self, seconds: float, shift: Any = (0.0, 0.0, 0.0), phase: str = "all", height: float = 0.04) -> None:
        """Run for a time [s]; lift the feet of the phase and put them down again."""
        goal, ticks, up = (
            self.start + self.turn @ shift,
            round(seconds / DT),
            () if phase == "all" else phase.split("+"),
        )
        normal = self.turn[:, 2]
        for k in range(ticks):
            q, v = self.plant.state()
            state = self.robot.state(q, v)
            references = [self.com.at(goal), self.trunk.at(self.upright)]
            if phase != "all":
                s = 2.0 * math.pi * k / ticks
                lift, rate = 0.5 * height * (1.0 - math.cos(s)), 0.5 * height * math.sin(s) * 2.0 * math.pi / seconds
                references += [
                    self.swings[foot].at(self.places[foot] + lift * normal, velocity=rate * normal) for foot in up
                ]
            if self.slope:
                contacts = [e for e in self.session.stack.subject_to if isinstance(e, PointContact)]
                references += [c.at(normal=normal) for c in contacts if c.name not in up]
            tick = self.session.step(state, *references, phase=phase)
            self.statuses.add(tick.status.name)
            self.plant.step(tick.command, steps=round(DT / self.plant.timestep))
            for foot in self.feet:
                if foot not in up:
                    self.slip = max(self.slip, math.dist(self.plant.place(foot)[0][:2], self.places[foot][:2]))
        for foot in up:
            self.places[foot] = self.plant.place(foot)[0].copy()

    def off(self, shift: Any = (0.0, 0.0, 0.0)) -> float:
        """Distance of the CoM from its goal [m]."""
        return float(np.linalg.norm(self.plant.com() - self.start - self.turn @ shift))


def stand_and_shift(stance: Stance) -> None:
    stance.run(1.0)
    assert stance.off() < 0.02
    shift = (0.02, 0.02, -0.01)
    stance.run(1.0, shift)
    assert stance.off(shift) < 0.02
    stance.run(0.6)
    assert stance.slip < 0.02
    assert stance.statuses == {"OPTIMAL"}


@pytest.mark.long
@pytest.mark.parametrize("slope", [0.0, SLOPE])
def test_go2_stands_on_feet_whose_frames_lean(slope: float) -> None:
    """The z axes of its feet lean 52 degrees from the vertical."""
    robot = hqp.robots.load("go2")
    stance = Stance(robot, robot.landmarks["feet"], slope)
    stance.run(1.0)
    assert stance.off() < 0.02
    assert stance.slip < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("slope", [0.0, SLOPE])
@pytest.mark.parametrize("name", CATALOGUE)
def test_quadrupeds_stand_and_shift(name: str, slope: float) -> None:
    robot = hqp.robots.load(name)
    stand_and_shift(Stance(robot, robot.landmarks["feet"], slope))


@pytest.mark.slow
@pytest.mark.parametrize("slope", [0.0, SLOPE])
@pytest.mark.parametrize("legs", [3, 4, 6])
@pytest.mark.parametrize("tilt", [(0.0, 0.0, 0.0), (0.0, math.pi / 2, 0.4), (math.pi, 0.3, -2.0)])
def test_generated_robots_stand_and_shift(tmp_path: Path, legs: int, tilt: Any, slope: float) -> None:
    robot = legged(tmp_path / "legs.urdf", legs, tilt)
    stand_and_shift(Stance(robot, tuple(f"foot_{k}" for k in range(legs)), slope))


@pytest.mark.slow
@pytest.mark.parametrize("slope", [0.0, SLOPE])
@pytest.mark.parametrize("name", CATALOGUE)
def test_quadrupeds_lift_every_foot(name: str, slope: float) -> None:
    """Each foot slips up to 10 mm as it takes the load: go2 on the slope 25 to 33 mm with impratio from 10 to 1000."""
    robot = hqp.robots.load(name)
    lift_every_foot(robot, robot.landmarks["feet"], slope)


@pytest.mark.slow
@pytest.mark.parametrize("slope", [0.0, SLOPE])
@pytest.mark.parametrize("legs", [4, 6])
def test_generated_robots_lift_every_foot(tmp_path: Path, legs: int, slope: float) -> None:
    robot = legged(tmp_path / "legs.urdf", legs, (math.pi, 0.3, -2.0))
    lift_every_foot(robot, tuple(f"foot_{k}" for k in range(legs)), slope)


def lift_every_foot(robot: Any, feet: tuple[str, ...], slope: float) -> None:
    """Move the CoM above the other feet first."""
    stance = Stance(robot, feet, slope, lifts=tuple((foot,) for foot in feet))
    stance.run(0.5)
    for foot in feet:
        others = np.mean([stance.places[other] for other in feet if other != foot], axis=0) - stance.start
        shift = 0.7 * (stance.turn.T @ others) * [1.0, 1.0, 0.0]
        for share in np.linspace(0.1, 1.0, 10):
            stance.run(0.15, share * shift)
        stance.run(0.8, shift, phase=foot)
        for share in np.linspace(0.9, 0.0, 10):
            stance.run(0.15, share * shift)
    assert stance.off() < 0.03
    assert stance.slip < 0.04


@pytest.mark.parametrize("slope", [0.0, pytest.param(SLOPE, marks=pytest.mark.slow)])
@pytest.mark.parametrize("tilt", [(0.0, 0.0, 0.0), pytest.param((math.pi, 0.3, -2.0), marks=pytest.mark.slow)])
def test_a_hexapod_steps_on_the_spot_on_three_feet(tmp_path: Path, tilt: Any, slope: float) -> None:
    robot = legged(tmp_path / "legs.urdf", 6, tilt)
    feet = tuple(f"foot_{k}" for k in range(6))
    groups = feet[::2], feet[1::2]
    stance = Stance(robot, feet, slope, lifts=groups)
    stance.run(0.4)
    for _ in range(4):
        for group in groups:
            stance.run(0.25, phase="+".join(group))
            stance.run(0.1)
    stance.run(0.4)
    assert stance.off() < 0.02
    assert stance.slip < 0.04
    assert stance.statuses == {"OPTIMAL"}


def test_a_trot_on_point_feet_is_refused_by_name() -> None:
    """Two points leave the rotation about their line to no motor."""
    robot = hqp.robots.load("go2")
    front, back = robot.landmarks["feet"][0], robot.landmarks["feet"][3]
    with pytest.raises(DeclarationError, match=f"{front}.*do not determine the motion"):
        Stance(robot, robot.landmarks["feet"], lifts=((front, back),))


@pytest.mark.parametrize(("pitch", "off"), [(0.0, 0), (0.3, 17), (math.pi / 2, 90), (math.pi, 180)])
def test_a_sole_whose_z_does_not_stand_up_is_named(tmp_path: Path, pitch: float, off: int) -> None:
    """Name it unless the surface's normal is given."""
    robot = legged(tmp_path / "legs.urdf", 3, (0.0, pitch - 1.2, 0.0))
    for normal in (None, (0.0, 0.0, 2.0)):
        contacts = [FixedContact(frame=f"foot_{k}", normal=normal) for k in range(3)]
        cones = [FrictionCone(contact=contact.name, mu=0.5) for contact in contacts]
        stack = Stack(Level(Com()), subject_to=[*contacts, *cones])
        controller = hqp.Controller(stack, hqp.Torque(), deadline=math.inf)
        if normal is None and off > 45:
            with pytest.raises(DeclarationError, match=rf"foot_0.*{off} degrees off"):
                controller.session(robot, DT)
        else:
            assert controller.session(robot, DT).step(robot.state()).status.solved

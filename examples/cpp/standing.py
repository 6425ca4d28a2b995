"""G1 for standing.cpp: its plan at torque level and its MuJoCo model: ``python examples/cpp/standing.py FOLDER``."""

import sys
from pathlib import Path

import mujoco

import hqp
import hqp.tasks as t
from hqp import PD, Level, Stack
from hqp.robots import Plant

folder = Path(sys.argv[1])
robot = hqp.robots.load("g1")
soles, palms = robot.landmarks["soles"], robot.landmarks["palms"]
hands = [
    t.Position(frame=palm, name=side, law=PD(80.0, 18.0)) for palm, side in zip(palms, ("left", "right"), strict=True)
]
feet = [t.FixedContact(frame=sole, law=PD(0.0, 40.0)) for sole in soles]
stack = Stack(
    Level(t.Com(axes="xy", name="balance", law=PD(50.0, 14.0))),
    Level(*hands, t.Orientation(frame="pelvis", name="pelvis", law=PD(80.0, 18.0))),
    Level(t.Posture(law=PD(40.0, 12.0))),
    subject_to=[
        *feet,
        *(t.FrictionCone(contact=sole, mu=0.6) for sole in soles),
        *(t.UnilateralContact(contact=sole) for sole in soles),
        t.TorqueLimits(),
    ],
)
hqp.Controller(stack, hqp.Torque()).session(robot, dt=0.001, max_age=0.01).export(folder / "g1.hqp")
mujoco.mj_saveModel(Plant(robot, timestep=0.001).model, str(folder / "g1.mjb"), None)

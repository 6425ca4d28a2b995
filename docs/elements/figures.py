"""Pictures of the elements, each from a closed loop on the exact integrator: docs/elements/figures.py [NAME ...]"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pinocchio as pin

matplotlib.use("Agg")
import matplotlib.pyplot as plt

import hqp
import hqp.tasks as t
from hqp import PD, Level, P, Stack

DT = 0.002
FOLDER = Path(__file__).parents[1] / "figures"
TALOS, PANDA = hqp.robots.load("talos"), hqp.robots.load("panda")
LEFT, RIGHT = TALOS.landmarks["palms"]
FEET = [t.FixedContact(frame=sole, name=sole) for sole in TALOS.landmarks["soles"]]
SOLE = (-0.1, 0.1, -0.05, 0.05)
FORMULATIONS = {
    "velocity": hqp.Velocity(law=P(5.0)),
    "acceleration": hqp.Acceleration(law=PD(100.0), contact_law=PD(400.0)),
    "torque": hqp.Torque(law=PD(100.0), contact_law=PD(400.0)),
}
Measure = Callable[[Any, Any], Any]


def run(
    robot: Any,
    stack: Stack,
    references: Any,
    seconds: float,
    measure: Measure,
    formulation: Any = None,
    plant: Any = None,
    v0: Any = None,
) -> Any:
    """Measure (state, tick) in each tick; references: a list, or a function of time."""
    formulation = formulation or FORMULATIONS["velocity"]
    session = hqp.Controller(stack, formulation, deadline=math.inf).session(robot, DT)
    q, v, found = robot.home, np.zeros(robot.nv) if v0 is None else v0, []
    data = None if plant is None else plant.createData()
    for k in range(round(seconds / DT)):
        state = robot.state(q, v)
        given = references(k * DT, state) if callable(references) else references
        tick = session.step(state, *given)
        if plant is None:
            q, v = tick.advance()
        else:
            tau = np.zeros(robot.nv)
            tau[robot.actuated] = tick.command
            v = v + DT * pin.aba(plant, data, q, v, tau)
            q = robot.integrate(q, v, DT)
        found.append(np.array(measure(robot.state(q, v), tick), dtype=np.float64))
    return np.array(found)


def panel(axes: Any, values: Any, label: str = "", **style: Any) -> None:
    """One curve over time."""
    axes.plot(DT * np.arange(len(values)), values, label=label, lw=1.6, **style)


def finish(figure: Any, name: str, *panels: tuple[Any, str]) -> None:
    """Titles, legends, and the file."""
    for axes, title in panels:
        axes.set_title(title, fontsize=9)
        axes.grid(alpha=0.3)
        axes.tick_params(labelsize=8)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize=7)
        if not axes.get_xlabel():
            axes.set_xlabel("time [s]", fontsize=8)
    figure.tight_layout()
    figure.savefig(FOLDER / f"element_{name}.png", dpi=110)
    plt.close(figure)


def posture(kind: str = "velocity") -> Level:
    """The last level."""
    return Level(t.Posture(law=P(1.0) if kind == "velocity" else PD(20.0)))


def within() -> None:
    """A hand against a wall, and one that starts behind it."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 2.8))
    hand = t.Position(frame="panda_hand", name="hand")
    start = PANDA.state().position("panda_hand")
    for kind, formulation in FORMULATIONS.items():
        wall = t.Within(
            t.Position(frame="panda_hand", axes="x"),
            upper=float(start[0]) + 0.06,
            name="wall",
        )
        stack = Stack(Level(hand), posture(kind), subject_to=[wall])
        goal = [hand.at(start + [0.2, 0.0, 0.0])]
        x = run(
            PANDA,
            stack,
            goal,
            2.0,
            lambda s, _: s.position("panda_hand")[0] - start[0],
            formulation,
        )
        panel(left, 100 * x, kind)
        floor = t.Within(
            t.Position(frame="panda_hand", axes="z"),
            lower=float(start[2]) + 0.05,
            name="floor",
            recovery=0.05,
        )
        back = Stack(posture(kind), subject_to=[floor])
        z = run(
            PANDA,
            back,
            [],
            2.5,
            lambda s, _: s.position("panda_hand")[2] - start[2],
            formulation,
        )
        panel(right, 100 * z, kind)
    left.axhline(6.0, color="k", ls=":", lw=1)
    right.axhline(5.0, color="k", ls=":", lw=1)
    finish(
        figure,
        "within",
        (left, "goal 20 cm ahead, upper bound at 6 cm [cm]"),
        (right, "5 cm outside, recovery 5 cm/s [cm]"),
    )


def support_polygon() -> None:
    """Path of the CoM over the soles, with the polygon and without."""
    figure, axes = plt.subplots(figsize=(4.2, 3.6))
    hand = t.Position(frame=LEFT, name="hand")
    goal = [hand.at(TALOS.state().position(LEFT) + [0.6, 0.0, -0.4])]
    polygon = t.SupportPolygon(sole=SOLE, margin=0.02)
    for label, more in (("without", []), ("with, margin 2 cm", [polygon])):
        stack = Stack(Level(hand), posture(), subject_to=[*FEET, *more])
        com = run(TALOS, stack, goal, 2.0, lambda s, _: s.com()[:2])
        axes.plot(100 * com[:, 0], 100 * com[:, 1], label=label, lw=1.8)
    ready: Any = polygon.among(FEET)
    corners = ready.corners(TALOS.state())
    for foot in (corners[:4], corners[4:]):
        axes.fill(100 * foot[:, 0], 100 * foot[:, 1], color="0.85")
    edge = corners[t.support_polygon.hull(corners)]
    axes.plot(*(100 * np.vstack((edge, edge[:1]))).T, "k:", lw=1)
    axes.set_aspect("equal")
    axes.set_xlabel("x [cm]", fontsize=8)
    finish(figure, "support_polygon", (axes, "centre of mass over the soles, y [cm]"))


def directions() -> None:
    """An axis to a direction, to a point, and inside a cone about that."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 2.8))
    state = PANDA.state()
    R, p = state.rotation("panda_hand").copy(), state.position("panda_hand").copy()
    align = t.AlignAxis(frame="panda_hand", axis=(0.0, 0.0, 1.0), name="align")
    look = t.LookAt(frame="panda_hand", axis=(0.0, 0.0, 1.0), name="look")
    wanted = R @ [0.6, 0.3, 1.0] / np.linalg.norm([0.6, 0.3, 1.0])
    point = p + R @ [0.4, 0.2, 0.5]
    for task, goal in ((align, wanted), (look, point)):
        stack = Stack(Level(task), posture())
        e = run(
            PANDA,
            stack,
            [task.at(goal)],
            1.5,
            lambda s, _, k=task, g=goal: np.linalg.norm(k.error(s, g)),
        )
        panel(left, e, type(task).__name__)
    for kind, formulation in FORMULATIONS.items():
        cone = t.Cone(look, angle=0.2, name="cone", recovery=0.5)
        stack = Stack(posture(kind), subject_to=[cone])
        e = run(
            PANDA,
            stack,
            [cone.at(point)],
            2.5,
            lambda s, _: np.linalg.norm(look.error(s, point)),
            formulation,
        )
        panel(right, e, kind)
    right.axhline(0.2, color="k", ls=":", lw=1)
    finish(
        figure,
        "directions",
        (left, "angle to direction or point [rad]"),
        (right, "Cone of 0.2 rad [rad]"),
    )


def distance() -> None:
    """Two hands at a distance of 30 cm."""
    figure, axes = plt.subplots(figsize=(4.2, 2.8))
    apart = t.Distance(frame=LEFT, other=RIGHT, name="apart")
    stack = Stack(Level(apart), posture(), subject_to=FEET)
    found = run(TALOS, stack, [apart.at(0.3)], 1.5, lambda s, _: apart.value(s)[0])
    panel(axes, 100 * found, "left to right palm, gain 5 per s")
    axes.axhline(30.0, color="k", ls=":", lw=1, label="target, 30 cm")
    axes.set_ylim(0.0, None)
    axes.set_ylabel("distance [cm]", fontsize=8)
    finish(figure, "distance", (axes, "Talos brings its hands together"))


def weld() -> None:
    """A box between two hands: error of its shape, and its load while both are pulled apart."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 2.8))
    hand = t.Position(frame=LEFT, name="hand")
    goal = [hand.at(TALOS.state().position(LEFT) + [0.1, 0.0, 0.1])]
    for kind, formulation in FORMULATIONS.items():
        box = t.Weld(
            frame=LEFT,
            relative_to=RIGHT,
            name="box",
            law=P(20.0) if kind == "velocity" else PD(400.0),
        )
        start = box.value(TALOS.state()).copy()
        stack = Stack(Level(hand), posture(kind), subject_to=[*FEET, box])
        off = run(
            TALOS,
            stack,
            goal,
            1.5,
            lambda s, _, b=box, w=start: np.abs(b.value(s) - w).max(),
            formulation,
        )
        left.semilogy(
            DT * np.arange(len(off)), np.maximum(off, 1e-12), label=kind, lw=1.4
        )
    squeeze = t.ContactForce(contact="box", components=("fy",), name="squeeze")
    limits = t.ForceLimits(contact="box", force=30.0, moment=5.0)
    stack = Stack(Level(squeeze), posture("torque"), subject_to=[*FEET, box, limits])
    session = hqp.Controller(stack, FORMULATIONS["torque"], deadline=math.inf).session(
        TALOS, DT
    )
    q, v, force = TALOS.home, np.zeros(TALOS.nv), []
    for k in range(750):
        tick = session.step(
            TALOS.state(q, v), squeeze.at([60.0 * math.sin(4.0 * DT * k)])
        )
        force.append(session.program.contact_forces(tick.x)["box"][1])  # type: ignore[attr-defined]
        q, v = tick.advance()
    panel(right, np.array(force), "f_y")
    panel(right, 60.0 * np.sin(4.0 * DT * np.arange(len(force))), "wanted", ls=":")
    finish(
        figure,
        "weld",
        (left, "largest error of the pose [m, 1]"),
        (right, "force on the box, limit 30 N [N]"),
    )


def rates() -> None:
    """Motion of free joints by the last level; joint velocities; momentum of an arm's motion; a slow base."""
    figure, panels = plt.subplots(2, 2, figsize=(8, 5))
    hand = t.Position(frame="panda_hand", name="hand")
    hold = [hand.at(PANDA.state().position("panda_hand"))]
    J = PANDA.state().jacobian("panda_hand")[:3]
    v0 = np.eye(PANDA.nv)[2] * 0.5
    v0 -= np.linalg.pinv(J) @ (J @ v0)  # the elbow turns, the hand rests
    for label, last in (
        ("LowAcceleration", t.LowAcceleration()),
        ("Damping", t.Damping(law=PD(0.0, 4.0))),
    ):
        stack = Stack(Level(hand), Level(last))
        speeds = run(
            PANDA,
            stack,
            hold,
            1.5,
            lambda s, _: np.linalg.norm(s.v[:7]),
            FORMULATIONS["acceleration"],
            v0=v0,
        )
        panel(panels[0, 0], speeds, label)
    spin = t.JointVelocity(joints="panda_joint1", name="spin")
    v = run(
        PANDA,
        Stack(Level(spin), posture("acceleration")),
        lambda time, _: [spin.at(velocity=[0.5 * math.sin(2 * time)])],
        3.0,
        lambda s, _: s.v[0],
        hqp.Acceleration(law=PD(100.0)),
    )
    panel(panels[0, 1], v, "v")
    panel(panels[0, 1], 0.5 * np.sin(2 * DT * np.arange(len(v))), "v_ref", ls=":")
    arm = t.Position(frame=LEFT, relative_to="base_link", name="arm")
    goal = [arm.at(arm.value(TALOS.state()) + [0.2, 0.1, 0.3])]
    for label, levels in (
        ("without", []),
        ("Momentum above", [Level(t.Momentum(linear=""))]),
    ):
        L = run(
            TALOS,
            Stack(*levels, Level(arm)),
            goal,
            0.8,
            lambda s, _: np.linalg.norm(t.Momentum(linear="").jacobian(s) @ s.v),
        )
        panel(panels[1, 0], L, label)
    reach = t.Position(frame=LEFT, name="reach")
    far = [reach.at(TALOS.state().position(LEFT) + [0.4, 0.0, 0.2])]
    for label, more in (
        ("without", []),
        ("linear = 0.05", [t.BaseVelocityLimits(linear=0.05, angular=0.2)]),
    ):
        base = run(
            TALOS,
            Stack(Level(reach), subject_to=[*FEET, *more]),
            far,
            1.0,
            lambda s, _: np.abs(s.v[:3]).max(),
        )
        panel(panels[1, 1], base, label)
    titles = (
        "|v| of a turning elbow [rad/s]",
        "JointVelocity [rad/s]",
        "|angular momentum| [kg m2/s]",
        "base [m/s]",
    )
    finish(figure, "rates", *zip(panels.ravel(), titles, strict=True))


def manipulability() -> None:
    """An arm that reaches out, with a bound away from the stretched posture and without."""
    figure, axes = plt.subplots(figsize=(4.2, 2.8))
    hand = t.Position(frame="panda_hand", name="hand", law=P(2.0))
    w = t.Manipulability(frame="panda_hand", angular="", name="w")
    goal = [hand.at(PANDA.state().position("panda_hand") + [0.5, 0.0, 0.0])]
    for label, more in (
        ("without", []),
        ("Within(..., lower=0.08)", [t.Within(w, lower=0.08, name="agile")]),
    ):
        stack = Stack(Level(hand), posture(), subject_to=[t.JointLimits(), *more])
        panel(axes, run(PANDA, stack, goal, 2.0, lambda s, _: w.value(s)[0]), label)
    axes.axhline(0.08, color="k", ls=":", lw=1)
    finish(figure, "manipulability", (axes, "w of Panda's hand, goal 50 cm ahead [m3]"))


def frozen() -> None:
    """Two frozen joints of Panda, and one that freezes while it moves."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 2.8))
    names = ("panda_joint3", "panda_joint5")
    hand = t.Position(frame="panda_hand", name="hand")
    goal = [hand.at(PANDA.state().position("panda_hand") + [0.05, 0.2, 0.1])]
    stack = Stack(Level(hand), posture(), subject_to=[t.Frozen(joints=names)])
    moved = run(PANDA, stack, goal, 1.5, lambda s, _: s.q[:7] - PANDA.home[:7])
    for k in range(7):
        panel(left, moved[:, k], f"{k + 1}", ls="--" if k in (2, 4) else "-")
    v0 = np.zeros(PANDA.nv)
    v0[3] = 1.0
    stack = Stack(
        posture("torque"),
        subject_to=[t.Frozen(joints="panda_joint4", acceleration=10.0)],
    )
    panel(
        right,
        run(PANDA, stack, [], 1.0, lambda s, _: s.v[3], FORMULATIONS["torque"], v0=v0),
    )
    finish(
        figure,
        "frozen",
        (left, "joints of Panda, 3 and 5 frozen [rad]"),
        (right, "frozen at 1 rad/s [rad/s]"),
    )


def frame_speed() -> None:
    """A hand of Panda that reaches a far goal, free and in reduced-speed mode."""
    figure, axes = plt.subplots(figsize=(4.2, 2.8))
    hand = t.Position(frame="panda_hand", name="hand")
    goal = [hand.at(PANDA.state().position("panda_hand") + [0.1, 0.4, 0.1])]
    for label, more in (
        ("without", []),
        ("linear = 0.25", [t.FrameVelocityLimits(frame="panda_hand", linear=0.25)]),
    ):
        stack = Stack(Level(hand), posture(), subject_to=[t.JointLimits(), *more])
        speed = run(
            PANDA,
            stack,
            goal,
            2.5,
            lambda s, _: np.linalg.norm(s.velocity("panda_hand")[:3]),
        )
        panel(axes, speed, label)
    finish(figure, "frame_speed", (axes, "speed of the hand [m/s]"))


def motors() -> None:
    """Torque over speed of a joint at high load, and the motor's line."""
    figure, axes = plt.subplots(figsize=(4.2, 2.8))
    limits = t.TorqueSpeedLimits(no_load=2.0, corner=0.3)
    task = t.Posture(law=PD(300.0, 8.0), name="all")
    wanted = PANDA.state().angles[PANDA.joints(None)] + np.eye(9)[0] * 1.2
    found = run(
        PANDA,
        Stack(Level(task), subject_to=[limits]),
        lambda time, _: [task.at(wanted - 2.4 * (time > 1.0) * np.eye(9)[0])],
        2.0,
        lambda s, tick: [tick.state.v[0], tick.command[0]],
        hqp.Torque(),
    )
    axes.plot(found[:, 0], found[:, 1], ".", ms=2.5, label="a tick of 2 ms")
    speeds = np.linspace(-2.5, 2.5, 201)
    for side in (0, 1):
        line = [
            limits.bounds(PANDA.state(PANDA.home, np.full(PANDA.nv, v)))[side][0]
            for v in speeds
        ]
        axes.plot(speeds, line, "k:", lw=1, label="" if side else "bounds of the motor")
    axes.set_xlabel("speed [rad/s]", fontsize=8)
    axes.set_ylabel("torque [N m]", fontsize=8)
    finish(figure, "motors", (axes, "panda_joint1 swings 1.2 rad up and back"))


ARM = """<mujoco><compiler angle="radian"/><worldbody><body pos="0 0 1.4">
<joint name="shoulder" type="ball" range="0 1.3"/><geom type="capsule" fromto="0 0 0 0.15 0 -0.26" size="0.04"/>
<body pos="0.15 0 -0.26"><joint name="elbow" axis="0 -1 0" range="-1.4 1"/>
<geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03"/><body name="hand" pos="0.3 0 0"><geom size="0.04"/></body>
</body></body></worldbody></mujoco>"""


def balls() -> None:
    """A ball joint as shoulder, with its limit and without, and the range overhead."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 2.8))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.xml"
        path.write_text(ARM)
        robot = hqp.robots.load(str(path))
    hand = t.Position(frame="hand", law=P(5.0), name="hand")
    start = robot.state().position("hand").copy()
    for label, more in (("without", []), ("BallLimits, 1.3 rad", [t.BallLimits()])):
        found = run(
            robot,
            Stack(Level(hand), posture(), subject_to=more),
            lambda time, _: [
                hand.at(
                    start
                    + [-0.1 * math.sin(time) ** 2, 0.0, 0.35 * (1.0 - math.cos(time))]
                )
            ],
            2.0 * math.pi,
            lambda s, _: [np.linalg.norm(s.angles[:3]), s.position("hand")[2]],
        )
        panel(left, found[:, 0], label)
        panel(right, 100 * (found[:, 1] - start[2]), label)
    left.axhline(1.3, color="k", ls=":", lw=1)
    finish(
        figure,
        "balls",
        (left, "turn of the shoulder [rad]"),
        (right, "height of the hand [cm]"),
    )


def joint_torque() -> None:
    """Solo12 shifts its weight to and fro, with a target of one knee's torque below the balance and without."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 2.8))
    robot = hqp.robots.load("solo12")
    feet = [t.PointContact(frame=foot) for foot in robot.landmarks["feet"]]
    pushing = [t.UnilateralContact(contact=foot.frame) for foot in feet]
    com, trunk = (
        t.Com(law=PD(40.0), name="com"),
        t.Orientation(frame="base_link", law=PD(40.0)),
    )
    knee = t.JointTorque(joints="FL_KFE", name="knee")
    index, start = robot.joint_names.index("FL_KFE"), robot.state().com().copy()

    def goals(time: float, asked: bool) -> list[Any]:
        swing = [
            0.04 * math.sin(math.pi * time),
            0.04 * math.sin(2.0 * math.pi * time),
            0.0,
        ]
        return [
            com.at(start + swing),
            *([knee.at([0.1 + 0.05 * math.sin(6.0 * time)])] if asked else []),
        ]

    for label, below in (("without", []), ("JointTorque", [Level(knee)])):
        stack = Stack(Level(com, trunk), *below, subject_to=[*feet, *pushing])
        found = run(robot, stack, lambda time, _, asked=bool(below): goals(time, asked), 2.0,
                    lambda s, tick: [tick.command[index], *(100 * (s.com() - start)[:2])], hqp.Torque())  # fmt: skip
        panel(left, found[:, 0], label)
        right.plot(
            found[:, 1], found[:, 2], label=label, lw=1.6, ls="--" if below else "-"
        )
    panel(left, 0.1 + 0.05 * np.sin(6.0 * DT * np.arange(1000)), "reference", ls=":")
    right.set_xlabel("x [cm]", fontsize=8)
    finish(
        figure,
        "joint_torque",
        (left, "torque of a knee [N m]"),
        (right, "centre of mass, y [cm]"),
    )


def holding() -> None:
    """Talos, targets of both hands 1 m beyond reach, with the bound on holding torques and without."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 2.8))
    law = PD(25.0, 10.0, max_velocity=0.4)
    hands = [t.Position(frame=palm, name=palm, law=law) for palm in (LEFT, RIGHT)]
    stack = Stack(
        Level(t.Com(axes="xy", law=law)),
        Level(*hands),
        Level(t.Orientation(frame="base_link", law=PD(4.0))),
        Level(t.Posture(law=PD(1.0))),
        subject_to=[*FEET, t.JointLimits(), t.TorqueLimits()],
    )
    goals = [
        hand.at(TALOS.state().position(hand.frame) + [1.5, 0.0, 0.0]) for hand in hands
    ]
    torso = TALOS.actuated.tolist().index(int(TALOS.joints("torso_2_joint")[0]))
    for label, share in (("Torque(holding=None)", None), ("holding=0.8", 0.8)):
        found = run(TALOS, stack, goals, 2.5,
                    lambda s, tick: [tick.command[torso], *s.com()[[0, 2]]], hqp.Torque(holding=share))  # fmt: skip
        panel(left, found[:, 0], label)
        panel(right, 100 * (found[:, 2] - TALOS.state().com()[2]), label)
    for side in (-1.0, 1.0):
        left.axhline(
            side * TALOS.effort_limit[TALOS.actuated[torso]], color="k", ls=":", lw=1
        )
    finish(
        figure,
        "holding",
        (left, "torque of torso_2_joint [N m]"),
        (right, "height of the CoM, from its start [cm]"),
    )


def loads() -> None:
    """Panda with 3 kg in its hand, and under a push of 40 N, known to the controller or not."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 2.8))
    hand = t.Position(frame="panda_hand", name="hand")
    load, push = t.Payload(frame="panda_hand"), t.ExternalWrench(frame="panda_hand")
    start = PANDA.state().position("panda_hand").copy()
    heavy = PANDA.model.copy()
    host = heavy.frames[heavy.getFrameId("panda_hand")]
    heavy.appendBodyToJoint(
        host.parentJoint,
        pin.Inertia(3.0, np.array([0, 0, 0.1]), np.zeros((3, 3))),
        host.placement,
    )
    stack = Stack(Level(hand), posture("torque"), subject_to=[load, push])
    goal = hand.at(start + [0.0, 0.0, 0.1])
    for label, more in (
        ("not told", []),
        ("load.at(3.0, (0, 0, 0.1))", [load.at(3.0, [0.0, 0.0, 0.1])]),
    ):
        z = run(PANDA, stack, [goal, *more], 1.5, lambda s, _: s.position("panda_hand")[2] - start[2],
                FORMULATIONS["torque"], heavy)  # fmt: skip
        panel(left, 100 * z, label)
    session_goal = hand.at(start)
    wrench = np.array([0.0, 40.0, 0.0, 0.0, 0.0, 0.0])
    for label, told in (("not told", False), ("push.at(w)", True)):
        session = hqp.Controller(
            stack, FORMULATIONS["torque"], deadline=math.inf
        ).session(PANDA, DT)
        q, v, y = PANDA.home, np.zeros(PANDA.nv), []
        data = PANDA.model.createData()
        for k in range(750):
            w = wrench * (k > 200)
            tick = session.step(
                PANDA.state(q, v), session_goal, *([push.at(w)] if told else [])
            )
            tau = PANDA.state(q, v).jacobian("panda_hand").T @ w
            tau[PANDA.actuated] += tick.command
            v = v + DT * pin.aba(PANDA.model, data, q, v, tau)
            q = PANDA.integrate(q, v, DT)
            y.append(PANDA.state(q).position("panda_hand")[1] - start[1])
        panel(right, 100 * np.array(y), label)
    finish(
        figure,
        "loads",
        (left, "Payload: height of the hand, goal 10 cm [cm]"),
        (right, "pushed by 40 N [cm]"),
    )


def nominal_torque() -> None:
    """UR5, floating with friction of 1 N m in its joints: a hand pushes it down, onto a virtual floor or not."""
    figure, axes = plt.subplots(1, 2, figsize=(7.6, 2.8))
    robot = hqp.robots.load("ur5")
    robot.set_home([0.0, -1.4, 1.9, -2.0708, 1.5708, 0.0])
    hand, force = t.Position(frame="tool0", axes="z"), np.zeros(6)
    floor = t.Within(hand, lower=-0.05, law=PD(400.0), name="floor")
    friction, nominal = t.JointLoad(), t.NominalTorque()
    push = t.ExternalWrench(frame="tool0", resisted=False)
    start = robot.state().position("tool0").copy()
    for label, bounds in (("floating", []), ("a floor 5 cm below", [floor])):
        stack = Stack(subject_to=[*bounds, friction, nominal, push])
        session = hqp.Controller(
            stack, hqp.Torque(holding=None), price=0, deadline=math.inf
        ).session(robot, DT)
        data, held = robot.model.createData(), robot.model.createData()
        q, v, found, changes = robot.home, np.zeros(robot.nv), [], []
        for k in range(500):
            force[2] = -20.0 * (k > 100)
            d, state = -np.tanh(v / 0.05), robot.state(q, v)
            gravity = pin.computeGeneralizedGravity(robot.model, held, q)
            tau_n = gravity - d - 4.0 * v
            pulled = state.jacobian("tool0").T @ force
            given = [friction.at(d), nominal.at(tau_n), push.at(force)]
            tick = session.step(state, *given, *(e.at(start[2:]) for e in bounds))
            changes.append(np.abs(tick.command - tau_n).max())
            pulled += tick.command + d
            v = v + DT * pin.aba(robot.model, data, q, v, pulled)
            q = robot.integrate(q, v, DT)
            found.append(robot.state(q).position("tool0")[2] - start[2])
        panel(axes[0], 100 * np.array(found), label)
        panel(axes[1], np.array(changes), label)
    finish(
        figure,
        "nominal_torque",
        (axes[0], "height of the hand, pushed down by 20 N [cm]"),
        (axes[1], "largest change of the nominal torque [N m]"),
    )


def balance() -> None:
    """Shift of the load onto the left foot: the DCM converges to its plan; the loads follow their share."""
    from hqp.walking import DcmPlan, Piece, natural_frequency

    names = [foot.frame for foot in FEET]
    soles = [t.CenterOfPressure(contact=name, rectangle=SOLE) for name in names]
    element, share = t.Balance(margin=0.005), t.LoadShare(contacts=(names[1], names[0]))
    trunk = t.Orientation(frame="base_link", name="trunk")
    levels = [
        Level(element, t.Com(axes="z", name="height")),
        Level(trunk),
        Level(t.Posture()),
    ]
    stack = Stack(*levels, Level(share, price=0), subject_to=[*FEET, *soles])
    state = TALOS.state()
    start, over = state.com()[:2] + [0.0, 0.02], state.position(names[0])[:2]
    omega = natural_frequency(state.com()[2])
    plan = DcmPlan(
        [Piece(0.5, start, start), Piece(0.8, start, over), Piece(0.7, over, over)],
        omega,
    )
    ready: Any = element.among([*FEET, *soles])

    def references(now: float, _: Any) -> Any:
        return [
            element.at(*plan.at(now)),
            share.at(0.5 + 0.5 * min(max((now - 0.5) / 0.8, 0.0), 1.0)),
        ]

    def measure(s: Any, tick: Any) -> Any:
        given = np.concatenate(plan.at(len(seen) * DT))
        seen.append(0)
        forces = tick.program.contact_forces(tick.solution.x)
        dcm = s.com()[1] + s.com_velocity()[1] / omega
        return [
            dcm,
            given[3],
            ready.zmp(s, given)[0][1],
            given[1],
            *(forces[name][2] for name in names),
        ]

    seen: list[int] = []
    found = run(TALOS, stack, references, 2.0, measure, hqp.Torque(holding=None))
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.6, 3.0))
    for k, label, style in (
        (0, "DCM", "-"),
        (1, "its plan", ":"),
        (2, "ZMP", "-"),
        (3, "its plan", ":"),
    ):
        panel(left, 100 * found[:, k], label, ls=style, color="C0" if k < 2 else "C1")
    for k, label in ((4, "left"), (5, "right")):
        panel(right, found[:, k], label)
    finish(
        figure,
        "balance",
        (left, "Balance: sideways [cm]"),
        (right, "LoadShare: normal forces [N]"),
    )


def compliance() -> None:
    """A press on a table, and a push against a spring."""
    import mujoco

    from hqp.robots.on_mujoco import Plant

    def table(spec: Any) -> None:
        box = spec.worldbody.add_geom(
            name="table", pos=[0.5, 0, 0.35], size=[0.4, 0.5, 0.05]
        )
        box.type, box.priority = mujoco.mjtGeom.mjGEOM_BOX, 2

    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 2.8))
    frame, push = "panda_hand", np.array([15.0, 0.0, 0.0])
    for k, mass in ((0.0, 4.0), (500.0, 4.0), (1000.0, 4.0)):
        along = (1000.0, 1000.0, k) if k == 0.0 else k
        damping = (130.0, 130.0, 400.0) if k == 0.0 else None
        hand = t.Impedance(
            frame=frame, stiffness=along, damping=damping, mass=mass, name="hand"
        )
        felt = t.ExternalWrench(frame=frame)
        turn = t.Orientation(frame=frame, law=PD(100.0), name="turn")
        stack = Stack(
            Level(hand, turn),
            posture("torque"),
            subject_to=[t.TorqueLimits(), t.JointLimits(), felt],
        )
        session = hqp.Controller(stack, hqp.Torque(), deadline=math.inf).session(
            PANDA, DT
        )
        plant = Plant(PANDA, watched=(frame,), edit=table if k == 0.0 else None)
        plant.reset(PANDA.home.copy())
        start, found = plant.place(frame)[0], []
        for tick in range(1300):
            reading = plant.measure()
            pushed = push if k and 250 <= tick < 900 else np.zeros(3)
            force = reading.contacts.force[0] + pushed
            asked = hand.at(force=force, bears=[0.0, 0.0, 20.0 if k == 0.0 else 0.0])
            state = PANDA.state(reading.q, reading.v)
            given = session.step(state, asked, felt.at([*force, 0.0, 0.0, 0.0]))
            plant.push(frame, pushed)
            plant.step(given.command, steps=2)
            load, moved = plant.contacts().load[0], plant.place(frame)[0] - start
            found.append(load if k == 0.0 else 1000 * moved[0])
        if k == 0.0:
            panel(left, np.array(found), "measured")
        else:
            panel(right, np.array(found), f"K = {k:.0f} N/m")
    left.axhline(20.0, color="k", ls=":", lw=1)
    for k in (500.0, 1000.0):
        right.axhline(15e3 / k, color="k", ls=":", lw=1)
    finish(
        figure,
        "compliance",
        (left, "a table pressed from the air, 20 N asked [N]"),
        (right, "pushed by 15 N: moved, F / K dotted [mm]"),
    )


ALL = (
    compliance, balance, within, support_polygon, directions, distance, weld, rates, manipulability, frozen, frame_speed, motors, balls,
    joint_torque, holding, loads, nominal_torque,
)  # fmt: skip

if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for draw in ALL:
        if len(sys.argv) < 2 or draw.__name__ in sys.argv[1:]:
            draw()
            print(draw.__name__)

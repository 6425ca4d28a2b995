"""CPU times of ticks of hands that follow a goal, beside placo's weighted program of the same tasks, turn by turn.

``python -m benchmarks.speed.beside_placo`` prints the table of docs/results/solver.md.  It needs an environment with
placo, whose time is that of ``solve`` and ``update_kinematics`` with the hands' targets set.  Ours is, in turns of a
tick each: ``step`` with a state and references that exist, the whole loop with them and ``advance``, and ``tick`` with
arrays and its next state.
"""

from __future__ import annotations

import argparse
import gc
from collections.abc import Callable
from dataclasses import replace
from time import thread_time_ns
from typing import Any, Protocol

import numpy as np

import hqp
from benchmarks.reports import machine
from benchmarks.speed import teleoperation, unmet
from hqp import PD, Level, Stack
from hqp.arrays import Mat, Vec
from hqp.markdown import table
from hqp.tasks import Com, FixedContact, FrictionCone, JointLimits, Posture, TorqueLimits
from tests.scenes.mistry2008 import HZ

SCENES = {"ur5": ("hard",), "panda": ("hard",), "talos": ("soft", "hard"), "g1": ("soft", "hard")}
"""Robots, with the priorities of placo's task of the CoM at velocity level."""

TORQUE, FRICTION = 1e-3, 0.7
"""Period at torque level [s]; coefficient of friction of the soles."""

KP, SLOW = 100.0, 20.0
"""Gains of hands; of CoM and posture [1/s^2]."""


class Run(Protocol):
    """A library in a closed loop."""

    spent: list[int]

    def run(self, aims: list[Mat]) -> None:
        """One tick, its CPU time [ns] appended to ``spent``."""
        ...


class Ours:
    """A session in a closed loop; what: the part of a tick that is timed, ``step``, ``loop`` or ``tick``."""

    def __init__(self, scene: teleoperation.Scene, start: Vec, what: str, torque: bool = False) -> None:
        formulation, dt = (hqp.Torque(), TORQUE) if torque else (hqp.Velocity(), 1.0 / HZ)
        controller = hqp.Controller(scene.stack, formulation, solver="lexicographic")
        self.robot, self.hands, self.spent = scene.robot.copy(), scene.hands, list[int]()
        self.session = controller.session(self.robot, dt)
        self.q, self.v = start.copy(), np.zeros(self.robot.nv)
        self.run: Callable[[list[Mat]], None] = getattr(self, what)

    def step(self, aims: list[Mat]) -> None:
        """Time ``session.step`` alone."""
        state = self.robot.state(self.q, self.v)
        references = [hand.at(aim) for hand, aim in zip(self.hands, aims, strict=True)]
        begin = thread_time_ns()
        tick = self.session.step(state, *references)
        self.spent.append(thread_time_ns() - begin)
        self.q, self.v = tick.advance()

    def loop(self, aims: list[Mat]) -> None:
        """Time state, references, ``step`` and ``advance``."""
        begin = thread_time_ns()
        state = self.robot.state(self.q, self.v)
        tick = self.session.step(state, *[hand.at(aim) for hand, aim in zip(self.hands, aims, strict=True)])
        self.q, self.v = tick.advance()
        self.spent.append(thread_time_ns() - begin)

    def tick(self, aims: list[Mat]) -> None:
        """Time ``session.tick`` with arrays, and its next state."""
        targets = {hand.name: aim for hand, aim in zip(self.hands, aims, strict=True)}
        begin = thread_time_ns()
        tick = self.session.tick(self.q, self.v, targets)
        self.q, self.v = tick.advance()
        self.spent.append(thread_time_ns() - begin)


class Kinematics(unmet.Placo):
    """placo's kinematics solver."""

    def run(self, aims: list[Mat]) -> None:
        """One step of it towards these poses."""
        self.aims = aims
        self.step()


class Dynamics:
    """placo's dynamics solver: hands, CoM and posture soft, planar contacts with friction, limits of torques."""

    def __init__(self, scene: teleoperation.Scene, start: Vec) -> None:
        placo, self.model = teleoperation.placo_model(scene, start)
        model, self.spent, robot = self.model, list[int](), scene.robot
        self.solver = solver = placo.DynamicsSolver(model)
        solver.dt = TORQUE
        self.tasks = []
        for hand in scene.hands:
            task = solver.add_frame_task(hand.frame, model.get_T_world_frame(hand.frame))
            task.configure(hand.frame, "soft", 1.0, 1.0)
            task.position().kp = task.orientation().kp = KP
            self.tasks.append(task)
        if robot.floating:
            self._stand(scene)
        else:
            solver.mask_fbase(True)
        posture = solver.add_joints_task()
        posture.set_joints({name: float(model.get_joint(name)) for name in model.joint_names()})
        posture.configure("posture", "soft", 1e-3)
        posture.kp = SLOW
        solver.enable_torque_limits(True)
        solver.enable_joint_limits(True)

    def _stand(self, scene: teleoperation.Scene) -> None:
        solver, model = self.solver, self.model
        for sole in scene.robot.landmarks["soles"]:
            frame = teleoperation.placo_sole(scene, model, sole)
            task = solver.add_frame_task(frame, model.get_T_world_frame(frame))
            task.configure(frame, "hard", 1.0, 1.0)
            contact = solver.add_planar_contact(task)
            contact.mu, contact.unilateral, contact.length, contact.width = FRICTION, True, 0.2, 0.1
        com = solver.add_com_task(model.com_world())
        com.configure("com", "soft", 10.0)
        com.kp = SLOW

    def run(self, aims: list[Mat]) -> None:
        """Solve and integrate towards these poses; raises where placo does."""
        begin = thread_time_ns()
        for task, aim in zip(self.tasks, aims, strict=True):
            task.T_world_frame = aim
        self.solver.solve(True)
        self.model.update_kinematics()
        self.spent.append(thread_time_ns() - begin)


def at_torque_level(scene: teleoperation.Scene) -> teleoperation.Scene:
    """The scene's robot with the same hands as accelerations, on contacts with friction, within limits of torques."""
    hands = tuple(replace(hand, law=PD(KP)) for hand in scene.hands)
    levels = [Level(*hands), Level(Posture(law=PD(SLOW)))]
    limits: list[Any] = [TorqueLimits(), JointLimits()]
    if scene.robot.floating:
        feet = [FixedContact(frame=sole) for sole in scene.robot.landmarks["soles"]]
        limits = [*feet, *(FrictionCone(contact=foot.name, mu=FRICTION) for foot in feet), *limits]
        levels = [Level(Com(law=PD(SLOW))), *levels]
    return teleoperation.Scene(scene.robot, Stack(*levels, subject_to=limits), hands)


def measure(name: str, com: str, ticks: int) -> tuple[str, ...]:
    """A row: median times of placo and ``step`` [us], and ours over placo's; com: "torque" for the torque level."""
    scene, torque = teleoperation.scene(name), com == "torque"
    start = scene.robot.home.copy()
    if name in teleoperation.START:
        step = np.array(teleoperation.START[name]) - scene.robot.state().angles
        start = scene.robot.integrate(start, step, 1.0)
    scene = at_torque_level(scene) if torque else scene
    state = scene.robot.state(start)
    starts = [np.array(hand.value(state)) for hand in scene.hands]
    scene.robot.set_home(start)
    ours = [Ours(scene, start, what, torque) for what in ("step", "loop", "tick")]
    rival: Run = Dynamics(scene, start) if torque else Kinematics(scene, starts, com)
    gc.collect()
    gc.disable()
    try:
        for i in range(-unmet.WARM_UP, ticks):
            aims = teleoperation.goals(starts, max(i, 0) * (TORQUE if torque else 1.0 / HZ))
            for run in (*ours, rival):
                run.run(aims)
    finally:
        gc.enable()
    of_placo, *medians = (float(np.median(run.spent[unmet.WARM_UP :])) for run in (rival, *ours))
    title = f"{name}, torques" if torque else f"{name}, placo's CoM {com}" if scene.robot.floating else name
    return title, f"{of_placo / 1e3:.1f}", f"{medians[0] / 1e3:.1f}", *(f"{us / of_placo:.2f}" for us in medians)


def main() -> None:
    """Measure all, print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=5000, metavar="N")
    ticks = parser.parse_args().ticks
    rows = [measure(name, com, ticks) for name, priorities in SCENES.items() for com in priorities]
    rows += [measure(name, "torque", ticks) for name in ("ur5", "talos", "g1")]
    print(table(("scene", "placo us", "`step` us", "`step`", "whole loop", "`tick`"), rows))
    print(f"\n{machine.line()}")


if __name__ == "__main__":
    main()

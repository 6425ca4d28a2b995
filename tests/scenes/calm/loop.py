"""A closed loop on the exact integrator, and figures of its calm."""

from __future__ import annotations

import math
from dataclasses import dataclass
from time import thread_time

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.errors import StaleState
from hqp.tasks import JointLimits
from hqp.torque.program import TorqueProgram
from tests.scenes.calm.scenes import FORMULATIONS, Scene
from tests.scenes.calm.variants import Variant

NOTICEABLE = 1e-3
"""Threshold of a change of command, as a share of the joint's limit."""


@dataclass(eq=False)
class Run:
    """Record of a loop, a row or a number per tick.

    commands, accelerations ``(ticks, k)`` of the actuated joints.  error: distance of the tracked frame from its goal
    [m]; above: largest residual of the levels above it [of their rows]; contact, com: displacement of a foot and the
    CoM [m]; over: excess of a joint over its position limit [rad, m]; load: least vertical force on a contact [N];
    times: CPU time of a step [s].  statuses: ticks by status.  scale: limit of each command.
    """

    scene: Scene
    commands: Mat
    accelerations: Mat
    error: Vec
    above: Vec
    contact: Vec
    com: Vec
    over: Vec
    load: Vec
    times: Vec
    statuses: dict[str, int]
    scale: Vec

    @classmethod
    def empty(cls, scene: Scene, ticks: int) -> Run:
        """An empty run."""
        k = len(scene.subject.robot.joint_names)
        numbers = (np.zeros(ticks) for _ in range(7))
        return cls(scene, np.zeros((ticks, k)), np.zeros((ticks, k)), *numbers, {}, limits(scene))


def run(scene: Scene, variant: Variant, ticks: int = 1500) -> Run:
    """Execute the commands exactly for ``ticks`` periods."""
    who, robot = scene.subject, scene.subject.robot
    session = variant.of(scene.stack, FORMULATIONS[scene.formulation]).session(robot, scene.dt)
    feet = who.feet
    data = Run.empty(scene, ticks)
    q, v = robot.home.copy(), np.zeros(robot.nv)
    state = robot.state(q, v)
    at_start = [state.position(foot) for foot in feet]
    com = state.com()[:2]
    frame = scene.stack.find(scene.tracked).frame  # type: ignore[attr-defined]
    place = state.position(frame)
    joints = robot.actuated
    low, high = robot.lower[joints], robot.upper[joints]
    for i in range(ticks):
        goals = scene.targets(i * scene.dt)
        place = goals[0].value if goals else place
        state = robot.state(q, v)
        data.error[i] = np.linalg.norm(state.position(frame) - place)
        data.contact[i] = max(
            (np.linalg.norm(state.position(f) - p) for f, p in zip(feet, at_start, strict=True)), default=0.0
        )
        data.com[i] = np.linalg.norm(state.com()[:2] - com) if feet else 0.0
        angles = state.angles[joints]
        data.over[i] = max(0.0, float(np.max(angles - high)), float(np.max(low - angles)))
        begin = thread_time()
        tick = session.step(state, *goals)
        data.times[i] = thread_time() - begin
        data.commands[i] = tick.command
        data.statuses[tick.status.name] = data.statuses.get(tick.status.name, 0) + 1
        if tick.solution is not None:
            places = session.program.places
            rows = [tick.solution.residuals[places[n].level][places[n].part] for n in scene.above if n in places]
            if isinstance(session.program, TorqueProgram) and feet:
                forces = session.program.contact_forces(tick.solution.x)
                data.load[i] = min(float(forces[contact.name][2]) for contact in who.contacts)
            data.above[i] = max((float(np.abs(w).max(initial=0.0)) for w in rows), default=0.0)
        try:
            q, v_next = tick.advance()
        except StaleState:  # no dynamics at such a state: the robot has fallen, the rest stays zero
            data.com[i:] = math.inf
            break
        data.accelerations[i] = (v_next - v)[joints] / scene.dt
        v = v_next
    return data


def limits(scene: Scene) -> Vec:
    """Largest command of each joint, the scale of noticeable changes [rad/s, rad/s^2 or N m]."""
    robot = scene.subject.robot
    if scene.formulation == "velocity":
        limit = robot.velocity_limit[robot.actuated]
    elif scene.formulation == "acceleration":
        limit = JointLimits().rates(robot)[0]
        limit = limit[np.searchsorted(JointLimits().selection(robot), robot.actuated)]
    else:
        limit = robot.effort_limit[robot.actuated]
    return np.where(np.isfinite(limit), limit, 10.0)


def figures(data: Run) -> dict[str, float | str]:
    """Figures of a run over its second half: jumps, reversals, accelerations, errors [SI], times [us]."""
    half = data.commands.shape[0] // 2
    change = np.diff(data.commands[half:], axis=0)
    size, seconds = data.scale * NOTICEABLE, (data.commands.shape[0] - half) * data.scene.dt
    noticed = np.abs(change) > size
    flips = (change[1:] * change[:-1] < 0.0) & noticed[1:] & noticed[:-1]
    share = np.abs(change) / data.scale
    largest = np.abs(data.accelerations[half:]).max(axis=1)
    return {
        "jump": float(np.abs(change).max()),
        "jump_share": float(share.max()),
        "jump_p50": float(np.median(np.abs(change).max(axis=1))),
        "jump_p99": float(np.quantile(np.abs(change).max(axis=1), 0.99)),
        "jump_start": float(np.abs(np.diff(data.commands, axis=0, prepend=0.0 * data.commands[:1])[:half]).max()),
        "reversals": float(flips.sum(axis=0).max() / seconds),
        "acceleration_p50": float(np.median(largest)),
        "acceleration_p99": float(np.quantile(largest, 0.99)),
        "error": float(data.error[half:].mean()),
        "error_end": float(data.error[-1]),
        "above": float(data.above[half:].max()),
        "contact": float(data.contact.max()),
        "com": float(data.com.max()),
        "over": float(data.over.max()),
        "load": float(data.load.min()),
        "tick_p50": float(np.median(data.times) * 1e6),
        "tick_p99": float(np.quantile(data.times, 0.99) * 1e6),
        "tick_max": float(data.times.max() * 1e6),
        "statuses": ", ".join(f"{n} {k}" for n, k in sorted(data.statuses.items())),
    }

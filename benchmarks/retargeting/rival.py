"""GMR's scheme on mink: weighted frame tasks, Levenberg damping 1, up to ten iterations a frame, speeds below 3 pi."""

from __future__ import annotations

import time
from typing import Any

import mink
import mujoco
import numpy as np

from hqp.lab.rivals.urdf import urdf
from hqp.motion.joints import SIDES
from hqp.motion.stacks import Stacks
from hqp.motion.targets import Targets

FOOT, FOOT_LATCHED, HAND, REST, TURN = 50.0, 100.0, 50.0, 10.0, 10.0
SPEED, DAMPING, GAIN, MOST = 3.0 * np.pi, 1.0, 0.5, 10
SETTLING = 60


def follow(robot: Any, stacks: Stacks, targets: Targets, *, latched: bool) -> tuple[Any, float]:
    """Configurations ``(T, nq)`` of hqp's robot, and CPU time [s].  latched: hold the targets of standing feet."""
    frames = stacks.frames
    model = compiled(urdf(robot, frames.values()))
    model.opt.timestep = 1.0 / targets.fps
    configuration = mink.Configuration(model)
    tasks = _tasks(frames, latched)
    limits = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, dict.fromkeys(robot.joint_names, SPEED))]
    columns = [int(model.joint(name).qposadr[0]) for name in robot.joint_names]
    q = configuration.q.copy()
    q[:3] = targets.places["pelvis"][0]
    q[3:7] = (1.0, 0.0, 0.0, 0.0)
    q[columns] = robot.state(robot.home).angles[robot.actuated]
    configuration.update(q)
    poses = _poses(stacks, targets)
    for _ in range(SETTLING):
        _frame(configuration, tasks, limits, poses, 0)
    found, begin = [], time.process_time()
    for i in range(len(targets)):
        _frame(configuration, tasks, limits, poses, i)
        found.append(configuration.q.copy())
    spent = time.process_time() - begin
    return np.array([_back(robot, q, columns) for q in found]), spent


def compiled(text: str) -> Any:
    """MuJoCo's model of a URDF whose massless frames are kept, with a free base."""
    told = '<mujoco><compiler fusestatic="false" boundmass="1e-6" boundinertia="1e-9" balanceinertia="true"/></mujoco>'
    spec = mujoco.MjSpec.from_string(text.replace("</robot>", f"{told}</robot>"))
    spec.worldbody.first_body().add_freejoint()
    return spec.compile()


def _tasks(frames: Any, latched: bool) -> dict[str, Any]:
    def task(part: str, position: float, turn: float) -> Any:
        return mink.FrameTask(frames[part], "body", position, turn, lm_damping=1.0)

    foot = FOOT_LATCHED if latched else FOOT
    tasks = {"pelvis": task("pelvis", REST, TURN), "torso": task("torso", 0.0, TURN)}
    for side in SIDES:
        tasks[f"{side}_sole"] = task(f"{side}_sole", foot, TURN)
        tasks[f"{side}_hand"] = task(f"{side}_hand", HAND, 0.0)
        tasks |= {f"{side}_{limb}": task(f"{side}_{limb}", REST, 0.0) for limb in ("elbow", "knee")}
    return tasks


def _poses(stacks: Stacks, targets: Targets) -> dict[str, tuple[Any, Any]]:
    """Rotations and positions of the frames, the points of the map taken back to the frames' origins."""
    n, plain = len(targets), np.broadcast_to(np.eye(3), (len(targets), 3, 3))
    hips = targets.axes["hips"]
    poses = {"pelvis": (hips, targets.places["pelvis"] - hips @ stacks.body.middle)}
    poses["torso"] = (targets.axes["torso"], np.zeros((n, 3)))
    for side in SIDES:
        axes = targets.axes[f"{side}_sole"]
        offset = np.array(stacks.in_frame(side, np.zeros(3)))
        poses[f"{side}_sole"] = (axes, targets.places[f"{side}_sole"] - axes @ offset)
        poses |= {f"{side}_{limb}": (plain, targets.places[f"{side}_{limb}"]) for limb in ("hand", "elbow", "knee")}
    return poses


def _frame(configuration: Any, tasks: dict[str, Any], limits: Any, poses: Any, i: int) -> None:
    for name, task in tasks.items():
        R, p = poses[name]
        turn = mink.SO3.from_matrix(R[i])
        task.set_target(mink.SE3.from_rotation_and_translation(turn, p[i]))
    every, dt = list(tasks.values()), configuration.model.opt.timestep

    def error() -> float:
        return float(np.linalg.norm(np.concatenate([task.compute_error(configuration) for task in every])))

    before = error()
    for _ in range(MOST + 1):
        v = mink.solve_ik(configuration, every, dt, "daqp", GAIN, limits=limits)
        configuration.integrate_inplace(v, dt)
        after = error()
        if before - after < 1e-3:
            break
        before = after


def _back(robot: Any, q: Any, columns: list[int]) -> Any:
    """hqp's configuration: a quaternion xyzw, joints in the robot's order."""
    angles = np.zeros(robot.nv)
    angles[robot.actuated] = q[columns]
    found = robot.configuration(angles)
    found[:3], found[3:7] = q[:3], q[[4, 5, 6, 3]]
    return found

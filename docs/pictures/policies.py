"""Films of policies: G1's arms above the legs of a walking policy, and a filter behind hostile targets.

The walking policy comes from the wheels of ``benchmarks.policies.arms``.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import hqp
from benchmarks.policies import arms
from hqp.tasks import CollisionAvoidance

from .moving import FPS, save
from .studio import BLUE, GREEN, ORANGE, Studio, caption

FIGURES = Path(__file__).parents[1] / "figures"
SIZE, SEED, REACH = (420, 420), 1, 0.05


def upper_body(path: Path = FIGURES / "upper_body.webp") -> Path:
    """The policy walks; the hands follow targets with loads of up to 2 kg."""
    files = arms.wheels()
    if files is None:
        raise RuntimeError("install holosoma-inference, holosoma and onnxruntime")
    robot, rows = hqp.robots.load("g1"), []  # type: ignore[var-annotated]

    def watch(q: Any, aims: Any) -> None:
        rows.append((q.copy(), [aim.translation.copy() for aim in aims]))

    run = arms.motion(files, arms.upper_body(REACH), SEED, watch)
    if run.fell:
        raise RuntimeError("the robot fell")
    studio, shown = Studio(robot, SIZE, azimuth=150.0, elevation=-12.0), []
    height, every = float(studio.camera.lookat[2]), round(1.0 / (FPS * arms.DT))
    for q, aims in rows[round(0.8 / arms.DT) :: every]:
        studio.camera.lookat = np.array([q[0], q[1], height])
        for aim in aims:
            studio.ball(aim, BLUE, 0.03)
        text = "legs and waist: a policy of others"
        shown.append(caption(studio.shoot(q), "arms: hqp.UpperBody", text, GREEN))
    return save(shown, path)


def guard(path: Path = FIGURES / "policy_filter.webp") -> Path:
    """Targets that cross the arms, beside the joints that the filter lets move."""
    robot, dt = hqp.robots.load("g1", floating=False), 0.002
    declared = hqp.PolicyFilter(kp=60.0, kd=2.0, collision=CollisionAvoidance())
    session, servos = (
        declared.session(robot, dt, deadline=math.inf),
        declared.servos(robot, dt),
    )
    names, home = robot.joint_names, robot.home
    studio = Studio(robot, SIZE, azimuth=150.0, elevation=-12.0)
    shown, q, v = [], robot.home.copy(), np.zeros(robot.nv)
    model = pin.Model(robot.model)
    model.armature = model.armature + servos.stiffening
    data = model.createData()
    for k in range(round(6.0 / dt)):
        target, wave = home.copy(), math.sin(math.pi * k * dt / 3.0) ** 2
        for side, sign in (("left", -1.0), ("right", 1.0)):
            target[names.index(f"{side}_shoulder_yaw_joint")] += sign * 1.8 * wave
            target[names.index(f"{side}_elbow_joint")] += 0.6 * wave
            target[names.index(f"{side}_shoulder_pitch_joint")] -= 0.7 * wave
        tick = session.tick(q, v, target)
        if k % round(1.0 / (FPS * dt)) == 0:
            active = len(tick.limited) > 0
            text = f"{len(tick.limited)} joints limited" if active else "targets pass"
            shown.append(
                caption(
                    studio.shoot(q),
                    "hqp.PolicyFilter",
                    text,
                    ORANGE if active else GREEN,
                )
            )
        tau = servos.torque(tick.command, q + dt * v, v)
        v = v + dt * pin.aba(model, data, q, v, tau)
        q = pin.integrate(model, q, v * dt)
    return save(shown, path)


if __name__ == "__main__":
    for make in (upper_body, guard):
        if len(sys.argv) < 2 or make.__name__ in sys.argv:
            print(make())

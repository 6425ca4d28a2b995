"""A stack as plain numbers that every library can be given: tasks with frames, gains, levels, and targets over time."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hqp.arrays import Mat
from hqp.declare.stack import Stack
from hqp.errors import UnsupportedProblem
from hqp.lab.trajectory import Trajectory

from .scenes import Scene
from .urdf import urdf

GAIN, CONTACT_GAIN = 5.0, 20.0
"""Gains of a task and of a contact without a law, as the formulations have them [1/s]."""


@dataclass(frozen=True)
class Plain:
    """One task: kind position, orientation, pose, com or posture; level -1 where it is a hard constraint.

    axes: components that count.  gain [1/s].  weight: inside its level.
    """

    name: str
    kind: str
    frame: str
    axes: str
    gain: float
    level: int
    weight: float


def plain(stack: Stack) -> list[Plain]:
    """Tasks of a stack; raises UnsupportedProblem for elements without a counterpart in rivals."""
    found, soft = [], 0
    for element in stack.subject_to:
        if element.equality:
            found.append(_plain(element, -1))
        elif type(element).__name__ not in ("JointLimits", "FrictionCone", "CenterOfPressure", "TorqueLimits"):
            raise UnsupportedProblem(f"rivals are given no {type(element).__name__} ({element.name})")
    for level in stack.levels:
        own = [_plain(e, -1 if e.is_contact else soft) for e in level]
        found += own
        soft += any(task.level >= 0 for task in own)
    return found


def _plain(element: Any, level: int) -> Plain:
    kinds = {
        "Position": "position", "Orientation": "orientation", "Pose": "pose", "Com": "com", "Posture": "posture",
        "FixedContact": "pose",
    }  # fmt: skip
    kind = kinds.get(type(element).__name__)
    if kind is None:
        raise UnsupportedProblem(f"rivals are given no {type(element).__name__} ({element.name})")
    for field in ("relative_to", "subtree", "offset", "joints"):
        value = getattr(element, field, None)
        if value is not None and np.any(np.asarray(value, dtype=object)):
            raise UnsupportedProblem(f"rivals are given no {field} ({element.name})")
    axes = getattr(element, "axes", "xyz") or "xyz"
    return Plain(
        element.name, kind, str(getattr(element, "frame", "") or ""), axes, gain(element), level, float(element.weight)
    )


def gain(element: Any) -> float:
    """Gain of an element [1/s]."""
    if element.law is not None:
        return float(getattr(element.law, "gain", GAIN))
    return CONTACT_GAIN if element.is_contact else GAIN


def write(folder: Path, robot: Any, scenes: list[Scene], seconds: float, dt: float) -> None:
    """``job.json`` and ``targets.npz`` of all scenes."""
    targets: dict[str, Mat] = {}
    jobs = []
    frames = {t.frame for scene in scenes for t in plain(scene.stack) if t.frame}
    for scene in scenes:
        tasks = plain(scene.stack)
        motion = Trajectory(scene.motion, scene.stack, scene.robot, seconds)
        ticks = round(seconds / dt)
        for task in tasks:
            element: Any = scene.stack.find(task.name)
            home = scene.robot.state(scene.robot.home)
            held = scene.held.get(task.name, None)
            hold = np.asarray(element.value(home) if held is None else held, dtype=np.float64)
            rows = np.repeat(hold.reshape(1, -1), ticks, axis=0)
            for k in range(ticks):
                given = motion.values(k * dt).get(task.name)
                if given is not None:
                    rows[k] = np.asarray(given[0] if isinstance(given, tuple) else given).ravel()
            targets[f"{scene.name}/{task.name}"] = rows
        state = scene.robot.state(scene.robot.home)
        names = [scene.robot.joint_name(int(c)) for c in scene.robot.joints(None)]
        columns = [int(c) for c in scene.robot.joints(None)]
        jobs.append({
            "name": scene.name, "ticks": ticks, "tasks": [vars(task) for task in tasks], "joints": names,
            "urdf": urdf(scene.robot, frames), "floating": bool(scene.robot.floating),
            "angles": state.angles[columns].tolist(),
            "base": scene.robot.home[:7].tolist() if scene.robot.floating else [],
            "speed": np.minimum(scene.robot.velocity_limit[columns], 1e3).tolist(),
            "limits": any(type(e).__name__ == "JointLimits" for e in scene.stack),
            "com": state.com().tolist(),
        })  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "job.json").write_text(json.dumps({"dt": dt, "scenes": jobs}))
    np.savez(folder / "targets.npz", allow_pickle=False, **targets)

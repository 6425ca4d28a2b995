"""Names in a compiled MuJoCo model; unnamed ones get a deterministic name."""

from __future__ import annotations

from collections.abc import Container
from typing import Any

from .mujoco_extra import mujoco


def body_names(model: Any) -> tuple[str, ...]:
    """Names of the bodies of a MjModel; ``body_3`` for one that has none."""
    return _unique([model.body(i).name or f"body_{i}" for i in range(model.nbody)])


def joint_names(model: Any) -> tuple[str, ...]:
    """Names of the joints of a MjModel; ``torso_free``, ``arm_joint`` or ``arm_joint_1`` for one that has none."""
    bodies, found = body_names(model), []
    for j in range(model.njnt):
        body = int(model.jnt_bodyid[j])
        word = "free" if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE else "joint"
        place = f"_{j - int(model.body_jntadr[body])}" if model.body_jntnum[body] > 1 else ""
        found.append(model.joint(j).name or f"{bodies[body]}_{word}{place}")
    return _unique(found)


def site_name(name: str, taken: Container[str]) -> str:
    """Name of the frame of a site whose own name is taken."""
    name += "_site"
    while name in taken:
        name += "_"
    return name


def _unique(names: list[str]) -> tuple[str, ...]:
    taken: set[str] = set()
    for i, name in enumerate(names):
        while name in taken:
            name += "_"
        taken.add(name)
        names[i] = name
    return tuple(names)

"""Links of a simulated robot that overlap at home, which then do not collide."""

from __future__ import annotations

from typing import Any

import numpy as np

from .model_map import ModelMap
from .mujoco_extra import mujoco


def exclude(spec: Any, robot: Any, root: str) -> Any:
    """Compile a MjSpec; pairs of links of the robot, whose root body is named, that overlap at its home do not collide.

    Shapes of a hip and a thigh may overlap by design, and their file may not exclude them: their contact would hold the
    joint between them.
    """
    simulated, home = spec.compile(), getattr(robot, "home", None)
    if home is None:
        return simulated
    data = mujoco.MjData(simulated)
    data.qpos[:] = ModelMap(simulated, robot).to_mujoco(home, np.zeros(robot.nv))[0]
    mujoco.mj_fwdPosition(simulated, data)
    overlaps = (data.contact.dist < 0.0) & (data.contact.geom >= 0).all(axis=1)
    links = np.sort(simulated.geom_bodyid[data.contact.geom[overlaps]], axis=1)
    own = (simulated.body_rootid[links] == simulated.body(root).rootid).all(axis=1)
    pairs = np.unique(links[own], axis=0).tolist()
    for one, two in pairs:
        spec.add_exclude(bodyname1=simulated.body(one).name, bodyname2=simulated.body(two).name)
    return spec.compile() if pairs else simulated

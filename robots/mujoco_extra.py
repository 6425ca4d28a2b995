"""The one place where MuJoCo, an optional extra, is imported; releases before 3.17 under the names of later ones."""

from __future__ import annotations

from typing import Any

import numpy as np

from hqp.arrays import Mat
from hqp.errors import ModelError

try:
    import mujoco
except ImportError as error:
    raise ModelError("the plant needs MuJoCo, which is not installed: pip install 'hqp[mujoco]'") from error

__all__ = ["full_inertia", "mujoco"]

if not hasattr(mujoco.MjSpec, "delete"):
    mujoco.MjSpec.delete = lambda spec, element: element.delete()
if not hasattr(mujoco.MjSpec, "body"):
    mujoco.MjSpec.body = mujoco.MjSpec.find_body
    mujoco.MjSpec.site = mujoco.MjSpec.find_site
if not hasattr(mujoco.MjModel, "tendon_armature"):
    mujoco.MjModel.tendon_armature = property(lambda model: np.zeros(model.ntendon))


def full_inertia(model: Any, data: Any) -> Mat:
    """Expand MuJoCo's sparse inertia matrix to ``(nv, nv)``, in MuJoCo's velocity coordinates."""
    full = np.zeros((model.nv, model.nv))
    try:
        mujoco.mj_fullM(model, data, full)
    except TypeError:
        mujoco.mj_fullM(model, full, data.qM)
    return full

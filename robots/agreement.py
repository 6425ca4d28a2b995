"""A model read from an MJCF compared with MuJoCo at a random state: differences are refused by name."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hqp.errors import ModelError

from .description import Description
from .mjcf_names import body_names
from .model_map import ModelMap
from .mujoco_extra import full_inertia, mujoco
from .releases import crba

_TOLERANCE = 1e-8  # relative to the largest length, mass, or inertia
_INERTIA = 1e-6  # of M: MuJoCo takes a centre of mass that is almost at the origin as if it were there
_SEED = 7


def check(found: Description) -> None:
    """Compare nv, moving mass, positions and rotations of bodies, and M; raises ModelError for the first off.

    At the random state every joint is off its zero, so that a wrong axis, anchor or order shows.
    """
    model, simulated = found.model, found.simulated
    moving = (np.asarray(simulated.body_treeid) >= 0) & ~np.isin(np.arange(simulated.nbody), sorted(found.scene))
    nv = int(simulated.body_dofnum[moving].sum())
    if model.nv != nv:
        raise _off(found, "nv", model.nv, nv)
    mass, there = float(pin.computeTotalMass(model)), float(simulated.body_mass[moving].sum())
    if not abs(mass - there) <= _TOLERANCE * max(there, 1e-9):
        raise _off(found, "mass [kg]", mass, there)
    rng = np.random.default_rng(_SEED)
    q = pin.integrate(model, pin.neutral(model), rng.uniform(-1.0, 1.0, model.nv))
    state_map, data, here = ModelMap(simulated, model), mujoco.MjData(simulated), pin.Data(model)
    data.qpos[:] = state_map.to_mujoco(q, np.zeros(model.nv))[0]
    mujoco.mj_kinematics(simulated, data)
    mujoco.mj_comPos(simulated, data)
    mujoco.mj_crb(simulated, data)
    pin.forwardKinematics(model, here, q)
    size = max(1.0, float(np.abs(data.xpos).max()))
    for name, (joint, placement), position, rotation in zip(
        body_names(simulated), found.carriers, data.xpos, data.xmat, strict=True
    ):
        placed = here.oMi[joint] * placement
        if not np.abs(placed.translation - position).max() <= _TOLERANCE * size:
            raise _off(found, f"position of body {name!r} [m]", placed.translation, position)
        if not np.abs(placed.rotation.ravel() - rotation).max() <= _TOLERANCE:
            raise _off(found, f"rotation of body {name!r}", placed.rotation.ravel(), rotation)
    crba(model, here, q)
    M = np.triu(here.M) + np.triu(here.M, 1).T
    B = state_map.tangent(data.qpos)
    expected = B.T @ full_inertia(simulated, data) @ B
    # each entry against the two coordinates' own inertia: a finger counts as much as a base
    scale = np.sqrt(np.abs(np.diag(expected)))
    off = np.abs(M - expected) / np.maximum(np.outer(scale, scale), 1e-15)
    if not off.max() <= _INERTIA:
        i, j = np.unravel_index(int(off.argmax()), off.shape)
        raise _off(found, f"inertia M[{i}, {j}]", M[i, j], expected[i, j])


def _off(found: Description, what: str, here: object, there: object) -> ModelError:
    return ModelError(
        f"{found.source or 'the MjModel'}: {what} is {here} in the model that was built and {there} in MuJoCo"
    )

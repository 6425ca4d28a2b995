"""Rotor inertia of joints whose motors the file does not describe."""

from __future__ import annotations

from typing import Any

import numpy as np

from hqp.arrays import Vec

ROTOR = 0.01
"""Reflected inertia of the rotor of a geared motor of a legged robot or an arm [kg m^2]."""

FREE = 5000.0
"""Largest acceleration of a motor's own rotor at its effort limit [rad/s^2]: weak motors have less inertia."""


def rotor_inertia(robot: Any, missing: float | None = None) -> dict[str, float]:
    """Armature of each actuated turning joint, by name [kg m^2]: the model's if it has one, else a guess.

    missing: armature of joints without one; None guesses min(0.01, effort limit / 5000).  Without one a foot has almost
    no inertia about its ankle, and a motor turns it by tens of rad/s in one simulation step.
    """
    model = getattr(robot, "model", robot)
    given: Vec = np.asarray(model.armature)
    effort: Vec = np.asarray(model.upperEffortLimit if hasattr(model, "upperEffortLimit") else model.effortLimit)
    found = {}
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
        turns = any(kind in joint.shortname() for kind in ("JointModelR", "JointModelH")) and joint.nv == 1
        if turns:
            own, limit = float(given[joint.idx_v]), float(effort[joint.idx_v])
            guess = min(ROTOR, limit / FREE) if limit > 0.0 else ROTOR
            found[str(name)] = own if own > 0.0 else guess if missing is None else missing
    return found

"""Joints whose axes move in their body as chains of plain ones, whose twists turn with their bodies."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

_VECTORS = (
    "lowerPositionLimit", "upperPositionLimit", "velocityLimit", "effortLimit", "armature", "damping", "friction",
    "rotorInertia", "rotorGearRatio", "lowerDryFrictionLimit", "upperDryFrictionLimit", "upperVelocityLimit",
    "lowerVelocityLimit", "upperEffortLimit", "lowerEffortLimit", "positionLimitMargin",
)  # fmt: skip


def plain(model: Any) -> tuple[Any, tuple[int, ...], dict[str, tuple[str, ...]]]:
    """The model without composite, Euler-angle and universal joints, q and v as they were.

    Beside it the number of each old joint in the new model, and the names of the joints that an old one became, NAME_0
    the first.  The model itself where it has no such joint.
    """
    chains = [_chain(joint) for joint in model.joints]
    if all(len(chain) == 1 for chain in chains):
        return model, tuple(range(model.njoints)), {}
    new = pin.Model()
    new.name, new.gravity = model.name, model.gravity
    places, groups = [0], {}
    for i in range(1, model.njoints):
        name, at, carrier = model.names[i], model.jointPlacements[i], places[model.parents[i]]
        names = [name] if len(chains[i]) == 1 else [f"{name}_{k}" for k in range(len(chains[i]))]
        for title, (part, placement) in zip(names, chains[i], strict=True):
            carrier = new.addJoint(carrier, part, at * placement, title)
            at = pin.SE3.Identity()
        if len(names) > 1:
            groups[name] = tuple(names)
        new.appendBodyToJoint(carrier, model.inertias[i], pin.SE3.Identity())
        places.append(carrier)
    new.inertias[0] = model.inertias[0]
    for field in _VECTORS:
        if hasattr(new, field):
            setattr(new, field, np.array(getattr(model, field)))
    for frame in list(model.frames)[1:]:
        moved = pin.Frame(frame.name, places[frame.parentJoint], 0, frame.placement, frame.type)
        new.addFrame(moved, False)
    for key in model.referenceConfigurations:
        new.referenceConfigurations[key.key()] = key.data()
    return new, tuple(places), groups


def shapes(geometry: Any, places: tuple[int, ...]) -> Any:
    """Shapes of the old model in the joints of the new one; None for None."""
    if geometry is None or places == tuple(range(len(places))):
        return geometry
    moved = geometry.copy()
    for item in moved.geometryObjects:
        item.parentJoint, item.parentFrame = places[item.parentJoint], 0
    return moved


def _chain(joint: Any) -> list[tuple[Any, Any]]:
    """Plain joints one after another, each with its placement in the one before."""
    kind, here = joint.shortname(), pin.SE3.Identity()
    own = joint.extract() if hasattr(joint, "extract") else joint
    if kind == "JointModelComposite":
        found = []
        for part, at in zip(own.joints, own.jointPlacements, strict=True):
            for k, (single, placement) in enumerate(_chain(part)):
                found.append((single, at * placement if k == 0 else placement))
        return found
    if kind == "JointModelSphericalZYX":
        return [(pin.JointModelRZ(), here), (pin.JointModelRY(), here), (pin.JointModelRX(), here)]
    if kind == "JointModelUniversal":
        axes = np.array(own.axis1), np.array(own.axis2)
        return [(pin.JointModelRevoluteUnaligned(axis), here) for axis in axes]
    return [(own, here)]

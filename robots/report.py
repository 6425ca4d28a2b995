"""Report on a robot's file in plain text: read, assumed, left out."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from hqp.errors import ModelError

from . import xml_lines

_KNOWN = {"link", "joint", "material"}
"""Children of a URDF's root that are read; materials are those of visual shapes."""
_IGNORED = {
    "ncam": "cameras",
    "nlight": "lights",
    "nsensor": "sensors",
    "npair": "contact pairs",
    "nexclude": "contact exclusions",
    "nhfield": "height fields",
    "nplugin": "plugins",
}
"""Counts of a MjModel that the robot does not take over, with their names."""


def report(robot: Any) -> str:
    """The report on a robot: its file, then the sections Read, Assumed, Left out."""
    description = robot.description
    kind = "" if description is None else " (URDF)" if description.simulated is None else " (MJCF)"
    head = f"{robot.name}: {robot.source or 'a model in memory'}{kind}"
    sections = {"Read": read(robot), "Assumed": assumed(robot), "Left out": left_out(robot)}
    blocks = ["\n".join((title, *(f"  {line}" for line in lines or ("nothing",)))) for title, lines in sections.items()]
    return "\n\n".join((head, *blocks))


def read(robot: Any) -> list[str]:
    """Base, mass, joints with their limits, couplings, configurations, shapes."""
    joints = joint_rows(robot)
    lines = [
        f"base: {'floating' if robot.floating else 'fixed'}; {len(joints)} joints, {len(robot.joint_names)} actuated; "
        f"nq = {robot.nq}, nv = {robot.nv}; {robot.mass:.4g} kg moved by joints",
        *table(("joint", "type", "lower", "upper", "speed", "effort", "rotor inertia", "moved by"), joints),
    ]
    lines += [f"coupling: {coupling.name}" for coupling in robot.couplings]
    if robot.configurations:
        lines.append(f"configurations: {', '.join(robot.configurations)}")
    if robot.disabled_pairs:
        lines.append(f"pairs of links that need not be kept apart: {len(robot.disabled_pairs)}")
    lines += [f"{what} shapes: {_shapes(robot, what)}" for what in ("collision", "visual")]
    if robot.obstacles.shapes:
        about = f", approximated: {', '.join(robot.obstacles.approximated)}" if robot.obstacles.approximated else ""
        lines.append(f"obstacles: {', '.join(shape.name for shape in robot.obstacles.shapes)}{about}")
    return lines


def joint_rows(robot: Any) -> list[tuple[str, ...]]:
    """Name, type, limits, rotor inertia and motor of each joint."""
    model = robot.model
    rows: list[tuple[str, ...]] = []
    coupled = {name for coupling in robot.couplings for name, _ in tuple(getattr(coupling, "coefficients", ()))}
    for i in range(2 if robot.floating else 1, model.njoints):
        name, joint = model.names[i], model.joints[i]
        kind = _kind(joint.shortname().removeprefix("JointModel"))
        if joint.nv != 1:
            rows.append((name, kind, "", "", "", "", "", "no motor"))
            continue
        v = joint.idx_v
        unit = "m" if kind == "prismatic" else "rad"
        force = "N" if unit == "m" else "N m"
        by = "motor" if name in robot.joint_names else "coupling" if name in coupled else "no motor"
        rows.append((
            name,
            kind,
            _number(robot.lower[v], unit),
            _number(robot.upper[v], unit),
            _number(robot.velocity_limit[v], f"{unit}/s"),
            _number(robot.effort_limit[v], force),
            _number(float(model.armature[v]), "kg" if unit == "m" else "kg m^2"),
            by,
        ))  # fmt: skip
    return rows


def assumed(robot: Any) -> list[str]:
    """Values that the file does not give."""
    found, description = [], robot.description
    urdf = description is not None and description.simulated is None
    if urdf:
        gravity = ", ".join(f"{x:g}" for x in robot.gravity)
        found.append(f"gravity [{gravity}] m/s^2: a URDF has none")
        if not np.any(robot.rotors):
            found.append(
                "rotor inertia zero: a URDF has none; load(..., rotors=True) gives that of the simulated plant"
            )
    if urdf and not robot.floating:
        found.append("the root is fixed in the world; floating=True frees it")
    if "home" not in robot.configurations:
        found.append("home: the first configuration of the file, else zero, moved into the limits of the joints")
    limits = {"speed limit": robot.velocity_limit, "effort limit": robot.effort_limit}
    limits["position limits"] = np.maximum(-robot.lower, robot.upper)
    single = [name for name in robot.model.names[2 if robot.floating else 1 :] if robot.joints(name).size == 1]
    for what, values in limits.items():
        free = [name for name in single if math.isinf(values[robot.joints(name)[0]])]
        if free:
            found.append(f"no {what}: {some(free)}")
    return found


def left_out(robot: Any) -> list[str]:
    """Parts of the file that the model lacks, the robot's notes among them."""
    description = robot.description
    found = list(robot.notes)
    if description is None:
        return found
    if description.simulated is not None:
        simulated = description.simulated
        counts = {word: int(getattr(simulated, field, 0)) for field, word in _IGNORED.items()}
        firsts = simulated.wrap_type[simulated.tendon_adr] if simulated.ntendon else np.zeros(0)
        counts["spatial tendons"] = int(np.count_nonzero(firsts != _FIXED))
        found += [f"{count} {word}" for word, count in counts.items() if count]
        dynamic = int(np.count_nonzero(simulated.actuator_dyntype)) if simulated.nu else 0
        if dynamic:
            found.append(f"dynamics of {dynamic} actuators")
        return found
    root = xml_lines.read(description.source)
    tags = Counter(child.tag for child in root if child.tag not in _KNOWN)
    inner = Counter(
        child.tag
        for joint in root.findall("joint")
        for child in joint
        if child.tag in ("safety_controller", "calibration")
    )
    return found + [f"{count} <{tag}>" for tag, count in (tags + inner).items()]


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table with aligned columns; columns without a value are dropped."""
    if not rows:
        return []
    kept = [k for k in range(len(head)) if any(row[k] for row in rows)]
    cells = [[head[k] for k in kept], *([row[k] for k in kept] for row in rows)]
    width = [max(len(row[k]) for row in cells) for k in range(len(kept))]
    return ["  ".join(cell.ljust(w) for cell, w in zip(row, width, strict=True)).rstrip() for row in cells]


def some(names: Sequence[str]) -> str:
    """The first eight names and how many more there are."""
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")


def _number(value: float, unit: str) -> str:
    return "" if math.isinf(value) or (value == 0.0 and unit.startswith("kg")) else f"{value:.4g} {unit}"


def _shapes(robot: Any, what: str) -> str:
    try:
        items = robot.read_shapes(what).geometryObjects
        kinds = Counter(type(item.geometry).__name__ for item in items)
        links = len({int(item.parentJoint) for item in items})
    except ModelError as error:
        return f"could not be read: {error}"
    if not kinds:
        return "none"
    words = ", ".join(f"{count} {_KINDS.get(kind, kind)}" for kind, count in sorted(kinds.items()))
    return f"{words}, on {links} bodies"


def _kind(name: str) -> str:
    """The field's term for a joint model of Pinocchio."""
    if name.startswith(("RUB", "RevoluteUnbounded")):
        return "continuous"
    known = {"P": "prismatic", "R": "revolute"}
    return _TERMS.get(name, known.get(name[:1], name.lower()))


_TERMS = {"FreeFlyer": "free", "Spherical": "ball", "Planar": "planar"}
_FIXED = 1
"""mjWRAP_JOINT: the wrap of a fixed tendon."""
_KINDS = {"BVHModelOBBRSS": "Mesh", "BVHModelBase": "Mesh"}

"""Files of a synthetic person: any naming, axes, rate, unit and joint axes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from hqp.motion import Motion

from .people import NAMES, PARENTS, walk

SIDED = ("UpLeg", "Leg", "Foot", "ToeBase", "Arm", "ForeArm", "Hand")
"""Names of ``people``, in the order of the schemes below."""

SCHEMES: dict[str, tuple[str, tuple[str, ...]]] = {
    "lafan": ("{Side}{}", SIDED),
    "mixamo": ("mixamorig:{Side}{}", SIDED),
    "soma": ("{Side}{}", ("Leg", "Shin", "Foot", "ToeBase", "Arm", "ForeArm", "Hand")),
    "biped": ("Bip01 {S} {}", ("Thigh", "Calf", "Foot", "Toe0", "UpperArm", "Forearm", "Hand")),
    "words": ("{Side} {}", ("Upper Leg", "Lower Leg", "Foot", "Toe", "Upper Arm", "Forearm", "Hand")),
    "blender": ("{}.{S}", ("thigh", "shin", "foot", "toe", "upper_arm", "forearm", "hand")),
    "smplx": ("{side}_{}", ("hip", "knee", "ankle", "foot", "shoulder", "elbow", "wrist")),
    "asf": ("{s}{}", ("femur", "tibia", "foot", "toes", "humerus", "radius", "wrist")),
    "estimate": ("{S}{}", ("Hip", "Knee", "Foot", "", "Shoulder", "Elbow", "Wrist")),
    "rigify": ("DEF-{}.{S}", ("thigh", "shin", "foot", "toe", "upper_arm", "forearm", "hand")),
    "daz": ("{s}{}", ("ThighBend", "Shin", "Foot", "Toe", "ShldrBend", "ForearmBend", "Hand")),
    "motive": ("Ann_{S}{}", ("Thigh", "Shin", "Foot", "Toe", "UArm", "FArm", "Hand")),
    "joined": ("mixamorig{Side}{}", SIDED),
    "vrm": ("J_Bip_{S}_{}", ("UpperLeg", "LowerLeg", "Foot", "ToeBase", "UpperArm", "LowerArm", "Hand")),
    "rigged": ("{s}_{}_JNT", ("upLeg", "lowLeg", "foot", "toe", "upArm", "lowArm", "hand")),
    "last": ("{}{S}", ("Thigh", "Shank", "Foot", "Toe", "UpperArm", "LowerArm", "Hand")),
    "brackets": ("{} ({Side})", ("Upper Leg", "Lower Leg", "Foot", "Toe", "Upper Arm", "Lower Arm", "Hand")),
    "worlds": ("m{}{Side}", ("Hip", "Knee", "Ankle", "Toe", "Shoulder", "Elbow", "Wrist")),
    "reversed": ("{}_{s}", ("leg_upper", "leg_lower", "foot", "toe", "arm_upper", "arm_lower", "hand")),
    "centres": ("{S}{}", ("HJC", "KJC", "AJC", "TOE", "SJC", "EJC", "WJC")),
    "opensim": ("{}_{s}", ("hip", "knee", "ankle", "mtp", "acromial", "elbow", "radius_hand")),
    "bones": ("{}_{s}", ("femur", "tibia", "talus", "toes", "humerus", "ulna", "hand")),
    "short": ("{s}_{}", ("uleg", "lleg", "foot", "toe", "uarm", "larm", "hand")),
    "parts": ("{S}{}", ("UpLeg", "LoLeg", "Foot", "Toe", "UpArm", "LoArm", "Hand")),
    "plain": ("{Side}{}", ("UpperLeg", "Leg", "Foot", "Toes", "UpperArm", "Arm", "Hand")),
    "tips": ("{side}_{}", ("hip", "knee", "ankle", "big_toe_tip", "shoulder", "elbow", "wrist")),
    "estimate_": ("{side}_{}", ("hip", "knee", "ankle", "", "shoulder", "elbow", "wrist")),
}
"""By scheme: pattern of a joint's name with its side, and the names; joints with an empty name are not recorded."""

UPS = ("x", "y", "z", "-x", "-y", "-z")
RATES = (24000 / 1001, 24.0, 25.0, 30000 / 1001, 30.0, 50.0, 60000 / 1001, 60.0, 90.0, 100.0, 120.0, 240.0)


def renamed(motion: Motion, scheme: str) -> tuple[Motion, dict[str, str]]:
    """Rename the joints of a motion, without joints missing in the scheme; return also the name of each part."""
    pattern, own = SCHEMES[scheme]
    names, parts = [], {}
    limbs = ("hip", "knee", "ankle", "toe", "shoulder", "elbow", "hand")
    for name in motion.names:
        side = (
            name[: -len(limb)]
            if (limb := next((n for n in sorted(SIDED, key=len)[::-1] if name.endswith(n)), ""))
            else ""
        )
        if not side:
            names.append(name)
            continue
        k = SIDED.index(limb)
        new = pattern.format(own[k], Side=side, S=side[0], s=side[0].lower(), side=side.lower()) if own[k] else ""
        names.append(new)
        if new:
            parts[f"{side.lower()}_{limbs[k]}"] = new
    kept = [k for k, name in enumerate(names) if name]
    parents = tuple(kept.index(motion.parents[k]) if motion.parents[k] >= 0 else -1 for k in kept)
    return Motion(tuple(names[k] for k in kept), motion.positions[:, kept], motion.fps, parents), parts


def laid(motion: Motion, up: str) -> Motion:
    """Convert a motion with z up to axes in which ``up`` is up."""
    found = next(R for R in Rotation.create_group("O").as_matrix() if np.allclose(R @ [0, 0, 1], _axis(up)))
    return Motion(motion.names, motion.positions @ found.T, motion.fps, motion.parents)


def mirrored(motion: Motion) -> Motion:
    """Mirror the motion, but keep the names."""
    return Motion(motion.names, motion.positions * (1.0, -1.0, 1.0), motion.fps, motion.parents)


def strolling(rng: np.random.Generator, fps: float = 30.0) -> Motion:
    """A person on a walk in any direction, from any place on the floor."""
    motion = walk(1.5, float(rng.uniform(0.3, 0.6)), fps)
    turn = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)]).as_matrix()
    places = motion.positions @ turn.T + [*rng.uniform(-2.0, 2.0, 2), 0.0]
    return Motion(NAMES, places, fps, PARENTS)


def write_turning_bvh(path: Path, motion: Motion, rng: np.random.Generator, digits: int = 6) -> Path:
    """Write a BVH file in the motion's axes, with random rotations of joints and channels in any order."""
    count, frames = len(motion.names), len(motion)
    turns = [Rotation.random(frames, random_state=int(rng.integers(1 << 30))) for _ in range(count)]
    lines, columns = ["HIERARCHY"], []

    def block(i: int, depth: int) -> None:
        parent, pad = motion.parents[i], "  " * depth
        order = "".join(rng.permutation(list("XYZ")))
        first = bool(rng.integers(2))
        channels = ([f"{a}position" for a in "XYZ"], [f"{a}rotation" for a in order])
        lines.extend([f"{pad}{'JOINT' if depth else 'ROOT'} {motion.names[i]}", f"{pad}{{", f"{pad}  OFFSET 1 2 3"])
        lines.append(f"{pad}  CHANNELS 6 {' '.join([*channels[not first], *channels[first]])}")
        place, turn = motion.positions[:, i], turns[i]
        if parent >= 0:
            place = turns[parent].inv().apply(place - motion.positions[:, parent])
            turn = turns[parent].inv() * turn
        angles: Any = turn.as_euler(order, degrees=True)
        columns.extend([place, angles] if first else [angles, place])
        children = [k for k, p in enumerate(motion.parents) if p == i]
        for child in children:
            block(child, depth + 1)
        if not children:
            lines.extend([f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET 0 0 0", f"{pad}  }}"])
        lines.append(f"{pad}}}")

    block(0, 0)
    lines += ["MOTION", f"Frames: {frames}", f"Frame Time: {1.0 / motion.fps:.{digits}f}"]
    lines += [" ".join(f"{x:.7f}" for x in row) for row in np.hstack(columns)]
    path.write_text("\n".join(lines) + "\n")
    return path


def _axis(up: str) -> Any:
    return np.eye(3)["xyz".index(up[-1])] * (-1.0 if up.startswith("-") else 1.0)

"""Map the joints of a recorded skeleton to parts of a person, by name."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from hqp.arrays import Mat
from hqp.errors import DeclarationError

from .clip import Motion

SIDES = ("left", "right")
LIMBS = ("shoulder", "elbow", "hand", "hip", "knee", "ankle", "toe")
PARTS = tuple(f"{side}_{limb}" for side in SIDES for limb in LIMBS)
"""Required parts of a motion."""

NAMES: dict[str, tuple[str, ...]] = {
    "shoulder": ("arm", "upperarm", "uparm", "shoulder"),
    "elbow": ("elbow", "forearm", "lowerarm", "lowarm"),
    "hand": ("wrist", "hand"),
    "hip": ("hip", "upleg", "upperleg", "thigh"),
    "knee": ("knee", "leg", "lowerleg", "lowleg", "shin", "calf"),
    "ankle": ("ankle", "foot"),
    "toe": ("toebase", "toe", "toes", "ball", "ballfoot", "foottoe", "foot", "toeend", "ankleend", "footend"),
}
"""Names of a part without its side, the first that occurs counts: in most skeletons ``LeftArm`` begins at the shoulder
and ``LeftShoulder`` is the collar bone, in those that have no ``LeftArm`` it is the shoulder."""


def plain(name: str) -> tuple[str, str]:
    """(side, rest) of a joint's name, in small letters: ``mixamorig:LeftUpLeg``, ``L_Hip`` and ``thigh.l`` have one."""
    name = name.rsplit(":", 1)[-1]
    name = re.sub(r"^(bip\d*|mixamorig\d*|character\d*|skeleton)[ _.]+", "", name, flags=re.IGNORECASE)
    for side in SIDES:
        letter = side[0]
        patterns = (
            rf"(?i:^{side})(.*)$", rf"(?i:^{letter}[ _.-])(.*)$", rf"^{letter}(?=[A-Z])(.*)$",
            rf"^{letter.upper()}(?=[A-Z][a-z])(.*)$", rf"(.*)(?i:[ _.-]{side})$", rf"(.*)(?i:[ _.-]{letter})$",
            rf"(.*)(?:{side.title()})$",
        )  # fmt: skip
        for pattern in patterns:
            if found := re.match(pattern, name):
                return side, re.sub(r"[^a-z]", "", found[1].lower())
    return "", re.sub(r"[^a-z]", "", name.lower())


def parts_of(names: Sequence[str], given: Mapping[str, str] | None = None) -> dict[str, str]:
    """The joint of each of ``PARTS``; given: parts that cannot be found by name.

    Raises DeclarationError for a part without a joint, and for one that is given and not there.
    """
    given = {} if given is None else given
    for part, name in given.items():
        if part not in PARTS:
            raise DeclarationError("human", "unknown part", value=part, allowed=", ".join(PARTS))
        if name not in names:
            raise DeclarationError("human", f"the motion has no joint for {part}", value=name, allowed=", ".join(names))
    sided: dict[tuple[str, str], str] = {}
    for name in names:
        sided.setdefault(plain(name), name)
    found = dict(given)
    for side in SIDES:
        for limb in LIMBS:
            part = f"{side}_{limb}"
            taken = set(found.values())
            fitting = (sided[side, name] for name in NAMES[limb] if (side, name) in sided)
            joint = next((name for name in fitting if name not in taken), None)
            if part not in found and joint is not None:
                found[part] = joint
    missing = [part for part in PARTS if part not in found]
    if missing:
        raise DeclarationError(
            "human", f"no joint for {', '.join(missing)} among {', '.join(names)}",
            allowed="a table [human] in the map, such as left_hip = \"LeftUpLeg\"",
        )  # fmt: skip
    return {part: found[part] for part in PARTS}


def middle(motion: Motion, parts: Mapping[str, str], limb: str) -> Mat:
    """Half way between a limb of both sides ``(T, 3)``."""
    return 0.5 * (motion.joint(parts[f"left_{limb}"]) + motion.joint(parts[f"right_{limb}"]))

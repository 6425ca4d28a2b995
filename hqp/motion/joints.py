"""Map the joints of a recorded skeleton to parts of a person, by name."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import takewhile

from hqp.errors import DeclarationError
from hqp.kinds import require

SIDES = ("left", "right")
LIMBS = ("shoulder", "elbow", "hand", "knee", "hip", "ankle", "toe")
PARTS = tuple(f"{side}_{limb}" for side in SIDES for limb in LIMBS)
"""Parts of a person; a motion needs a joint for each but the toes."""

OPTIONAL = tuple(f"{side}_toe" for side in SIDES)
"""Parts that a motion may lack: estimates of 17 joints end at the ankles."""

NAMES: dict[str, tuple[str, ...]] = {
    "shoulder": (
        "upperarm", "armupper", "uparm", "uarm", "humerus", "shldr", "arm", "shoulder", "acromial", "sjc",
    ),
    "elbow": (
        "elbow", "forearm", "lowerarm", "armlower", "lowarm", "loarm", "farm", "larm", "radius", "ulna", "ejc", "arm",
    ),
    "hand": ("wrist", "hand", "radiushand", "wjc"),
    "knee": ("knee", "lowerleg", "leglower", "lowleg", "loleg", "lleg", "shin", "shank", "calf", "tibia", "kjc", "leg"),
    "hip": ("hip", "upleg", "upperleg", "legupper", "uleg", "thigh", "femur", "hjc", "leg"),
    "ankle": ("ankle", "foot", "talus", "ajc"),
    "toe": (
        "toebase", "toe", "toes", "bigtoe", "bigtoetip", "ball", "ballfoot", "mtp", "foottoe", "footindex", "foot",
        "toeend", "ankleend", "footend",
    ),
}  # fmt: skip
"""Names of a part without its side, the first that occurs counts: in most skeletons ``LeftArm`` begins at the shoulder
and ``LeftShoulder`` is the collar bone, in those that have no ``LeftArm`` it is the shoulder, and beside a
``LeftUpperArm`` it is the forearm; ``LeftLeg`` begins at the hip if there is a ``LeftShin`` (SOMA), else at the knee
(LAFAN1)."""

MANNERS = ("bend", "stretch")
"""Ends of names of the first of several joints along a limb: ``lThighBend``, ``arm_stretch.l``."""

FORMS = (("left", "right"), ("Left", "Right"), ("LEFT", "RIGHT"), ("l", "r"), ("L", "R"))
"""Spellings of both sides in names."""

SHORT = {"left": "l|lf|lft", "right": "r|rt|rgt"}
"""Short sides in names, apart from the rest: ``lf_hip``."""

_KNOWN = "|".join(sorted({name for names in NAMES.values() for name in names}))


def plain(name: str) -> tuple[str, str]:
    """(side, rest) of a joint's name, in small letters: ``mixamorig:LeftUpLeg``, ``L_Hip`` and ``thigh.l`` have one.

    The end of a chain keeps its mark: ``foot.LEnd`` is (left, footend).
    """
    name = name.rsplit(":", 1)[-1]
    end = "end" if name.endswith("End") else ""
    name = name.removesuffix("End").rstrip(" _.")
    for side in SIDES:
        letter, short = side[0], SHORT[side]
        patterns = (
            rf"^{letter.upper()}({_KNOWN.upper()})$", rf"(?i:^{side})(.*)$", rf"(?i:^(?:{short})[ _.-])(.*)$",
            rf"^{letter}(?=[A-Z])(.*)$",
            rf"^{letter.upper()}(?=[A-Z][a-z])(.*)$", rf"(.*)(?i:[ _.(-]{side})$", rf"(.*)(?i:[ _.(-](?:{short}))$",
            rf"(.*)(?:{side.title()})$", rf"(.*[a-z0-9]){letter.upper()}$", rf"(?i:^{letter}({_KNOWN})$)",
        )  # fmt: skip
        for pattern in patterns:
            if found := re.match(pattern, name):
                rest = re.sub(r"[^a-z]", "", found[1].lower())
                return side, re.sub(f"({'|'.join(MANNERS)})$", "", rest) + end
    return "", re.sub(r"[^a-z]", "", name.lower()) + end


def bare(names: Sequence[str]) -> list[str]:
    """Names without a number or brackets at their end, and without the beginning and the end that all joints with a
    counterpart on the other side share: ``DEF-thigh.L``, ``J_Bip_L_Hand`` and ``NPC L Thigh [LThg]`` have one.
    """
    names = [re.sub(r"[ _.]\d+$| *\[.*\]$", "", name.strip()) for name in names]
    paired, known = [], set(names)
    for name in names:
        for own, other in (form[::way] for form in FORMS for way in (1, -1)):
            for side in re.finditer(own, name):
                before, after = name[: side.start()], name[side.end() :]
                if before + other + after in known:
                    paired += [name, before + after]
    first, last = _begin(paired), _begin([name[::-1] for name in paired])[::-1]
    return [name.removeprefix(first).removesuffix(last) for name in names]


def _begin(names: Sequence[str]) -> str:
    """The letters with which all names begin."""
    least, most = min(names, default=""), max(names, default="")
    return least[: sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(least, most, strict=False)))]


def parts_of(names: Sequence[str], given: Mapping[str, str] | None = None) -> dict[str, str]:
    """The joint of each of ``PARTS``, without ``OPTIONAL`` ones that are missing; given: parts whose joints have other
    names.

    Raises DeclarationError for a part without a joint, and for one that is given and not there.
    """
    given = {} if given is None else given
    require("human", "table", given, Mapping, "names of joints by part of the person")
    for part, name in given.items():
        if part not in PARTS:
            raise DeclarationError("human", "unknown part", value=part, allowed=", ".join(PARTS))
        if name not in names:
            raise DeclarationError("human", f"the motion has no joint for {part}", value=name, allowed=", ".join(names))
    sided: dict[tuple[str, str], str] = {}
    for name, own in sorted(zip(names, bare(names), strict=True), key=lambda each: len(each[0])):
        sided.setdefault(plain(own), name)  # the joint itself before its second part, ``thigh.L.001``
    found = dict(given)
    for side in SIDES:
        for limb in LIMBS:
            part = f"{side}_{limb}"
            taken = set(found.values())
            fitting = (sided[side, name] for name in NAMES[limb] if (side, name) in sided)
            joint = next((name for name in fitting if name not in taken), None)
            if part not in found and joint is not None:
                found[part] = joint
    missing = [part for part in PARTS if part not in found and part not in OPTIONAL]
    if missing:
        raise DeclarationError(
            "human", f"no joint for {', '.join(missing)} among {', '.join(names)}",
            allowed="a table [human] in the map, such as left_hip = \"LeftUpLeg\"",
        )  # fmt: skip
    if any(part in found for part in OPTIONAL) and not all(part in found for part in OPTIONAL):
        raise DeclarationError("human", "a toe on one side only", value=[p for p in OPTIONAL if p in found])
    return {part: found[part] for part in PARTS if part in found}

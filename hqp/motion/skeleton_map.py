"""Map the frames of a robot to parts of a person."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from hqp.declare.robot import Robot
from hqp.errors import DeclarationError, closest
from hqp.kinds import file_path

from .joints import SIDES

BODY = ("pelvis", "torso")
CHAIN = ("hip", "knee", "ankle", "sole", "shoulder", "elbow", "hand")
FRAMES = (*BODY, *(f"{side}_{limb}" for side in SIDES for limb in CHAIN))
"""Parts of a person that a map names a frame for."""

Offset = tuple[float, float, float]


@dataclass(frozen=True)
class SkeletonMap:
    """Names and offsets, no weights.

    frames: frames of the robot, one for each of pelvis, torso, and left and right hip, knee, ankle, sole, shoulder,
    elbow and hand.  A sole is a point of the foot that is on level ground at home.  offsets: by part, the point that is
    meant in the frame's axes ``(3,)`` [m].  human: by part of the person (left_hip, left_toe, ...), the joint of the
    motion, if its name does not match.  Raises DeclarationError for parts that are missing or unknown, and offsets that
    are no three numbers.
    """

    frames: Mapping[str, str]
    offsets: Mapping[str, Offset] = field(default_factory=dict)
    human: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        missing = [part for part in FRAMES if part not in self.frames]
        if missing:
            raise DeclarationError("map", f"no frame for {', '.join(missing)}", allowed=", ".join(FRAMES))
        for part in (*self.frames, *self.offsets):
            if part not in FRAMES:
                near = ", ".join(closest(part, FRAMES) or FRAMES)
                raise DeclarationError("map", "unknown part", value=part, allowed=near)
        offsets = {}
        for part, offset in self.offsets.items():
            try:
                x, y, z = (float(number) for number in offset)
            except (TypeError, ValueError) as error:
                raise DeclarationError("map", f"offset of {part}", value=offset, allowed="three numbers") from error
            if not max(abs(x), abs(y), abs(z)) < 10.0:
                raise DeclarationError("map", f"offset of {part}", value=offset, unit="m", allowed="three numbers")
            offsets[part] = (x, y, z)
        for what, table in (("frames", self.frames), ("offsets", offsets), ("human", self.human)):
            object.__setattr__(self, what, dict(table))

    def offset(self, part: str) -> Offset:
        """The point of the part's frame that is meant ``(3,)`` [m]."""
        return self.offsets.get(part, (0.0, 0.0, 0.0))

    def fits(self, robot: Robot) -> bool:
        """Return true if the robot has all frames."""
        return set(self.frames.values()) <= set(robot.frame_names)

    def check(self, robot: Robot) -> None:
        """Raise FrameNotFound for a frame that the robot lacks, DeclarationError for a robot without a free base."""
        if not robot.floating:
            raise DeclarationError("retarget", "a robot whose base is fixed", value=robot.name, allowed="a free base")
        for name in self.frames.values():
            robot.frame(name)

    def toml(self) -> str:
        """The map as a file."""
        lines = ["[frames]", *(f'{part} = "{self.frames[part]}"' for part in FRAMES)]
        if self.offsets:
            lines += ["", "[offsets]  # of the point that is meant, in the frame's axes [m]"]
            lines += [f"{part} = [{', '.join(f'{x:g}' for x in self.offset(part))}]" for part in self.offsets]
        if self.human:
            lines += [
                "",
                "[human]  # joints of the motion",
                *(f'{part} = "{name}"' for part, name in self.human.items()),
            ]
        return "\n".join(lines) + "\n"


def shipped() -> dict[str, SkeletonMap]:
    """The maps that come with hqp, by robot."""
    folder = resources.files("hqp.motion") / "maps"
    files = sorted((f for f in folder.iterdir() if f.name.endswith(".toml")), key=lambda f: f.name)
    return {f.name.removesuffix(".toml"): parse(f.read_text(encoding="utf-8"), f.name) for f in files}


def parse(text: str, name: str = "map") -> SkeletonMap:
    """The map of a TOML text; raises DeclarationError."""
    try:
        import tomllib
    except ImportError:
        import tomli as tomllib  # type: ignore[no-redef,import-not-found,unused-ignore]
    try:
        tables: dict[str, Any] = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise DeclarationError("map", f"no TOML: {error}", value=name) from error
    strange = set(tables) - {"frames", "offsets", "human"}
    if strange or not all(isinstance(table, dict) for table in tables.values()):
        raise DeclarationError("map", "tables", value=sorted(tables), allowed="[frames], [offsets], [human]")
    return SkeletonMap(tables.get("frames", {}), tables.get("offsets", {}), tables.get("human", {}))


def find_map(given: SkeletonMap | str | Path | None, robot: Robot) -> SkeletonMap:
    """A map as given, from a file, by name, or for None the first shipped one that fits the robot, its soles at the
    robot's lowest shapes.

    Raises DeclarationError where none does, FrameNotFound for one that does not fit.
    """
    if given is None:
        maps = shipped()
        fitting = [found for found in maps.values() if found.fits(robot)]
        if not fitting:
            allowed = f"map=FILE, which `hqp retarget --suggest-map` begins; shipped: {', '.join(maps)}"
            raise DeclarationError("retarget", "no shipped map fits the robot", value=robot.name, allowed=allowed)
        from .suggestion import on_shapes

        found = on_shapes(fitting[0], robot)
    elif isinstance(given, SkeletonMap):
        found = given
    elif str(file_path("map", given)) in (maps := shipped()):
        found = maps[str(given)]
    else:
        try:
            found = parse(Path(given).read_text(encoding="utf-8"), str(given))
        except (OSError, UnicodeDecodeError) as error:
            allowed = f"a file, or {', '.join(maps)}"
            raise DeclarationError("map", f"cannot be read: {error}", value=str(given), allowed=allowed) from error
    found.check(robot)
    return found

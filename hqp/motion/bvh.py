"""Motions from BVH files."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from decimal import ROUND_DOWN, ROUND_HALF_EVEN, Decimal, InvalidOperation
from pathlib import Path

import numpy as np

from hqp.arrays import Mat
from hqp.errors import DeclarationError

from .clip import Motion

END = "End"
"""Behind the name of a joint: the end of a chain."""

CHANNELS = {f"{axis}{kind}": (kind, k) for k, axis in enumerate("XYZ") for kind in ("position", "rotation")}
"""Kind and axis of a channel."""

VIDEO = tuple(1000.0 * rate / 1001.0 for rate in (24, 30, 48, 60, 120, 240))
"""Rates of NTSC video, 23.976 and so on [1/s]."""


@dataclass
class _Joint:
    name: str
    parent: int
    offset: Mat = field(default_factory=lambda: np.zeros(3))
    channels: list[str] = field(default_factory=list)


def read_bvh(path: str | Path) -> Motion:
    """Joint positions of a BVH file in its own axes and unit; ends of chains are joints, ``HeadEnd``.

    A joint's name is the rest of its line, spaces included.  Raises DeclarationError with the line of an invalid file.
    """
    try:
        data = Path(path).read_bytes()
        wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        text = (
            data.decode("utf-16" if wide else "utf-8-sig", errors="replace").replace("\r\n", "\n").replace("\r", "\n")
        )
    except OSError as error:
        raise DeclarationError("motion", f"no BVH file: {error.strerror}", value=str(path)) from error
    try:
        return _parsed(text)
    except ValueError as error:
        if isinstance(error, DeclarationError):
            raise
        raise DeclarationError("motion", f"no BVH file: {error}", value=str(path)) from error


def _parsed(text: str) -> Motion:
    """The motion of a file's text; raises ValueError with the line."""
    text = re.sub(r"(?<=\d),(?=\d)", ".", text)  # decimal commas
    parts = re.split(r"^\s*MOTION\s*$", text, maxsplit=1, flags=re.MULTILINE | re.IGNORECASE)
    if len(parts) < 2:
        raise ValueError("no line MOTION")
    joints = _hierarchy(parts[0])
    head = re.match(r"\s*Frames\s*:\s*(\S+)\s+Frame\s+Time\s*:\s*(\S+)(.*)", parts[1], re.DOTALL | re.IGNORECASE)
    if head is None:
        raise ValueError("MOTION is not followed by 'Frames: N' and 'Frame Time: SECONDS'")
    count, width = _whole(head[1], "frames"), sum(len(joint.channels) for joint in joints)
    if count < 2:
        raise ValueError(f"{count} frames, needed at least 2")
    try:
        numbers = np.array(head[3].split(), dtype=np.float64)
    except ValueError as error:
        raise ValueError(f"the frames have a word that is not a number ({error})") from error
    if len(numbers) != count * width:
        raise ValueError(f"{len(numbers)} numbers, needed {count * width}: {count} frames of {width} channels")
    unknown = np.flatnonzero(~np.isfinite(numbers))
    if unknown.size:
        raise ValueError(f"frame {unknown[0] // width} has a number that is not finite")
    return _placed(joints, numbers.reshape(count, width), _rate(head[2]))


def _hierarchy(text: str) -> list[_Joint]:
    """Joints, parents before children; raises ValueError with the line."""
    joints: list[_Joint] = []
    opened: list[int] = []
    pending: int | None = None
    for line, words in _lines(text):
        key, rest = words.split(maxsplit=1)[0].upper(), words.split(maxsplit=1)[1:]
        if key == "HIERARCHY":
            continue
        if pending is not None and key != "{":
            raise ValueError(f"line {line}: {words!r} in place of {{")
        if key in ("ROOT", "JOINT", "END", "END_SITE"):
            if (key == "ROOT") == bool(opened) or (key != "ROOT" and not rest and key != "END_SITE"):
                raise ValueError(f"line {line}: {words!r} in the wrong place")
            parent = opened[-1] if opened else -1
            name = f"{joints[parent].name}{END}" if key.startswith("END") else rest[0].strip() if rest else "root"
            pending = len(joints)
            joints.append(_Joint(name, parent))
        elif key == "{" and pending is not None:
            opened.append(pending)
            pending = None
        elif key == "}" and opened:
            opened.pop()
        elif key == "OFFSET" and opened:
            joints[opened[-1]].offset = _offset(rest, line)
        elif key == "CHANNELS" and opened:
            joints[opened[-1]].channels = _channels(rest, line)
        else:
            raise ValueError(f"line {line}: {words[:40]!r} in the wrong place")
    if opened or not joints:
        raise ValueError(f"the hierarchy ends within {joints[opened[-1]].name!r}" if opened else "no line ROOT")
    return joints


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Number and text of each line, braces on lines of their own."""
    for number, line in enumerate(text.splitlines(), 1):
        for part in re.split(r"([{}])", line):
            if part.strip():
                yield number, part.strip()


def _offset(rest: list[str], line: int) -> Mat:
    words = rest[0].split() if rest else []
    try:
        offset = np.array(words, dtype=np.float64)
    except ValueError:
        offset = np.zeros(0)
    if offset.shape != (3,):
        raise ValueError(f"line {line}: OFFSET {' '.join(words)[:40]!r}, needed three numbers")
    return offset


def _channels(rest: list[str], line: int) -> list[str]:
    words = rest[0].split() if rest else []
    count, names = _whole(words[0] if words else "", f"line {line}: CHANNELS"), [w.capitalize() for w in words[1:]]
    strange = [name for name in names if name not in CHANNELS]
    if strange or len(names) != count:
        raise ValueError(f"line {line}: {count} channels {strange or names}, allowed {', '.join(CHANNELS)}")
    return names


def _whole(word: str, what: str) -> int:
    if not word.isdecimal():
        raise ValueError(f"{what} {word[:20]!r}, needed a whole number")
    return int(word)


def _placed(joints: list[_Joint], numbers: Mat, fps: float) -> Motion:
    """The motion of joints whose channels have these values ``(T, C)``."""
    from scipy.spatial.transform import Rotation

    names: list[str] = []
    places: list[Mat] = []
    turns: list[Rotation] = []
    kept: list[int] = []
    at = 0
    for k, joint in enumerate(joints):
        values = numbers[:, at : at + len(joint.channels)]
        at += len(joint.channels)
        local, turn = np.tile(joint.offset, (len(numbers), 1)), Rotation.identity(len(numbers))
        for channel, column in zip(joint.channels, values.T, strict=True):
            kind, axis = CHANNELS[channel]
            if kind == "position":
                local[:, axis] = column
            else:
                turn = turn * Rotation.from_rotvec(np.outer(np.deg2rad(column), np.eye(3)[axis]))
        if joint.parent >= 0:
            local = places[joint.parent] + turns[joint.parent].apply(local)
            turn = turns[joint.parent] * turn
        places.append(local)
        turns.append(turn)
        if joint.name.endswith(END) and not joint.channels and not joint.offset.any():
            continue  # an end of no length is its parent
        name = joint.name
        while name in names:
            name += "_"
        names.append(name)
        kept.append(k)
    parents = tuple(kept.index(joints[k].parent) if joints[k].parent >= 0 else -1 for k in kept)
    return Motion(tuple(names), np.stack([places[k] for k in kept], axis=1), fps, parents)


def _rate(written: str) -> float:
    """Frames per second: the whole or video rate with the written digits of the period, else the period's inverse.

    ``0.008333`` is 120, ``0.033367`` 30000 / 1001, ``0.03`` fits 33 and 34 and stays 1 / 0.03.
    """
    try:
        period = Decimal(written).normalize()
        exponent = period.as_tuple().exponent
    except InvalidOperation:
        period, exponent = Decimal(0), 0
    if not isinstance(exponent, int) or not period > 0:
        raise DeclarationError("motion", "frame time", value=written, unit="s", allowed="above 0")
    inverse, last = 1.0 / float(period), Decimal(1).scaleb(exponent)
    near = [float(rate) for rate in (int(inverse), int(inverse) + 1) if rate > 0]

    def fits(rate: float) -> bool:
        exact = 1 / Decimal(rate)
        if np.float32(float(exact)) == np.float32(float(period)):
            return True
        return period in (exact.quantize(last, ROUND_HALF_EVEN), exact.quantize(last, ROUND_DOWN))

    whole = [rate for rate in near if fits(rate)]
    if len(whole) == 1:
        return whole[0]
    video = [] if whole else [rate for rate in VIDEO if fits(rate)]
    return video[0] if len(video) == 1 else inverse

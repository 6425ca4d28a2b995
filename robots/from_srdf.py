"""SRDF files: group states as named configurations, and pairs of links that need not be kept apart."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pinocchio as pin

from hqp.errors import ModelError

from . import xml_lines
from .description import Description

_PARTS = ("group_state", "joint", "disable_collisions")
_NEEDED = {"group_state": ("name",), "disable_collisions": ("link1", "link2")}


def read(path: Path, found: Description) -> None:
    """Add the group states and the disabled pairs; raises ModelError for an invalid file or value.

    Warnings list entries that Pinocchio's reader ignores: joints that the model does not have, a state's name once
    more.
    """
    if not path.is_file():
        raise ModelError(f"no such file: {path}")
    root = xml_lines.read(path)
    if root.tag != "robot":
        raise ModelError(f"{path}: its root element is <{root.tag}>; allowed: <robot> (SRDF)")
    for element in root.iter():
        meant = next((word for word in _PARTS if word == element.tag.lower() != element.tag), None)
        if meant is not None:
            raise ModelError(f"{xml_lines.place(path, element)}: <{element.tag}> is unknown; allowed: <{meant}>")
        for needed in _NEEDED.get(element.tag, ()):
            if not element.get(needed):
                at = xml_lines.place(path, element)
                raise ModelError(f'{at}: <{element.tag}> has no {needed}; allowed: {needed}="..."')
    states = root.findall("group_state")
    for name, count in Counter(state.get("name") for state in states).items():
        if count > 1:
            found.warnings.append(f"{path.name}: {count} group states {name!r}, using the first")
    for state in states:
        what = f"group state {state.get('name')!r}"
        unknown = []
        twice = [name for name, n in Counter(joint.get("name") for joint in state.findall("joint")).items() if n > 1]
        if twice:
            found.warnings.append(f"{path.name}: {what} has several values of {', '.join(map(str, twice))}")
        for joint in state.findall("joint"):
            name, text = str(joint.get("name")), str(joint.get("value"))
            if not found.model.existJointName(name):
                unknown.append(name)
                continue
            model = found.model.joints[found.model.getJointId(name)]
            if not _are_numbers(text, 1 if model.nv == 1 else model.nq):
                raise ModelError(
                    f"{xml_lines.place(path, joint)}: {what}, joint {name!r}: value={text!r} is not a number"
                )
        if unknown:
            found.warnings.append(f"{path.name}: {what} names unknown or fixed joints: {', '.join(unknown)}")
    read_states(path, found)
    links = {frame.name for frame in found.model.frames if frame.type == pin.FrameType.BODY}
    named = {str(pair.get(end)) for pair in root.iter("disable_collisions") for end in ("link1", "link2")}
    strange = sorted(named - links)
    if strange:
        found.notes.append(f"{path.name}: disabled pairs of links that the robot does not have: {', '.join(strange)}")
    pairs = ((str(pair.get("link1")), str(pair.get("link2"))) for pair in root.iter("disable_collisions"))
    found.disabled_pairs = frozenset(map(frozenset, pairs))


def read_states(path: Path, found: Description) -> None:
    """Add the group states to the configurations, joints that they leave out at neutral; raises ModelError."""
    try:
        pin.loadReferenceConfigurations(found.model, str(path), False)
    except (RuntimeError, ValueError) as error:
        raise ModelError(f"{path}: cannot read the SRDF: {error}") from error
    found.configurations |= {pose.key(): pose.data() for pose in found.model.referenceConfigurations}


def _are_numbers(text: str, count: int) -> bool:
    try:
        values = np.array(text.split(), dtype=np.float64)
    except ValueError:
        return False
    return values.size == count and bool(np.isfinite(values).all())

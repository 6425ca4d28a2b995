"""Structure of a URDF: demands of its reader, reported with line and element before it reads."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from pathlib import Path

from hqp.errors import ModelError

from .xml_lines import named, place

_MACRO = "xacro:"
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_ONCE = (
    "inertial", "mass", "inertia", "origin", "geometry", "parent", "child", "axis", "limit", "dynamics", "mimic",
    "safety_controller", "calibration",
)  # fmt: skip
_PARTS = ("link", "joint", "visual", "collision", "box", "sphere", "cylinder", "mesh", "material", *_ONCE)
_ATTRIBUTES = (
    "name", "type", "xyz", "rpy", "value", "size", "radius", "length", "filename", "scale", "lower", "upper", "effort",
    "velocity", "damping", "friction", "multiplier", "offset", *_MOMENTS,
)  # fmt: skip
_NEEDED: dict[str, tuple[str, ...]] = {
    "limit": ("effort", "velocity"),
    "mimic": ("joint",),
    "safety_controller": ("k_velocity",),
}
"""Attributes that an element of a joint must have."""


def check(path: Path, root: ET.Element) -> None:
    """Raise ModelError for the first fault: names twice, missing parts, unknown links, several roots, loops."""
    if not root.get("name"):
        raise _fault(path, root, "<robot> has no name", '<robot name="...">')
    if root.get("version", "1.0") not in ("1.0", "1.1"):
        raise _fault(path, root, f"version {root.get('version')!r} of URDF is not read", "1.0")
    if root.find("link") is None:
        raise _fault(path, root, "a robot without a <link>", "one link or more")
    for tag in ("link", "joint", "material"):
        seen: dict[str, ET.Element] = {}
        for name, element in named(root, tag):
            if not element.get("name") or (tag, name) == ("joint", "universe"):
                given = f"{tag} {name!r}: its name is reserved" if element.get("name") else f"<{tag}> has no name"
                raise _fault(path, element, given, 'name="...", for joints not "universe"')
            if name in seen:
                first = place(path, seen[name]).rpartition(", ")[2]
                raise _fault(path, element, f"{tag} {name!r} is there twice, first on {first}", "another name")
            seen[name] = element
    links = {name for name, _ in named(root, "link")}
    for name, joint in named(root, "joint"):
        _check_joint(path, f"joint {name!r}", joint, links)
    _check_tree(path, root)


def refuse_macros(path: Path, root: ET.Element) -> None:
    """Raise ModelError for a macro that xacro has not expanded."""
    for element in root.iter():
        if element.tag.startswith(_MACRO):
            what = f"<{element.tag}>: a macro of xacro is left in"
            raise _fault(path, element, what, "plain URDF; run xacro on the source file")


def refuse_spellings(path: Path, root: ET.Element) -> None:
    """Raise ModelError for a name of an element or attribute that differs in case alone from one of URDF."""
    known = {word.lower(): word for word in (*_PARTS, *_ATTRIBUTES)}
    for owner, element in _parts(root):
        for given in (element.tag, *element.attrib):
            meant = known.get(given.lower(), given)
            if meant != given:
                raise _fault(
                    path, element, f"{owner}: {given!r} of <{element.tag}> is unknown", f"{meant!r}: case counts"
                )


def repeated(path: Path, root: ET.Element) -> list[str]:
    """Sentences on elements of a link or joint that are there twice, of which the reader takes the first."""
    found = []
    for owner, element in _parts(root):
        seen = set()
        for child in element:
            if child.tag in seen:
                line = place(path, child).rpartition(", ")[2]
                found.append(f"{line}: {owner} has one more <{child.tag}>, using the first")
            if child.tag in _ONCE:
                seen.add(child.tag)
    return found


def _parts(root: ET.Element) -> Iterator[tuple[str, ET.Element]]:
    """The root's children and all elements in links and joints, with their link or joint."""
    for child in root:
        owner = f"{child.tag} {child.get('name')!r}"
        for element in child.iter() if child.tag in ("link", "joint") else (child,):
            yield owner, element


def incomplete_inertias(path: Path, root: ET.Element) -> list[str]:
    """Sentences on inertias that the reader takes as zero because a part is missing."""
    found = []
    for name, link in named(root, "link"):
        inertial = link.find("inertial")
        if inertial is None:
            continue
        for tag, needed in (("mass", ("value",)), ("inertia", _MOMENTS)):
            element = inertial.find(tag)
            if element is None:
                line = place(path, inertial).rpartition(", ")[2]
                found.append(f"{line}: link {name!r}: its <inertial> has no <{tag}>, which is read as zero")
            elif missing := [word for word in needed if element.get(word) is None]:
                line = place(path, element).rpartition(", ")[2]
                found.append(f"{line}: link {name!r}: its <{tag}> has no {missing[0]}, all of it is read as zero")
    return found


def _check_joint(path: Path, what: str, joint: ET.Element, links: set[str]) -> None:
    for end in ("parent", "child"):
        element = joint.find(end)
        if element is None:
            raise _fault(path, joint, f"{what} has no <{end}>", f'<{end} link="..."/>')
        _demand(path, what, element, ("link",))
        if element.get("link") not in links:
            raise _fault(path, element, f"{what}: its {end} {element.get('link')!r} is no link", "a link of the file")
    if joint.get("type") in ("revolute", "prismatic") and joint.find("limit") is None:
        allowed = '<limit lower= upper= effort= velocity=/>, or type="continuous"'
        raise _fault(path, joint, f"{what} is {joint.get('type')} and has no <limit>", allowed)
    for tag, names in _NEEDED.items():
        if (element := joint.find(tag)) is not None:
            _demand(path, what, element, names)
    dynamics = joint.find("dynamics")
    if dynamics is not None and not {"damping", "friction"} & set(dynamics.keys()):
        raise _fault(path, dynamics, f"{what}: <dynamics> has neither damping nor friction", "damping=, friction=")


def _check_tree(path: Path, root: ET.Element) -> None:
    carried: dict[str, tuple[str, str]] = {}
    for name, joint in named(root, "joint"):
        child, parent = (str(joint.find(end).get("link")) for end in ("child", "parent"))  # type: ignore[union-attr]
        if child in carried:
            what = f"link {child!r} is the child of two joints, {carried[child][0]!r} and {name!r}"
            raise _fault(path, joint, what, "one joint to each link: a URDF is a tree")
        carried[child] = name, parent
    free = [(name, link) for name, link in named(root, "link") if name not in carried]
    if len(free) > 1:
        listed = ", ".join(f"{name!r} ({place(path, link).rpartition(', ')[2]})" for name, link in free)
        raise _fault(path, free[1][1], f"links without a parent: {listed}", "one root; a fixed joint ties the other")
    free_of_loops = {name for name, _ in free}
    for link in carried:
        way: dict[str, None] = {}
        at = link
        while at not in free_of_loops:
            if at in way:
                element = next(e for name, e in named(root, "link") if name == at)
                loop = ", ".join(list(way)[list(way).index(at) :])
                raise _fault(path, element, f"links in a loop: {loop}", "a tree; hqp.tasks.Weld closes a loop")
            way[at] = None
            at = carried[at][1]
        free_of_loops.update(way)


def _demand(path: Path, what: str, element: ET.Element, names: Sequence[str]) -> None:
    for name in names:
        if element.get(name) is None:
            raise _fault(path, element, f"{what}: its <{element.tag}> has no {name}", f'{name}="..."')


def _fault(path: Path, element: ET.Element, what: str, allowed: str) -> ModelError:
    return ModelError(f"{place(path, element)}: {what}; allowed: {allowed}")

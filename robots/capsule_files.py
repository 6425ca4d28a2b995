"""Capsules as TOML files: shipped ones in ``robots/capsules``, found by the surface of a link, and users' own."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.errors import ModelError, ModelWarning
from hqp.shapes import LinkCapsule

from .capsules import Capsule, link_name, surfaces
from .surface import Surface, sphere

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

FOLDER = Path(__file__).parent / "capsules"
SAME = 1e-6
"""Largest difference of the measures of one surface [m]: files round their numbers."""
_DIRECTIONS = sphere(20)


class _Shipped(NamedTuple):
    """Links of all files: measures of their surfaces ``(n, 24)`` [m] and their capsules, in the axes of the link."""

    measures: Mat
    capsules: tuple[tuple[Capsule, ...], ...]


def shipped(robot: Any, found: Mapping[int, Surface]) -> dict[int, tuple[LinkCapsule, ...]]:
    """Capsules that ship with hqp, by joint, of the links whose surface is that of the fit; names do not count."""
    library, fits = _shipped(), {}
    for joint, part in found.items():
        off = np.abs(library.measures - measures(part.placed(_axes(robot, joint).inverse()))).max(axis=1, initial=0.0)
        if off.size and off.min() <= SAME:
            fits[joint] = named(robot, joint, library.capsules[int(off.argmin())])
    return fits


def named(robot: Any, joint: int, fits: Sequence[Capsule]) -> tuple[LinkCapsule, ...]:
    """Capsules of a joint, from the axes of its link, with the link's name and a number if there are several."""
    placement, name, found = _axes(robot, joint), link_name(robot, joint), []
    for k, (a, b, radius) in enumerate(fits):
        title = name if len(fits) == 1 else f"{name}/{k}"
        found.append(LinkCapsule(title, joint, _tuple(placement * a), _tuple(placement * b), radius, True))
    return tuple(found)


def read(robot: Any, path: Path) -> tuple[LinkCapsule, ...]:
    """Capsules of a file of ``hqp capsules``, with a ModelWarning for links whose shapes differ from those of the fit.

    Raises ModelError if the file is missing or names a link that the robot lacks.
    """
    if not path.is_file():
        raise ModelError(f"no such file: {path}")
    table = tomllib.loads(path.read_text())
    try:
        found = tuple(_placed(robot, entry) for entry in table["capsule"])
        fitted = {robot.body(robot.frame(e["link"])): np.array(e["measures"]) for e in table.get("surface", ())}
    except KeyError as error:
        raise ModelError(f"{path}: capsules do not fit {robot.name}: {error}") from error
    same = _same(robot, path, fitted) if fitted else set()
    return tuple(c._replace(fitted=c.body in same) for c in found)


def _same(robot: Any, path: Path, fitted: Mapping[int, Vec]) -> set[int]:
    """Bodies whose surfaces are those of the fit; warns of others."""
    try:
        own = {j: measures(part.placed(_axes(robot, j).inverse())) for j, part in surfaces(robot).items()}
    except ModelError:  # no shapes to compare with
        return set()
    joints = {*own, *fitted}
    differ = [j for j in joints if j not in own or j not in fitted or np.abs(own[j] - fitted[j]).max() > SAME]
    if differ:
        links = ", ".join(link_name(robot, j) for j in sorted(differ))
        message = (
            f"{path}: capsules were fitted to other shapes than {robot.name} has at {links}; fit anew: hqp capsules"
        )
        warnings.warn(message, ModelWarning, stacklevel=4)
    return joints - set(differ)


def measures(part: Surface) -> Vec:
    """Twenty support heights, centroid and square root of the size of a surface ``(24,)`` [m].

    They do not depend on the order, the number or the division of the triangles.  Size and centroid weigh a triangle
    of area A, perimeter p and swept radius r by A + r p + r^2, so that each shape of a link counts.
    """
    t, r = part.triangles, part.radii
    heights = (np.einsum("nkd,md->nkm", t, _DIRECTIONS).max(axis=1) + r[:, None]).max(axis=0)
    area = 0.5 * np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1)
    weight = area + r * np.linalg.norm(t - np.roll(t, 1, axis=1), axis=2).sum(axis=1) + r**2
    size = float(weight.sum())
    centroid = weight @ t.mean(axis=1) / max(size, 1e-18)
    return np.concatenate((heights, centroid, [np.sqrt(size)]))


def text(robot: Any, found: Sequence[LinkCapsule]) -> str:
    """The capsules as TOML, ends in the axes of their links."""
    lines = [
        f"# Capsules around the shapes of {robot.name}, fitted by `hqp capsules`; ends in the link's axes [m].",
        "# measures: support heights, centroid and size of the surface that they were fitted to [m].",
        "format = 1",
    ]
    for c in found:
        inverse = _axes(robot, c.body).inverse()
        a, b = (inverse * np.array(end) for end in (c.a, c.b))
        lines += ["", "[[capsule]]", f'name = "{c.name}"', f'link = "{link_name(robot, c.body)}"']
        lines += [f"a = {_row(a)}", f"b = {_row(b)}", f"radius = {c.radius + 1.5e-6:.6f}"]
    for joint, part in surfaces(robot).items():
        values = _row(measures(part.placed(_axes(robot, joint).inverse())), 7)
        lines += ["", "[[surface]]", f'link = "{link_name(robot, joint)}"', f"measures = {values}"]
    return "\n".join(lines) + "\n"


def _row(values: Iterable[float], digits: int = 6) -> str:
    return "[" + ", ".join(f"{float(x) + 0.0:.{digits}f}" for x in values) + "]"


def _axes(robot: Any, joint: int) -> Any:
    """Placement of the link's axes in its joint, a pinocchio.SE3."""
    return robot.model.frames[robot.frame(link_name(robot, joint))].placement


def _placed(robot: Any, entry: Mapping[str, Any]) -> LinkCapsule:
    index = robot.frame(entry["link"])
    placement = robot.model.frames[index].placement
    a, b, radius = _numbers(entry)
    name, body = entry.get("name", entry["link"]), robot.body(index)
    return LinkCapsule(name, body, _tuple(placement * a), _tuple(placement * b), radius)


def _tuple(point: Vec) -> tuple[float, float, float]:
    x, y, z = point.tolist()
    return x, y, z


def _numbers(entry: Mapping[str, Any]) -> Capsule:
    a, b = (np.array(entry[end], dtype=np.float64) for end in ("a", "b"))
    return a, b, float(entry["radius"])


@cache
def _shipped() -> _Shipped:
    rows: list[Vec] = []
    found: list[tuple[Capsule, ...]] = []
    for path in sorted(FOLDER.glob("*.toml")):
        table = tomllib.loads(path.read_text())
        for entry in table.get("surface", ()):
            rows.append(np.array(entry["measures"], dtype=np.float64))
            found.append(tuple(_numbers(c) for c in table["capsule"] if c["link"] == entry["link"]))
    return _Shipped(np.array(rows).reshape(-1, len(_DIRECTIONS) + 4), tuple(found))

"""Robots by catalogue name, description file or Pinocchio model."""

from __future__ import annotations

import importlib
import importlib.util
import sys
import warnings
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from hqp.errors import DeclarationError, ModelError, ModelWarning, closest
from hqp.numbers import number

from . import file_kind, from_srdf, from_urdf
from .description import Description
from .on_pinocchio import Robot, Wheel
from .rotors import rotor_inertia

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_HERE = Path(__file__).parent
_OWN = ("cbi", "dreamer")
_DATA = "example-robot-data"
_SOURCES = "str, Path, pinocchio.Model, mujoco.MjModel"


def load(
    source: str | Path | Any, *, floating: bool | None = None, name: str | None = None, rotors: bool | float = False,
    srdf: str | Path | None = None, root: str | Sequence[str] | None = None,
) -> Robot:  # fmt: skip
    """A robot from a catalogue name, a URDF or MJCF file, a robot_descriptions name, a pinocchio.Model or a MjModel.

    floating: true for a free base.  None uses the catalogue for a name, the file or model for an MJCF or a model, and
    for any other URDF a fixed base, unless the file has a floating joint at its root.  rotors: give the model the
    reflected rotor inertia of its simulated plant, which our tables and URDF files lack (an MJCF brings its own); a
    number [kg m^2] is that of every motor whose file gives none.  srdf: SRDF of a URDF path; None takes ARM.srdf beside
    ARM.urdf, if there is one.  Its group states become ``robot.configurations``; pairs of links that it disables are
    left out of ``CollisionAvoidance()``.  root: bodies of an MJCF; the robot consists of the trees that they carry or
    belong to.  None takes the actuated trees; other moving bodies become ``robot.obstacles``, and a note lists them.
    The content of a file decides between URDF and MJCF, not its suffix.  Raises ModelError if no robot has that name
    (with the closest names) or a file cannot be read, DeclarationError for another type, an SRDF without a URDF, a root
    without an MJCF, a negative inertia, or a base that differs from the request and cannot be changed.
    """
    if not isinstance(rotors, bool):
        rotors = number("robot", "rotors", rotors, 0.0, unit="kg m^2")
    path = Path(source) if isinstance(source, (str, Path)) else Path()
    kind = file_kind.of(path) if path.is_file() and str(source) not in names() else ""
    if srdf is not None and kind != "urdf":
        raise DeclarationError("robot", "an SRDF needs a URDF", value=source, allowed="the path of a URDF")
    compiled = type(source).__name__ == "MjModel"
    if root is not None and kind != "mjcf" and not compiled:
        allowed = "a path of an MJCF, a MjModel"
        raise DeclarationError("root", "chooses among the bodies of an MJCF", value=source, allowed=allowed)
    if isinstance(source, pin.Model) or compiled:
        robot = _compiled(source, name, root) if compiled else Robot(source, name=name)
        if floating not in (None, robot.floating):
            allowed = "None; a free joint at the root frees a model"
            raise DeclarationError(robot.name, "base differs from that of the model", value=floating, allowed=allowed)
        return robot
    if not isinstance(source, (str, Path)):
        raise DeclarationError("robot", "not a name, path or model", value=source, allowed=_SOURCES)
    if str(source) in _OWN:
        return _own(str(source), floating is not False, rotors is not False)
    robot = _from_file(path, floating, name, srdf, root) if kind else _named(str(source), floating, name)
    if rotors and robot.description is not None and robot.description.simulated is None:
        for joint, inertia in rotor_inertia(robot, None if rotors is True else rotors).items():
            robot.model.armature[robot.model.joints[robot.model.getJointId(joint)].idx_v] = inertia
    return robot


def _named(key: str, floating: bool | None, name: str | None) -> Robot:
    path = Path(key)
    if path.suffix.lower() == ".xacro":
        raise ModelError(f"{path} is not a URDF: run xacro {path} > {path.name.removesuffix('.xacro')}")
    if path.suffix.lower() in (".urdf", ".xml", ".mjcf"):
        raise ModelError(f"no such file: {path}")
    if key in _catalogue() or key in _stems():
        return _example(key, floating, name)
    found = _description(key)
    if found is None:
        near = closest(key, names()) or ("none; `hqp robots` lists them; a path of a URDF or MJCF loads as well",)
        raise ModelError(f"no robot {key!r}; closest: {', '.join(near)}{_hint()}")
    return _from_file(found, floating, name or key)


def names() -> tuple[str, ...]:
    """Every catalogue name that loads here and now (robot_descriptions names load besides)."""
    stems = _stems()
    listed = tuple(n for n, entry in _catalogue().items() if entry["stem"] in stems)
    return (*_OWN, *listed, *(s for s in sorted(stems) if s not in listed))


def _own(key: str, floating: bool, rotors: bool) -> Robot:
    folder = _HERE / key
    about = tomllib.loads((folder / "robot.toml").read_text())
    found = _read(folder / about["urdf"], floating)
    model = found.model
    unactuated = set(about["unactuated"])
    wheels = {w["frame"]: Wheel(w["radius"], tuple(w["axle"])) for w in about.get("wheels", ())}
    landmarks = {k: (v,) if isinstance(v, str) else tuple(v) for k, v in about["frames"].items()}
    landmarks.setdefault("base", (about["root"],))
    robot = Robot(
        model,
        name=key,
        actuated=[n for n in model.names[2 if floating else 1 :] if n not in unactuated],
        groups=about["groups"],
        wheels=wheels,
        landmarks=landmarks,
        description=found,
    )
    for joints, inertia in about["plant"]["armature"].items() if rotors else ():
        model.armature[robot.joints(joints)] = inertia
    _stand(robot, about["posture"], [c["frame"] for c in about.get("contacts", ())] or landmarks["wheel_contacts"])
    return robot


def _example(key: str, floating: bool | None, name: str | None) -> Robot:
    entry: Mapping[str, Any] = _catalogue().get(key, {"stem": key})
    entry = dict(_catalogue().get(entry.get("like", ""), {})) | dict(entry)
    path = _stems().get(entry["stem"])
    if path is None:
        raise ModelError(f"robot {key!r} is in the package {_DATA}: pip install {_DATA}")
    if floating is None:
        floating = bool(entry.get("floating", False))
    kinds: tuple[str, ...] = ("soles", "feet", "palms", "base")
    landmarks = {k: tuple(np.atleast_1d(entry[k]).tolist()) for k in kinds if k in entry}
    found = _read(path, floating)
    for frame, place in entry.get("frames", {}).items():
        host = found.model.frames[found.model.getFrameId(place["parent"])]
        at = host.placement * pin.SE3(np.eye(3), np.array(place["position"]))
        found.model.addFrame(pin.Frame(frame, host.parentJoint, 0, at, pin.FrameType.OP_FRAME), False)
    states = _files(".srdf").get(entry.get("srdf", ""))
    if states is not None:
        from_srdf.read_states(states, found)
        found.home = found.configurations.get(entry.get("pose", ""))
    robot = Robot(found.model, name=name or key, groups=entry.get("groups"), landmarks=landmarks, description=found)
    feet = landmarks.get("soles", landmarks.get("feet", ()))
    _stand(robot, entry.get("posture", {}), feet, entry.get("foot_radius", 0.0), entry.get("height"))
    return robot


def _stand(
    robot: Robot, posture: Mapping[str, float], feet: Any, height: float = 0.0, base: float | None = None
) -> None:
    """Put joints at the posture, a free base where the lowest of the feet is at a height [m], or itself at one."""
    q = robot.home.copy()
    for joint, angle in posture.items():
        q[robot.model.joints[robot.model.getJointId(joint)].idx_q] = angle
    robot.set_home(q)
    q = robot.home
    if not robot.floating:
        return
    if feet:
        state = robot.state(q)
        q[2] += height - min(state.position(frame)[2] for frame in feet)
        robot.current = None
    elif base is not None:
        q[2] = base


def _from_file(
    path: Path,
    floating: bool | None,
    name: str | None,
    srdf: str | Path | None = None,
    root: str | Sequence[str] | None = None,
) -> Robot:
    found = _read(path, floating, root)
    beside = path.with_suffix(".srdf")
    if srdf is not None or (found.simulated is None and beside.is_file()):
        from_srdf.read(Path(srdf or beside), found)
    robot = Robot(found.model, name=name or path.stem, description=found)
    for text in found.warnings:
        warnings.warn(f"{path.name}: {text}", ModelWarning, stacklevel=4)
    return robot


def _compiled(simulated: Any, name: str | None, root: str | Sequence[str] | None) -> Robot:
    from . import agreement, from_mjcf

    found = from_mjcf.describe(simulated, None, root)
    agreement.check(found)
    robot = Robot(found.model, name=name, description=found)
    for text in found.warnings:
        warnings.warn(f"{robot.name}: {text}", ModelWarning, stacklevel=4)
    return robot


def _read(path: Path, floating: bool | None, root: str | Sequence[str] | None = None) -> Description:
    if file_kind.of(path) == "urdf":
        return from_urdf.read(path, floating)
    from . import agreement, from_mjcf  # MuJoCo is an extra

    found = from_mjcf.read(path, floating, root)
    agreement.check(found)
    return found


@cache
def _catalogue() -> dict[str, Any]:
    return tomllib.loads((_HERE / "catalogue.toml").read_text())


@cache
def _data() -> tuple[Path, ...]:
    """The URDF and SRDF files of example-robot-data, which holds data only, no Python loader.

    Its wheels and conda packages lie beside Pinocchio's; otherwise pip's record of the installation is read.
    """
    beside = Path(pin.__file__).parents[4] / "share" / _DATA / "robots"
    if found := sorted(beside.glob("*/*/*.[us]rdf")):
        return tuple(found)
    from importlib.metadata import PackageNotFoundError, distribution  # 30 ms, seldom needed

    try:
        package = distribution(_DATA)
    except PackageNotFoundError:
        return ()
    return tuple(Path(str(package.locate_file(file))) for file in package.files or ())


@cache
def _files(suffix: str) -> dict[str, Path]:
    return {path.stem: path for path in _data() if path.suffix == suffix}


def _stems() -> dict[str, Path]:
    return _files(".urdf")


def _description(key: str) -> Path | None:
    """The file behind a robot_descriptions name such as ``panda_description`` or ``g1_mj_description``."""
    for module in (key, f"{key}_description"):
        if importlib.util.find_spec("robot_descriptions") is None:
            return None
        if importlib.util.find_spec(f"robot_descriptions.{module}") is not None:
            description = importlib.import_module(f"robot_descriptions.{module}")
            return Path(getattr(description, "URDF_PATH", None) or description.MJCF_PATH)
    return None


def _hint() -> str:
    return "" if _stems() else f" (more come with: pip install {_DATA})"

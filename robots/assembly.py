"""From a model file to a MjSpec that a plant can compile: file, solver, armature, IMU."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hqp.errors import FrameNotFound, JointNotFound, ModelError

from . import file_kind, urdf_plant
from .from_mjcf import parsed, set_root
from .from_tables import FOLDER, OWN
from .mjcf_names import body_names, joint_names
from .mujoco_extra import mujoco
from .tables import Tables

_LABEL = "hqp_unnamed_"


def find(robot: Any, mjcf: str | Path | None, timestep: float) -> tuple[Any, Path, dict[str, Any]]:
    """The robot's model as a MjSpec, its file, and the ``robot.toml`` of our own ones; raises ModelError.

    mjcf: a file or one of our own; by default the one of the robot's name if that is ours, else the robot's file, a
    URDF through MuJoCo's reader.
    """
    source = getattr(robot, "source", None)
    beside = None if source is None else Path(source).resolve().parent
    stem = str(getattr(robot, "name", "") if mjcf is None else mjcf)
    own: dict[str, str] = {}
    for name in OWN:
        description = Tables.read(FOLDER / name).description
        if stem in description["mjcf"] and (mjcf is not None or beside in (None, FOLDER / name)):
            path = FOLDER / name / f"{stem}.xml"
            return prepared(parsed(path), timestep), path, description
        own |= description["mjcf"]
    if mjcf is None and source is not None:
        path = Path(source)
        is_urdf = file_kind.of(path) == "urdf"
        spec = urdf_plant.read(robot) if is_urdf else parsed(path)
        if not is_urdf and robot.description.rooted is not None:
            set_root(spec, robot.description.rooted, robot.description.roots)
    elif Path(stem).is_file():
        path = Path(stem)
        spec = parsed(path)
    else:
        if mjcf is None and source is None:
            raise ModelError(
                f"{stem}: a plant needs a file, and the robot comes from a model in memory; allowed: mjcf="
            )
        raise ModelError(f"no MJCF {stem!r}: neither a file nor one of {', '.join(own)}")
    name_all(spec)
    if mjcf is None and file_kind.of(path) != "urdf":
        urdf_plant.free_frames(spec, robot)
    return prepared(spec, timestep), path, {}


def prepared(spec: Any, timestep: float) -> Any:
    """The MjSpec with the plant's solver: implicitfast, elliptic cones, MuJoCo's default solver and iterations.

    A file's iterations may be too few: after 4 loads of standing feet are wrong by 80 %.
    Divergence is not reset silently: the state stays not finite.
    """
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    usual = mujoco.MjSpec().option
    for field in ("solver", "iterations", "tolerance", "ls_iterations", "ls_tolerance"):
        setattr(spec.option, field, getattr(usual, field))
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return spec


def name_all(spec: Any) -> None:
    """Give bodies and joints without a name the one that the robot knows them by."""
    unnamed = [item for item in (*spec.bodies, *spec.joints) if not item.name]
    if not unnamed:
        return
    labelled = spec.copy()  # compiled once more, geoms between two points are refused
    for k, item in enumerate(item for item in (*labelled.bodies, *labelled.joints) if not item.name):
        item.name = f"{_LABEL}{k}"
    simulated, twin = spec.copy().compile(), labelled.compile()
    names = (body_names(simulated), joint_names(simulated))
    at = {twin.body(i).name: names[0][i] for i in range(twin.nbody)}
    at |= {twin.joint(i).name: names[1][i] for i in range(twin.njnt)}
    for k, item in enumerate(unnamed):
        item.name = at[f"{_LABEL}{k}"]


def root_of(spec: Any, robot: Any) -> str:
    """The root body of the robot among those of a MjSpec: the root of its first joint."""
    names = set(getattr(robot, "model", robot).names[1:])
    for body in spec.worldbody.bodies:
        if any(j.name in names for j in body.find_all("joint")) or any(j.name in names for j in body.joints):
            free = [j for j in body.joints if j.type == mujoco.mjtJoint.mjJNT_FREE]
            floating = getattr(robot, "floating", False)
            if not free or floating == (free[0].name == getattr(robot, "model", robot).names[1]):
                return str(body.name)
    return str(spec.worldbody.first_body().name)


def set_armature(spec: Any, armature: Mapping[str, float], groups: Mapping[str, Sequence[str]]) -> None:
    """Give joints, or groups of them, a rotor inertia [kg m^2]; raises JointNotFound."""
    joints = {joint.name: joint for joint in spec.joints}
    for name, value in armature.items():
        for member in groups.get(name, (name,)):
            if member not in joints:
                raise JointNotFound(member, [*joints, *groups], "the MuJoCo model")
            joints[member].armature = value


def add_imu(spec: Any, frame: str) -> str:
    """Put a gyro and an accelerometer at a site or a body; the site's name.  Raises FrameNotFound."""
    site = spec.site(frame)
    if site is None:
        body = spec.body(frame)
        if body is None:
            raise FrameNotFound(
                frame, [*(s.name for s in spec.sites), *(b.name for b in spec.bodies)], "the MuJoCo model"
            )
        site = body.add_site(name="plant_imu", group=4)
    for kind in ("gyro", "accelerometer"):
        sensor = spec.add_sensor(name=f"plant_{kind}", type=getattr(mujoco.mjtSensor, f"mjSENS_{kind.upper()}"))
        sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_SITE, site.name
    return str(site.name)

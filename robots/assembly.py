"""From a model file to a MjSpec that a plant can compile: file, solver, armature, IMU."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hqp.errors import FrameNotFound, JointNotFound, ModelError

from .from_tables import FOLDER, OWN
from .mujoco_extra import mujoco
from .tables import Tables


def find(robot: Any, mjcf: str | Path | None) -> tuple[Path, dict[str, Any]]:
    """The model file, and the ``robot.toml`` of our own ones; raises ModelError where there is no such file."""
    stem = str(getattr(robot, "name", "") if mjcf is None else mjcf)
    own: dict[str, str] = {}
    for name in OWN:
        about = Tables.read(FOLDER / name).description
        if stem in about["mjcf"]:
            return FOLDER / name / f"{stem}.xml", about
        own |= about["mjcf"]
    if not Path(stem).is_file():
        raise ModelError(f"no MJCF {stem!r}: neither a file nor one of {', '.join(own)}")
    return Path(stem), {}


def read(path: Path, timestep: float) -> Any:
    """The file as a MjSpec with the plant's solver: implicitfast, elliptic cones; raises ModelError.

    Divergence is not reset silently: the state stays not finite.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise ModelError(f"{path} could not be read: {error}") from error
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return spec


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

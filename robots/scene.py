"""The scene around a robot's MJCF: ground, sky, lights, cameras, and the hand that pulls at it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hqp.arrays import Vec

from .mujoco_extra import mujoco
from .terrain import Terrain

HAND = "human_hand"
VIEWS = {"side": (-90.0, -8.0), "front": (0.0, -8.0), "corner": (-50.0, -18.0), "top": (-90.0, -89.0)}
"""Named cameras, which follow the centre of mass: azimuth of the camera and elevation of its view [deg]."""
PAIRED = 1 << 20
"""Contact bit of the ground for geoms that touch the planes of their file by pairs alone."""
DISTANCE = 2.6  # distance of the cameras from the centre of mass [m]
_SKIN = (0.87, 0.67, 0.53, 1.0)


def dress(spec: Any, root: str, terrain: Terrain | None) -> None:
    """Add everything but the robot to a MjSpec; without a terrain the file's own ground stays alone."""
    for light in list(spec.lights):
        spec.delete(light)
    for camera in list(spec.cameras):
        if camera.name in VIEWS:
            spec.delete(camera)
    _sky_and_light(spec)
    if terrain is not None:
        planes = [geom for geom in spec.worldbody.geoms if geom.type == mujoco.mjtGeom.mjGEOM_PLANE]
        _let_go(spec, {plane.name for plane in planes})
        for geom in list(spec.worldbody.geoms):
            if geom.type == mujoco.mjtGeom.mjGEOM_PLANE:
                spec.delete(geom)
            elif geom.name == "ground":
                geom.name = "ground_"
        _ground(spec, terrain)
    _hand(spec)
    _cameras(spec, root)


def light(model: Any) -> None:
    """Set light and size of pictures in the compiled model; MuJoCo 3.2 gives a MjSpec no access to them."""
    model.vis.headlight.ambient[:] = 0.35
    model.vis.headlight.diffuse[:] = 0.25
    model.vis.headlight.specular[:] = 0.0
    model.vis.quality.shadowsize = 4096
    model.vis.global_.offwidth, model.vis.global_.offheight = 1280, 960  # size of pictures without a screen
    model.stat.extent = 2.5  # the shadow map spans this, not the whole ground


def _sky_and_light(spec: Any) -> None:
    sky = {"builtin": mujoco.mjtBuiltin.mjBUILTIN_GRADIENT, "width": 512, "height": 512}
    kind = mujoco.mjtTexture.mjTEXTURE_SKYBOX
    spec.add_texture(name="plant_sky", type=kind, rgb1=[0.86, 0.90, 0.95], rgb2=[0.98, 0.98, 0.98], **sky)
    # directional: MuJoCo lights planes by their few corners, where spots leave them dark
    for name, direction, strength in (("key", (-0.35, 0.55, -0.75), 0.5), ("fill", (0.5, -0.6, -0.6), 0.25)):
        light = spec.worldbody.add_light(name=name, dir=direction, castshadow=name == "key")
        if hasattr(mujoco, "mjtLightType"):
            light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        else:
            light.directional = True
        light.mode = mujoco.mjtCamLight.mjCAMLIGHT_TRACK
        light.pos = [-4.0 * x for x in direction]
        light.diffuse = [strength] * 3
        light.specular = [0.1] * 3


def _let_go(spec: Any, planes: set[str]) -> None:
    """Delete sensors and contact pairs of these planes; other geoms of pairs touch the ground by its contact bit."""
    for sensor in list(spec.sensors):
        if not (planes - {""}).isdisjoint((sensor.objname, sensor.refname)):
            spec.delete(sensor)
    for pair in list(spec.pairs):
        ends = (pair.geomname1, pair.geomname2)
        if planes.isdisjoint(ends):
            continue
        for geom in spec.geoms:
            if geom.name in ends:
                geom.conaffinity |= PAIRED
        spec.delete(pair)


def _ground(spec: Any, terrain: Terrain) -> None:
    # priority: friction and stiffness are the ground's for every body on it
    law = {
        "contype": 1 | PAIRED,
        "conaffinity": 1,
        "condim": 3,
        "priority": 1,
        "friction": [terrain.friction, 0.005, 0.0001],
        "solref": list(terrain.solref),
        "solimp": [*terrain.impedance, 0.001, 0.5, 2.0],
    }
    world, plane, box = spec.worldbody, mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_BOX
    level = _tiles(spec, "plant_level", (0.80, 0.81, 0.83), (0.72, 0.74, 0.77))
    world.add_geom(name="ground", type=plane, size=[0, 0, 0.05], material=level, **law)
    raised = _tiles(spec, "plant_raised", (0.86, 0.80, 0.70), (0.80, 0.73, 0.62))
    for k, slab in enumerate(terrain.slabs()):
        half = -0.5 * slab.angle  # a turn about -y
        geom = world.add_geom(name=f"slab_{k}", type=box, material=raised, **law)
        geom.pos, geom.size = slab.centre, slab.half
        geom.quat = [math.cos(half), 0.0, math.sin(half), 0.0]
    for k, cap in enumerate(terrain.caps()):
        ball = world.add_geom(name=f"cap_{k}", type=mujoco.mjtGeom.mjGEOM_SPHERE, material=raised, **law)
        ball.pos, ball.size = cap.centre, [cap.radius, 0.0, 0.0]


def _tiles(spec: Any, name: str, one: tuple[float, ...], other: tuple[float, ...]) -> str:
    """A material of tiles of half a metre in two colours; its name."""
    checker = {"builtin": mujoco.mjtBuiltin.mjBUILTIN_CHECKER, "width": 512, "height": 512}
    spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, rgb1=one, rgb2=other, **checker)
    material = spec.add_material(name=name, texrepeat=[1.0, 1.0], texuniform=True, reflectance=0.0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    return name


def _hand(spec: Any) -> None:
    """A hand and forearm reaching from +x, drawn only: it touches nothing, and is hidden until it is moved."""
    hand = spec.worldbody.add_body(name=HAND, mocap=True, pos=[0.0, 0.0, -10.0])
    drawn = {"contype": 0, "conaffinity": 0, "group": 1, "rgba": _SKIN}
    capsule, ellipsoid = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_ELLIPSOID
    hand.add_geom(type=ellipsoid, pos=[0.065, 0.0, 0.0], size=[0.055, 0.042, 0.018], **drawn)
    for y in (-0.03, -0.01, 0.01, 0.03):
        hand.add_geom(type=capsule, fromto=[0.04, y, 0.0, -0.025, 0.9 * y, -0.012], size=[0.009, 0, 0], **drawn)
    hand.add_geom(type=capsule, fromto=[0.07, 0.035, 0.0, 0.015, 0.062, -0.01], size=[0.011, 0, 0], **drawn)
    drawn["rgba"] = (0.25, 0.35, 0.55, 1.0)
    hand.add_geom(type=capsule, fromto=[0.13, 0.0, 0.0, 0.36, 0.0, 0.03], size=[0.032, 0, 0], **drawn)


def _cameras(spec: Any, root: str) -> None:
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    body = data.body(root)
    centre = body.xmat.reshape(3, 3).T @ (body.subtree_com - body.xpos)
    for name, (azimuth, elevation) in VIEWS.items():
        look = _direction(math.radians(azimuth), math.radians(elevation))
        right = np.array([look[1], -look[0], 0.0]) / math.hypot(look[0], look[1])
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, np.column_stack((right, np.cross(right, look), -look)).ravel())
        camera = spec.body(root).add_camera(name=name, pos=centre - DISTANCE * look, quat=quaternion, fovy=47.0)
        camera.mode = mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM


def _direction(azimuth: float, elevation: float) -> Vec:
    """Unit vector along the view of a camera that stands at an azimuth [rad]."""
    level = math.cos(elevation)
    return np.array([-level * math.cos(azimuth), -level * math.sin(azimuth), math.sin(elevation)])

"""A robot in any configuration, with targets, arrows and polygons beside it, as an image."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from hqp.arrays import Mat, Vec
from hqp.robots.shapes import shapes
from hqp.viewer.meshes import GREY, color_of, links, load, quaternion

GREEN, ORANGE, RED, BLUE = (
    (0.1, 0.56, 0.3),
    (0.85, 0.48, 0.0),
    (0.81, 0.16, 0.16),
    (0.09, 0.41, 0.78),
)
INK, SOFT = (29, 37, 48), (92, 103, 117)
FONTS = ("DejaVuSans-Bold.ttf", "DejaVuSans.ttf")
Color = tuple[float, float, float]


class Studio:
    """MuJoCo as a renderer only: hqp's kinematics places every body of the robot.

    size: width and height [px].  look: target of the camera [m]; distance [m], azimuth and elevation [deg].
    """

    def __init__(
        self, robot: Any, size: tuple[int, int], *, look: Vec | None = None, distance: float = 0.0,
        azimuth: float = 150.0, elevation: float = -14.0,
    ) -> None:  # fmt: skip
        self.robot = robot
        spec = mujoco.MjSpec()
        spec.visual.global_.offwidth, spec.visual.global_.offheight = size
        spec.visual.quality.shadowsize = 4096
        _room(spec)
        robot.state(robot.home).kinematics()
        for i, (body, mesh, color) in enumerate(_meshes(robot)):
            _add(spec, i, body, mesh, color)
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)
        self._renderer = mujoco.Renderer(self._model, size[1], size[0])
        points = np.array([np.array(p) for *_, (p, _R) in robot.bodies[1:]])
        low, high = points.min(axis=0), points.max(axis=0)
        self.camera = mujoco.MjvCamera()
        self.camera.lookat = (
            0.5 * (low + high) + [0.0, 0.0, 0.07 * (high - low)[2]]
            if look is None
            else look
        )
        self.camera.distance = distance or 2.0 * max(
            float(np.linalg.norm(high - low)), 0.6
        )
        self.camera.azimuth, self.camera.elevation = azimuth, elevation
        self._marks: list[tuple[Any, ...]] = []

    def ball(
        self, at: Vec, color: Color, radius: float = 0.03, opacity: float = 1.0
    ) -> None:
        """A ball in the next picture."""
        self._marks.append(
            (
                mujoco.mjtGeom.mjGEOM_SPHERE,
                np.full(3, radius),
                at,
                np.eye(3),
                (*color, opacity),
            )
        )

    def box(
        self,
        at: Vec,
        half: Vec,
        color: Color,
        opacity: float = 0.3,
        R: Mat | None = None,
    ) -> None:
        """A box in the next picture."""
        self._marks.append(
            (
                mujoco.mjtGeom.mjGEOM_BOX,
                half,
                at,
                np.eye(3) if R is None else R,
                (*color, opacity),
            )
        )

    def line(self, start: Vec, end: Vec, color: Color, width: float = 0.006) -> None:
        """A rod between two points in the next picture."""
        self._rod(mujoco.mjtGeom.mjGEOM_CAPSULE, start, end, color, width)

    def capsule(
        self, start: Vec, end: Vec, color: Color, radius: float, opacity: float = 1.0
    ) -> None:
        """A capsule that may be seen through."""
        self._marks.append(
            (mujoco.mjtGeom.mjGEOM_CAPSULE, radius, start, end, (*color, opacity))
        )

    def arrow(self, start: Vec, end: Vec, color: Color, width: float = 0.014) -> None:
        """An arrow in the next picture."""
        self._rod(mujoco.mjtGeom.mjGEOM_ARROW, start, end, color, width)

    def axes(self, at: Vec, R: Mat, length: float = 0.14) -> None:
        """Three arrows along the axes of a frame."""
        for i, color in enumerate((RED, GREEN, BLUE)):
            self.arrow(at, at + length * R[:, i], color, 0.008)

    def outline(self, corners: Mat, color: Color, width: float = 0.006) -> None:
        """A closed line through points ``(k, 3)``."""
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            self.line(a, b, color, width)

    def shoot(
        self,
        q: Vec,
        opacity: float = 1.0,
        bodies: frozenset[int] = frozenset(),
        faint: float = 0.04,
    ) -> Image.Image:
        """Picture of a configuration with the marks since the last one; opacity of the robot.

        bodies: the subject, all for none; others have the opacity faint.
        """
        shown = [
            int(self._model.body(i + 1).name.split("_")[0])
            for i in range(self._model.nbody - 1)
        ]
        self._model.geom_rgba[1:, 3] = [
            opacity if not bodies or body in bodies else faint for body in shown
        ]
        state = self.robot.state(q)
        state.kinematics()
        for i, body in enumerate(shown):
            *_, (p, R) = self.robot.bodies[body]
            self._data.mocap_pos[i], self._data.mocap_quat[i] = p, quaternion(R)
        mujoco.mj_forward(self._model, self._data)
        self._renderer.update_scene(self._data, self.camera)
        for kind, size, at, R, color in self._marks:
            self._put(kind, size, at, R, color)
        self._marks.clear()
        return Image.fromarray(self._renderer.render())

    def _rod(self, kind: Any, start: Vec, end: Vec, color: Color, width: float) -> None:
        self._marks.append((kind, width, start, end, (*color, 1.0)))

    def _put(
        self, kind: Any, size: Any, at: Vec, R: Any, color: tuple[float, ...]
    ) -> None:
        scene = self._renderer.scene
        geom = scene.geoms[scene.ngeom]
        rod = not isinstance(size, np.ndarray)
        mujoco.mjv_initGeom(
            geom, kind, np.full(3, 0.01) if rod else size, np.zeros(3) if rod else np.asarray(at, dtype=float),
            (np.eye(3) if rod else np.asarray(R)).ravel(), np.array(color, dtype=np.float32),
        )  # fmt: skip
        if rod:
            mujoco.mjv_connector(
                geom,
                kind,
                size,
                np.asarray(at, dtype=float),
                np.asarray(R, dtype=float),
            )
        scene.ngeom += 1


def caption(image: Image.Image, title: str, text: str, color: Color) -> Image.Image:
    """A title and a line below it on a white band with a coloured edge."""
    draw = ImageDraw.Draw(image, "RGBA")
    scale = image.width / 640
    large, small = font(FONTS[0], 25 * scale), font(FONTS[1], 17 * scale)
    height = int(70 * scale)
    draw.rectangle((0, 0, image.width, height), fill=(255, 255, 255, 225))
    draw.rectangle(
        (0, 0, int(9 * scale), height), fill=tuple(round(255 * c) for c in color)
    )
    draw.text((22 * scale, 7 * scale), title, font=large, fill=INK)
    draw.text(
        (22 * scale, 40 * scale),
        text,
        font=small,
        fill=tuple(round(255 * c) for c in color),
    )
    return image


def font(name: str, size: float) -> Any:
    """A font that matplotlib ships."""
    import matplotlib

    return ImageFont.truetype(
        f"{matplotlib.get_data_path()}/fonts/ttf/{name}", round(size)
    )


def _room(spec: Any) -> None:
    spec.add_texture(name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
                     rgb1=[0.97, 0.98, 0.99], rgb2=[0.86, 0.89, 0.93], width=256, height=256)  # fmt: skip
    spec.add_texture(name="tiles", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
                     rgb1=[0.72, 0.74, 0.77], rgb2=[0.66, 0.685, 0.715], width=256, height=256)  # fmt: skip
    tiles = spec.add_material(name="tiles", texrepeat=[2, 2], texuniform=True)
    tiles.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=[20, 20, 0.1], material="tiles"
    )
    spec.worldbody.add_light(
        pos=[1.5, 1.0, 4.0], dir=[-0.3, -0.2, -1.0], diffuse=[0.4] * 3, castshadow=True
    )
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.62] * 3, [0.3] * 3
    spec.visual.headlight.specular = [0.1] * 3


def _meshes(robot: Any) -> list[tuple[int, Any, tuple[float, ...]]]:
    found = []
    for shape in shapes(robot):
        mesh = load(shape)
        if mesh is not None:
            color = color_of(shape, mesh) or tuple(
                int(c) for c in mesh.visual.to_color().main_color[:3]
            )
            found.append((shape.body, mesh, tuple(c / 255 for c in color)))
    return found or [(body, mesh, GREY) for body, mesh in links(robot)]


def _add(spec: Any, i: int, body: int, mesh: Any, color: tuple[float, ...]) -> None:
    faces = np.asarray(mesh.faces)
    if len(faces) > 190_000:
        faces = faces[:190_000]
    name = f"{body}_{i}"
    shell = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    corners = np.asarray(mesh.vertices, dtype=np.float32).ravel()
    spec.add_mesh(
        name=name,
        uservert=corners,
        userface=faces.astype(np.int32).ravel(),
        inertia=shell,
    )
    holder = spec.worldbody.add_body(name=name, mocap=True)
    holder.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        rgba=[*color, 1.0],
        contype=0,
        conaffinity=0,
    )

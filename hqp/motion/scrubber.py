"""A retargeted motion in a browser: the person beside the robot, and a slider over the frames."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.arrays import Mat
from hqp.errors import HqpError

if TYPE_CHECKING:
    from .retargeted import Retargeted

BESIDE = 1.0
"""The person stands so far to the left of the robot, of its height [m]."""

PERSON, STANDS = (22, 104, 199), (26, 143, 76)


class Scrubber:
    """The page of a motion, which plays until it is closed.  port: of the page, any for 0.  host: of the page."""

    def __init__(self, motion: Retargeted, *, host: str = "127.0.0.1", port: int = 0, speed: float = 1.0) -> None:
        from hqp.web.doors import Doors, address, listening
        from hqp.web.serve import serve

        self._motion, self._robot, self._speed = motion, motion.robot.copy(), speed
        doors = Doors(listening(host))
        try:
            self._server = serve(doors, port)
        except ImportError as error:
            raise HqpError("the page needs viser and trimesh: pip install 'hqp[view]'") from error
        self.url = address(doors.host, self._server.get_port(), doors.token)
        """Where the page is, with its token."""
        self._server.scene.set_up_direction("+z")
        self._frames: dict[int, Any] = {}
        self._draw_robot()
        self._bones = _bones(motion)
        self._aside = np.array([0.0, BESIDE * float(np.ptp(motion.person[0, :, 2])), 0.0])
        gui = self._server.gui
        self._slider = gui.add_slider("Frame", 0, len(motion) - 1, 1, 0)
        self._playing = gui.add_checkbox("Play", True)
        self._text = gui.add_markdown("")
        gui.add_markdown("\n\n".join(str(motion).splitlines()))
        self._open = True
        self._shown = -1
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def show(self, frame: int) -> None:
        """Show a frame."""
        motion, state = self._motion, self._robot.state(self._motion.q[frame])
        state.kinematics()
        for body, handle in self._frames.items():
            *_, (p, R) = self._robot.bodies[body]
            handle.position, handle.wxyz = np.array(p), _wxyz(R)
        scene, joints = self._server.scene, motion.person[frame] + self._aside
        if len(self._bones):
            scene.add_line_segments("/person/bones", joints[self._bones], PERSON, line_width=4.0)
        scene.add_point_cloud("/person/joints", joints.astype(np.float32), PERSON, point_size=0.02)
        down = [n for n, on in zip(motion.contact_names, motion.contacts[frame], strict=True) if on]
        self._text.content = f"{frame / motion.fps:.2f} s, in contact: {', '.join(down) or 'nothing'}"
        self._shown = frame

    def close(self) -> None:
        """Take the page down."""
        self._open = False
        self._thread.join(2.0)
        self._server.stop()

    def _run(self) -> None:
        begin, first = time.monotonic(), 0
        while self._open:
            if self._playing.value:
                now = int((time.monotonic() - begin) * self._speed * self._motion.fps) + first
                self._slider.value = now % len(self._motion)
            else:
                begin, first = time.monotonic(), int(self._slider.value)
            if int(self._slider.value) != self._shown:
                self.show(int(self._slider.value))
            time.sleep(1.0 / 30.0)

    def _draw_robot(self) -> None:
        from hqp.viewer.description import describe_robot
        from hqp.viewer.meshes import color_of, links, load

        scene = self._server.scene
        scene.add_grid("/ground", width=20.0, height=20.0, cell_size=0.25, section_size=1.0)
        drawn = []
        for shape in describe_robot(self._robot).shapes:
            mesh = load(shape)
            if mesh is not None:
                drawn.append((shape.body, mesh, color_of(shape, mesh)))
        if not drawn:
            drawn = [(body, mesh, (120, 132, 150)) for body, mesh in links(self._robot)]
        for i, (body, mesh, color) in enumerate(drawn):
            if body not in self._frames:
                self._frames[body] = scene.add_frame(f"/robot/{body}", show_axes=False)
            if color is None:
                scene.add_mesh_trimesh(f"/robot/{body}/{i}", mesh)
            else:
                vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
                scene.add_mesh_simple(f"/robot/{body}/{i}", vertices, faces, color=color, side="double")


def _bones(motion: Retargeted) -> Mat:
    """Pairs of joints ``(n, 2)``: a joint and its parent."""
    pairs = [(child, parent) for child, parent in enumerate(motion.person_parents) if parent >= 0]
    return np.array(pairs, dtype=int).reshape(-1, 2)


def _wxyz(R: Mat) -> Mat:
    from hqp.viewer.meshes import quaternion

    return quaternion(np.asarray(R))

"""A retargeted motion in a browser: the person beside the robot, and a slider over the frames."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import Mat
from hqp.errors import HqpError
from hqp.viewer.camera import PERIOD, Cameras
from hqp.web.serve import tolerating_races

if TYPE_CHECKING:
    from .retargeted import Retargeted

BESIDE = 1.0
"""Distance of the person to the left of the robot, as a share of the person's height."""

LOOKS = 9
"""Number of a motion's frames that the first camera view contains."""

PERSON = (22, 104, 199)


class Scrubber:
    """The page of a motion, which plays until it is closed.  port: port of the page, any for 0.  host: host of the
    page."""

    def __init__(self, motion: Retargeted, *, host: str = "127.0.0.1", port: int = 0, speed: float = 1.0) -> None:
        from hqp.viewer.description import describe_robot
        from hqp.viewer.drawn_robot import DrawnRobot
        from hqp.web.doors import Doors, address, checked_port, listening
        from hqp.web.serve import serve

        self._motion, self._robot, self._speed = motion, motion.robot.copy(), speed
        port, doors = checked_port(port), Doors(listening(host))
        try:
            self._server = serve(doors, port)
        except ImportError as error:
            raise HqpError("the page needs viser and trimesh: pip install 'hqp[view]'") from error
        self.url = address(doors.host, self._server.get_port(), doors.token)
        """Address of the page, with its token."""
        self._drawn = DrawnRobot(self._server.scene, describe_robot(self._robot), self._robot)
        self._bones = _bones(motion)
        self._aside = np.array([0.0, BESIDE * float(np.ptp(motion.person[0, :, 2])), 0.0])
        self._way = self._outlines()
        self._cameras = Cameras(self._server, self._way, overlay=0.0)
        self._looked = 0.0
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
        self._drawn.update()
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
            with tolerating_races():
                if self._playing.value:
                    now = int((time.monotonic() - begin) * self._speed * self._motion.fps) + first
                    self._slider.value = now % len(self._motion)
                else:
                    begin, first = time.monotonic(), int(self._slider.value)
                if int(self._slider.value) != self._shown:
                    self.show(int(self._slider.value))
                if time.monotonic() >= self._looked:
                    self._looked = time.monotonic() + PERIOD
                    self._cameras.update(self._way, np.empty((0, 3)))
            time.sleep(1.0 / 30.0)

    def _outlines(self) -> Mat:
        """Points of robot and person ``(k, 3)`` [m] at some frames of the motion, the first and the last among them."""
        points = []
        for frame in np.linspace(0, len(self._motion) - 1, LOOKS).astype(int):
            self._robot.state(self._motion.q[frame]).kinematics()
            points += [self._drawn.outline(), self._motion.person[frame] + self._aside]
        return np.vstack(points)


def _bones(motion: Retargeted) -> Mat:
    """Pairs of joints ``(n, 2)``: a joint and its parent."""
    pairs = [(child, parent) for child, parent in enumerate(motion.person_parents) if parent >= 0]
    return np.array(pairs, dtype=int).reshape(-1, 2)

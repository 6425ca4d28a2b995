"""LeRobot's teleoperators as operators: actions of a phone, a leader arm, a gamepad or a keyboard to a Follow."""

from __future__ import annotations

from collections.abc import Mapping
from threading import Event, Thread
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.errors import DeclarationError
from hqp.estimation.rotations import exponential
from hqp.teleoperation.follow import Follow

from .lerobot import RobotKinematics

AXES = ("x", "y", "z")
NOTHING = (ValueError, TypeError, KeyError, AttributeError, OverflowError)


class TeleoperatorReader:
    """Takes the actions of a LeRobot ``Teleoperator`` to a source of references, in a thread of its own.

    Keys of an action for the hand, the first present ones: ``phone.pos`` [m], ``phone.rot``, ``phone.enabled``: a
    phone, whose zero of positions moves with each press; ``ee.x, y, z`` [m] and ``ee.wx, wy, wz`` [rad], a rotation
    vector: a leader arm after their forward kinematics; ``delta_x, y, z``: a gamepad or a keyboard, sums of ``step``
    [m]; ``NAME.pos`` [deg] for each joint of ``kinematics``: a leader arm as it is. Phones, gamepads and keyboards
    report motion alone: they need a Follow with ``clutch=True``.

    rate: rate of ``get_action`` [1/s]; 0 for no thread, where a loop of your own calls ``take``.  action: the last one,
    whole, for the gripper.  taken, refused: how many; fault: why the last one was refused.  The teleoperator is to be
    connected before, and is not disconnected.  Raises DeclarationError for rate and step.
    """

    def __init__(
        self,
        teleoperator: Any,
        follow: Follow,
        *,
        kinematics: RobotKinematics | None = None,
        rate: float = 60.0,
        step: float = 0.005,
    ) -> None:
        if not 0.0 <= rate < np.inf:
            raise DeclarationError("TeleoperatorReader", "rate", value=rate, unit="1/s", allowed="0 or above")
        if not 0.0 < step < np.inf:
            raise DeclarationError("TeleoperatorReader", "step", value=step, unit="m", allowed="above 0")
        self.teleoperator, self.follow, self.kinematics, self.step = teleoperator, follow, kinematics, step
        self.action: dict[str, Any] = {}
        self.taken, self.refused, self.fault = 0, 0, ""
        self._zero, self._place, self._engaged = np.zeros(3), np.zeros(3), False
        self._end = Event()
        self._thread = Thread(target=self._run, args=(rate,), name="hqp lerobot", daemon=True)
        if rate > 0.0:
            self._thread.start()

    def read(self, *, received: float | None = None) -> None:
        """Get an action from the teleoperator and take it; its exceptions become faults, never errors."""
        try:
            action = self.teleoperator.get_action()
        except Exception as error:  # an error of the driver, of any kind: the hand holds
            self._refuse(error)
            return
        self.take(action, received=received)

    def take(self, action: Mapping[str, Any], *, received: float | None = None) -> None:
        """Take an action; never raises for its content.

        received [s]: on the clock of the Follow's ``reference``, that of ``time.monotonic`` for None.
        """
        try:
            pose, engaged = self._pose(action)
            kind = self.follow.takes
            value = pose if kind == "pose" else pose[:3, :3] if kind == "rotation" else pose[:3, 3]
        except NOTHING as error:
            self._refuse(error)
            return
        self.action = dict(action)
        self.follow.receive(value, engaged=engaged, received=received)
        self.taken += 1

    def close(self) -> None:
        """Read no more."""
        self._end.set()
        if self._thread.is_alive():
            self._thread.join(timeout=1.0)

    def __enter__(self) -> TeleoperatorReader:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _run(self, rate: float) -> None:
        while not self._end.wait(1.0 / rate):
            self.read()

    def _refuse(self, error: Exception) -> None:
        self.refused, self.fault = self.refused + 1, f"{type(error).__name__}: {error}"[:200]

    def _pose(self, action: Mapping[str, Any]) -> tuple[Mat, bool]:
        """The hand's pose ``(4, 4)``, and whether the operator holds the clutch."""
        if "phone.pos" in action:
            engaged = bool(action["phone.enabled"])
            return _pose(
                self._continued(_vector(action["phone.pos"]), engaged), action["phone.rot"].as_matrix()
            ), engaged
        if "ee.x" in action:
            turn = exponential(_vector([action[f"ee.w{axis}"] for axis in AXES]))
            return _pose(_vector([action[f"ee.{axis}"] for axis in AXES]), turn), True
        if "delta_x" in action:
            self._place = self._place + self.step * _vector([action[f"delta_{axis}"] for axis in AXES])
            return _pose(self._place, np.eye(3)), True
        if self.kinematics is None:
            raise ValueError(f"no hand in an action with {', '.join(map(str, action)) or 'no keys'}")
        angles = [float(action[f"{name}.pos"]) for name in self.kinematics.joint_names]
        return self.kinematics.forward_kinematics(angles), True

    def _continued(self, place: Vec, engaged: bool) -> Vec:
        """A phone's position where its zero had not moved: it does where the button goes down."""
        if engaged and not self._engaged:
            self._zero = self._place - place
        self._engaged, self._place = engaged, place + self._zero
        return self._place


def _vector(values: Any) -> Vec:
    found = np.asarray(values, dtype=np.float64)
    if found.shape != (3,):
        raise ValueError(f"three numbers are needed, not {found.shape}")
    if not np.isfinite(found).all():
        raise ValueError("not finite")
    return found


def _pose(place: Vec, turn: Any) -> Mat:
    pose = np.eye(4)
    pose[:3, 3], pose[:3, :3] = place, turn
    return pose
